//! Why nothing was estimated.
//!
//! What is wrong with an estimate that another way from the same start could better.

use crate::estimation::Estimate;
use crate::problem::ProblemError;
use crate::problem::method::{Domain, Method};
use crate::problem::unknowns::ChangeError;
use crate::residuals::OutputFit;
use crate::work::{Reason, Termination};
use fdm_system::record::Run;
use fdm_system::simulate::Unsuited;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Why nothing was estimated: every reason that was found.
#[derive(Debug, Clone, PartialEq)]
pub enum FitError {
    /// Changes that cannot be made.
    Changes(Vec<ChangeError>),
    /// A run that cannot be simulated with exact derivatives.
    Unsuited {
        /// Name of the run.
        run: String,
        /// Why.
        reason: Unsuited,
    },
    /// A standard deviation of an output that is not above zero with the start values.
    Deviation {
        /// The output.
        output: String,
        /// The expression of its deviation.
        expression: String,
        /// Name of the run.
        run: String,
        /// Time of the first such sample.
        time: f64,
        /// What the expression is there.
        value: f64,
    },
    /// A problem that cannot be solved.
    Problem(Vec<ProblemError>),
    /// A strategy that was asked for and cannot be followed.
    Strategy(StrategyError),
    /// Options of another method or domain, which [`identify`](crate::identify()) is for.
    Method {
        /// The method.
        method: Method,
        /// The domain.
        domain: Domain,
    },
}

impl FitError {
    pub(crate) fn unsuited(run: &Run, reason: Unsuited) -> Self {
        Self::Unsuited { run: run.name.clone(), reason }
    }
}

impl fmt::Display for FitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = |reasons: Vec<String>| reasons.join("\n");
        match self {
            Self::Changes(e) => write!(f, "{}", lines(e.iter().map(ToString::to_string).collect())),
            Self::Unsuited { run, reason } => write!(f, "run `{run}`: {reason}"),
            Self::Deviation { output, expression, run, time, value } => write!(
                f,
                "run `{run}`: the noise of `{output}`, `{expression}`, is {value} at time {time} with the start values, and a standard \
                 deviation is above zero; begin with other values (--set){}",
                // the absolute value of zero helps nobody
                if *value < 0.0 { format!(", or write abs({expression})") } else { String::new() }
            ),
            Self::Problem(e) => write!(f, "{}", lines(e.iter().map(ToString::to_string).collect())),
            Self::Strategy(e) => write!(f, "{e}"),
            Self::Method { method, domain } => {
                write!(f, "`fit` estimates by output error in the time domain, not by {method} in the {domain} domain")
            }
        }
    }
}

impl std::error::Error for FitError {}

