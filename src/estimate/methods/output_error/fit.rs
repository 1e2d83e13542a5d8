//! The result of an output-error fit: estimates, and all that is known about how they were reached.
//!
//! Integration errors that no estimate should be trusted with: what is fitted is then the steps, not the model.

use super::error::FitDefect;
use crate::estimation::{Estimate, ParameterEstimate, Status};
use crate::examined::doubted_initials::DoubtedInitials;
use crate::examined::input_interpolation::InputInterpolation;
use crate::examined::unexplained::FewSamples;
use crate::methods::output_error::loss::Loss;
use crate::residuals::{Baseline, OutputQuality};
use crate::work::{StartSummary, Termination};
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Accuracy, WorstError};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Estimates, and how they were reached.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The model with the changes that were asked for.
    pub model: Model,
    /// The estimates.
    pub estimate: Estimate,
    /// Steps and integration error of each run at the estimates.
    pub integration: Vec<Accuracy>,
    /// Integration errors that are too large to be passed over; empty when there are none, or when that was not looked at.
    pub integration_faults: Vec<IntegrationFault>,
    /// Parameters that few samples moved far from their starts; empty when that was not looked at.
    pub few_samples: Vec<FewSamples>,
    /// Initial values that the model states and the data contradict; none when they do not, or when that was not looked at.
    pub doubted_initials: Option<DoubtedInitials>,
    /// What the record says of inputs about which nobody said how they go between samples; empty when that was not looked at.
    pub interpolations: Vec<InputInterpolation>,
    /// Inputs about which nobody said how they go between samples where that was not compared: by a filter, with noise that is an expression, and with
    /// another loss than squares.
    pub uncompared_inputs: Vec<String>,
    /// What the residuals say: every output of every run, runs outermost; empty when nothing could be simulated, or when that
    /// was not asked for.
    pub quality: Vec<OutputQuality>,
    /// What was done about start values that could not be used, and why; none when they could.
    pub fallback: Option<Recovery>,
    /// Estimates by length of the record, the whole record's last; empty when only that was fitted.
    pub by_length: Vec<LengthFit>,
    /// Estimates with other weights of the outputs; none when that was not asked for, or there was no noise to weigh.
    pub reweighting: Option<Reweighting>,
    /// States whose measured records took their place in a first fit, because that was asked for.
    pub substituted: Vec<String>,
    /// How continuous the result of multiple shooting is; none when there was none.
    pub shooting: Option<Continuity>,
    /// What was made of residuals.
    pub loss: Loss,
    /// The noise of every sample, where it is an expression; empty where all noise is of one size.
    pub noise_of_samples: Vec<NoiseOfSamples>,
    /// What came out of each start; empty when there was only one. Those that an interruption prevented are missing.
    pub starts: Vec<StartSummary>,
}

impl Fit {
    /// A plain fit, without a fallback strategy and without anything said about confidence.
    pub(crate) fn new(model: Model, estimate: Estimate, integration: Vec<Accuracy>) -> Self {
        Self {
            model,
            estimate,
            integration,
            integration_faults: Vec::new(),
            few_samples: Vec::new(),
            doubted_initials: None,
            interpolations: Vec::new(),
            uncompared_inputs: Vec::new(),
            quality: Vec::new(),
            fallback: None,
            by_length: Vec::new(),
            reweighting: None,
            substituted: Vec::new(),
            shooting: None,
            loss: Loss::Squares,
            noise_of_samples: Vec::new(),
            starts: Vec::new(),
        }
    }

    /// Whether a fit is worth more than another of the same runs by the same noise: it has a cost at all, a maximum of the likelihood and no place
    /// without one, and by more than rounding a lower cost.
    pub(crate) fn is_better_than(&self, other: &Self) -> bool {
        let (own, than) = (&self.estimate, &other.estimate);
        match (own.cost, than.cost) {
            (Some(_), Some(_)) if own.degenerate.is_empty() != than.degenerate.is_empty() => own.degenerate.is_empty(),
            (Some(a), Some(b)) => a < b - 1e-9 * b.abs().max(1.0) || (!than.termination.is_good() && a <= b),
            (a, _) => a.is_some(),
        }
    }

    /// Whether the iteration converged, the data determine every free parameter, and no integration error falsifies that.
    pub fn is_good(&self) -> bool {
        self.estimate.is_good() && self.is_integrated()
    }

