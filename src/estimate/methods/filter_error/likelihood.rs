//! The likelihood of all runs' innovations at one vector of unknowns: parameters, intensities of process noise, and deviations of
//! measurement noise; and from a model and runs to what is filtered.

use super::fit::FilterError;
use super::jacobians::Programs;
use super::kalman::{Kalman, Score};
use crate::iteration::priors::Priors;
use crate::methods::output_error::error::FitError;
use crate::problem::noise::Noise;
use crate::problem::response::RunResponse;
use crate::problem::unknowns::DerivedQuantities;
use crate::problem::unknowns::Unknowns;
use crate::problem::{Options, Problem, ProblemRun};
use fdm_grammar::graph::Signal;
use fdm_grammar::model::{Origin, Param, Quantity};
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Divergence, Simulator, Steps};
use rayon::prelude::*;

/// The filters of all runs.
pub(super) struct Likelihood<'a> {
    filters: Vec<(Kalman<'a>, Memory)>,
    pub(super) unknowns: Unknowns,
    /// Number of parameters of the model; unknowns behind them are deviations of outputs.
    params: usize,
    /// For each output its known deviation, or the parameter that stands for it.
    noise: Vec<Deviation>,
    /// The sums over all runs.
    pub(super) score: Score,
    /// Passes with derivatives, and without.
    pub(super) passes: (usize, usize),
}

/// The deviation of an output.
#[derive(Debug, Clone, Copy)]
pub(super) enum Deviation {
    Known(f64),
    /// The parameter (index) behind the model's own.
    Unknown(usize),
}

/// All parameters of a run, deviations behind them, and how the last pass ended.
struct Memory {
    theta: Vec<f64>,
    deviations: Vec<f64>,
    failure: Option<Divergence>,
}

/// A run whose filter left the finite numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lost {
    pub(super) run: usize,
    pub(super) divergence: Divergence,
}

impl<'a> Likelihood<'a> {
    pub(super) fn new(filters: Vec<Kalman<'a>>, unknowns: Unknowns, params: usize, noise: Vec<Deviation>) -> Self {
        let size = unknowns.len();
        let memory =
            |theta: &Vec<f64>| Memory { theta: theta.clone(), deviations: vec![0.0; noise.len()], failure: None };
        let filters = filters.into_iter().zip(unknowns.theta.iter().map(memory)).collect();
        let score = Score { cost: 0.0, gradient: vec![0.0; size], information: vec![0.0; size * size] };
        Self { filters, unknowns, params, noise, score, passes: (0, 0) }
    }

    /// Evaluates at `values`; gradient and information too where these are wanted.
    ///
    /// # Errors
    /// The first run that fails.
    pub(super) fn evaluate(&mut self, values: &[f64], wanted: bool) -> Result<f64, Lost> {
        let (unknowns, params, noise) = (&self.unknowns, self.params, &self.noise);
        let work = |(run, (filter, memory)): (usize, &mut (Kalman<'a>, Memory))| {
            unknowns.assemble(run, values, &mut memory.theta);
            for (deviation, noise) in memory.deviations.iter_mut().zip(noise) {
                *deviation = match noise {
                    Deviation::Known(known) => *known,
                    Deviation::Unknown(k) => memory.theta[*k],
                };
            }
            memory.failure = filter.run(&memory.theta[..params], &memory.deviations, wanted).err();
        };
        match self.filters.len() == 1 || rayon::current_num_threads() == 1 {
            true => self.filters.iter_mut().enumerate().for_each(work),
            false => self.filters.par_iter_mut().enumerate().for_each(work),
        }
        if wanted {
            self.passes.0 += 1
        } else {
            self.passes.1 += 1
        }
        self.sum(wanted)
    }

    /// In the order of the runs, so that the number of threads does not change a bit.
    fn sum(&mut self, wanted: bool) -> Result<f64, Lost> {
        let (size, lanes) = (self.unknowns.len(), self.unknowns.columns.len());
        let mut cost = 0.0;
        if wanted {
            self.score.gradient.fill(0.0);
            self.score.information.fill(0.0);
        }
        for (run, (filter, memory)) in self.filters.iter().enumerate() {
            if let Some(divergence) = memory.failure {
                return Err(Lost { run, divergence });
            }
            cost += filter.score.cost;
            for i in (0..lanes).filter(|_| wanted) {
                let at = self.unknowns.position(run, i);
                self.score.gradient[at] += filter.score.gradient[i];
                for j in 0..lanes {
                    self.score.information[at * size + self.unknowns.position(run, j)] +=
                        filter.score.information[i * lanes + j];
                }
            }
        }
        self.score.cost = cost;
        Ok(cost)
    }

    /// One-step predictions of the last evaluation, run by run (N by q each).
    pub(super) fn predictions(&self) -> impl Iterator<Item = &Vec<f64>> {
        self.filters.iter().map(|(filter, _)| &filter.predicted)
    }
}

/// In which coordinates the search moves: deviations and intensities by parts of themselves, everything else as it is.
pub(super) struct Coordinates {
    /// Whether an unknown moves by its logarithm.
    pub(super) logarithmic: Vec<bool>,
    /// Bounds of the coordinates.
    pub(super) lower: Vec<f64>,
    pub(super) upper: Vec<f64>,
}

impl Coordinates {
    pub(super) fn new(logarithmic: Vec<bool>, lower: &[f64], upper: &[f64], start: &[f64]) -> Self {
        let bound = |j: usize, bound: f64| match logarithmic[j] {
            // least part of its start value that an unknown in logarithms goes down to
            true => bound.max(1e-12 * start[j]).ln(),
            false => bound,
        };
        let lower = lower.iter().enumerate().map(|(j, b)| bound(j, *b)).collect();
        let upper = upper.iter().enumerate().map(|(j, b)| bound(j, *b)).collect();
        Self { logarithmic, lower, upper }
    }

