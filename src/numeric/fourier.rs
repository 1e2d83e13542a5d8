//! Fast Fourier and cosine transforms: the only file that names the libraries that compute them.
//!
//! Plans are kept for the whole process, since finding one costs more than using it. Each is found by a planner of its own: one that has
//! planned before builds on what it has, so that bits would depend on who asked first.

use num_complex::Complex64;
use realfft::{RealFftPlanner, RealToComplex};
use rustdct::{DctPlanner, TransformType2And3};
use rustfft::{Fft, FftPlanner};
use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

/// Plans by length.
type Plans<T> = LazyLock<Mutex<BTreeMap<usize, T>>>;

/// What is planned for series of a length.
fn planned<T: Clone>(kept: &Plans<T>, length: usize, plan: impl FnOnce() -> T) -> T {
    // plans above this length are not kept: their tables are as large as the series
    if length > (1 << 16) {
        return plan();
    }
    kept.lock().unwrap_or_else(PoisonError::into_inner).entry(length).or_insert_with(plan).clone()
}

/// Transforms of real series of one length at their own frequencies.
pub struct RealFft {
    plan: Arc<dyn RealToComplex<f64>>,
    series: Vec<f64>,
    bins: Vec<Complex64>,
    scratch: Vec<Complex64>,
}

impl RealFft {
    /// For series of so many samples.
    pub fn new(samples: usize) -> Self {
        static KEPT: Plans<Arc<dyn RealToComplex<f64>>> = LazyLock::new(Mutex::default);
        let plan = planned(&KEPT, samples, || RealFftPlanner::new().plan_fft_forward(samples));
        let (series, bins, scratch) = (plan.make_input_vec(), plan.make_output_vec(), plan.make_scratch_vec());
        Self { plan, series, bins, scratch }
    }

    /// Some of the bins `X_k = sum_i x_i exp(-2 pi j i k/N)`, k from 0 to N/2, of a series.
    pub fn transform(&mut self, series: impl Iterator<Item = f64>, bins: Range<usize>, out: &mut [Complex64]) {
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

/// Transforms of complex series of one length, there and back, neither scaled.
pub struct ComplexFft {
    forward: Arc<dyn Fft<f64>>,
    backward: Arc<dyn Fft<f64>>,
    scratch: Vec<Complex64>,
}

impl ComplexFft {
    /// For series of this length.
    pub fn new(length: usize) -> Self {
        static KEPT: Plans<[Arc<dyn Fft<f64>>; 2]> = LazyLock::new(Mutex::default);
        let plans = || [FftPlanner::new().plan_fft_forward(length), FftPlanner::new().plan_fft_inverse(length)];
        let [forward, backward] = planned(&KEPT, length, plans);
        let scratch = forward.get_inplace_scratch_len().max(backward.get_inplace_scratch_len());
        Self { forward, backward, scratch: vec![Complex64::ZERO; scratch] }
    }

    /// `X_k = sum_i x_i exp(-2 pi j i k/N)`, in place.
    pub fn forward(&mut self, series: &mut [Complex64]) {
        self.forward.process_with_scratch(series, &mut self.scratch);
    }

    /// `x_i = sum_k X_k exp(2 pi j i k/N)`, in place: N times the inverse of [`Self::forward`].
    pub fn backward(&mut self, series: &mut [Complex64]) {
        self.backward.process_with_scratch(series, &mut self.scratch);
    }
}

impl fmt::Debug for ComplexFft {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ComplexFft({})", self.forward.len())
    }
}

/// Cosine transforms of one length, there and back, neither scaled.
#[derive(Clone)]
pub struct CosineTransform {
    plan: Arc<dyn TransformType2And3<f64>>,
    scratch: Vec<f64>,
}

impl CosineTransform {
    /// For series of this length.
    pub fn new(length: usize) -> Self {
        static KEPT: Plans<Arc<dyn TransformType2And3<f64>>> = LazyLock::new(Mutex::default);
        let plan = planned(&KEPT, length, || DctPlanner::new().plan_dct2(length));
        let scratch = vec![0.0; plan.get_scratch_len()];
        Self { plan, scratch }
    }

    /// DCT-II, `X_k = sum_i x_i cos(pi k (i + 1/2)/N)`, in place.
    pub fn forward(&mut self, series: &mut [f64]) {
        self.plan.process_dct2_with_scratch(series, &mut self.scratch);
    }

    /// DCT-III, `x_i = X_0/2 + sum_(k>0) X_k cos(pi k (i + 1/2)/N)`, in place: N/2 times the inverse of [`Self::forward`].
    pub fn backward(&mut self, series: &mut [f64]) {
        self.plan.process_dct3_with_scratch(series, &mut self.scratch);
    }
}

impl fmt::Debug for CosineTransform {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "CosineTransform({})", self.plan.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    #[test]
    fn bits_do_not_depend_on_what_was_planned_before() {
        for n in 380_usize..=660 {
            let series: Vec<f64> = (0..n).map(|i| (i as f64 * 0.7).sin() + 0.2).collect();
            let mut alone: Vec<Complex64> = series.iter().map(|v| Complex64::new(*v, 0.0)).collect();
            let mut kept = alone.clone();
            FftPlanner::new().plan_fft_forward(n).process(&mut alone);
            ComplexFft::new(n).forward(&mut kept);
            assert!(alone == kept, "{n}");
            let (mut alone, mut kept) = (series.clone(), series);
            DctPlanner::new().plan_dct2(n).process_dct2(&mut alone);
            CosineTransform::new(n).forward(&mut kept);
            assert!(alone == kept, "{n}");
        }
    }

    #[test]
    fn transforms_are_the_sums_of_their_definitions() {
        for n in [1, 2, 7, 8, 12, 31] {
            let series: Vec<f64> = (0..n).map(|i| (i as f64 * 0.7).sin() + 0.2).collect();
            let turned = |k: usize, i: usize| Complex64::cis(-TAU * (i * k) as f64 / n as f64);
            let bin = |k: usize| (0..n).map(|i| turned(k, i) * series[i]).sum::<Complex64>();
            let mut bins = vec![Complex64::ZERO; n / 2 + 1];
            RealFft::new(n).transform(series.iter().copied(), 0..n / 2 + 1, &mut bins);
            assert!(bins.iter().enumerate().all(|(k, x)| (x - bin(k)).norm() < 1e-12), "{n}");

            let mut complex: Vec<Complex64> = series.iter().map(|v| Complex64::new(*v, 0.0)).collect();
            let mut fft = ComplexFft::new(n);
            fft.forward(&mut complex);
            assert!(complex.iter().enumerate().all(|(k, x)| (x - bin(k)).norm() < 1e-12), "{n}");
            fft.backward(&mut complex);
            assert!(complex.iter().zip(&series).all(|(x, v)| (x / n as f64 - v).norm() < 1e-13), "{n}");

            let mut cosines = series.clone();
            let mut transform = CosineTransform::new(n);
            transform.forward(&mut cosines);
            for (k, x) in cosines.iter().enumerate() {
                let angle = |i: usize| PI * k as f64 * (i as f64 + 0.5) / n as f64;
                let sum: f64 = (0..n).map(|i| series[i] * angle(i).cos()).sum();
                assert!((x - sum).abs() < 1e-12, "{n} {k}: {x} {sum}");
            }
            transform.backward(&mut cosines);
            let scale = 2.0 / n as f64;
            assert!(cosines.iter().zip(&series).all(|(x, v)| (x * scale - v).abs() < 1e-13), "{n}");
        }
    }
}
