//! What is to be estimated from what: parameters, runs, options, and everything that can be wrong with them.

pub(crate) mod initial;
pub(crate) mod method;
pub(crate) mod noise;
pub(crate) mod response;
pub(crate) mod unknowns;

use crate::problem::method::{Optimizer, SmoothBy};
use crate::problem::noise::Noise;
use crate::problem::response::RunResponse;
use crate::residuals::NoiseVariation;
use fdm_grammar::model::{Model, Param, Prior, Table};
use response::affine;
use serde::Serialize;
use std::fmt;
use unknowns::DerivedQuantities;

/// One run of a problem.
pub struct ProblemRun<'a> {
    /// Name that tables show, unique among the runs.
    pub name: String,
    /// The model, driven by this run's inputs.
    pub response: RunResponse<'a>,
    /// Measured outputs, N by q row-major; NaN where nothing is to be compared.
    pub measured: Vec<f64>,
    /// Start values of all parameters (p); only the per-run ones are read. Empty: as the parameters say.
    pub start: Vec<f64>,
}

/// Parameters and runs.
pub struct Problem<'a> {
    /// All parameters of the model, in its order.
    pub params: Vec<Param>,
    /// Names of the outputs (q).
    pub outputs: Vec<String>,
    /// The runs that are compared with the model, all at once.
    pub runs: Vec<ProblemRun<'a>>,
    /// Parameters (indices) in which all responses are jointly affine, as far as that is known; used when the
    /// iteration needs a fallback strategy.
    pub affine: Vec<usize>,
    /// The model's tables; the nodes of smooth ones have a prior of unknown scale.
    pub tables: Vec<Table>,
    /// Weights of the axes of smooth tables with which the choice of these begins; empty where nothing is known of them.
    pub smoothness: Vec<f64>,
    /// Quantities that follow from the parameters.
    pub derived: DerivedQuantities<'a>,
    /// What noise does besides, where measured records stand in the equations.
    pub regressor_noise: Option<Box<dyn RegressorNoise + 'a>>,
    /// How large the noise of every sample is, where coefficients of whole records are compared.
    pub noise_in_time: Option<Box<dyn NoiseInTime + 'a>>,
    /// Whether estimates are all that is asked for: intervals are then not looked at beyond their errors.
    pub bare: bool,
    /// How well the noise is known of which some samples are known by a limit alone.
    pub(crate) limited: Option<LimitedNoise>,
}

/// What determines the deviation of a noise of which some samples are known by a limit alone: these say little of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LimitedNoise {
    /// Samples with values.
    pub(crate) values: usize,
    /// Parameters that are estimated and stand in the noise alone.
    pub(crate) params: usize,
}

/// What the numbers of all runs are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Numbers {
    /// Samples in time.
    InTime,
    /// Samples in time, some of them over their stated deviations.
    Standardised,
    /// Coefficients of whole records.
    Coefficients,
    /// Numbers of known noise.
    KnownNoise,
}

/// Noise of records that are compared and stand in the equations as well.
pub trait RegressorNoise: Send + Sync {
    /// What other noise would do to one run at `theta` (p), record by record and draw by draw: of each output, `levels` (q) says how large its variance
    /// is among the numbers that are compared; then of inputs whose noise is known. None where it cannot be told.
    fn shifts(
        &self,
        run: usize,
        theta: &[f64],
        levels: &[f64],
        slopes: Option<Slopes<'_>>,
    ) -> Option<Vec<Vec<NoiseShift>>>;
}

/// The noise of records in time, behind the coefficients that are compared.
pub trait NoiseInTime: Send + Sync {
    /// Whether it is of one size at `theta` (all parameters of each run); none where that cannot be told.
    fn sizes(&self, theta: &[Vec<f64>]) -> Option<NoiseSizes>;
}

/// How large noise is in time.
#[derive(Debug, Clone, PartialEq)]
pub struct NoiseSizes {
    /// Whether the noise of each output is of one size.
    pub variation: Vec<NoiseVariation>,
    /// Variance of every place of the even grid over the mean one, by run and output.
    pub shapes: Vec<Vec<Vec<f64>>>,
}

