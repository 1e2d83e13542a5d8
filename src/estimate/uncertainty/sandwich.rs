//! Covariance of the estimates where the noise is not what the likelihood takes it for: `D M D`, D the Cramer-Rao covariance, `M = S' R^-1 Rvv R^-1 S`
//! with the autocovariance Rvv that the noise really has (Maine and Iliff, NASA RP-1168, 1986; Morelli and Klein 1997).
//!
//! Standard errors where the noise of every number is known from another source than the residuals, correlations among them.

use super::cramer_rao::CramerRao;
use super::spectral_colour::SpectralColour;
use crate::iteration::priors::{PriorRow, Priors};
use crate::problem::noise::Weights;
use crate::problem::response::{KnownNoise, RunResponse};
use crate::problem::unknowns::Unknowns;
use crate::problem::{Problem, ProblemRun};
use crate::residuals::autoregression::AutoRegression;
use fdm_numeric::dense::{multiply, multiply_to_symmetric};
use fdm_numeric::quadratic::Inverse;
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use std::fmt;

/// An estimation that has ended, and how its unknowns stand in the covariance.
pub(crate) struct Ended<'e> {
    pub(crate) sandwich: Sandwich<'e>,
    /// The noise that the likelihood takes.
    pub(crate) noise: &'e Weights,
    /// All unknowns.
    pub(crate) values: &'e [f64],
    /// The responses of all runs to them (N by q each).
    pub(crate) responses: &'e [Vec<f64>],
    pub(crate) priors: &'e Priors,
    /// Whether it ended at a minimum.
    pub(crate) good: bool,
}

impl Ended<'_> {
    /// Prior information, which the noise does not touch.
    pub(super) fn prior(&self) -> Vec<PriorInformation> {
        self.sandwich.prior(self.priors.rows(self.values))
    }
}

/// Where the columns of the runs stand among the unknowns.
#[derive(Clone, Copy)]
pub(crate) struct Sandwich<'f> {
    pub(crate) unknowns: &'f Unknowns,
    pub(crate) bound: &'f CramerRao,
}

