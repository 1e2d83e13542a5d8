//! The fast Fourier transform of a library: the only file that names it.

use num_complex::Complex64;
use realfft::{RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

/// Transforms of real series at their own frequencies.
pub(crate) struct RealFft {
    plan: Arc<dyn RealToComplex<f64>>,
    series: Vec<f64>,
    bins: Vec<Complex64>,
    scratch: Vec<Complex64>,
}

impl RealFft {
    pub(crate) fn new(samples: usize) -> Self {
        let plan = RealFftPlanner::new().plan_fft_forward(samples);
        let (series, bins, scratch) = (plan.make_input_vec(), plan.make_output_vec(), plan.make_scratch_vec());
        Self { plan, series, bins, scratch }
    }

    /// Some bins of a series.
    pub(crate) fn transform(&mut self, series: impl Iterator<Item = f64>, bins: Range<usize>, out: &mut [Complex64]) {
        self.series.iter_mut().zip(series).for_each(|(to, from)| *to = from);
        // all lengths are the plan's own
        let done = self.plan.process_with_scratch(&mut self.series, &mut self.bins, &mut self.scratch);
        debug_assert!(done.is_ok());
        out.copy_from_slice(&self.bins[bins]);
    }
}

impl fmt::Debug for RealFft {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "RealFft({})", self.series.len())
    }
}

/// Transforms of complex series there and back, not scaled.
pub(super) struct ComplexFft {
    forth: Arc<dyn Fft<f64>>,
    back: Arc<dyn Fft<f64>>,
    scratch: Vec<Complex64>,
}

impl ComplexFft {
    pub(super) fn new(length: usize) -> Self {
        let mut planner = FftPlanner::new();
        let (forth, back) = (planner.plan_fft_forward(length), planner.plan_fft_inverse(length));
        let scratch = forth.get_inplace_scratch_len().max(back.get_inplace_scratch_len());
        Self { forth, back, scratch: vec![Complex64::ZERO; scratch] }
    }

    pub(super) fn forward(&mut self, series: &mut [Complex64]) {
        self.forth.process_with_scratch(series, &mut self.scratch);
    }

    pub(super) fn backward(&mut self, series: &mut [Complex64]) {
        self.back.process_with_scratch(series, &mut self.scratch);
    }
}

impl fmt::Debug for ComplexFft {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ComplexFft({})", self.forth.len())
    }
}
