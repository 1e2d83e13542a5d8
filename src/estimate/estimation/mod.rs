//! The road from a problem to its estimate.
//!
//! **In** a [`Problem`](crate::Problem), options, [`Work`](crate::Work). **Out** an [`Estimate`](crate::Estimate), whatever became of
//! the iteration. **Start** at [`solve`]: smoothness of tables, iteration, uncertainty; what the data do not determine is held.
//!
//! The result of an estimation, ready for tables, JSON and plots.

use crate::problem::noise::Degeneracy;
use crate::residuals::{NoiseVariation, OutputFit, residuals};
use crate::uncertainty::curvature::Curvature;
use crate::uncertainty::identifiability::Direction;
use crate::uncertainty::sandwich::{NoiseColour, Uncorrected};
use crate::uncertainty::spectral_colour::SpectralColour;
use crate::work::Termination;
use fdm_numeric::least_squares::{Fallback, Iteration};
use serde::{Deserialize, Serialize};
use smoothness::TableEstimate;

pub(crate) mod smoothness;
pub(crate) mod solve;

pub use crate::uncertainty::parameters::{ParameterEstimate, Status, Symmetric};

/// Measurement, response and residuals of one run.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct RunFit {
    /// Name of the run.
    pub run: String,
    /// The model's outputs, N by q row-major.
    pub response: Vec<f64>,
    /// Measured minus model, N by q row-major; NaN where nothing was measured.
    pub residuals: Vec<f64>,
}

/// Compares the responses of runs (name and measurement of each) with what was measured, output by output.
pub(crate) fn matches<'r>(
    outputs: &[String],
    runs: impl Iterator<Item = (&'r str, &'r [f64])>,
    responses: Vec<Vec<f64>>,
) -> (Vec<OutputFit>, Vec<RunFit>) {
    let q = outputs.len();
    let (mut compared, mut fits) = (Vec::new(), Vec::new());
    for ((run, measured), response) in runs.zip(responses) {
        let of = outputs.iter().enumerate();
        compared.extend(of.map(|(o, name)| OutputFit::new(name, run, measured, &response, o, q)));
        fits.push(RunFit { run: run.to_string(), residuals: residuals(measured, &response), response });
    }
    (compared, fits)
}

/// A bias that was removed: that of a parameter by the noise of measured regressors (SIMEX; Cook and Stefanski 1994).
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct BiasCorrection {
    /// Its name.
    pub name: String,
    /// The run that it belongs to; none when all runs share it.
    pub run: Option<String>,
    /// The maximum-likelihood value.
    pub maximum_likelihood: f64,
    /// How far from it the reported value is, in corrected standard errors.
    pub standard_errors: f64,
}

/// How smooth a table is, and its effective number of parameters.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Smoothing {
    /// Its name.
    pub table: String,
    /// The order of the differences that are small.
    pub order: usize,
    /// Nodes that are estimated.
    pub parameters: usize,
    /// Their effective number: the trace of the share of the data in what is known about them.
    pub effective_parameters: f64,
    /// Its arguments.
    pub arguments: Vec<String>,
    /// Weight along each argument, whose axis is measured in its range: one over the variance of the derivative of that order.
    pub weights: Vec<f64>,
    /// Whether the choice of the weights came to rest, or they were given.
    #[serde(default = "yes")]
    pub settled: bool,
}

fn yes() -> bool {
    true
}