impl Sandwich<'_> {
    /// The place of each column of a run in the covariance.
    pub(crate) fn places(&self, run: usize) -> Vec<Option<usize>> {
        let chosen = &self.bound.inverse.chosen;
        let columns = 0..self.unknowns.columns.len();
        columns.map(|c| chosen.binary_search(&self.unknowns.position(run, c)).ok()).collect()
    }

    /// The norm of each column of a run, 0 for those that are not part of the covariance.
    pub(crate) fn scale(&self, run: usize) -> Vec<f64> {
        let norm = |(c, place): (usize, Option<usize>)| {
            place.map_or(0.0, |_| self.bound.scale[self.unknowns.position(run, c)])
        };
        self.places(run).into_iter().enumerate().map(norm).collect()
    }

    fn prior(&self, priors: impl Iterator<Item = PriorRow>) -> Vec<PriorInformation> {
        let mut prior = Vec::new();
        for row in priors {
            let placed = |(j, entry): &(usize, f64)| {
                let k = self.bound.inverse.chosen.binary_search(j).ok()?;
                Some((k, entry / self.bound.scale[*j]))
            };
            let placed: Vec<(usize, f64)> = row.entries().iter().filter_map(placed).collect();
            let pairs = placed.iter().flat_map(|a| placed.iter().map(move |b| (a, b)));
            prior.extend(pairs.map(|((i, a), (j, b))| PriorInformation { place: (*i, *j), value: a * b }));
        }
        prior
    }

    /// The covariance, chosen by chosen, from the middle of each run (square, its columns first) and the priors.
    pub(crate) fn covariance(&self, middles: &[impl AsRef<[f64]>], prior: &[PriorInformation]) -> Vec<f64> {
        self.around(&self.gather(middles, prior))
    }

    /// The middle of all, chosen by chosen, from that of each run (square, its columns first) and the priors.
    pub(crate) fn gather(&self, middles: &[impl AsRef<[f64]>], prior: &[PriorInformation]) -> Vec<f64> {
        let n = self.bound.inverse.chosen.len();
        let mut middle = vec![0.0; n * n];
        for (run, own) in middles.iter().map(AsRef::as_ref).enumerate() {
            let (places, width) = (self.places(run), own.len().isqrt());
            for (i, a) in places.iter().enumerate() {
                for (j, b) in places.iter().enumerate() {
                    if let (Some(a), Some(b)) = (a, b) {
                        middle[a * n + b] += own[i * width + j];
                    }
                }
            }
        }
        prior.iter().for_each(|p| middle[p.place.0 * n + p.place.1] += p.value);
        middle
    }

    /// The covariance (n by n) with this middle.
    pub(crate) fn around(&self, middle: &[f64]) -> Vec<f64> {
        if let Some(covariance) = between(&self.bound.inverse, middle) {
            return covariance;
        }
        let n = self.bound.inverse.chosen.len();
        let inverse = &self.bound.inverse.values;
        multiply_to_symmetric(&multiply(inverse, middle, n), inverse, n)
    }

    /// Rows of the Cramer-Rao covariance for the columns of one run (width by chosen).
    pub(crate) fn columns(&self, run: usize, width: usize) -> Vec<f64> {
        let inverse = &self.bound.inverse;
        let (n, mut rows) = (inverse.chosen.len(), vec![0.0; width * self.bound.inverse.chosen.len()]);
        for (place, row) in self.places(run).into_iter().zip(rows.chunks_mut(n.max(1))) {
            if let Some(k) = place {
                row.copy_from_slice(&inverse.values[k * n..(k + 1) * n]);
            }
        }
        rows
    }

    /// Cramer-Rao covariance and corrected covariance of the columns of one run (width by width).
    pub(crate) fn of_run(&self, run: usize, covariance: &[f64], width: usize) -> [Vec<f64>; 2] {
        let (n, places) = (self.bound.inverse.chosen.len(), self.places(run));
        [&self.bound.inverse.values[..], covariance].map(|from| {
            let mut to = vec![0.0; width * width];
            for (i, a) in places.iter().enumerate() {
                for (j, b) in places.iter().enumerate() {
                    if let (Some(a), Some(b)) = (a, b) {
                        to[i * width + j] = from[a * n + b];
                    }
                }
            }
            to
        })
    }
}

/// Variance of a direction in scaled unknowns, about 1 where all is determined, from which on rounding of the middle, whose entries are as large, takes the
/// third digit of it.
const LOST: f64 = 1e-3 / f64::EPSILON;

/// `D M D` (n by n) where a direction is so badly determined that rounding of M leaves nothing of it; none where there is no such direction. In coordinates
/// in which the information is the unit matrix, M says how much each variance grows; such a direction grows as the others do in the mean.
pub(super) fn between(inverse: &Inverse, middle: &[f64]) -> Option<Vec<f64>> {
    let n = inverse.chosen.len();
    let rank = inverse.along.len() / n.max(1);
    let is_lost = |k: &usize| inverse.along[k * n..][..n].iter().map(|v| v * v).sum::<f64>() > LOST;
    let (lost, kept): (Vec<usize>, Vec<usize>) = (0..rank).partition(is_lost);
    if lost.is_empty() {
        return None;
    }
    let along = DMatrix::from_row_slice(rank, n, &inverse.along);
    let mut growth = &along * DMatrix::from_row_slice(n, n, middle) * along.transpose();
    let mean = kept.iter().map(|k| growth[(*k, *k)]).sum::<f64>() / kept.len().max(1) as f64;
    for k in lost {
        growth.row_mut(k).fill(0.0);
        growth.column_mut(k).fill(0.0);
        growth[(k, k)] = if kept.is_empty() { 1.0 } else { mean };
    }
    Some((along.transpose() * growth * along).as_slice().to_vec())
}

