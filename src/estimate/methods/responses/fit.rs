//! A model and sweeps to a fit of frequency responses, with its bounds of Cramer and Rao and insensitivities (Tischler and Remple 2012, chapter 11).

use super::decibels::{Decibels, Pair, measured_rows};
use super::measured::Measured;
use super::options::{ResponseError, ResponseOptions};
use crate::estimation::solve::estimate;
use crate::estimation::{Estimate, ParameterEstimate};
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::noise_model::without_output_noise;
use crate::methods::output_error::single::{changed, starts};
use crate::methods::spectra::bins::Reason;
use crate::methods::spectra::initial_conditions::{found_later, in_time, values_of};
use crate::methods::spectra::initial_conditions::{longest, unobservable_modes};
use crate::methods::spectra::setting::regressed_values;
use crate::methods::spectra::setting::{checked_model, seen, short_delays};
use crate::methods::spectra::{SpectralError, StartingValue, Unanswered, UnobservableMode};
use crate::problem::noise::Noise;
use crate::problem::response::RunResponse;
use crate::problem::unknowns::DerivedQuantities;
use crate::problem::{Problem, ProblemRun};
use crate::work::Budget;
use crate::work::Work;
use fdm_grammar::graph::Signal;
use fdm_system::linear::{LinearModel, Recorded, Structure, Trim};
use fdm_system::model::Model;
use fdm_system::record::Run;
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::sync::{Arc, PoisonError};

/// Measured and modelled response of one output to one input, at the frequencies that count.
#[derive(Debug, Clone, PartialEq)]
pub struct PairFit {
    /// The output.
    pub output: String,
    /// The input.
    pub input: String,
    /// Angular frequencies, rising, in radians per unit of time.
    pub omega: Vec<f64>,
    /// Measured decibels and degrees.
    pub measured: Vec<[f64; 2]>,
    /// The model's; degrees are those nearest to the measured ones.
    pub modelled: Vec<[f64; 2]>,
    /// Partial coherence.
    pub coherence: Vec<f64>,
    /// Random error of the magnitude, as a part of it, and of the phase in radians.
    pub error: Vec<f64>,
    /// Frequencies that were left out because their coherence is too low.
    pub left_out: usize,
    /// `J = (20/n) sum W (error in dB squared + 0.01745 error in degrees squared)`: below 100 good, below 50 as good as the data.
    pub cost: f64,
}

/// Estimates from frequency responses, and how they were reached.
#[derive(Debug, Clone)]
pub struct ResponseFit {
    /// The model with the changes that were asked for.
    pub model: Model,
    /// Estimates, their errors and the iteration. Its output and residuals are weighted decibels and degrees.
    pub estimate: Estimate,
    /// All pairs that were compared; empty when nothing could be computed at the start values.
    pub pairs: Vec<PairFit>,
    /// Pairs that the model connects and that are nowhere coherent.
    pub incoherent: Vec<(String, String)>,
    /// Lengths of the segments that were averaged.
    pub segments: Vec<f64>,
    /// Coherence below which a frequency does not count.
    pub least_coherence: f64,
    /// Bounds and insensitivities of the parameters.
    pub sensitivities: Vec<Sensitivity>,
    /// Where the model was linearised, when that matters.
    pub trim: Option<Trim>,
    /// Free parameters that are not identifiable from frequency responses.
    pub not_identifiable: Vec<String>,
    /// Starting values from equation error; empty when they were the model's own.
    pub starting_values: Vec<StartingValue>,
    /// Why a response could not be computed, when that ended the estimation.
    pub unanswered: Option<Unanswered>,
    /// Unstable modes that no output shows or no input moves: frequency responses cannot show them, and there is no finish in the time domain.
    pub unobservable: Vec<UnobservableMode>,
    /// Initial states, biases and what else frequency responses do not show, found in the time domain with the rest held.
    pub finish: Option<Fit>,
    /// Why there is no such fit although it was asked for.
    pub unfinished: Option<FitError>,
}

impl ResponseFit {
    /// The mean cost of all pairs; none when nothing was compared.
    pub fn cost(&self) -> Option<f64> {
        let sum: f64 = self.pairs.iter().map(|p| p.cost).sum();
        (!self.pairs.is_empty()).then(|| sum / self.pairs.len() as f64)
    }