    pub(super) fn inwards(&self, values: &[f64]) -> Vec<f64> {
        values.iter().zip(&self.logarithmic).map(|(v, log)| if *log { v.ln() } else { *v }).collect()
    }

    pub(super) fn outwards(&self, points: &[f64]) -> Vec<f64> {
        points.iter().zip(&self.logarithmic).map(|(u, log)| if *log { u.exp() } else { *u }).collect()
    }

    /// Derivative of each unknown by its coordinate.
    pub(super) fn slope(&self, j: usize, value: f64) -> f64 {
        if self.logarithmic[j] { value } else { 1.0 }
    }

    /// As far as a quadratic of a logarithm is believed; anywhere for other unknowns.
    pub(super) fn reach(&self) -> Vec<f64> {
        const FACTOR: f64 = 1.5;
        self.logarithmic.iter().map(|log| if *log { FACTOR } else { f64::INFINITY }).collect()
    }
}

/// Everything that stays as it is while steps change.
pub(super) struct Setting<'a> {
    pub(super) runs: &'a [Run],
    pub(super) programs: Programs,
    pub(super) problem: Problem<'a>,
    pub(super) unknowns: Unknowns,
    /// Parameters of the model; those of the problem behind them are deviations.
    pub(super) params: usize,
    pub(super) noise: Vec<Deviation>,
    /// Parameters (of the problem) that move by parts of themselves.
    logarithmic: Vec<bool>,
}

/// Deviations stay above this part of an output's magnitude.
const LEAST_DEVIATION: f64 = 1e-8;

impl<'a> Setting<'a> {
    /// Looks at everything that must be right before anything is estimated; `model` has the changes that were asked for.
    ///
    /// # Errors
    /// [`FilterError`].
    pub(super) fn new(
        model: &'a Model,
        runs: &'a [Run],
        starts: &[Vec<f64>],
        options: &Options,
    ) -> Result<Self, FilterError> {
        let definition = model.definition();
        if definition.states.iter().all(|s| s.noise.is_none()) {
            return Err(FilterError::NoProcessNoise);
        }
        if let Some(table) = model.definition().tables.iter().find(|t| t.smooth.is_some()) {
            return Err(FilterError::SmoothTable { table: table.quantity.name.clone() });
        }
        let state = |s: &Signal| if let Signal::State(k) = s { Some(*k as usize) } else { None };
        if let Some(k) = model.layout().delayed.iter().find_map(state) {
            return Err(FilterError::DelayedState { state: definition.states[k].quantity.name.clone() });
        }
        if let Some(k) = model.layout().limited.first() {
            return Err(FilterError::Limit { state: definition.states[*k as usize].quantity.name.clone() });
        }
        if definition.has_events() {
            return Err(FilterError::Events);
        }
        let known = match options.noise.clone().or_declared(&definition.outputs) {
            Noise::Full => return Err(FilterError::FullNoise),
            Noise::Given(known) => known,
            Noise::Diagonal => vec![None; definition.outputs.len()],
        };
        let (mut params, intensities) = (definition.params.clone(), definition.only_in_noise());
        let first = starts.first().map_or(&[][..], Vec::as_slice);
        for (k, param) in params.iter_mut().enumerate() {
            // shared parameters go on from where a round before left them
            param.value = first.get(k).copied().filter(|_| !param.per_run).unwrap_or(param.value);
            if intensities[k] && !param.fixed {
                param.value = param.value.abs();
                param.lower = param.lower.max(0.0);
                if param.value == 0.0 {
                    return Err(FilterError::StartsAtZero { parameter: param.quantity.name.clone() });
                }
            }
        }
        let (own, mut noise, mut logarithmic) = (params.len(), Vec::new(), intensities);
        let q = known.len();
        for (o, known) in known.iter().enumerate() {
            noise.push(known.map_or(Deviation::Unknown(params.len()), Deviation::Known));
            if known.is_none() {
                let name = format!("noise {}", definition.outputs[o].quantity.name);
                params.push(deviation(name, &definition.outputs[o].quantity, runs, (o, q)));
                logarithmic.push(true);
            }
        }
        let problem = problem(model, runs, starts, params)?;
        let mistakes = problem.mistakes(&Options { noise: Noise::Diagonal, ..options.clone() });
        if !mistakes.is_empty() {
            return Err(FitError::Problem(mistakes).into());
        }
        let unknowns = Unknowns::new(&problem);
        Ok(Self { runs, programs: Programs::new(model), problem, unknowns, params: own, noise, logarithmic })
    }

