//! The noise of one output as a smooth logarithm of its spectrum with as few hat functions as its likelihood is content with.
//!
//! A disturbance is weighed against noise of any smooth spectrum; each hat function has a penalty, so that both pay for what they
//! are free to do. log S is a sum of hats over log f; what is left of n bins beside a leverage h has the mean S (n - h): gamma
//! variates (Whittle), solved by reweighted least squares.

use super::residual_power::ResidualPower;
use nalgebra::{DMatrix, DVector};

/// Numbers of hat functions that are tried.
const SIZES: [usize; 6] = [1, 2, 3, 5, 8, 12];
/// What a hat function costs in log-likelihood.
pub(crate) const PENALTY: f64 = 1.5;
const PASSES: usize = 60;
/// Change of the log-spectrum below which the iteration ends.
const CONVERGED: f64 = 1e-9;

/// A smooth spectrum.
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothSpectrum {
    /// Logarithms of frequencies, evenly spaced; one for white noise.
    knots: Vec<f64>,
    /// log S at the knots.
    values: Vec<f64>,
}

impl SmoothSpectrum {
    /// The spectrum of the least penalty and loss.
    pub(crate) fn fit(left: &[ResidualPower]) -> Self {
        let tried = SIZES.iter().filter_map(|size| Self::of_size(left, *size));
        let penalised = tried.map(|s| (s.twice_loss(left) + 2.0 * PENALTY * s.size() as f64, s));
        let best = penalised.min_by(|a, b| a.0.total_cmp(&b.0));
        best.map_or_else(|| Self::level(left), |(_, spectrum)| spectrum)
    }

    /// White noise of a given density.
    pub(crate) fn white(density: f64) -> Self {
        Self { knots: vec![0.0], values: vec![density.max(f64::MIN_POSITIVE).ln()] }
    }

    /// White noise as strong as what is left.
    pub(crate) fn level(left: &[ResidualPower]) -> Self {
        let freedom: f64 = left.iter().map(|l| l.freedom).sum();
        Self::white(left.iter().map(|l| l.freedom * l.power).sum::<f64>() / freedom.max(f64::MIN_POSITIVE))
    }

    /// The spectrum with so many hat functions; none where the bins do not determine it.
    fn of_size(left: &[ResidualPower], size: usize) -> Option<Self> {
        let logs = || left.iter().map(|l| l.log_frequency);
        let (low, high) = (logs().fold(f64::INFINITY, f64::min), logs().fold(f64::NEG_INFINITY, f64::max));
        let step = if size > 1 { (high - low) / (size - 1) as f64 } else { 0.0 };
        let freedom: f64 = left.iter().map(|l| l.freedom).sum();
        let mean = left.iter().map(|l| l.freedom * l.power).sum::<f64>() / freedom;
        let told = left.len() >= 2 * size && freedom >= 8.0 * size as f64 && (size == 1 || step > 0.0);
        if !told || mean <= 0.0 || !mean.is_finite() {
            return None;
        }
        let knots: Vec<f64> = (0..size).map(|k| low + k as f64 * step).collect();
        let hats = DMatrix::from_fn(left.len(), size, |i, k| tent(&knots, left[i].log_frequency, k));
        let mut values = DVector::from_element(size, mean.ln());
        for _ in 0..PASSES {
            let logs = &hats * &values;
            let weighed = DMatrix::from_fn(left.len(), size, |i, k| left[i].freedom * hats[(i, k)]);
            let excess = DVector::from_fn(left.len(), |i, _| left[i].power * (-logs[i]).exp() - 1.0);
            let mut change = weighed.tr_mul(&hats).cholesky()?.solve(&weighed.tr_mul(&excess));
            // a knot that starts far too high overshoots: at most one step in the logarithm at once
            let largest = change.amax();
            if largest > 1.0 {
                change /= largest;
            }
            values += &change;
            if largest < CONVERGED {
                break;
            }
        }
        Some(Self { knots, values: values.as_slice().to_vec() })
    }

    /// S at a frequency given by its logarithm.
    pub fn at(&self, log_frequency: f64) -> f64 {
        let hats = self.values.iter().enumerate().map(|(k, v)| v * tent(&self.knots, log_frequency, k));
        hats.sum::<f64>().exp()
    }

    /// Number of hat functions; 1 is white.
    pub fn size(&self) -> usize {
        self.knots.len()
    }

    /// Minus twice the logarithm of the likelihood of what is left.
    pub(crate) fn twice_loss(&self, left: &[ResidualPower]) -> f64 {
        let loss = |l: &ResidualPower| {
            let density = self.at(l.log_frequency);
            l.freedom * (density.ln() + l.power / density)
        };
        left.iter().map(loss).sum()
    }
}

/// The k-th hat function, constant beyond the outer knots.
fn tent(knots: &[f64], log_frequency: f64, k: usize) -> f64 {
    let last = knots.len() - 1;
    if last == 0 {
        return 1.0;
    }
    let place = ((log_frequency - knots[0]) / (knots[1] - knots[0])).clamp(0.0, last as f64);
    (1.0 - (place - k as f64).abs()).max(0.0)
}