    /// What no model at all would miss by in these runs, which the fit predicts from `from` after their beginning on.
    pub fn baselines(&self, runs: &[Run], from: f64) -> Vec<Baseline> {
        let names: Vec<&str> = self.model.definition().outputs.iter().map(|o| o.quantity.name.as_str()).collect();
        let residuals: Vec<&[f64]> = self.estimate.runs.iter().map(|r| r.residuals.as_slice()).collect();
        Baseline::of(&names, runs, &residuals, from)
    }

    /// Whether the estimates are those of the model and not of integration steps that are too long.
    pub fn is_integrated(&self) -> bool {
        !self.integration_faults.iter().any(IntegrationFault::is_severe)
    }
}

/// The noise of every sample of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct NoiseOfSamples {
    /// Name of the run.
    pub run: String,
    /// Its standard deviation at the estimates, in the output's unit (N by q row-major); NaN where nothing is compared, and for outputs whose noise is of one
    /// size.
    pub deviations: Vec<f64>,
}

/// A way out.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RecoveryStrategy {
    /// Record-length continuation: a short part of the record was fitted first, then longer ones.
    Continuation,
    /// Measured records first took the place of these states in the equations.
    Substitution {
        /// The states.
        states: Vec<String>,
    },
    /// The record was cut into so many segments for each run.
    Shooting {
        /// Segments of the longest run.
        segments: usize,
    },
}

/// What was done to reach an estimate that the start values alone would not have given, and why.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Recovery {
    /// What was wrong with the fit from the start values.
    pub trouble: FitDefect,
    /// What was tried, in this order, without a better result.
    pub failed: Vec<RecoveryStrategy>,
    /// What gave the result; none when nothing did better than the fit from the start values.
    pub by: Option<RecoveryStrategy>,
}

impl fmt::Display for RecoveryStrategy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Continuation => write!(f, "fitting a short record first and lengthening it"),
            Self::Substitution { states } => {
                write!(f, "fitting first with the measured {} in the equations", states.join(", "))
            }
            Self::Shooting { segments } => write!(f, "multiple shooting with {segments} segments"),
        }
    }
}

impl fmt::Display for Recovery {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the fit from the start values failed ({}); ", self.trouble)?;
        let failed: Vec<String> = self.failed.iter().map(ToString::to_string).collect();
        match &self.by {
            Some(remedy) => write!(f, "reached by {remedy}")?,
            None if failed.is_empty() => write!(f, "there was nothing else to try")?,
            None => write!(f, "no better: {}", failed.join("; "))?,
        }
        if self.by.is_some() && !failed.is_empty() {
            write!(f, ", after these had failed: {}", failed.join("; "))?;
        }
        Ok(())
    }
}

/// Estimates from records of one length.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct LengthFit {
    /// Time that the longest run lasts, in the model's time unit.
    pub length: f64,
    /// Samples of all runs.
    pub samples: usize,
    /// How the iteration ended.
    pub termination: Termination,
    /// The parameters as in [`Estimate::parameters`](crate::Estimate::parameters), those that are not estimated left out.
    pub parameters: Vec<ParameterEstimate>,
}

impl LengthFit {
    pub(crate) fn new(runs: &[Run], fit: &Fit) -> Self {
        let ends = runs.iter().filter_map(|r| r.time.last());
        let open = |p: &&ParameterEstimate| !matches!(p.status, Status::Fixed | Status::Derived | Status::Tied);
        Self {
            length: ends.copied().fold(0.0, f64::max),
            samples: runs.iter().map(Run::len).sum(),
            termination: fit.estimate.termination.clone(),
            parameters: fit.estimate.parameters.iter().filter(open).cloned().collect(),
        }
    }
}

/// What was different about the weight of an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Weight {
    /// Its noise was taken as half of what it is.
    NoiseHalved,
    /// Its noise was taken as twice what it is.
    NoiseDoubled,
    /// It was not compared.
    LeftOut,
}

/// One fit with other weights.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Variation {
    /// The output whose weight was changed.
    pub output: String,
    /// What was different about it.
    pub weight: Weight,
    /// How the iteration ended.
    pub termination: Termination,
    /// Change of each parameter in its standard errors, in the order of [`Reweighting::parameters`]; none where the
    /// parameter is not determined with these weights.
    pub changes: Vec<Option<f64>>,
}