/// Why a strategy that was asked for cannot be followed.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs, reason = "the message below each variant says what its fields are")]
pub enum StrategyError {
    UnknownState { name: String, nearest: Option<String> },
    NothingMeasured,
    InitialConditions { run: String, length: f64, samples: usize },
    NotMeasured { reason: String },
    NotASegmentLength { length: f64 },
    NoStates,
    Delays,
    TooManySegments { cells: usize, most: usize },
    Loss { value: f64 },
    LossOfNoiseModel,
    LossOfFullNoise,
    ConfidenceOfOwnNoise,
    NoiseModel { method: Method, domain: Domain },
    Censored { method: Method, domain: Domain },
    CensoredNoise { output: String },
    OptionOfMethod { option: &'static str, method: Method, domain: Domain },
    SmoothByOneRun,
    SmoothByValidation { method: Method, domain: Domain },
    SmoothWeights { given: usize, wanted: usize },
}

impl fmt::Display for StrategyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownState { name, nearest: Some(hint) } => {
                write!(f, "the model has no state `{name}` to substitute; did you mean `{hint}`?")
            }
            Self::UnknownState { name, nearest: None } => write!(f, "the model has no state `{name}` to substitute"),
            Self::NothingMeasured => write!(f, "no output shows a state: there is no record to substitute for one"),
            Self::InitialConditions { run, length, samples: samples @ (0 | 1) } => write!(
                f,
                "run `{run}` has {samples} sample{} in its first {length}, and initial values want two at least; give a longer time (--initial-from)",
                if *samples == 1 { "" } else { "s" }
            ),
            Self::InitialConditions { run, length, .. } => write!(
                f,
                "run `{run}` has no measured output in its first {length}: nothing there says what its initial values are"
            ),
            Self::NotMeasured { reason } => write!(f, "{reason}"),
            Self::NotASegmentLength { length } => {
                write!(f, "segments of length {length} are not possible; a length is a number above 0")
            }
            Self::NoStates => write!(f, "the model has no states, so that there is nothing to shoot from"),
            Self::Delays => write!(
                f,
                "multiple shooting is not possible with delays: a segment would begin with a past that it does not know; \
                 lengthen the record instead (--continuation)"
            ),
            Self::Loss { value } => {
                write!(
                    f,
                    "Huber's loss has a number from 0.01 to 100, and Student's law 1 to 1e6 degrees of freedom; {value} was given"
                )
            }
            Self::LossOfNoiseModel => write!(
                f,
                "the model says how large the noise of each sample is, and the loss takes it for one size in each output; \
                 take the noise of one size (--noise diagonal) or squares (--loss squares)"
            ),
            Self::LossOfFullNoise => write!(
                f,
                "a loss other than squares is of each output by itself; leave out --noise full, or take squares (--loss squares)"
            ),
            Self::ConfidenceOfOwnNoise => write!(
                f,
                "shorter records and other weights (--confidence, --weights) are of squares and noise of one size; \
                 take these (--noise diagonal, --loss squares), or leave the questions out"
            ),
            Self::NoiseModel { method, domain } => write!(
                f,
                "noise that is an expression (`noise y = ...;`) is estimated by output error in the time domain, not by {method} in the {domain} domain; \
                 --noise diagonal takes one size for each output instead"
            ),
            Self::Censored { method, domain } => write!(
                f,
                "samples below a limit are compared by output error in the time domain, not by {method} in the {domain} domain; \
                 take --method output-error --domain time, or leave them out (--below-limit missing)"
            ),
            Self::CensoredNoise { output } => write!(
                f,
                "`{output}` has samples below a limit, and the probability of these wants a deviation of its noise that is known or a param: \
                 write `param sigma = ...; noise {output} = sigma;`, give a number (--noise {output}=0.1), or leave them out (--below-limit missing)"
            ),
            Self::OptionOfMethod { option: "--loss", method, domain } => write!(
                f,
                "losses other than squares are of output error in the time domain, not of {method} in the {domain} domain; take --loss squares"
            ),
            Self::OptionOfMethod { option, method, domain } => write!(
                f,
                "{option} has no part in {method} in the {domain} domain, and would be ignored: leave it out, or take another method"
            ),
            Self::SmoothByOneRun => write!(
                f,
                "--smooth-by validation leaves runs out and predicts them, and there is one run; give more, or take --smooth-by likelihood"
            ),
            Self::SmoothByValidation { method, domain } => write!(
                f,
                "--smooth-by validation is of output error in the time domain, not of {method} in the {domain} domain; take --smooth-by likelihood"
            ),
            Self::SmoothWeights { given, wanted } => write!(
                f,
                "--smooth-by gives {given} weights, and the smooth tables of this model have {wanted} axes; give one for each axis, above 0"
            ),
            Self::TooManySegments { cells, most } => write!(
                f,
                "so many segments want a table of {cells} sensitivities, more than {most}; take fewer or longer ones"
            ),
        }
    }
}

impl std::error::Error for StrategyError {}

/// What is wrong with an estimate.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FitDefect {
    /// The iteration did not end at a minimum.
    Ended(Termination),
    /// At the start values the free response grows by so many e-folds over the record, while the outputs stay in place.
    Unstable {
        /// E-folds.
        growth: f64,
    },
    /// It did, but the model matches the measurement badly there.
    PoorMatch {
        /// The output that is matched worst.
        output: String,
        /// Its R^2 over all runs.
        r2: f64,
    },
    /// It did, and to a fair match; but what is left over is smooth, as a wrong minimum leaves it, and slow noise too.
    SmoothResiduals {
        /// The output that is matched worst.
        output: String,
        /// Its R^2 over all runs.
        r2: f64,
    },
}

impl fmt::Display for FitDefect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ended(termination) => write!(f, "{termination}"),
            Self::Unstable { growth } => write!(f, "unstable as a free response: it grows by e^{growth:.0}"),
            Self::SmoothResiduals { output, r2 } => {
                write!(f, "converged to smooth residuals of `{output}`, R^2 {}", shown(*r2))
            }
            Self::PoorMatch { output, r2 } => write!(f, "converged to a poor match of `{output}`, R^2 {}", shown(*r2)),
        }
    }
}

/// Three decimals, or three digits where the response is lost.
fn shown(r2: f64) -> String {
    if r2.abs() < 1000.0 { format!("{r2:.3}") } else { format!("{r2:.2e}") }
}

