//! What can be chosen about an output-error fit in the time domain.
//!
//! One attempt at a fit: everything that it takes.

use super::error::FitError;
use crate::estimation::Estimate;
use crate::methods::equation_error;
use crate::methods::equation_error::RegressionOptions;
use crate::methods::output_error::loss::Loss;
use crate::methods::responses::ResponseOptions;
use crate::methods::spectra::{Nonlinear, SpectralOptions};
use crate::problem::method::{Domain, Method};
use crate::problem::response::RunResponse;
use crate::problem::unknowns::Changes;
use crate::problem::unknowns::DerivedQuantities;
use crate::problem::{Options, Problem, ProblemRun};
use crate::work::Work;
use fdm_system::frequency::EndTerms;
use fdm_system::model::Model;
use fdm_system::record::{Censored, Run};
use fdm_system::simulate::{Accuracy, Scheme, Simulator, Steps, UNSOUND};
use fdm_system::spectrum::Frequencies;
use serde::Serialize;
use std::str::FromStr;

/// What a user may choose about a fit.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct FitOptions {
    /// What is minimised.
    pub method: Method,
    /// On what data.
    pub domain: Domain,
    /// Start values, and which parameters are fixed and free.
    pub changes: Changes,
    /// How to estimate.
    pub options: Options,
    /// What is made of residuals; other than squares by output error in the time domain only.
    #[serde(skip_serializing_if = "Loss::is_squares")]
    pub loss: Loss,
    /// Samples of which only a limit is known that they lie below; by output error in the time domain only.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub censored: Vec<Censored>,
    /// Equal steps between neighbouring samples; chosen for accuracy when not given.
    pub per_interval: Option<usize>,
    /// How to integrate; chosen for accuracy and speed when not given.
    pub scheme: Option<Scheme>,
    /// Integration error that is of no consequence, as a part of each output's range; 1e-8 when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accuracy: Option<f64>,
    /// Whether and how the record is fitted by continuation: a short part of it first, then longer ones.
    pub continuation: Continuation,
    /// States whose measured record takes their place in the equations of a first fit, whose result starts the fit of the
    /// full model; `all` for every state that is measured.
    pub substitute: Vec<String>,
    /// Whether and how the record is cut for multiple shooting.
    pub shooting: Option<Shooting>,
    /// Fit shorter records too and order the parameters by confidence ([`Fit::by_length`](crate::Fit::by_length)).
    pub confidence: bool,
    /// Fit with other weights of the outputs too ([`Fit::reweighting`](crate::Fit::reweighting)).
    pub reweight: bool,
    /// From how many starts to fit.
    pub starts: MultiStart,
    /// Steps that these starts have in common.
    pub shared_steps: SharedSteps,
    /// Estimates and their errors alone: the residuals are not judged, nor is the integration where its steps were given
    /// (its error is then not a number). For fits by the thousand.
    pub bare: bool,
    /// What may be chosen in the frequency domain.
    pub frequency: FrequencyOptions,
    /// What may be chosen about equation error; its domain is that of the fit.
    pub regression: RegressionOptions,
}

/// What may be chosen in the frequency domain.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrequencyOptions {
    /// At which frequencies.
    pub frequencies: Frequencies,
    /// What is done about the end terms of the transforms.
    pub ends: EndTerms,
    /// What is done about nonlinear terms.
    pub nonlinear: Nonlinear,
    /// Standard deviations of the noise of recorded inputs, by name.
    pub input_noise: Vec<(String, f64)>,
    /// Whether the estimation begins with values from equation error, where states are measured.
    pub regressed: bool,
    /// Whether initial states and biases are found in the time domain afterwards.
    pub finish: bool,
    /// Of frequency responses: lengths of the segments that are averaged, in the model's time; none for two of them.
    pub segments: Vec<f64>,
    /// Of frequency responses: pairs of output and input that are compared; none for all that the model connects.
    pub pairs: Vec<(String, String)>,
    /// Of frequency responses: coherence below which a frequency does not count.
    pub coherence: f64,
}

impl Default for FrequencyOptions {
    fn default() -> Self {
        let SpectralOptions { frequencies, ends, nonlinear, input_noise, regressed, finish, .. } =
            SpectralOptions::default();
        let ResponseOptions { segments, pairs, coherence, .. } = ResponseOptions::default();
        Self { frequencies, ends, nonlinear, input_noise, regressed, finish, segments, pairs, coherence }
    }
}

impl FitOptions {
    /// Those of a fit of spectra.
    pub fn of_spectra(&self) -> SpectralOptions {
        let FrequencyOptions { frequencies, ends, nonlinear, input_noise, regressed, finish, .. } =
            self.frequency.clone();
        let (changes, options) = (self.changes.clone(), self.options.clone());
        SpectralOptions { changes, options, frequencies, ends, nonlinear, input_noise, regressed, finish }
    }