/// The result of an estimation.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Estimate {
    /// Every parameter in the model's order (per-run ones once for every run), then the derived quantities.
    pub parameters: Vec<ParameterEstimate>,
    /// How well each output of each run is matched.
    pub outputs: Vec<OutputFit>,
    /// Minus the logarithm of the likelihood, without its constant, at the maximum-likelihood values (see [`Self::bias_corrections`]).
    pub cost: Option<f64>,
    /// Logarithm of the likelihood of the measured numbers, whole: with its constant, without priors. None where noise is not that of
    /// independent samples in time.
    pub log_likelihood: Option<f64>,
    /// How the iteration ended.
    pub termination: Termination,
    /// Gauss-Newton iterations made.
    pub iterations: usize,
    /// What helped the iteration on; empty when it needed no help.
    pub fallbacks: Vec<Fallback>,
    /// Simulations of all runs with sensitivities, and without.
    pub evaluations: (usize, usize),
    /// The state after each iteration, the start first.
    pub history: Vec<Iteration>,
    /// Entries of `parameters` that `covariance` and `correlations` are about.
    pub covered: Vec<usize>,
    /// Covariance of the estimates (Cramer-Rao bound).
    pub covariance: Symmetric,
    /// Correlations of the estimates.
    pub correlations: Symmetric,
    /// Covariance of the estimates corrected for the colour of the residuals; empty when there is none.
    pub corrected_covariance: Symmetric,
    /// The colour of the noise of each output; empty when errors were not corrected for it.
    pub colours: Vec<NoiseColour>,
    /// Whether the residuals of each output are white over the frequencies that were compared; empty in the time domain.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub spectral_colours: Vec<SpectralColour>,
    /// Intervals that the profile of the likelihood contradicts; empty where that was not looked at.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub curvature: Vec<Curvature>,
    /// Why errors were not corrected for the colour of the residuals; none when they were.
    pub uncorrected: Option<Uncorrected>,
    /// Whether the noise of each output is of one size; empty when that was not tested.
    #[serde(default)]
    pub noise_variation: Vec<NoiseVariation>,
    /// Covariance R of the measurement noise (q by q): as given, or estimated and corrected for degrees of freedom; 0
    /// for an output that was never measured. None when nothing was estimated or no degree of freedom is left.
    pub noise: Option<Symmetric>,
    /// Outputs that the model matches to 1e-10 of their magnitude: data without noise, where noise covariance and
    /// standard errors stand for rounding only.
    pub noise_free: Vec<String>,
    /// Of each output (q) the sum of the leverages of its samples: how many parameters it determines. Empty where that is not told.
    #[serde(default)]
    pub leverages: Vec<f64>,
    /// Why the likelihood has no maximum here, if it has none: the values then say nothing.
    #[serde(default)]
    pub degenerate: Vec<Degeneracy>,
    /// Biases by the noise of measured regressors that were removed.
    pub bias_corrections: Vec<BiasCorrection>,
    /// What the data do not determine, nor a prior.
    pub undetermined: Vec<Direction>,
    /// What the data do not determine, so that it is known by its prior alone.
    pub determined_by_prior: Vec<Direction>,
    /// How smooth tables are; empty where none is.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub smoothing: Vec<Smoothing>,
    /// The model's tables, and what of them was visited; empty where that was not looked at.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tables: Vec<TableEstimate>,
    /// Condition number of the scaled sensitivities.
    pub condition: Option<f64>,
    /// Responses and residuals; empty when the start values could not be simulated.
    pub runs: Vec<RunFit>,
}

impl Estimate {
    /// A parameter by name and, for per-run ones, run.
    pub fn parameter(&self, name: &str, run: Option<&str>) -> Option<&ParameterEstimate> {
        self.parameters.iter().find(|p| p.name == name && p.run.as_deref() == run)
    }

    /// This estimate without some entries of `parameters`, which leaves their rows and columns of all matrices out too.
    pub(crate) fn without(mut self, left_out: impl Fn(&ParameterEstimate) -> bool) -> Self {
        let stays: Vec<bool> = self.parameters.iter().map(|p| !left_out(p)).collect();
        let place = |k: usize| stays[..k].iter().filter(|s| **s).count();
        let rows: Vec<usize> = (0..self.covered.len()).filter(|i| stays[self.covered[*i]]).collect();
        for matrix in [&mut self.covariance, &mut self.correlations, &mut self.corrected_covariance] {
            if matrix.size == self.covered.len() {
                let values = rows.iter().flat_map(|i| rows.iter().map(|j| matrix.at(*i, *j))).collect();
                *matrix = Symmetric { size: rows.len(), values };
            }
        }
        self.covered = rows.iter().map(|i| place(self.covered[*i])).collect();
        let mut stays = stays.into_iter();
        self.parameters.retain(|_| stays.next().unwrap_or(true));
        let parameters = &self.parameters;
        self.bias_corrections.retain(|d| parameters.iter().any(|p| p.name == d.name && p.run == d.run));
        self
    }

    /// Whether the iteration converged at a maximum of the likelihood, and the data determine every free parameter.
    pub fn is_good(&self) -> bool {
        self.termination.is_good() && self.undetermined.is_empty() && self.degenerate.is_empty()
    }

    /// Corrected over Cramer-Rao standard error of every parameter that has both, rising.
    pub fn correction_factors(&self) -> Vec<f64> {
        let both = self.covered.iter().map(|k| &self.parameters[*k]);
        let factor = |p: &ParameterEstimate| Some(p.corrected_error? / p.standard_error.filter(|s| *s > 0.0)?);
        let mut factors: Vec<f64> = both.filter_map(factor).collect();
        factors.sort_by(f64::total_cmp);
        factors
    }

    /// Pairs of entries of `parameters` whose estimates correlate by more than `limit`, with the correlation.
    pub fn correlated(&self, limit: f64) -> Vec<(usize, usize, f64)> {
        let pairs = (0..self.covered.len()).flat_map(|i| (0..i).map(move |j| (j, i)));
        let valued = pairs.map(|(i, j)| (self.covered[i], self.covered[j], self.correlations.at(i, j)));
        valued.filter(|(_, _, c)| c.abs() > limit).collect()
    }
}