/// Estimates under other weights of the outputs.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Reweighting {
    /// The estimated parameters, with the noise of each output held at what was estimated.
    pub parameters: Vec<ParameterEstimate>,
    /// The variations, output by output.
    pub variations: Vec<Variation>,
}

impl Reweighting {
    /// Largest change of a parameter (by its place in `parameters`) in its standard errors; infinite when some variation
    /// leaves it undetermined.
    pub fn largest(&self, parameter: usize) -> f64 {
        let sizes = self.variations.iter().map(|v| v.changes[parameter].map_or(f64::INFINITY, f64::abs));
        sizes.fold(0.0, f64::max)
    }
}

/// How continuous a result of multiple shooting is.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Continuity {
    /// Segments of the run that has most.
    pub segments: usize,
    /// Largest gap at a cut, relative to the size of its state there.
    pub largest_gap: f64,
    /// Whether a fit of the uncut model followed, so that there are no cuts in the result.
    pub polished: bool,
}

/// An integration error above 1e-3 of an output's range, or one that may move an estimate by as much as its error.
#[derive(Debug, Clone, PartialEq)]
pub struct IntegrationFault {
    /// The run.
    pub run: String,
    /// The output.
    pub output: String,
    /// Time since the run began where the error is largest, in the model's time unit.
    pub time: f64,
    /// The error there, as a part of the output's range; infinite where the response with half of the steps is not finite.
    pub part: f64,
    /// The error there beside the standard deviation of the output's residual; none where nothing of it was compared.
    pub beside_residual: Option<f64>,
    /// By how many of its standard errors all errors together may move an estimate, at most; none where nothing was compared.
    pub shift: Option<f64>,
    /// The state that is farthest off there; none where that is not known.
    pub state: Option<String>,
    /// Whether method and steps were left to be chosen, so that nothing is gained by leaving them.
    pub chosen: bool,
}

/// Standard errors by which an estimate may be moved before it is that of the steps.
const MOVED: f64 = 1.0;
/// Whether errors may move an estimate that far: the root of the sum of their squares, over the standard deviation of the noise, bounds what least squares make of
/// them (Cauchy and Schwarz).
pub(crate) fn is_moving(norm: f64, deviation: f64) -> bool {
    norm > MOVED * deviation
}

impl IntegrationFault {
    /// Of the places where a run of a fit is integrated worst.
    pub(crate) fn of(fit: &Fit, run: &Run, worst: &[WorstError]) -> Vec<Self> {
        let definition = fit.model.definition();
        let of = |worst: &WorstError| {
            let output = definition.outputs[worst.output].quantity.name.clone();
            let matched = fit.estimate.outputs.iter().find(|o| o.run == run.name && o.name == output);
            let deviation = matched.and_then(|o| o.rms).map(|rms| rms.max(f64::MIN_POSITIVE));
            Self {
                run: run.name.clone(),
                output,
                time: run.time[worst.sample],
                part: worst.part,
                beside_residual: deviation.map(|deviation| worst.error / deviation),
                shift: deviation.map(|deviation| worst.norm / deviation),
                state: worst.state.map(|j| definition.states[j].quantity.name.clone()),
                chosen: false,
            }
        };
        worst.iter().map(of).collect()
    }

    /// Whether some estimate may be that of the steps, and not of the model.
    pub fn is_severe(&self) -> bool {
        self.shift.is_none_or(|shift| is_moving(shift, 1.0))
    }
}