    /// Those of a fit of frequency responses.
    pub fn of_responses(&self) -> ResponseOptions {
        let FrequencyOptions { frequencies, segments, pairs, coherence, finish, .. } = self.frequency.clone();
        let (changes, options) = (self.changes.clone(), self.options.clone());
        ResponseOptions { changes, options, frequencies, segments, pairs, coherence, finish }
    }

    /// Those of equation error.
    pub fn of_regression(&self) -> RegressionOptions {
        let domain = match self.domain {
            Domain::Time => equation_error::Domain::Time,
            Domain::Frequency => equation_error::Domain::Frequency(self.frequency.frequencies.clone()),
        };
        RegressionOptions { domain, ..self.regression.clone() }
    }

    /// These options, but noise that the model declares is known where all variances were to be estimated.
    pub fn with_declared_noise(mut self, model: &Model) -> Self {
        self.options.noise = self.options.noise.or_declared(&model.definition().outputs);
        self
    }
}

/// Whether and how a record is fitted by record-length continuation: a short part of it first, then longer ones.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub enum Continuation {
    /// Only as a fallback strategy, when the start values cannot be used or lead astray.
    #[default]
    Auto,
    /// Never.
    Never,
    /// These shares of every run, rising; the whole record comes last without being asked for.
    Shares(Vec<f64>),
    /// Up to these times since the run began, in the model's time unit, rising; the whole record comes last.
    Times(Vec<f64>),
}

impl FromStr for Continuation {
    type Err = String;

    /// `auto`, `never`, a number of equal lengths, or rising times divided by commas.
    fn from_str(text: &str) -> Result<Self, String> {
        const WANTED: &str = "`auto`, `never`, a number of lengths from 2 on, or rising times such as 5,10,20";
        match text.trim() {
            "auto" => Ok(Self::Auto),
            "never" => Ok(Self::Never),
            list if list.contains(',') || list.contains('.') => {
                let times = list.split(',').filter(|t| !t.trim().is_empty()).map(|t| t.trim().parse::<f64>());
                let times: Vec<f64> = times.collect::<Result<_, _>>().map_err(|_| format!("expected {WANTED}"))?;
                let rising = times.windows(2).all(|w| w[0] < w[1]) && times.iter().all(|t| t.is_finite() && *t > 0.0);
                if rising && !times.is_empty() { Ok(Self::Times(times)) } else { Err(format!("expected {WANTED}")) }
            }
            number => match number.parse::<u32>() {
                Ok(n) if (2..=1000).contains(&n) => {
                    Ok(Self::Shares((1..=n).map(|k| f64::from(k) / f64::from(n)).collect()))
                }
                _ => Err(format!("expected {WANTED}")),
            },
        }
    }
}

/// How the record is cut.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub enum Shooting {
    /// So many segments in each run.
    Segments(usize),
    /// Segments of this length, in the model's time unit.
    Length(f64),
}

/// From how many starts to fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct MultiStart {
    /// Number of starts, the given one included.
    pub count: usize,
    /// Chooses the others.
    pub seed: u64,
}

impl Default for MultiStart {
    fn default() -> Self {
        Self { count: 1, seed: 0 }
    }
}

/// Steps of each run that were chosen once for many starts: what they reach is then comparable, and wild start values do not
/// ask for wildly fine steps.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct SharedSteps {
    /// Empty when every start chooses its own.
    steps: Vec<Steps>,
    /// Whether steps count as good enough that a result must not be reported with.
    provisional: bool,
}

/// Integration errors at the estimates above this part of an output's range are worth another round with finer steps.
const COARSE: f64 = 1e-7;

impl SharedSteps {
    /// The steps that were chosen for the given start, unless it cannot be simulated.
    pub fn of(chosen: Vec<Accuracy>) -> Self {
        let usable = chosen.iter().all(|a| a.error.is_finite());
        let steps = if usable { chosen.into_iter().map(|a| a.steps).collect() } else { Vec::new() };
        Self { steps, provisional: false }
    }

    /// These steps for starts of which only the best is looked at once more.
    pub(crate) fn provisional(&self) -> Self {
        Self { steps: self.steps.clone(), provisional: !self.steps.is_empty() }
    }

    /// Whether only the best of many starts is looked at once more.
    pub(crate) fn is_provisional(&self) -> bool {
        self.provisional
    }

    /// The integration error that calls for finer steps where this accuracy was asked for.
    pub(crate) fn coarse(&self, accuracy: Option<f64>) -> f64 {
        let coarse = accuracy.map_or(COARSE, |accuracy| 10.0 * accuracy);
        if self.provisional { UNSOUND.max(coarse) } else { coarse }
    }