/// What is asked about the sensitivities S to some parameters.
#[derive(Debug, Clone, Copy)]
pub struct Slopes<'s> {
    /// The parameters (C).
    pub columns: &'s [usize],
    /// Weights W of the residuals (q by q).
    pub weights: &'s [f64],
}

/// How residuals change with the noise of the records, N by q row-major, and what that does to their score through other sensitivities `S + dS`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NoiseShift {
    /// Because what is compared changes.
    pub measured: Vec<f64>,
    /// Because what moves the model changes.
    pub regressed: Vec<f64>,
    /// `dS' W (measured + regressed)` (C); empty where it was not asked for.
    pub pull: Vec<f64>,
    /// `dS' W e`, e the residuals as they are (C).
    pub tilt: Vec<f64>,
    /// `S' W dS` (C by C).
    pub cross: Vec<f64>,
    /// `dS' W dS` (C by C).
    pub added: Vec<f64>,
}

impl<'a> Problem<'a> {
    /// The problem of a model as it stands: its parameters (see [`Changes`](crate::Changes)) and outputs.
    pub fn new(model: &Model, runs: Vec<ProblemRun<'a>>, derived: DerivedQuantities<'a>) -> Self {
        let outputs = model.outputs.iter().map(|o| o.quantity.name.clone()).collect();
        let (affine, tables) = (affine(model), model.tables.clone());
        Self { affine, tables, ..Self::of(model.params.clone(), outputs, runs, derived) }
    }

    /// The problem of these parameters and outputs, of whose responses nothing else is known.
    pub fn of(
        params: Vec<Param>,
        outputs: Vec<String>,
        runs: Vec<ProblemRun<'a>>,
        derived: DerivedQuantities<'a>,
    ) -> Self {
        let (affine, tables, smoothness) = Default::default();
        let (regressor_noise, noise_in_time) = (None, None);
        let (bare, limited) = (false, None);
        Self {
            params,
            outputs,
            runs,
            affine,
            tables,
            smoothness,
            derived,
            regressor_noise,
            noise_in_time,
            bare,
            limited,
        }
    }

    /// What the numbers of all runs are.
    pub(crate) fn numbers(&self) -> Numbers {
        let all = |of: fn(&RunResponse<'_>) -> bool| self.runs.iter().all(|run| of(&run.response));
        match () {
            () if all(|response| matches!(response, RunResponse::KnownNoise(_))) => Numbers::KnownNoise,
            () if all(|response| matches!(response, RunResponse::Coefficients(_))) => Numbers::Coefficients,
            () if all(|response| matches!(response, RunResponse::InTime(_))) => Numbers::InTime,
            () => Numbers::Standardised,
        }
    }

    /// What a measured number is worth on the average: 1, or less where frequencies are closer than one cycle in the record.
    pub(crate) fn worth(&self) -> f64 {
        let (mut numbers, mut worth) = (0.0, 0.0);
        for run in &self.runs {
            let compared = run.measured.iter().filter(|z| !z.is_nan()).count() as f64;
            let part = match &run.response {
                RunResponse::InTime(_) | RunResponse::Standardised(_) => 1.0,
                RunResponse::Coefficients(response) => {
                    let coefficients = response.coefficients();
                    coefficients.independent() / coefficients.omega.len().max(1) as f64
                }
                RunResponse::KnownNoise(_) => continue,
            };
            numbers += compared;
            worth += compared * part;
        }
        if numbers > 0.0 { worth / numbers } else { 1.0 }
    }

    /// Everything that makes the problem impossible.
    pub(crate) fn mistakes(&self, options: &Options) -> Vec<ProblemError> {
        let mut found = Vec::new();
        if self.runs.is_empty() {
            found.push(ProblemError::NoRuns);
        }
        self.option_mistakes(options, &mut found);
        for (k, run) in self.runs.iter().enumerate() {
            if self.runs[..k].iter().any(|r| r.name == run.name) {
                found.push(ProblemError::RunTwice { run: run.name.clone() });
            }
            self.shape_mistakes(run, &mut found);
            self.start_mistakes(run, &mut found);
        }
        if found.is_empty() {
            self.data_mistakes(options, &mut found);
        }
        found.dedup();
        found
    }

    fn option_mistakes(&self, options: &Options, found: &mut Vec<ProblemError>) {
        if !(options.gain > 0.0 && options.gain <= 1.0) {
            found.push(ProblemError::BadOption { option: "gain", value: options.gain, wanted: "above 0, at most 1" });
        }
        if !(options.tolerance > 0.0 && options.tolerance < 1.0) {
            let (option, value) = ("tolerance", options.tolerance);
            found.push(ProblemError::BadOption { option, value, wanted: "between 0 and 1" });
        }
        let Noise::Given(given) = &options.noise else { return };
        if given.len() != self.outputs.len() {
            found.push(ProblemError::NoiseCount { given: given.len(), outputs: self.outputs.len() });
        }
        for (output, value) in self.outputs.iter().zip(given) {
            if let Some(value) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
                found.push(ProblemError::BadNoise { output: output.clone(), value });
            }
        }
    }

