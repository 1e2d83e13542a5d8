//! The transform of one run.

use num_complex::Complex64;

/// Fourier coefficients of one run, `x(w) = (1/N) sum_k x_k exp(-j w k dt)` (Marchand and Fu 1985), zero frequency left out.
///
/// The transform of a derivative is `x'(w) = j w x(w) + [x(T - dt/2) exp(-j w (T - dt/2)) - x(-dt/2) exp(j w dt/2)]/T`, T = N dt,
/// with end values by interpolation with one more sample on each side of what is transformed.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// Name of the run.
    pub name: String,
    /// Angular frequencies (M), rising, above 0, in radians per unit of time.
    pub omega: Vec<f64>,
    /// Sampling interval.
    pub dt: f64,
    /// Number of samples N that were transformed.
    pub samples: usize,
    /// Inputs, m by M.
    pub inputs: Vec<Complex64>,
    /// Measured outputs, q by M.
    pub outputs: Vec<Complex64>,
    /// Values of the inputs half an interval before the first transformed sample, and half an interval behind the last (m each).
    pub input_ends: [Vec<f64>; 2],
    /// The same of the outputs (q each).
    pub output_ends: [Vec<f64>; 2],
}

impl Spectrum {
    /// Length of what was transformed, T = N dt.
    pub fn duration(&self) -> f64 {
        self.samples as f64 * self.dt
    }
}