    /// The steps of these runs, or of parts of them from their beginnings; none where they cannot be simulated with them.
    pub(crate) fn steps(&self, model: &Model, runs: &[Run], starts: &[Vec<f64>]) -> Option<Vec<Steps>> {
        if self.steps.len() != runs.len() || runs.is_empty() {
            return None;
        }
        let steps: Vec<Steps> = self.steps.iter().zip(runs).map(|(steps, run)| steps.part(0..run.len())).collect();
        let reached = |((run, theta), steps): ((&Run, &Vec<f64>), &Steps)| {
            let Ok(mut simulator) = Simulator::new(model.dynamics(), run, steps.clone()) else { return false };
            let mut y = vec![0.0; simulator.samples() * simulator.outputs()];
            simulator.suits(theta).is_ok() && simulator.simulate(theta, &mut y).is_ok()
        };
        runs.iter().zip(starts).zip(&steps).all(reached).then_some(steps)
    }
}

/// A model and runs, where its parameters begin, how they are estimated, and the work that this is. Another attempt is this one with
/// something else in it: `Attempt { starts: &reached, ..attempt }`.
#[derive(Clone, Copy)]
pub struct Attempt<'a> {
    /// The model, with the changes that the options ask for.
    pub model: &'a Model,
    /// The runs.
    pub runs: &'a [Run],
    /// Start values: all parameters of each run (see [`starts`](crate::starts)).
    pub starts: &'a [Vec<f64>],
    /// How it is fitted.
    pub options: &'a FitOptions,
    /// When it ends, and who follows it.
    pub work: &'a Work<'a>,
}

impl<'a> Attempt<'a> {
    /// The problem of these runs with these steps; what all runs share begins where the first one does.
    ///
    /// # Errors
    /// [`FitError::Unsuited`] for a run that the model cannot be simulated on.
    pub(crate) fn problem(&self, steps: &[Steps]) -> Result<Problem<'a>, FitError> {
        let Self { model, runs, starts, options, .. } = *self;
        let one = |((run, theta), steps): ((&'a Run, &Vec<f64>), &Steps)| {
            let response = RunResponse::in_time(suited(model, run, theta, steps.clone())?);
            let (name, measured, start) = (run.name.clone(), run.measured.clone(), theta.clone());
            Ok(ProblemRun { name, response, measured, start })
        };
        let prepared = runs.iter().zip(starts).zip(steps).map(one).collect::<Result<_, FitError>>()?;
        let derived = DerivedQuantities::of(model.definition(), model.dynamics());
        let mut problem = Problem { bare: options.bare, ..Problem::new(model.definition(), prepared, derived) };
        if let Some(first) = starts.first() {
            problem.params.iter_mut().zip(first).filter(|(p, _)| !p.per_run).for_each(|(p, v)| p.value = *v);
        }
        Ok(problem)
    }

    /// The estimates as start values: all parameters of each run; its start where nothing was estimated.
    pub(crate) fn reached(&self, estimate: &Estimate) -> Vec<Vec<f64>> {
        after(self.model, self.runs, estimate, self.starts)
    }
}

/// The simulator of a run, which these parameters suit.
///
/// # Errors
/// [`FitError::Unsuited`]
pub(crate) fn suited<'a>(
    model: &'a Model,
    run: &'a Run,
    theta: &[f64],
    steps: Steps,
) -> Result<Simulator<'a>, FitError> {
    let mut simulator = Simulator::new(model.dynamics(), run, steps).map_err(|e| FitError::unsuited(run, e))?;
    simulator.suits(theta).map_err(|e| FitError::unsuited(run, e))?;
    Ok(simulator)
}

/// The estimates as start values; `starts` where nothing was estimated.
pub(crate) fn after(model: &Model, runs: &[Run], estimate: &Estimate, starts: &[Vec<f64>]) -> Vec<Vec<f64>> {
    runs.iter().zip(starts).map(|(run, start)| at(model, estimate, &run.name, start)).collect()
}

/// All parameters of a run at the estimates.
fn at(model: &Model, estimate: &Estimate, run: &str, start: &[f64]) -> Vec<f64> {
    let params = model.definition().params.iter().zip(start);
    params
        .map(|(p, start)| {
            let owner = p.per_run.then_some(run);
            estimate.parameter(&p.quantity.name, owner).map_or(*start, |e| e.value)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_numbers_and_times_are_told_apart() {
        let read = |text: &str| text.parse::<Continuation>();
        assert_eq!(read("auto"), Ok(Continuation::Auto));
        assert_eq!(read("never"), Ok(Continuation::Never));
        assert_eq!(read("4"), Ok(Continuation::Shares(vec![0.25, 0.5, 0.75, 1.0])));
        assert_eq!(read("5, 10,20"), Ok(Continuation::Times(vec![5.0, 10.0, 20.0])));
        assert_eq!(read("2.5"), Ok(Continuation::Times(vec![2.5])));
        for wrong in ["", "1", "10,5", "-1,2", "1,nan", "some", "0"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