/// The corrected covariance.
pub(crate) struct Corrected {
    /// In scaled unknowns, chosen by chosen, as that of the bound.
    pub(crate) values: Vec<f64>,
    /// What was found.
    pub(crate) colours: Vec<NoiseColour>,
    /// Colours that were found of spectra.
    pub(crate) spectral: Vec<SpectralColour>,
    /// Degrees of freedom of each variance; empty where they are not known.
    pub(crate) freedom: Vec<f64>,
    /// All unknowns, corrected for the bias by noise of measured regressors; none without such noise.
    pub(crate) unbiased: Option<Vec<f64>>,
}

/// The colour of the noise of one output, in the runs that share it.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct NoiseColour {
    /// Name of the output.
    pub output: String,
    /// Names of the runs.
    pub runs: Vec<String>,
    /// Time between neighbouring samples; the middle one of all intervals where they differ.
    pub interval: f64,
    /// Coefficients of the autoregression `v(i) = sum of a(k) v(i - k) + e(i)`; none for white noise.
    pub coefficients: Vec<f64>,
    /// Standard deviation of the noise v.
    pub deviation: f64,
    /// Standard deviation of the innovations e.
    pub innovation: f64,
    /// Correlation of neighbouring samples.
    pub lag_one_correlation: f64,
}

impl Corrected {
    /// Of which nothing but the covariance is known.
    pub(super) fn of(values: Vec<f64>) -> Self {
        Self { values, colours: Vec::new(), spectral: Vec::new(), freedom: Vec::new(), unbiased: None }
    }
}

impl NoiseColour {
    pub(crate) fn new(output: String, runs: Vec<String>, interval: f64, model: &AutoRegression) -> Self {
        let r = model.autocovariances(1);
        let lag_one_correlation = if r[0] > 0.0 { r[1] / r[0] } else { 0.0 };
        let (coefficients, innovation) = (model.coefficients.clone(), model.variance.sqrt());
        Self { output, runs, interval, coefficients, deviation: r[0].sqrt(), innovation, lag_one_correlation }
    }

    /// Whether it is white.
    pub fn is_white(&self) -> bool {
        self.coefficients.is_empty()
    }
}

/// Why errors were not corrected for the colour of the residuals.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Uncorrected {
    /// As many parameters as data, or nothing estimated.
    NoDegreesOfFreedom,
    /// The sensitivities do not fit into memory all at once.
    TooLarge,
    /// Numbers left the finite ones.
    NotFinite,
    /// It was not asked for.
    NotAsked,
    /// The residuals are innovations, white where the noise that the model declares is right.
    Innovations,
}

impl fmt::Display for Uncorrected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoDegreesOfFreedom => f.write_str("no more data than parameters"),
            Self::TooLarge => f.write_str("too many samples times parameters; take every k-th sample"),
            Self::NotFinite => f.write_str("the colour of the residuals could not be determined"),
            Self::NotAsked => f.write_str("not asked for"),
            Self::Innovations => f.write_str("innovations of a filter have none where its noise is right"),
        }
    }
}

/// An entry of the information that priors add, among the chosen unknowns.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PriorInformation {
    pub(crate) place: (usize, usize),
    pub(crate) value: f64,
}