/// Iterations that no sound start needs: an iteration that had so many and did not converge is stuck.
const MANY: usize = 50;
/// Mean R^2 over the outputs below which an estimate cannot be what was meant.
const POOR: f64 = 0.5;
/// R^2 of an output below which it is matched badly when what is left over is no noise, but smooth.
const DOUBTFUL: f64 = 0.95;
/// R^2 of an output with smooth residuals below which even its values are no start.
const POOR_AND_SMOOTH: f64 = 0.8;
/// Correlation of neighbouring residuals beyond which they are smooth.
const SMOOTH: f64 = 0.8;

impl FitDefect {
    /// Whether no start for a longer record should come from such an estimate.
    pub(crate) fn is_severe(&self) -> bool {
        !matches!(self, Self::SmoothResiduals { r2, .. } if *r2 >= POOR_AND_SMOOTH)
    }
}

/// What is wrong with an estimate, if anything is that another way could better.
pub(crate) fn trouble(estimate: &Estimate) -> Option<FitDefect> {
    let stuck = match &estimate.termination {
        // where nothing is free no other way leads anywhere else
        Termination::Interrupted | Termination::TimeLimit | Termination::Converged(Reason::NothingToEstimate) => {
            return None;
        }
        Termination::Converged(_) => false,
        Termination::IterationLimit => estimate.iterations >= MANY,
        _ => true,
    };
    if stuck {
        return Some(FitDefect::Ended(estimate.termination.clone()));
    }
    let outputs = pooled(&estimate.outputs);
    let mean = outputs.iter().map(|(_, r2)| r2.max(-1.0)).sum::<f64>() / outputs.len() as f64;
    let (output, r2) = outputs.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let (output, r2) = (output.to_string(), *r2);
    if mean < POOR {
        Some(FitDefect::PoorMatch { output, r2 })
    } else if r2 < DOUBTFUL && smoothness(estimate, &output) > SMOOTH {
        Some(FitDefect::SmoothResiduals { output, r2 })
    } else {
        None
    }
}

/// R^2 of each output over all runs in which it varies.
fn pooled(outputs: &[OutputFit]) -> Vec<(&str, f64)> {
    let mut sums: Vec<(&str, f64, f64)> = Vec::new();
    for o in outputs {
        let (Some(rms), Some(r2)) = (o.rms, o.r2) else { continue };
        let left = o.compared as f64 * rms * rms;
        // beside a match to rounding the spread cannot be told, nor is it wanted
        let (left, spread) = if r2 < 1.0 { (left, left / (1.0 - r2)) } else { (0.0, f64::MIN_POSITIVE) };
        match sums.iter_mut().find(|s| s.0 == o.name) {
            Some(sum) => (sum.1, sum.2) = (sum.1 + left, sum.2 + spread),
            None => sums.push((&o.name, left, spread)),
        }
    }
    sums.into_iter().map(|(name, left, spread)| (name, 1.0 - left / spread)).collect()
}

/// Correlation of neighbouring residuals of an output over all runs.
fn smoothness(estimate: &Estimate, output: &str) -> f64 {
    let (mut products, mut squares) = (0.0, 0.0);
    for run in &estimate.runs {
        let names = || estimate.outputs.iter().filter(|o| o.run == run.run);
        let Some(place) = names().position(|o| o.name == output) else { continue };
        let column: Vec<f64> = run.residuals.iter().skip(place).step_by(names().count()).copied().collect();
        let measured: Vec<f64> = column.into_iter().filter(|v| !v.is_nan()).collect();
        products += measured.windows(2).map(|w| w[0] * w[1]).sum::<f64>();
        squares += measured.iter().map(|v| v * v).sum::<f64>();
    }
    if squares > 0.0 { products / squares } else { 0.0 }
}

#[cfg(test)]
mod defect_tests {
    use super::*;

    #[test]
    fn outputs_are_pooled_over_runs_and_a_match_to_rounding_is_one() {
        let of = |name: &str, run: &str, rms: f64, r2: f64| OutputFit {
            censored: 0,
            name: name.into(),
            run: run.into(),
            compared: 10,
            rms: Some(rms),
            bias: None,
            r2: Some(r2),
            tic: None,
            tic_parts: None,
        };
        // hardly moved in the second run, so that nothing of it is explained there
        let outputs = [of("a", "r", 0.1, 0.99), of("b", "r", 1e-14, 1.0), of("a", "s", 0.1, -1.0)];
        let pooled = pooled(&outputs);
        assert_eq!(pooled[1], ("b", 1.0));
        let want = 1.0 - 0.02 / (0.01 / 0.01 + 0.01 / 2.0);
        assert!(pooled[0].0 == "a" && (pooled[0].1 - want).abs() < 1e-12, "{pooled:?}");
    }
}
