//! From a model and runs to a problem whose unknowns are parameters, intensities and deviations of the outputs.

use super::coordinates::Coordinates;
use super::filter_error::FilterError;
use super::kalman::Kalman;
use super::likelihood::{Deviation, Likelihood};
use super::programs::Programs;
use crate::estimate::errors::derived::DerivedQuantities;
use crate::estimate::iteration::priors::Priors;
use crate::estimate::noise::Noise;
use crate::estimate::problem::{Options, Problem, ProblemRun};
use crate::estimate::road::fit_error::FitError;
use crate::estimate::unknowns::Unknowns;
use crate::model::Model;
use crate::record::Run;
use crate::simulate::{Simulator, Steps};
use fdm_grammar::graph::Signal;
use fdm_grammar::model::{Origin, Param, Quantity};

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
const LEAST: f64 = 1e-8;

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
        let state = |s: &Signal| if let Signal::State(k) = s { Some(*k as usize) } else { None };
        if let Some(k) = model.layout().delayed.iter().find_map(state) {
            return Err(FilterError::DelayedState { state: definition.states[k].quantity.name.clone() });
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
        prepared.push(ProblemRun { name, response: Box::new(simulator), measured, start });
    }
    let outputs = model.definition().outputs.iter().map(|o| o.quantity.name.clone()).collect();
    let derived = DerivedQuantities::of(model.definition(), model.dynamics());
    Ok(Problem { params, outputs, runs: prepared, affine: Vec::new(), derived, carried_noise: None })
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
    Param {
        quantity: Quantity { name, doc: String::new(), unit: output.unit.clone() },
        origin: Origin::Declared,
        value: rough.max(1e-4 * size),
        lower: LEAST * size,
        upper: f64::INFINITY,
        fixed: false,
        per_run: false,
        prior: None,
    }
}