/// Corrects the covariance of a bound at `values`; of all runs the noise is known, and all have one output.
///
/// # Errors
/// [`Uncorrected`] when that is not possible.
pub(super) fn corrected_known(problem: &mut Problem<'_>, ended: &Ended<'_>) -> Result<Corrected, Uncorrected> {
    let Ended { sandwich, noise, values, .. } = *ended;
    let Sandwich { unknowns, bound } = sandwich;
    let (mut middles, mut sizes) = (Vec::new(), (0.0, 0.0, 0));
    for (r, run) in problem.runs.iter_mut().enumerate() {
        let theta = unknowns.assembled(r, values);
        let weight = |scale: f64| if scale > 0.0 { 1.0 / (scale * noise.covariance[0]) } else { 0.0 };
        let weights: Vec<f64> = sandwich.scale(r).into_iter().map(weight).collect();
        middles.push(middle(run, unknowns, &theta, &weights, &mut sizes)?);
    }
    let (found, expected, count) = sizes;
    let freedom = (count as f64 - bound.inverse.chosen.len() as f64).max(1.0) / count as f64;
    let growth = (found / (expected * freedom)).max(1.0);
    middles.iter_mut().flatten().for_each(|v| *v *= growth);
    let covariance = sandwich.covariance(&middles, &ended.prior());
    if covariance.iter().all(|v| v.is_finite()) { Ok(Corrected::of(covariance)) } else { Err(Uncorrected::NotFinite) }
}

/// `sum_ij s_i Rvv(i, j) s_j'` of one run, its columns multiplied by their weights (square). Adds up the squares of residuals and deviations, and
/// their number.
fn middle(
    run: &mut ProblemRun<'_>,
    unknowns: &Unknowns,
    theta: &[f64],
    weights: &[f64],
    sizes: &mut (f64, f64, usize),
) -> Result<Vec<f64>, Uncorrected> {
    let RunResponse::KnownNoise(response) = &mut run.response else { return Err(Uncorrected::NotFinite) };
    let width = weights.len();
    let mut rows = vec![0.0; response.samples() * width];
    let measured = &run.measured;
    let streamed = response.sensitivities(theta, &unknowns.columns, &mut |block| {
        for sample in 0..block.samples() {
            sizes.0 += block.residual(measured, sample, 0).powi(2);
            let row = &mut rows[(block.first + sample) * width..][..width];
            for (c, value) in block.layout.outputs[0].columns.iter().zip(block.row(sample, 0)) {
                row[*c as usize] = value * weights[*c as usize];
            }
        }
    });
    streamed.map_err(|_| Uncorrected::NotFinite)?;
    let KnownNoise { deviations, correlations } = response.noise();
    sizes.1 += deviations.iter().map(|d| d * d).sum::<f64>();
    sizes.2 += deviations.len();
    let mut middle = vec![0.0; width * width];
    let mut add = |i: usize, j: usize, covariance: f64| {
        let (left, right) = (&rows[i * width..][..width], &rows[j * width..][..width]);
        for (to, left) in middle.chunks_exact_mut(width).zip(left) {
            to.iter_mut().zip(right).for_each(|(to, right)| *to += covariance * left * right);
        }
    };
    deviations.iter().enumerate().for_each(|(i, d)| add(i, i, d * d));
    for (i, j, correlation) in correlations {
        let (i, j) = (*i as usize, *j as usize);
        let covariance = correlation * deviations[i] * deviations[j];
        add(i, j, covariance);
        add(j, i, covariance);
    }
    Ok(middle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_rounding_takes_grows_as_the_others() {
        // two columns that differ by 1e-8, and noise of three times the variance that was taken for it
        let (sum, difference) = (1.0 / 2.0_f64.sqrt() / 2.0_f64.sqrt(), 1e8 / 2.0_f64.sqrt());
        let along = vec![sum, sum, difference, -difference];
        let inverse = Inverse { chosen: vec![0, 1], along, ..Inverse::default() };
        let found = between(&inverse, &[3.0, 3.0, 3.0, 3.0]).expect("a direction is lost");
        assert!((found[0] / 1.5e16 - 1.0).abs() < 1e-9 && (found[1] / -1.5e16 - 1.0).abs() < 1e-9, "{found:?}");
        // of the sum all digits are there
        let well = Inverse { along: vec![sum, sum, 0.5, -0.5], ..inverse };
        assert_eq!(between(&well, &[3.0, 3.0, 3.0, 3.0]), None);
    }
}