    /// Lowest and highest frequency that counts, in cycles per unit of time.
    pub fn band(&self) -> (f64, f64) {
        let all = || self.pairs.iter().flat_map(|p| &p.omega).map(|w| w / TAU);
        (all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max))
    }

    /// Every parameter of the model: from frequency responses, or from the time domain where these do not show it.
    pub fn parameters(&self) -> Vec<ParameterEstimate> {
        found_later(&self.estimate.parameters, self.finish.as_ref(), &self.not_identifiable)
    }

    /// Whether the iteration converged, the data determine every free parameter, and no unstable mode is unobservable or uncontrollable.
    pub fn is_good(&self) -> bool {
        self.estimate.is_good() && self.unobservable.is_empty()
    }

    /// What the estimates predict of runs that took no part, with initial states and biases of their own.
    ///
    /// # Errors
    /// [`FitError`], as any fit in the time domain.
    pub fn predict(&self, runs: &[Run], work: &Work<'_>) -> Result<Fit, FitError> {
        in_time(&self.model, &values_of(&self.model, &self.estimate), &self.not_identifiable, runs, work)
    }
}

/// Estimates a model's parameters from the frequency responses that sweeps show: all that `fdm fit --method frequency-response` does, but reading and printing.
///
/// # Errors
/// [`ResponseError`]; a fit that ran and went wrong is an [`Estimate`] with its [`Termination`](crate::Termination).
pub fn fit_responses(
    model: &Model,
    runs: &[Run],
    options: &ResponseOptions,
    work: &Work<'_>,
) -> Result<ResponseFit, ResponseError> {
    let budget = Budget::new(work, options.options.total);
    let work = &work.unkept().within(&budget);
    // errors are those that the coherence gives
    let model = without_output_noise(&changed(model, &options.changes).map_err(SpectralError::of)?);
    let mut setting = Setting::new(&model, runs, options)?;
    let start = starts(&model, runs, &options.changes).swap_remove(0);
    let mut found = setting.estimated(&start, options, work)?;
    let mut first = regressed_values(&model, runs, &setting.seen, &options.frequencies, &options.changes);
    if first.iter().any(|f| !f.equations.is_empty()) {
        // of two starts the one that ends better
        let mut regressed = start.clone();
        for value in &first {
            model.definition().param(&value.parameter).into_iter().for_each(|k| regressed[k] = value.value);
        }
        let other = setting.estimated(&regressed, options, work)?;
        let rank = |e: &Estimate| (u8::from(!e.termination.is_good()), e.cost.unwrap_or(f64::INFINITY));
        if rank(&other) < rank(&found) { found = other } else { first.clear() }
    } else {
        first.clear();
    }
    let unanswered = setting.reason.lock().unwrap_or_else(PoisonError::into_inner).take();
    let params = &model.definition().params;
    let not_identifiable: Vec<String> = (params.iter().zip(&setting.seen))
        .filter(|(p, seen)| !p.fixed && !**seen)
        .map(|(p, _)| p.quantity.name.clone())
        .collect();
    let values = |p: &fdm_grammar::model::Param| found.parameter(&p.quantity.name, None).map_or(p.value, |e| e.value);
    let theta: Vec<f64> = params.iter().map(values).collect();
    let mut fit = ResponseFit {
        pairs: setting.compared(&model, &found),
        incoherent: setting.incoherent.clone(),
        segments: setting.measured.lengths.clone(),
        least_coherence: options.coherence,
        sensitivities: sensitivities(&found),
        trim: Some(setting.linear.trim(&theta)),
        not_identifiable,
        starting_values: first,
        unanswered: unanswered.filter(|_| !found.termination.is_good()),
        unobservable: unobservable_modes(&setting.linear, &theta, longest(runs)),
        finish: None,
        unfinished: None,
        model: model.clone(),
        estimate: found,
    };
    if options.finish && fit.estimate.termination.is_good() && fit.unobservable.is_empty() {
        match fit.predict(runs, work) {
            Ok(finish) => fit.finish = Some(finish),
            Err(e) => fit.unfinished = Some(e),
        }
    }
    Ok(fit)
}

/// A model as frequency responses see it, and what was measured.
struct Setting {
    linear: LinearModel,
    seen: Vec<bool>,
    measured: Measured,
    pairs: Vec<Pair>,
    incoherent: Vec<(String, String)>,
    params: Vec<fdm_grammar::model::Param>,
    model: Model,
    plans: Arc<fdm_system::frequency::Plans>,
    reason: Reason,
}

