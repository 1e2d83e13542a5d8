//! What is wrong with an estimate that another way from the same start could better.

use crate::estimation::estimate::Estimate;
use crate::residuals::OutputFit;
use crate::work::termination::{Reason, Termination};
use serde::{Deserialize, Serialize};
use std::fmt;

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
mod tests {
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
