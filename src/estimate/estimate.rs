//! The result of an estimation, ready for tables, JSON and plots.

use crate::estimate::errors::direction::Direction;
use crate::estimate::errors::noise_colour::{NoiseColour, Uncorrected};
use crate::estimate::iteration::restart::Aid;
use crate::estimate::progress::Iteration;
use crate::estimate::termination::Termination;
use crate::quality::OutputFit;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// What can be said about a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Estimated, with a standard error.
    Estimated,
    /// Held at its lower bound: not part of the covariance.
    AtLowerBound,
    /// Held at its upper bound: not part of the covariance.
    AtUpperBound,
    /// The data do not determine it; see [`Estimate::undetermined`].
    NotDetermined,
    /// Known.
    Fixed,
    /// Follows from others.
    Derived,
    /// Follows from others as long as its tie is on.
    Tied,
    /// The start values could not be simulated.
    NotEstimated,
}

/// A parameter, or a derived quantity, after the estimation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParameterEstimate {
    /// Its name.
    pub name: String,
    /// The run that it belongs to; none when all runs share it.
    pub run: Option<String>,
    /// Its value.
    pub value: f64,
    /// Cramer-Rao standard error, with degrees of freedom taken off the noise; none when there is none to give.
    pub standard_error: Option<f64>,
    /// Standard error corrected for the colour of the residuals (Morelli and Klein); none where [`Estimate::uncorrected`]
    /// says why, and where there is no other either.
    pub corrected_error: Option<f64>,
    /// Degrees of freedom of the corrected error, which says how well the colour of the noise is known; none where that is not said.
    pub freedom: Option<f64>,
    /// Its unit, as text.
    pub unit: Option<String>,
    /// What can be said about it.
    pub status: Status,
    /// Where the estimation started; none for derived quantities.
    pub start: Option<f64>,
    /// Least admissible value.
    pub lower: Option<f64>,
    /// Greatest admissible value.
    pub upper: Option<f64>,
}

impl ParameterEstimate {
    /// The standard error to be trusted: corrected for the colour of the residuals where that was possible.
    pub fn error(&self) -> Option<f64> {
        self.corrected_error.or(self.standard_error)
    }

    /// The interval that holds the true value in 95 of 100 cases, by the error that is to be trusted and what is known of it: as many of
    /// these errors on both sides as Student's law says.
    pub fn interval(&self) -> Option<[f64; 2]> {
        let half = self.error()? * quantile(self.freedom.filter(|_| self.corrected_error.is_some()));
        Some([self.value - half, self.value + half])
    }
}

/// Standard errors on both sides that hold 95 % of Student's law with so many degrees of freedom; of the normal law without.
pub fn quantile(freedom: Option<f64>) -> f64 {
    const NORMAL: f64 = 1.959_963_984_540_054;
    let law = freedom.and_then(|f| StudentsT::new(0.0, 1.0, f.max(1.0)).ok());
    law.map_or(NORMAL, |law| law.inverse_cdf(0.975).max(NORMAL))
}

/// A symmetric matrix.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Symmetric {
    /// Rows and columns.
    pub size: usize,
    /// Entries, row-major.
    pub values: Vec<f64>,
}

impl Symmetric {
    /// The entry in row i and column j.
    pub fn at(&self, i: usize, j: usize) -> f64 {
        self.values[i * self.size + j]
    }
}

/// Measurement, response and residuals of one run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunFit {
    /// Name of the run.
    pub run: String,
    /// The model's outputs, N by q row-major.
    pub response: Vec<f64>,
    /// Measured minus model, N by q row-major; NaN where nothing was measured.
    pub residuals: Vec<f64>,
}

/// A parameter whose likeliest value is not the reported one: noise of records that stand in the equations had drawn it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Drawn {
    /// Its name.
    pub name: String,
    /// The run that it belongs to; none when all runs share it.
    pub run: Option<String>,
    /// The value of the greatest likelihood.
    pub likeliest: f64,
    /// How far from it the reported value is, in corrected standard errors.
    pub by: f64,
}

/// The result of an estimation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Estimate {
    /// Every parameter in the model's order (per-run ones once for every run), then the derived quantities.
    pub parameters: Vec<ParameterEstimate>,
    /// How well each output of each run is matched.
    pub outputs: Vec<OutputFit>,
    /// Minus the logarithm of the likelihood, without its constant, at the likeliest values (see [`Self::drawn`]).
    pub cost: Option<f64>,
    /// How the iteration ended.
    pub termination: Termination,
    /// Corrections made.
    pub iterations: usize,
    /// What helped the iteration on; empty when it needed no help.
    pub aids: Vec<Aid>,
    /// Simulations of all runs with sensitivities, and without.
    pub evaluations: (usize, usize),
    /// The state after each correction, the start first.
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
    /// Why errors were not corrected for the colour of the residuals; none when they were.
    pub uncorrected: Option<Uncorrected>,
    /// Covariance R of the measurement noise (q by q): as given, or estimated with degrees of freedom taken off; 0
    /// for an output that was never measured. None when nothing was estimated or no degree of freedom is left.
    pub noise: Option<Symmetric>,
    /// Outputs that the model matches to 1e-10 of their magnitude: data without noise, where noise covariance and
    /// standard errors stand for rounding only.
    pub noise_free: Vec<String>,
    /// What the noise of records in the equations had drawn, before that was taken off.
    pub drawn: Vec<Drawn>,
    /// What the data do not determine, nor a prior.
    pub undetermined: Vec<Direction>,
    /// What the data do not determine, so that it is known by its prior alone.
    pub determined_by_prior: Vec<Direction>,
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

    /// The same without some entries of `parameters`, which leaves their rows and columns of all matrices out too.
    pub(in crate::estimate) fn without(mut self, left_out: impl Fn(&ParameterEstimate) -> bool) -> Self {
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
        self.drawn.retain(|d| parameters.iter().any(|p| p.name == d.name && p.run == d.run));
        self
    }

    /// Whether the iteration converged and the data determine every free parameter.
    pub fn is_good(&self) -> bool {
        self.termination.is_good() && self.undetermined.is_empty()
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