impl Setting {
    fn new(model: &Model, runs: &[Run], options: &ResponseOptions) -> Result<Self, ResponseError> {
        checked_model(model, runs)?;
        let definition = model.definition();
        // the response to an input is the response to its derivative too
        let source = |k: usize| definition.inputs[k].slope.map_or(k, |slope| slope.of as usize);
        let mut hidden = (0..definition.inputs.len()).filter(|k| !definition.inputs[source(*k)].is_declared());
        if let Some(hidden) = hidden.next().map(|k| &definition.inputs[k]) {
            return Err(ResponseError::Hidden(hidden.quantity.name.clone()));
        }
        if definition.inputs.is_empty() {
            return Err(ResponseError::NoInputs);
        }
        if !(0.0..1.0).contains(&options.coherence) {
            return Err(ResponseError::NoCoherence(options.coherence));
        }
        let recorded = Recorded::of(model.definition(), runs);
        let linear = LinearModel::near(model, &recorded).map_err(SpectralError::Trim)?;
        short_delays(model, &linear, longest(runs))?;
        let wanted = wanted(model, linear.structure(), options)?;
        let measured = Measured::new(model, runs, options)?;
        let (mut pairs, mut incoherent): (Vec<Pair>, Vec<_>) = Default::default();
        for (o, i) in wanted {
            let coherent = measured.coherent(o, i, options.coherence);
            if coherent.is_empty() {
                incoherent.push(names(model, o, i));
                continue;
            }
            let first = pairs.last().map_or(0, Pair::end);
            pairs.push(Pair::new(&measured, o, i, coherent, first));
        }
        if pairs.is_empty() {
            let best = measured.estimate.partial_coherence.iter().copied().fold(0.0, f64::max);
            return Err(ResponseError::Incoherent { least: options.coherence, best });
        }
        let seen = seen(linear.structure());
        let mut params = definition.params.clone();
        for (param, seen) in params.iter_mut().zip(&seen) {
            param.fixed |= !*seen;
            param.per_run = false;
        }
        let unknowns = params.iter().filter(|p| !p.fixed).count();
        let points = pairs.iter().map(|p| p.at.len()).sum();
        if 2 * points < unknowns {
            return Err(ResponseError::TooFewPoints { unknowns, points });
        }
        let (plans, reason) = (Arc::default(), Reason::default());
        Ok(Self { linear, seen, measured, pairs, incoherent, params, model: model.clone(), plans, reason })
    }

    /// The estimation from these values.
    fn estimated(&self, start: &[f64], options: &ResponseOptions, work: &Work<'_>) -> Result<Estimate, ResponseError> {
        let Self { linear, measured, pairs, plans, reason, .. } = self;
        let response = Decibels::new(linear, start, measured, pairs, plans, reason)
            .map_err(|e| ResponseError::Spectral(SpectralError::Unanswered(e)))?;
        let mut params = self.params.clone();
        params.iter_mut().zip(start).for_each(|(p, value)| p.value = *value);
        let (name, values) = ("frequency responses".to_string(), measured_rows(pairs));
        let run = ProblemRun {
            name: name.clone(),
            response: RunResponse::KnownNoise(Box::new(response)),
            measured: values,
            start: Vec::new(),
        };
        let derived = DerivedQuantities::of(self.model.definition(), self.model.dynamics());
        let mut problem = Problem::of(params, vec![name], vec![run], derived);
        let how = crate::problem::Options { noise: Noise::Diagonal, ..options.options.clone() };
        estimate(&mut problem, &how, work).map_err(ResponseError::Problem)
    }

    /// Measured and modelled responses at the estimates.
    fn compared(&self, model: &Model, estimate: &Estimate) -> Vec<PairFit> {
        let Some(result) = estimate.runs.first() else { return Vec::new() };
        let of = |pair: &Pair| {
            let (output, input) = names(model, pair.output, pair.input);
            let place = self.measured.estimate.pair(pair.output, pair.input).start;
            let coherence = self.measured.coherence(pair.output, pair.input);
            PairFit {
                output,
                input,
                omega: pair.at.iter().map(|k| self.measured.estimate.omega[*k]).collect(),
                measured: pair.measured.clone(),
                modelled: pair.modelled(&result.response),
                coherence: pair.at.iter().map(|k| coherence[*k]).collect(),
                error: pair.at.iter().map(|k| self.measured.estimate.error[place + k]).collect(),
                left_out: coherence.len() - pair.at.len(),
                cost: pair.cost(&result.residuals),
            }
        };
        self.pairs.iter().map(of).collect()
    }
}