    fn shape_mistakes(&self, run: &ProblemRun<'_>, found: &mut Vec<ProblemError>) {
        let (n, q) = (run.response.samples(), self.outputs.len());
        let name = || run.name.clone();
        if run.response.outputs() != q {
            found.push(ProblemError::Outputs { run: name(), found: run.response.outputs(), wanted: q });
        }
        if run.measured.len() != n * q {
            found.push(ProblemError::Measured { run: name(), found: run.measured.len(), wanted: n * q });
        }
        if !run.start.is_empty() && run.start.len() != self.params.len() {
            found.push(ProblemError::Start { run: name(), found: run.start.len(), wanted: self.params.len() });
        }
    }

    fn start_mistakes(&self, run: &ProblemRun<'_>, found: &mut Vec<ProblemError>) {
        for (k, p) in self.params.iter().enumerate() {
            let own = run.start.get(k).filter(|_| p.per_run);
            let (parameter, value) = (p.quantity.name.clone(), *own.unwrap_or(&p.value));
            if let Some(Prior { mean, deviation }) = p.prior
                && !(mean.is_finite() && deviation.is_finite() && deviation > 0.0)
            {
                found.push(ProblemError::BadPrior { parameter: parameter.clone(), mean, deviation });
            }
            if !value.is_finite() {
                found.push(ProblemError::NotFinite { parameter, run: own.map(|_| run.name.clone()) });
            } else if !p.fixed && (value < p.lower || value > p.upper) {
                let (lower, upper) = (p.lower, p.upper);
                found.push(ProblemError::OutsideBounds { parameter, value, lower, upper });
            }
        }
    }

    fn data_mistakes(&self, options: &Options, found: &mut Vec<ProblemError>) {
        let q = self.outputs.len();
        let mut compared = 0;
        for run in &self.runs {
            compared += run.measured.iter().filter(|z| !z.is_nan()).count();
            let cell = |k: usize| (run.name.clone(), k / q, self.outputs[k % q].clone());
            if let Some(k) = run.measured.iter().position(|z| z.is_infinite()) {
                let (run, sample, output) = cell(k);
                found.push(ProblemError::InfiniteData { run, sample, output });
            }
            if options.noise == Noise::Full {
                let torn =
                    run.measured.chunks(q).position(|r| r.iter().any(|z| z.is_nan()) && !r.iter().all(|z| z.is_nan()));
                if let Some(sample) = torn {
                    let gap = run.measured[sample * q..][..q].iter().position(|z| z.is_nan()).unwrap_or(0);
                    let (run, sample, output) = cell(sample * q + gap);
                    found.push(ProblemError::FullWithGaps { run, sample, output });
                }
            }
        }
        if compared == 0 && !self.runs.is_empty() {
            found.push(ProblemError::NothingCompared);
        }
    }
}

