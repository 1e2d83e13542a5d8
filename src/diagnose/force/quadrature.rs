//! Signals with their quadratures: what a gain and a phase make of a signal, in cosine lines.

use super::sheet::{Cosines, DROPPED};
use nalgebra::DMatrix;
use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlanner};
use std::sync::Arc;

/// Hilbert's transform of one length.
pub(super) struct Quadrature {
    forward: Arc<dyn Fft<f64>>,
    back: Arc<dyn Fft<f64>>,
    samples: usize,
}

impl Quadrature {
    pub(super) fn new(samples: usize) -> Self {
        // twice as long, so that the ends do not meet
        let (mut planner, long) = (FftPlanner::new(), 2 * samples);
        Self { forward: planner.plan_fft_forward(long), back: planner.plan_fft_inverse(long), samples }
    }

    /// The signal a quarter of a period late, at every frequency.
    fn of(&self, signal: &[f64]) -> Vec<f64> {
        let long = 2 * self.samples;
        // continued by its mirror image, so that it does not jump
        let mirrored = signal.iter().chain(signal.iter().rev());
        let mut lines: Vec<Complex<f64>> = mirrored.map(|v| Complex::new(*v, 0.0)).collect();
        self.forward.process(&mut lines);
        for (k, line) in lines.iter_mut().enumerate() {
            *line = match k {
                0 => Complex::default(),
                k if k < self.samples => *line * Complex::new(0.0, -1.0),
                k if k > self.samples => *line * Complex::new(0.0, 1.0),
                _ => Complex::default(),
            };
        }
        self.back.process(&mut lines);
        lines[..self.samples].iter().map(|c| c.re / long as f64).collect()
    }

    /// Lines of a signal (without its mean) and of its quadrature (L by 2).
    pub(super) fn lines(&self, cosines: &mut Cosines, signal: &[f64]) -> DMatrix<f64> {
        let mean = signal.iter().sum::<f64>() / signal.len().max(1) as f64;
        let centred: Vec<f64> = signal.iter().map(|v| v - mean).collect();
        let late = self.of(&centred);
        let mut lines = DMatrix::zeros(self.samples - DROPPED, 2);
        cosines.lines(centred.into_iter(), lines.column_mut(0).as_mut_slice());
        cosines.lines(late.into_iter(), lines.column_mut(1).as_mut_slice());
        lines
    }
}

/// A signal a quarter of a period late, at every frequency.
pub(in crate::diagnose) fn late(signal: &[f64]) -> Vec<f64> {
    Quadrature::new(signal.len()).of(signal)
}