fn names(model: &Model, output: usize, input: usize) -> (String, String) {
    let definition = model.definition();
    (definition.outputs[output].quantity.name.clone(), definition.inputs[input].quantity.name.clone())
}

/// The pairs that are to be compared: those that were asked for, else all that the model connects.
fn wanted(
    model: &Model,
    structure: &Structure,
    options: &ResponseOptions,
) -> Result<Vec<(usize, usize)>, ResponseError> {
    let definition = model.definition();
    let (q, m) = (definition.outputs.len(), definition.inputs.iter().filter(|i| i.is_declared()).count());
    let driven = |i: usize| {
        let own = definition.inputs.iter().enumerate();
        let own = own.map(|(k, input)| k == i || input.slope.is_some_and(|s| s.of as usize == i));
        own.collect::<Vec<bool>>()
    };
    let reached: Vec<Vec<bool>> = (0..m).map(|i| reached(structure, &driven(i))).collect();
    if options.pairs.is_empty() {
        let all = (0..q).flat_map(|o| (0..m).map(move |i| (o, i)));
        return Ok(all.filter(|(o, i)| reached[*i][*o]).collect());
    }
    let there = |names: Vec<&String>| names.into_iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
    let (outputs, inputs): (Vec<_>, Vec<_>) = (
        definition.outputs.iter().map(|o| &o.quantity.name).collect(),
        definition.inputs[..m].iter().map(|i| &i.quantity.name).collect(),
    );
    let find = |role, list: &Vec<&String>, name: &String| {
        let missing = || ResponseError::NoChannel { role, name: name.clone(), there: there(list.clone()) };
        list.iter().position(|n| *n == name).ok_or_else(missing)
    };
    let mut found = Vec::new();
    for (output, input) in &options.pairs {
        let pair = (find("output", &outputs, output)?, find("input", &inputs, input)?);
        if !reached[pair.1][pair.0] {
            return Err(ResponseError::NotConnected { output: output.clone(), input: input.clone() });
        }
        if !found.contains(&pair) {
            found.push(pair);
        }
    }
    Ok(found)
}

/// The outputs to which some inputs find a way through the coefficients.
fn reached(structure: &Structure, inputs: &[bool]) -> Vec<bool> {
    let n = structure.states;
    let mut rows = vec![false; n + structure.outputs];
    let source = |signal: usize| match signal.checked_sub(n + structure.inputs) {
        Some(d) => structure.delayed[d],
        None if signal < n => Signal::State(signal as u32),
        None => Signal::Input((signal - n) as u32),
    };
    for _ in 0..=n {
        for term in &structure.terms {
            let moved = match source(term.signal as usize) {
                Signal::State(k) => rows[k as usize],
                Signal::Input(k) => inputs[k as usize],
            };
            rows[term.row as usize] |= moved;
        }
    }
    rows.split_off(n)
}

/// How well the cost determines a parameter, in percent of its value: H are the second derivatives of the sum of all pairs' costs.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Sensitivity {
    /// The parameter.
    pub parameter: String,
    /// `100 * 2 sqrt((H^-1)_ii)/|theta_i|`: good up to 20.
    pub cramer_rao: f64,
    /// `100/(sqrt(H_ii) |theta_i|)`: good up to 10; more, and the parameter hardly moves the cost.
    pub insensitivity: f64,
}

/// The figures of all estimated parameters of which the covariance is known. Residuals are such that their squares add up to the cost.
pub(super) fn sensitivities(estimate: &Estimate) -> Vec<Sensitivity> {
    let (covariance, variance) = (&estimate.covariance, estimate.noise.as_ref().map_or(0.0, |n| n.values[0]));
    // the cost is the sum of squares, its second derivatives are twice the products of sensitivities
    let inverse = DMatrix::from_row_slice(covariance.size, covariance.size, &covariance.values) / (2.0 * variance);
    let Some(curvature) = inverse.clone().try_inverse() else { return Vec::new() };
    let figures = estimate.covered.iter().enumerate().map(|(k, p)| {
        let p = &estimate.parameters[*p];
        Sensitivity {
            parameter: p.name.clone(),
            cramer_rao: 200.0 * inverse[(k, k)].sqrt() / p.value.abs(),
            insensitivity: 100.0 / (curvature[(k, k)].sqrt() * p.value.abs()),
        }
    });
    figures.filter(|s| s.cramer_rao.is_finite() && s.insensitivity.is_finite()).collect()
}
