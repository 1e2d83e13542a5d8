//! Of all iterates of recursive least squares the one whose simulated error over the whole record is least (Ren and Feng 2010).

use crate::methods::equation_error::{RecursiveEstimates, RecursiveOptions, RegressionError, recursive};
use crate::methods::spectra::initial_conditions::with_initials;
use crate::problem::initial::initial_guess;
use crate::residuals::add_squares;
use fdm_grammar::model::Param;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Scheme, Simulator, StepOptions, Steps, choose_steps};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// By what an iterate is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Criterion {
    /// The error of the response to the recorded inputs.
    #[default]
    Simulation,
    /// The error of all steps from one measured sample to the next.
    OneStep,
    /// None: the last iterate is taken.
    Last,
}

/// What can be chosen.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BestOptions {
    /// The recursion.
    pub recursion: RecursiveOptions,
    /// By what the best iterate is chosen.
    pub criterion: Criterion,
    /// Length of the parts of the record that are simulated each from initial values of its own; the whole record when not given.
    /// For unstable vehicles, whose response to recorded inputs leaves the record before long.
    pub restart: Option<f64>,
}

/// The iterate that was chosen.
#[derive(Debug, Clone)]
pub struct BestIterate {
    /// All of them.
    pub recursion: RecursiveEstimates,
    /// By what it was chosen: one-step errors where no iterate could be simulated.
    pub criterion: Criterion,
    /// Which it is.
    pub best: usize,
    /// Iterates that were simulated, with their errors: mean over the outputs of the part of the mean square that is not met; none where the
    /// response left the finite numbers.
    pub simulated: Vec<(usize, Option<f64>)>,
    /// Mean over the outputs of the part of the mean square that least squares of all steps without forgetting does not
    /// meet; none where its response left the finite numbers.
    pub batch_error: Option<f64>,
    /// The model with the chosen values; those of a run are the mean of all runs.
    pub model: Model,
}

impl BestIterate {
    /// Whether no step of the records says anything about a parameter.
    pub fn is_undetermined(&self) -> bool {
        let best = self.recursion.iterates.get(self.best);
        !best.is_some_and(|i| i.values.iter().any(|v| v.is_finite()))
    }

    /// The simulated error of an iterate, if it was simulated.
    pub fn error_of(&self, iterate: usize) -> Option<f64> {
        self.simulated.iter().find(|(k, _)| *k == iterate)?.1
    }
}

/// Iterates that are simulated at most; of longer histories every so manieth, then all between the neighbours of the best.
const MOST: usize = 1000;

/// Follows the parameters along the records and chooses among the iterates.
///
/// # Errors
/// [`RegressionError`], as [`recursive`]; a restart that is no length of time.
pub fn best_iterate(model: &Model, runs: &[Run], options: &BestOptions) -> Result<BestIterate, RegressionError> {
    if let Some(restart) = options.restart.filter(|r| !(*r > 0.0 && r.is_finite())) {
        return Err(RegressionError::Restart(restart));
    }
    let recursion = recursive(model, runs, &options.recursion)?;
    let count = recursion.iterates.len();
    let judge = Judge::new(model, &recursion, options.restart);
    let least = |of: &mut dyn Iterator<Item = (usize, f64)>| of.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(k, _)| k);
    let mut simulated = Vec::new();
    let by_simulation = |simulated: &[(usize, Option<f64>)]| {
        least(&mut simulated.iter().filter_map(|(k, error)| Some((*k, (*error)?))))
    };
    if options.criterion == Criterion::Simulation && count > 0 {
        let stride = count.div_ceil(MOST);
        let mut chosen: Vec<usize> = (0..count).step_by(stride).chain([count - 1]).collect();
        chosen.dedup();
        simulated = judge.errors(&chosen);
        if let Some(best) = by_simulation(&simulated).filter(|_| stride > 1) {
            let near = best.saturating_sub(stride)..(best + stride).min(count);
            let near: Vec<usize> = near.filter(|k| chosen.binary_search(k).is_err()).collect();
            simulated.extend(judge.errors(&near));
            simulated.sort_by_key(|(k, _)| *k);
        }
    }
    let by_steps = || least(&mut recursion.iterates.iter().map(|i| i.one_step).enumerate());
    let (best, criterion) = match (options.criterion, by_simulation(&simulated)) {
        (Criterion::Last, _) => (count.saturating_sub(1), Criterion::Last),
        (Criterion::Simulation, Some(best)) => (best, Criterion::Simulation),
        _ => (by_steps().unwrap_or(0), Criterion::OneStep),
    };
    let batch_error = judge.error(&mut judge.simulators(), &recursion.batch);
    let values = recursion.iterates.get(best).map_or(&recursion.batch, |i| &i.values);
    let model = model.with_params(with_values(model, &recursion, values, None));
    Ok(BestIterate { criterion, best, simulated, batch_error, model, recursion })
}

