//! Outputs that the model does not explain, or explains with the wrong sign: what nobody should have to find in a table.

use crate::estimation::estimate::Estimate;
use serde::{Deserialize, Serialize};

/// R^2 over all runs below which an output counts as not explained.
const LITTLE: f64 = 0.2;
/// Correlation of record and response below which one is the mirror image of the other: the sign alone then explains a quarter and more.
const AGAINST: f64 = -0.5;
/// Correlation above which record and response are one motion, four fifths of whose variance a line explains.
const ALIKE: f64 = 0.9;
/// A correlation of n independent pairs scatters by `1/sqrt(n)`; so many deviations are exceeded by chance once in a thousand.
const NO_CHANCE: f64 = 3.09;

/// An output that the model does not explain.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Unexplained {
    /// Its name.
    pub output: String,
    /// Share of the variance that the model explains, over all runs; none where no run's record of it varies.
    pub r2: Option<f64>,
    /// Correlation of record and response, each about its mean in each run; none where one of them does not vary.
    pub correlation: Option<f64>,
    /// `record = factor*response + offset` by least squares, where the correlation is above 0.9 and that explains most of it.
    pub line: Option<(f64, f64)>,
}

impl Unexplained {
    /// Whether the record is the mirror image of the response.
    pub fn is_mirrored(&self) -> bool {
        self.correlation.is_some_and(|r| r < AGAINST)
    }

    /// Outputs of a fit in the time domain whose residuals are no noise, and of which the model explains less than a fifth or the mirror image.
    pub fn of(estimate: &Estimate) -> Vec<Self> {
        let Some(first) = estimate.runs.first() else { return Vec::new() };
        let names: Vec<&str> =
            estimate.outputs.iter().filter(|o| o.run == first.run).map(|o| o.name.as_str()).collect();
        let told = names.iter().enumerate().filter_map(|(o, name)| {
            let sums = Sums::of(estimate, o, names.len());
            let (r2, correlation) = (sums.r2(), sums.correlation());
            let line = correlation.filter(|r| *r > ALIKE).map(|_| sums.line());
            let found = Self { output: name.to_string(), r2, correlation, line };
            let little = found.r2.is_none_or(|r2| r2 < LITTLE);
            let sure = |correlation: f64| correlation * sums.count.sqrt() > NO_CHANCE;
            let mirrored = found.is_mirrored() && found.correlation.is_some_and(|r| sure(-r));
            (little && (mirrored || sure(sums.smoothness()))).then_some(found)
        });
        told.collect()
    }

    /// Outputs of a fit in the time domain whose record and response are not one motion (a correlation of 0.9), while their residuals are one: what is left is no noise.
    pub fn unlike(estimate: &Estimate) -> Vec<String> {
        let Some(first) = estimate.runs.first() else { return Vec::new() };
        let names: Vec<&str> =
            estimate.outputs.iter().filter(|o| o.run == first.run).map(|o| o.name.as_str()).collect();
        let is_unlike = |o: usize| {
            let sums = Sums::of(estimate, o, names.len());
            let residual = sums.smoothness();
            sums.correlation().is_some_and(|r| r < ALIKE)
                && residual > ALIKE
                && residual * sums.count.sqrt() > NO_CHANCE
        };
        names.iter().enumerate().filter(|(o, _)| is_unlike(*o)).map(|(_, name)| (*name).to_string()).collect()
    }
}

/// Sums over the compared samples of an output, of all runs.
#[derive(Default)]
struct Sums {
    count: f64,
    /// Squares of the residuals, and products of neighbouring ones.
    left: f64,
    neighbours: f64,
    /// Squares of record and response about their means in each run, and their products.
    record: f64,
    response: f64,
    product: f64,
    /// Squares of record and response, and the sums of both.
    size: f64,
    totals: [f64; 2],
}

impl Sums {
    fn of(estimate: &Estimate, o: usize, q: usize) -> Self {
        let mut sums = Self::default();
        for run in &estimate.runs {
            let cells = run.residuals.iter().zip(&run.response).skip(o).step_by(q);
            let cells: Vec<(f64, f64)> =
                cells.filter(|(e, y)| e.is_finite() && y.is_finite()).map(|(e, y)| (*e, *y)).collect();
            let n = cells.len() as f64;
            let mean = |of: &dyn Fn(&(f64, f64)) -> f64| cells.iter().map(of).sum::<f64>() / n.max(1.0);
            let (z_mean, y_mean) = (mean(&|(e, y)| e + y), mean(&|(_, y)| *y));
            sums.count += n;
            sums.neighbours += cells.windows(2).map(|w| w[0].0 * w[1].0).sum::<f64>();
            for (e, y) in &cells {
                let (dz, dy) = (e + y - z_mean, y - y_mean);
                sums.left += e * e;
                sums.record += dz * dz;
                sums.response += dy * dy;
                sums.product += dz * dy;
                sums.size += (e + y).powi(2) + y * y;
                sums.totals[0] += e + y;
                sums.totals[1] += y;
            }
        }
        sums
    }

    /// The record over the response, and what is then left of their means.
    fn line(&self) -> (f64, f64) {
        let factor = self.product / self.response;
        (factor, (self.totals[0] - factor * self.totals[1]) / self.count)
    }

    /// A variance that is the rounding of a constant, in either of the two that it is made from, is none.
    fn varies(&self) -> bool {
        self.record > (8.0 * f64::EPSILON).powi(2) * self.count * self.size
    }

    fn r2(&self) -> Option<f64> {
        (self.count > 0.0 && self.varies()).then(|| 1.0 - self.left / self.record)
    }

    fn correlation(&self) -> Option<f64> {
        let size = (self.record * self.response).sqrt();
        (self.varies() && size > 0.0).then(|| self.product / size)
    }

    /// Correlation of neighbouring residuals about zero; that of residuals that are rounding is none.
    fn smoothness(&self) -> f64 {
        let rounding = 1e-20 * self.size;
        if self.left > rounding { self.neighbours / self.left } else { 0.0 }
    }
}
