//! The noise of one output as a smooth logarithm of its spectrum, from cells of which a part has been fitted away.
//!
//! log S(f) is a sum of hat functions over log f. What a projection of leverage h leaves of n lines has the mean
//! S (n - h): the likelihood is that of gamma variates (Whittle), each weighed by what is left of it, and is solved by
//! reweighted least squares (McCullagh & Nelder 1989, gamma with logarithmic link).

use nalgebra::{DMatrix, DVector};

/// Numbers of hat functions that are tried; the least criterion chooses.
const SIZES: [usize; 6] = [1, 2, 3, 5, 8, 12];
/// What a hat function must gain in twice the log-likelihood.
const PRICE: f64 = 3.0;
const ROUNDS: usize = 60;
/// Change of the log-spectrum below which the iteration ends.
const SETTLED: f64 = 1e-9;

/// What is left of the lines of a cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Left {
    /// log f
    pub(super) log_frequency: f64,
    /// Mean square of what is left: its sum over `freedom`.
    pub(super) power: f64,
    /// Lines less leverage, n - h.
    pub(super) freedom: f64,
}

/// The spectrum of one output's noise.
#[derive(Debug, Clone, PartialEq)]
pub struct LogSpectrum {
    /// Logarithms of frequencies, evenly spaced; one for white noise.
    knots: Vec<f64>,
    /// log S at the knots.
    values: DVector<f64>,
    /// Factor L of the covariance L L' of `values`.
    spread: DMatrix<f64>,
}

impl LogSpectrum {
    /// Fits what is left of one output.
    pub(super) fn fit(left: &[Left]) -> Self {
        let tried = SIZES.iter().filter_map(|size| Self::of_size(left, *size));
        let best = tried.min_by(|a, b| a.0.total_cmp(&b.0));
        best.map_or_else(Self::nothing, |(_, spectrum)| spectrum)
    }

    /// An output without noise.
    fn nothing() -> Self {
        let least = DVector::from_element(1, f64::MIN_POSITIVE.ln());
        Self { knots: vec![0.0], values: least, spread: DMatrix::zeros(1, 1) }
    }

    /// The spectrum with so many hat functions and its criterion; none where the lines do not determine it.
    fn of_size(left: &[Left], size: usize) -> Option<(f64, Self)> {
        let logs = || left.iter().map(|l| l.log_frequency);
        let (low, high) = (logs().fold(f64::INFINITY, f64::min), logs().fold(f64::NEG_INFINITY, f64::max));
        let step = if size > 1 { (high - low) / (size - 1) as f64 } else { 0.0 };
        let freedom: f64 = left.iter().map(|l| l.freedom).sum();
        if left.len() < 2 * size || freedom < 8.0 * size as f64 || size > 1 && step <= 0.0 {
            return None;
        }
        let knots: Vec<f64> = (0..size).map(|k| low + k as f64 * step).collect();
        let hats: Vec<_> = left.iter().map(|l| Hat::at(&knots, l.log_frequency)).collect();
        let mean = left.iter().map(|l| l.freedom * l.power).sum::<f64>() / freedom;
        if mean <= 0.0 || !mean.is_finite() {
            return None;
        }
        let mut values = DVector::from_element(size, mean.ln());
        let mut information = DMatrix::zeros(size, size);
        for _ in 0..ROUNDS {
            information.fill(0.0);
            let mut gradient = DVector::zeros(size);
            for (line, hat) in left.iter().zip(&hats) {
                let excess = line.power * (-hat.of(&values)).exp() - 1.0;
                hat.add(line.freedom, line.freedom * excess, &mut information, &mut gradient);
            }
            let mut change = information.clone().cholesky()?.solve(&gradient);
            // a knot that starts far too high overshoots: at most one step in the logarithm at once
            let largest = change.amax();
            if largest > 1.0 {
                change /= largest;
            }
            values += &change;
            if largest < SETTLED {
                break;
            }
        }
        let loss = |(line, hat): (&Left, &Hat)| {
            let log = hat.of(&values);
            line.freedom * (log + line.power * (-log).exp())
        };
        let twice: f64 = left.iter().zip(&hats).map(loss).sum();
        let covariance = information.cholesky()?.inverse() * 2.0;
        let spread = covariance.cholesky()?.unpack();
        Some((twice + PRICE * size as f64, Self { knots, values, spread }))
    }

    /// S at a frequency given by its logarithm.
    pub fn at(&self, log_frequency: f64) -> f64 {
        Hat::at(&self.knots, log_frequency).of(&self.values).exp()
    }

    /// Number of hat functions; 1 is white.
    pub fn size(&self) -> usize {
        self.knots.len()
    }

    /// A spectrum as likely as this one: its values moved by as much as they are uncertain, by standard normal numbers.
    pub(super) fn drawn(&self, mut normal: impl FnMut() -> f64) -> Self {
        let numbers = DVector::from_fn(self.size(), |_, _| normal());
        Self { values: &self.values + &self.spread * numbers, ..self.clone() }
    }
}

/// The two hat functions that are not zero at a frequency.
#[derive(Debug, Clone, Copy)]
struct Hat {
    below: usize,
    /// Weight of the knot above; 0 where there is none.
    above: f64,
}

impl Hat {
    fn at(knots: &[f64], log_frequency: f64) -> Self {
        let last = knots.len() - 1;
        if last == 0 {
            return Self { below: 0, above: 0.0 };
        }
        let place = ((log_frequency - knots[0]) / (knots[1] - knots[0])).clamp(0.0, last as f64);
        let below = (place as usize).min(last - 1);
        Self { below, above: place - below as f64 }
    }

    fn parts(self) -> impl Iterator<Item = (usize, f64)> {
        let parts = [(self.below, 1.0 - self.above), (self.below + 1, self.above)];
        parts.into_iter().filter(|(_, part)| *part > 0.0)
    }

    fn of(self, values: &DVector<f64>) -> f64 {
        self.parts().map(|(k, part)| part * values[k]).sum()
    }

    fn add(self, weight: f64, score: f64, information: &mut DMatrix<f64>, gradient: &mut DVector<f64>) {
        for (k, part) in self.parts() {
            gradient[k] += part * score;
            for (l, other) in self.parts() {
                information[(k, l)] += weight * part * other;
            }
        }
    }
}