/// The parameters with the values of an iterate: those of a run, or the mean of all runs.
fn with_values(model: &Model, recursion: &RecursiveEstimates, values: &[f64], run: Option<usize>) -> Vec<Param> {
    let mut params = model.definition().params.clone();
    for (k, param) in params.iter_mut().enumerate() {
        let own = recursion
            .places
            .iter()
            .zip(values)
            .filter(|((p, of), _)| *p == k && (run.is_none() || of.is_none() || *of == run));
        let own: Vec<f64> = own.map(|(_, value)| *value).collect();
        if !own.is_empty() {
            // what bounds exclude is no start of an estimation
            param.value = (own.iter().sum::<f64>() / own.len() as f64).max(param.lower).min(param.upper);
        }
    }
    params
}

/// Simulates iterates.
struct Judge<'a> {
    /// Where parts begin anew, with initial values of their own for all states.
    model: Model,
    recursion: &'a RecursiveEstimates,
    /// The runs, or their parts, with the run that each belongs to and its steps.
    parts: Vec<(Run, usize, Steps)>,
    /// Sum of squares about the mean of each output, and how often it was measured.
    spread: Vec<f64>,
}

impl<'a> Judge<'a> {
    fn new(model: &Model, recursion: &'a RecursiveEstimates, restart: Option<f64>) -> Self {
        let model = match restart {
            Some(_) => with_initials(model, &model.definition().start(), &|_| true),
            None => model.clone(),
        };
        let q = model.layout().outputs;
        let mut parts = Vec::new();
        for (r, run) in recursion.runs.iter().enumerate() {
            for part in cut(run, restart) {
                let params = with_values(&model, recursion, &recursion.batch, Some(r));
                let theta = initial_guess(&params, model.dynamics(), &part);
                let steps = choose_steps(model.dynamics(), &part, &theta, &StepOptions::default()).map(|a| a.steps);
                parts.push((part, r, steps.unwrap_or_else(|_| Steps::equal(Scheme::RungeKutta, 1))));
            }
        }
        let spread = (0..q).map(|o| {
            let cells = || {
                recursion.runs.iter().flat_map(move |r| r.measured.iter().skip(o).step_by(q)).filter(|z| !z.is_nan())
            };
            let (count, sum) = cells().fold((0.0, 0.0), |(n, s), z| (n + 1.0, s + z));
            cells().map(|z| (z - sum / f64::max(count, 1.0)).powi(2)).sum()
        });
        Self { model, recursion, spread: spread.collect(), parts }
    }

    fn simulators(&self) -> Vec<Option<Simulator<'_>>> {
        let dynamics = self.model.dynamics();
        self.parts.iter().map(|(part, _, steps)| Simulator::new(dynamics, part, steps.clone()).ok()).collect()
    }

    /// The errors of some iterates, each for itself, so that the number of threads changes nothing.
    fn errors(&self, chosen: &[usize]) -> Vec<(usize, Option<f64>)> {
        let one = |simulators: &mut Vec<Option<Simulator<'_>>>, k: &usize| {
            (*k, self.error(simulators, &self.recursion.iterates[*k].values))
        };
        chosen.par_iter().map_init(|| self.simulators(), one).collect()
    }

    /// Part of the mean square of each output that the response with these values does not meet, mean over the outputs.
    fn error(&self, simulators: &mut [Option<Simulator<'_>>], values: &[f64]) -> Option<f64> {
        let q = self.spread.len();
        let mut left = vec![(0.0, 0); q];
        for ((part, run, _), simulator) in self.parts.iter().zip(simulators) {
            let params = with_values(&self.model, self.recursion, values, Some(*run));
            let theta = initial_guess(&params, self.model.dynamics(), part);
            let mut y = vec![0.0; part.measured.len()];
            simulator.as_mut()?.simulate(&theta, &mut y).ok()?;
            add_squares(&mut left, &part.measured, &y);
        }
        let moved = || left.iter().zip(&self.spread).filter(|(_, s)| **s > 0.0);
        let error = moved().map(|((left, _), spread)| left / spread).sum::<f64>() / moved().count().max(1) as f64;
        error.is_finite().then_some(error)
    }
}

/// A run in parts of some length; their times stay those of the record.
fn cut(run: &Run, length: Option<f64>) -> Vec<Run> {
    let Some(length) = length else { return vec![run.clone()] };
    let mut parts = Vec::new();
    let mut first = 0;
    while first + 1 < run.len() {
        let end = (first + 1..run.len()).find(|k| run.time[*k] - run.time[first] >= length).unwrap_or(run.len() - 1);
        parts.push(run.part(first..end + 1));
        first = end;
    }
    parts
}