/// How to estimate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Options {
    /// What is assumed about the measurement noise.
    pub noise: Noise,
    /// Most iterations of each estimation before it gives up.
    pub iterations: usize,
    /// Most iterations of all estimations together, fallback strategies and further steps included; any number when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub total: Option<usize>,
    /// Largest step, relative to the parameter, at which the estimates count as converged.
    pub tolerance: f64,
    /// Factor on every step; 1 is the full one.
    pub gain: f64,
    /// Whether standard errors corrected for the colour of the residuals are computed too.
    pub colour: bool,
    /// How the minimum is approached.
    pub optimizer: Optimizer,
    /// How the weights of smooth tables are chosen.
    #[serde(skip_serializing_if = "is_by_likelihood")]
    pub smooth_by: SmoothBy,
}

fn is_by_likelihood(smooth_by: &SmoothBy) -> bool {
    *smooth_by == SmoothBy::Likelihood
}

impl Default for Options {
    fn default() -> Self {
        let (noise, optimizer) = (Noise::Diagonal, Optimizer::default());
        let smooth_by = SmoothBy::default();
        Self { noise, iterations: 100, total: None, tolerance: 1e-9, gain: 1.0, colour: true, optimizer, smooth_by }
    }
}

/// A reason why a problem cannot be solved.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs, reason = "the message below each variant says what its fields are")]
pub enum ProblemError {
    NoRuns,
    RunTwice { run: String },
    Outputs { run: String, found: usize, wanted: usize },
    Measured { run: String, found: usize, wanted: usize },
    Start { run: String, found: usize, wanted: usize },
    NotFinite { parameter: String, run: Option<String> },
    OutsideBounds { parameter: String, value: f64, lower: f64, upper: f64 },
    InfiniteData { run: String, sample: usize, output: String },
    FullWithGaps { run: String, sample: usize, output: String },
    NothingCompared,
    NoiseCount { given: usize, outputs: usize },
    BadNoise { output: String, value: f64 },
    BadPrior { parameter: String, mean: f64, deviation: f64 },
    BadOption { option: &'static str, value: f64, wanted: &'static str },
    ForeignState { reason: &'static str },
}

impl fmt::Display for ProblemError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoRuns => write!(f, "there is no run to compare the model with"),
            Self::RunTwice { run } => write!(f, "two runs are called `{run}`; tables could not tell them apart"),
            Self::Outputs { run, found, wanted } => {
                write!(f, "the response of run `{run}` has {found} outputs, the model {wanted}")
            }
            Self::Measured { run, found, wanted } => {
                write!(f, "run `{run}` has {found} measured cells, its samples and outputs make {wanted}")
            }
            Self::Start { run, found, wanted } => {
                write!(f, "run `{run}` has start values for {found} parameters, the model has {wanted}")
            }
            Self::NotFinite { parameter, run: None } => {
                write!(f, "the start value of `{parameter}` is not a finite number")
            }
            Self::NotFinite { parameter, run: Some(run) } => {
                write!(f, "the start value of `{parameter}` in run `{run}` is not a finite number")
            }
            Self::OutsideBounds { parameter, value, lower, upper } => {
                write!(f, "`{parameter}` starts at {value}, outside its bounds [{lower}, {upper}]")
            }
            Self::InfiniteData { run, sample, output } => {
                write!(f, "run `{run}`, sample {}: the measured `{output}` is infinite", sample + 1)
            }
            Self::FullWithGaps { run, sample, output } => write!(
                f,
                "run `{run}`, sample {}: `{output}` is missing while other outputs are there; a full noise covariance \
                 needs all outputs of a sample or none, diagonal noise does not",
                sample + 1
            ),
            Self::NothingCompared => write!(f, "no measured value is left to compare with the model"),
            Self::NoiseCount { given, outputs } => {
                write!(f, "noise is given for {given} outputs, the model has {outputs}")
            }
            Self::BadNoise { output, value } => {
                write!(f, "the noise of `{output}` is {value}; a standard deviation must be above 0")
            }
            Self::BadPrior { parameter, mean, deviation } => write!(
                f,
                "the prior of `{parameter}` is normal({mean}, {deviation}); its mean must be finite and its standard \
                 deviation above 0"
            ),
            Self::BadOption { option, value, wanted } => write!(f, "{option} is {value}, but must be {wanted}"),
            Self::ForeignState { reason } => {
                write!(f, "the estimation cannot go on from the state that was kept: {reason}")
            }
        }
    }
}

impl std::error::Error for ProblemError {}