impl fmt::Display for IntegrationFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { run, output, time, part, beside_residual, shift, state, .. } = self;
        if part.is_infinite() {
            write!(f, "run `{run}`: with half of the integration steps the response is not finite at time {time}")?;
        } else {
            write!(f, "run `{run}`: integration error {part:.0e} of the range of `{output}` at time {time}")?;
        }
        if let Some(state) = state {
            write!(f, ", where state `{state}` is farthest off")?;
        }
        if let Some(beside) = beside_residual.filter(|beside| beside.is_finite()) {
            write!(f, "; {beside:.1e} of the standard deviation of its residual")?;
        }
        if let Some(shift) = shift.filter(|shift| shift.is_finite()) {
            write!(f, ", which may move an estimate by up to {shift:.1} of its standard errors")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod integration_fault_tests {
    use crate::methods::output_error::options::FitOptions;
    use crate::methods::time_domain::fit;
    use crate::work::Work;
    use fdm_system::model::Model;
    use fdm_system::record::Run;

    /// A pendulum at full swing, seen four times in a period.
    fn faults(noise: f64, steps: usize) -> (bool, Vec<super::IntegrationFault>) {
        let text = "model m { input u; state x = 1; state v = 0; param w = 1; der(x) = v; der(v) = u - w*w*sin(x); output y = x; }";
        let model = Model::from_text("m.fdm", text).unwrap();
        let time: Vec<f64> = (0..40).map(|k| 1.2 * f64::from(k)).collect();
        let blank = Run {
            name: "r".into(),
            inputs: vec![0.0; time.len()],
            held: vec![false],
            measured: vec![0.0; time.len()],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0],
            time,
        };
        let mut simulator = fdm_system::simulate::Simulator::new(model.dynamics(), &blank, 64).unwrap();
        let mut measured = vec![0.0; blank.len()];
        simulator.simulate(&model.definition().start(), &mut measured).unwrap();
        let rough = |k: usize| noise * ((k * k * 7 % 11) as f64 / 5.0 - 1.0);
        measured.iter_mut().enumerate().for_each(|(k, y)| *y += rough(k));
        let run = Run { measured, ..blank };
        let found =
            fit(&model, &[run], &FitOptions { per_interval: Some(steps), ..FitOptions::default() }, &Work::default())
                .unwrap();
        (found.is_good(), found.integration_faults)
    }

    #[test]
    fn steps_that_are_fitted_instead_of_the_model_are_told_with_place_and_state() {
        let (good, found) = faults(1e-3, 1);
        assert!(!good && found[0].is_severe() && found[0].part > 1e-3, "{found:?}");
        assert!(found[0].state.is_some() && found[0].time > 0.0 && found[0].to_string().contains("`y`"), "{found:?}");
        // beside much more noise the same error does not matter, and is said all the same
        let (good, found) = faults(2.0, 2);
        assert!(good && found.iter().all(|f| !f.is_severe()), "{found:?}");
        assert!(faults(1e-3, 32).1.is_empty());
    }

    #[test]
    fn errors_far_below_the_noise_are_told_where_many_samples_average_it() {
        let text = "model m { input u; state x = 0; param a = 0.5; der(x) = u - a*x; output y = x; }";
        let model = Model::from_text("m.fdm", text).unwrap();
        let fault = |count: usize, steps: usize| {
            let time: Vec<f64> = (0..count).map(|k| 1.8 * k as f64).collect();
            let inputs: Vec<f64> = (0..count).map(|k| ((k / 7) % 2) as f64).collect();
            let (held, gaps) = (vec![true], vec![0]);
            let measured = vec![0.0; count];
            let blank = Run {
                name: "r".into(),
                time,
                inputs,
                held,
                measured,
                input_gaps: gaps.clone(),
                stated: Vec::new(),
                output_gaps: gaps,
            };
            let mut simulator = fdm_system::simulate::Simulator::new(model.dynamics(), &blank, 64).unwrap();
            let mut measured = vec![0.0; count];
            simulator.simulate(&model.definition().start(), &mut measured).unwrap();
            let mut normal = fdm_numeric::random::Normal(3);
            measured.iter_mut().for_each(|y| *y += 0.4 * normal.next());
            let run = Run { measured, ..blank };
            let options = FitOptions { per_interval: Some(steps), ..FitOptions::default() };
            let found = fit(&model, &[run], &options, &Work::default()).unwrap();
            let a = found.estimate.parameter("a", None).unwrap();
            let off = (a.value - 0.5) / a.standard_error.unwrap();
            (off, found.is_good(), found.integration_faults)
        };
        let ((off, good, faults), (right, sound, none)) = (fault(40_000, 1), fault(40_000, 16));
        assert!(!good && sound && none.is_empty(), "{faults:?} {none:?}");
        assert!(
            faults[0].beside_residual.unwrap() < 0.1 && faults[0].shift.unwrap() > (off - right).abs(),
            "{faults:?}"
        );
        assert!((off - right).abs() > 0.1, "{off} {right}");
        let (off, good, faults) = fault(100, 1);
        assert!(off.abs() < 2.5 && good, "{off} {faults:?}");
    }
}