    /// The filters of all runs on these steps.
    ///
    /// # Errors
    /// [`FitError::Unsuited`].
    pub(super) fn likelihood(&self, steps: &[Steps]) -> Result<Likelihood<'_>, FitError> {
        let columns = &self.unknowns.columns;
        let lane = |noise: &Deviation| match noise {
            Deviation::Unknown(k) => columns.iter().position(|c| c == k),
            Deviation::Known(_) => None,
        };
        let lanes: Vec<Option<usize>> = self.noise.iter().map(lane).collect();
        let mut filters = Vec::with_capacity(self.runs.len());
        for (run, steps) in self.runs.iter().zip(steps) {
            let filter = Kalman::new(&self.programs, run, steps, columns, lanes.clone());
            filters.push(filter.map_err(|e| FitError::unsuited(run, e))?);
        }
        Ok(Likelihood::new(filters, self.unknowns.clone(), self.params, self.noise.clone()))
    }

    /// The coordinates of the search from these values.
    pub(super) fn coordinates(&self, start: &[f64]) -> Coordinates {
        Coordinates::new(self.by_parts(), &self.unknowns.lower, &self.unknowns.upper, start)
    }

    /// By unknown whether it is an intensity or a deviation.
    pub(super) fn by_parts(&self) -> Vec<bool> {
        (0..self.unknowns.len()).map(|j| self.logarithmic[self.unknowns.owner(j).1]).collect()
    }

    /// By unknown whether it is an intensity.
    pub(super) fn is_intensity(&self, j: usize) -> bool {
        let (_, param) = self.unknowns.owner(j);
        param < self.params && self.logarithmic[param]
    }

    /// Unknowns with priors.
    pub(super) fn priors(&self) -> Priors {
        Priors::new(&self.problem, &self.unknowns)
    }
}

fn problem<'a>(
    model: &'a Model,
    runs: &'a [Run],
    starts: &[Vec<f64>],
    params: Vec<Param>,
) -> Result<Problem<'a>, FilterError> {
    let mut prepared = Vec::with_capacity(runs.len());
    for (run, theta) in runs.iter().zip(starts) {
        let simulator = Simulator::new(model.dynamics(), run, 1).map_err(|e| FitError::unsuited(run, e))?;
        let mut start: Vec<f64> = params.iter().map(|p| p.value).collect();
        start[..theta.len()].copy_from_slice(theta);
        let (name, measured) = (run.name.clone(), run.measured.clone());
        prepared.push(ProblemRun { name, response: RunResponse::in_time(simulator), measured, start });
    }
    let outputs = model.definition().outputs.iter().map(|o| o.quantity.name.clone()).collect();
    let derived = DerivedQuantities::of(model.definition(), model.dynamics());
    Ok(Problem::of(params, outputs, prepared, derived))
}

/// The deviation of an output's noise as a parameter, started at what third differences of the record say (a signal that is smooth
/// from sample to sample has none).
fn deviation(name: String, output: &Quantity, runs: &[Run], (o, q): (usize, usize)) -> Param {
    let (mut squares, mut count, mut size, mut cells) = (0.0, 0usize, 0.0, 0usize);
    for run in runs {
        let values: Vec<f64> = run.measured.chunks_exact(q).map(|row| row[o]).collect();
        for w in values.windows(4) {
            let third = w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0];
            if third.is_finite() {
                (squares, count) = (squares + third * third, count + 1);
            }
        }
        for z in values.iter().filter(|z| z.is_finite()) {
            (size, cells) = (size + z * z, cells + 1);
        }
    }
    let size = (size / cells.max(1) as f64).sqrt();
    let size = if size > 0.0 { size } else { 1.0 };
    let rough = (squares / (20.0 * count.max(1) as f64)).sqrt();
    let quantity = Quantity { name, doc: String::new(), unit: output.unit.clone() };
    let (value, lower) = (rough.max(1e-4 * size), LEAST_DEVIATION * size);
    Param { value, lower, ..Param::open(quantity, Origin::Declared) }
}
