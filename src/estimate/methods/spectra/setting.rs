//! From a model and runs to a problem of coefficients: what is linear, which frequencies, which end-point corrections, which unknowns.
//!
//! A coefficient of noise has a variance in inverse proportion to the length of its record. Spectra are therefore scaled by the root of their length, so that
//! those of all runs have the noise of one spectral density; the response is linear in inputs and end values and is scaled with them.
//!
//! Starting values from equation error: where states are measured, their equations are regressions that need no start.

use super::bins::{Reason, SpectralResponse};
use super::error::{SpectralError, Unanswered};
use super::initial_conditions::longest;
use super::options::{Nonlinear, SpectralOptions};
use super::regressor_noise::with_areas;
use crate::methods::equation_error::{Domain, Regressed, RegressionOptions, regress};
use crate::problem::noise::Noise;
use crate::problem::response::RunResponse;
use crate::problem::response::affine;
use crate::problem::unknowns::Changes;
use crate::problem::unknowns::DerivedQuantities;
use crate::problem::{Problem, ProblemRun};
use fdm_grammar::carried::CarriedTerm;
use fdm_grammar::graph::{Leaf, Signal};
use fdm_grammar::model::{Origin, Param, Quantity};
use fdm_system::frequency::{EndColumn, EndTerms, Plans};
use fdm_system::linear::{LinearModel, Recorded, Structure, Values};
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::spectrum::{Ends, Frequencies, Spectrum, SpectrumError, SpectrumOptions};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Part of a channel's power that the band holds when none was chosen.
const KEPT: f64 = 0.995;
/// Fewest frequencies of such a band.
const FEWEST: f64 = 10.0;
/// Most coefficients of all channels of a band whose spacing was chosen: a finer one shows nothing more, and takes memory.
const MOST: usize = 1 << 22;
/// Smallest eigenvalue of the correlations of outputs that are not combinations of each other.
const DEPENDENT: f64 = 1e-12;

/// A model as the frequency domain sees it, and the runs.
pub(super) struct Setting {
    /// Affine in states and inputs, or to be linearised.
    pub(super) model: Model,
    pub(super) linear: LinearModel,
    /// Nonlinear terms that are computed from records.
    pub(super) measured_regressors: Vec<CarriedTerm>,
    /// For each parameter whether a coefficient or a delay depends on it (p).
    pub(super) seen: Vec<bool>,
    pub(super) spectra: Vec<Spectrum>,
    /// Parameters of the problem: the model's, those fixed that are not identifiable, then end values.
    pub(super) params: Vec<Param>,
    ends: EndTerms,
    /// Scaled to one noise density.
    pub(super) weighted: Vec<Spectrum>,
    plans: Arc<Plans>,
    pub(super) reason: Reason,
}

impl Setting {
    /// Looks at everything that must be right before anything is estimated; `model` has the changes that were asked for.
    ///
    /// # Errors
    /// [`SpectralError`].
    pub(super) fn new(model: &Model, runs: &[Run], options: &SpectralOptions) -> Result<Self, SpectralError> {
        if model.definition().has_events() {
            return Err(SpectralError::Events);
        }
        let (model, measured_regressors) = linear_or_regressed(model, options.nonlinear)?;
        checked_model(&model, runs)?;
        let recorded = Recorded::of(model.definition(), runs);
        let linear = LinearModel::near(&model, &recorded).map_err(SpectralError::Trim)?;
        short_delays(&model, &linear, longest(runs))?;
        let runs: Result<Vec<Run>, _> = runs.iter().map(|r| r.with_measured(model.definition())).collect();
        let spectra = spectra(&model, &runs.map_err(SpectralError::Incomplete)?, options)?;
        let seen = seen(linear.structure());
        let mut params = model.definition().params.clone();
        params.iter_mut().zip(&seen).filter(|(_, seen)| !**seen).for_each(|(p, _)| p.fixed = true);
        let weighted = on_one_footing(&spectra);
        let mut setting = Self {
            model,
            linear,
            measured_regressors,
            seen,
            spectra,
            params,
            ends: options.ends.clone(),
            weighted,
            plans: Arc::default(),
            reason: Reason::default(),
        };
        setting.settle_ends()?;
        setting.enough()?;
        setting.powered()?;
        if options.options.noise == Noise::Full {
            independent(&setting.model, &setting.spectra)?;
        }
        Ok(setting)
    }

    /// The end values behind the model's parameters, the same ones for all runs.
    fn settle_ends(&mut self) -> Result<(), SpectralError> {
        let mut columns = self.end_columns()?;
        if columns.windows(2).any(|pair| pair[0] != pair[1]) {
            // where one run shows what another does not, all are found
            self.ends = EndTerms::Unknown;
            columns = self.end_columns()?;
        }
        for column in columns.first().into_iter().flatten() {
            let state = &self.model.definition().states[column.state].quantity;
            self.params.push(end_value(column.name(&state.name), state));
        }
        Ok(())
    }

    fn end_columns(&self) -> Result<Vec<Vec<EndColumn>>, SpectralError> {
        let columns = |s: &Spectrum| self.response(s).map(|r| r.inner().end_columns().to_vec());
        self.weighted.iter().map(columns).collect()
    }

    /// The response to the inputs of one of `weighted`.
    pub(super) fn response(&self, spectrum: &Spectrum) -> Result<SpectralResponse, SpectralError> {
        self.response_of(&self.linear, spectrum)
    }

    /// The response of a model with other outputs to the inputs of one of `weighted`.
    pub(super) fn response_of(
        &self,
        linear: &LinearModel,
        spectrum: &Spectrum,
    ) -> Result<SpectralResponse, SpectralError> {
        let theta = self.model.definition().start();
        SpectralResponse::new(linear, &theta, spectrum, &self.ends, &self.plans, &self.reason)
            .map_err(|why| SpectralError::Unanswered(self.named(why)))
    }

    /// A failure in the names of the model.
    pub(super) fn named(&self, why: Unanswered) -> Unanswered {
        why.named(self.model.definition(), self.linear.structure())
    }

    /// Number of the model's own parameters p.
    pub(super) fn own(&self) -> usize {
        self.linear.structure().params
    }

    /// Whether there are more numbers than unknowns.
    fn enough(&self) -> Result<(), SpectralError> {
        let outputs = self.linear.structure().outputs;
        let frequencies = self.spectra.iter().map(Spectrum::independent).sum::<f64>().round() as usize;
        let ends = (self.params.len() - self.own()) * self.spectra.len();
        let own = self.params[..self.own()].iter().filter(|p| !p.fixed);
        let unknowns = ends + own.map(|p| if p.per_run { self.spectra.len() } else { 1 }).sum::<usize>();
        match 2 * frequencies * outputs >= unknowns {
            true => Ok(()),
            false => Err(SpectralError::TooFewFrequencies { unknowns, ends, frequencies, outputs }),
        }
    }

    /// Whether every input moves whose coefficients are to be found.
    fn powered(&self) -> Result<(), SpectralError> {
        for k in self.unexcited() {
            let parameters = self.told_by(k);
            if !parameters.is_empty() {
                let input = self.model.definition().inputs[k].quantity.name.clone();
                return Err(SpectralError::NoPower { input, parameters, band: band(&self.spectra) });
            }
        }
        Ok(())
    }

    /// Inputs that the equations see and that do not move in any run.
    pub(super) fn unexcited(&self) -> Vec<usize> {
        let unexcited: Vec<Vec<usize>> = self.spectra.iter().map(Spectrum::inputs_without_power).collect();
        let s = self.linear.structure();
        let drives = |k: usize| s.terms.iter().any(|t| self.is_input(t.signal as usize, k));
        (0..s.inputs).filter(|k| drives(*k) && unexcited.iter().all(|s| s.contains(k))).collect()
    }

    /// Whether a signal is an input, delayed or not.
    fn is_input(&self, signal: usize, input: usize) -> bool {
        let s = self.linear.structure();
        match signal.checked_sub(s.states + s.inputs) {
            Some(d) => s.delayed[d] == Signal::Input(input as u32),
            None => signal == s.states + input,
        }
    }

    /// Free parameters that an input alone moves by their coefficients.
    fn told_by(&self, input: usize) -> Vec<String> {
        let s = self.linear.structure();
        let is = |signal: usize| self.is_input(signal, input);
        let told = |k: &usize| {
            let mut slopes = s.slopes.iter().filter(|slope| slope.param as usize == *k).peekable();
            slopes.peek().is_some() && slopes.all(|slope| is(s.terms[slope.term as usize].signal as usize))
        };
        let free = (0..self.own()).filter(|k| !self.params[*k].fixed).filter(told);
        free.map(|k| self.params[k].quantity.name.clone()).collect()
    }

    /// The problem; `starts` are all parameters of each run (p).
    ///
    /// # Errors
    /// [`SpectralError::Unanswered`].
    pub(super) fn problem(&self, starts: &[Vec<f64>]) -> Result<Problem<'_>, SpectralError> {
        let mut runs = Vec::with_capacity(self.spectra.len());
        for (spectrum, start) in self.weighted.iter().zip(starts) {
            let mut start = start.clone();
            start.resize(self.params.len(), 0.0);
            let response = self.response(spectrum)?;
            let (name, measured) = (spectrum.name.clone(), samples(spectrum));
            runs.push(ProblemRun { name, response: RunResponse::Coefficients(Box::new(response)), measured, start });
        }
        let definition = self.model.definition();
        let derived = DerivedQuantities::of(definition, self.model.dynamics());
        let mut problem = Problem::new(definition, runs, derived);
        problem.affine = if is_linear(&self.model) { affine(definition) } else { Vec::new() };
        problem.affine.extend(self.own()..self.params.len());
        problem.params = self.params.clone();
        if let Some(first) = starts.first() {
            problem.params.iter_mut().zip(first).filter(|(p, _)| !p.per_run).for_each(|(p, v)| p.value = *v);
        }
        Ok(problem)
    }
}

/// Lowest and highest frequency of all spectra, in cycles per unit of time.
pub(super) fn band(spectra: &[Spectrum]) -> (f64, f64) {
    let all = || spectra.iter().flat_map(|s| &s.omega).map(|w| w / TAU);
    (all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max))
}

pub(super) fn is_linear(model: &Model) -> bool {
    let affine = &model.layout().affine;
    affine.rates && affine.outputs.iter().all(|o| *o)
}

/// The model with its nonlinear terms as measured regressors, where that was asked for or is possible.
fn linear_or_regressed(model: &Model, nonlinear: Nonlinear) -> Result<(Model, Vec<CarriedTerm>), SpectralError> {
    if nonlinear == Nonlinear::Linearised || is_linear(model) {
        return Ok((model.clone(), Vec::new()));
    }
    match model.definition().carried() {
        Ok(carried) => Ok((model.altered(carried.model), carried.terms)),
        Err(_) if nonlinear == Nonlinear::Auto => Ok((model.clone(), Vec::new())),
        Err(e) => Err(SpectralError::NotCarried(e)),
    }
}

/// What must be true of models and runs in the frequency domain.
///
/// # Errors
/// [`SpectralError`].
pub(crate) fn checked_model(model: &Model, runs: &[Run]) -> Result<(), SpectralError> {
    let definition = model.definition();
    match () {
        () if runs.is_empty() => Err(SpectralError::NoRuns),
        () if definition.has_events() => Err(SpectralError::Events),
        () if is_forced(definition) => Err(SpectralError::UsesTime),
        () if definition.states.is_empty() && definition.graph.delayed().is_empty() => Err(SpectralError::NoStates),
        () => Ok(()),
    }
}

/// Whether rates or outputs mention the time itself.
fn is_forced(definition: &fdm_grammar::Model) -> bool {
    let timed = definition.graph.depends(|leaf| leaf == Leaf::Time);
    let rates = definition.states.iter().map(|s| s.rate);
    rates.chain(definition.outputs.iter().map(|o| o.expr)).any(|e| timed.get(e.index()).is_some_and(|timed| *timed))
}

/// Whether all delays are within the records, at the start values.
pub(crate) fn short_delays(model: &Model, linear: &LinearModel, duration: f64) -> Result<(), SpectralError> {
    let (mut linear, mut values) = (linear.clone(), Values::default());
    linear.evaluate(&model.definition().start(), &mut values).map_err(SpectralError::Trim)?;
    match values.tau.iter().find(|tau| **tau >= duration) {
        Some(delay) => Err(SpectralError::LongDelay { delay: *delay, duration }),
        None => Ok(()),
    }
}

/// Whether no measured output is a combination of others, which would make the covariance of their residuals singular.
fn independent(model: &Model, spectra: &[Spectrum]) -> Result<(), SpectralError> {
    let q = model.definition().outputs.len();
    let of = |a: usize, b: usize| {
        let planes = |s: &Spectrum| {
            let plane = |o: usize| s.outputs[o * s.omega.len()..][..s.omega.len()].to_vec();
            plane(a).into_iter().zip(plane(b)).map(|(a, b)| (a * b.conj()).re).sum::<f64>()
        };
        spectra.iter().map(planes).sum::<f64>()
    };
    let power: Vec<f64> = (0..q).map(|o| of(o, o)).collect();
    let matrix = DMatrix::from_fn(q, q, |a, b| of(a, b) / (power[a] * power[b]).sqrt());
    if q < 2 || matrix.iter().any(|v| !v.is_finite()) {
        return Ok(());
    }
    let eigen = matrix.symmetric_eigen();
    let vanishing: Vec<usize> = (0..q).filter(|k| eigen.eigenvalues[*k] < DEPENDENT).collect();
    let part = |o: &usize| vanishing.iter().any(|k| eigen.eigenvectors[(*o, *k)].abs() > 1e-3);
    let outputs: Vec<String> =
        (0..q).filter(part).map(|o| model.definition().outputs[o].quantity.name.clone()).collect();
    if outputs.is_empty() { Ok(()) } else { Err(SpectralError::DependentOutputs { outputs }) }
}

/// Spectra of runs that are complete with their computed inputs.
pub(super) fn spectra(model: &Model, runs: &[Run], options: &SpectralOptions) -> Result<Vec<Spectrum>, SpectralError> {
    let ends = match options.ends {
        EndTerms::Known => Ends::Interpolated,
        _ => Ends::Extrapolated,
    };
    transformed(model, runs, &options.frequencies, ends)
}

/// Spectra of whole records.
///
/// # Errors
/// [`SpectralError::Spectrum`].
pub(crate) fn all_spectra(model: &Model, runs: &[Run], choice: &Frequencies) -> Result<Vec<Spectrum>, SpectralError> {
    transformed(model, runs, choice, Ends::Extrapolated)
}

fn transformed(model: &Model, runs: &[Run], choice: &Frequencies, ends: Ends) -> Result<Vec<Spectrum>, SpectralError> {
    let definition = model.definition();
    let channels = definition.inputs.len() + definition.outputs.len();
    if let Frequencies::Band { lowest, highest, spacing: Some(spacing) } = choice {
        let frequencies = ((highest - lowest) / spacing).floor() + 1.0;
        if *spacing > 0.0 && frequencies * channels as f64 > MOST as f64 {
            let reason = SpectrumError::TooMany { frequencies, channels, limit: MOST };
            return Err(SpectralError::Spectrum { run: runs[0].name.clone(), reason });
        }
    }
    let how = SpectrumOptions {
        ends,
        allow_unmeasured: true,
        vanishing: definition.vanishing().collect(),
        inputs: definition.inputs.iter().map(|i| i.quantity.name.clone()).collect(),
        outputs: definition.outputs.iter().map(|o| o.quantity.name.clone()).collect(),
        ..SpectrumOptions::default()
    };
    let of = |choice: &Frequencies| -> Result<Vec<Spectrum>, SpectralError> {
        let one = |run: &Run| {
            let of = |run: &Run| {
                let wrong = |reason| SpectralError::Spectrum { run: run.name.clone(), reason };
                Spectrum::of(run, choice, &how).map_err(wrong)
            };
            let spectrum = of(run)?;
            let Some(areas) = with_areas(run, definition) else { return Ok(spectrum) };
            // outputs see samples, states what lies between them
            Ok(Spectrum { sampled_inputs: spectrum.sampled_inputs, ..of(&areas)? })
        };
        runs.iter().map(one).collect()
    };
    match choice {
        Frequencies::Grid { lowest: None, highest: None } => {
            let declared = definition.inputs.iter().filter(|i| i.is_declared()).count();
            let highest = of(choice)?.iter().map(|s| moved(s, declared)).fold(0.0, f64::max);
            of(&Frequencies::Grid { lowest: None, highest: Some(highest) })
        }
        _ => of(choice),
    }
}

/// The frequency (in cycles) up to which inputs hold their power; outputs, where there are no inputs.
pub(crate) fn moved(spectrum: &Spectrum, inputs: usize) -> f64 {
    let count = spectrum.omega.len();
    let up_to = |plane: &[num_complex::Complex64]| {
        let power: f64 = plane.iter().map(|v| v.norm_sqr()).sum();
        let mut sum = 0.0;
        let place = plane.iter().position(|v| {
            sum += v.norm_sqr();
            sum >= KEPT * power
        });
        place.filter(|_| power > 0.0).map_or(0.0, |k| spectrum.omega[k] / TAU)
    };
    let highest = |planes: &[num_complex::Complex64]| planes.chunks(count).map(up_to).fold(0.0, f64::max);
    // where nothing is known, nothing moves
    let known = |v: &num_complex::Complex64| if v.is_nan() { num_complex::Complex64::ZERO } else { *v };
    let of_inputs = highest(&spectrum.inputs[..inputs * count]);
    let outputs = || spectrum.outputs.iter().map(known).collect::<Vec<_>>();
    let wanted = if of_inputs > 0.0 { of_inputs } else { highest(&outputs()) };
    wanted.max(FEWEST / spectrum.duration()).min(spectrum.omega[count - 1] / TAU)
}

/// For each parameter whether the coefficients or the delays depend on it.
pub(crate) fn seen(structure: &Structure) -> Vec<bool> {
    let mut seen = vec![false; structure.params];
    structure.slopes.iter().for_each(|s| seen[s.param as usize] = true);
    structure.tau_slopes.iter().for_each(|s| seen[s.param as usize] = true);
    seen
}

/// Measured coefficients as samples by q: real and imaginary part of a frequency one after the other.
pub(super) fn samples(spectrum: &Spectrum) -> Vec<f64> {
    let count = spectrum.omega.len();
    let outputs: Vec<_> = spectrum.outputs.chunks(count.max(1)).collect();
    let rows = (0..count).flat_map(|k| [false, true].map(|imaginary| (k, imaginary)));
    rows.flat_map(|(k, imaginary)| outputs.iter().map(move |o| if imaginary { o[k].im } else { o[k].re })).collect()
}

fn end_value(name: String, state: &Quantity) -> Param {
    of_run(Quantity { name, ..state.clone() })
}

/// A parameter that belongs to each run alone and may have any value.
pub(super) fn of_run(quantity: Quantity) -> Param {
    Param {
        quantity,
        origin: Origin::Declared,
        value: 0.0,
        lower: f64::NEG_INFINITY,
        upper: f64::INFINITY,
        fixed: false,
        per_run: true,
        group: None,
        logarithmic: false,
        prior: None,
    }
}

/// Spectra scaled by the root of their duration over that of the longest.
pub(super) fn on_one_footing(spectra: &[Spectrum]) -> Vec<Spectrum> {
    let longest = spectra.iter().map(Spectrum::duration).fold(0.0, f64::max);
    spectra.iter().map(|s| scaled(s, (s.duration() / longest).sqrt())).collect()
}

/// The factor by which a spectrum was scaled among others.
pub(super) fn weight(spectra: &[Spectrum], run: usize) -> f64 {
    let longest = spectra.iter().map(Spectrum::duration).fold(0.0, f64::max);
    (spectra[run].duration() / longest).sqrt()
}

/// A spectrum times a number.
pub(super) fn scaled(spectrum: &Spectrum, factor: f64) -> Spectrum {
    let mut scaled = spectrum.clone();
    if factor != 1.0 {
        let coefficients = [&mut scaled.inputs, &mut scaled.sampled_inputs, &mut scaled.outputs];
        coefficients.into_iter().flatten().for_each(|v| *v *= factor);
        let ends = scaled.input_ends.iter_mut().chain(&mut scaled.output_ends);
        ends.flatten().chain(&mut scaled.input_samples).chain(&mut scaled.input_before).for_each(|v| *v *= factor);
    }
    scaled
}

/// Squared ratio of a value to its error from which on a regression is preferred to the model's own value.
const PREFERRED: f64 = 4.0;

/// A value that an estimation begins with, and where it is from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StartingValue {
    /// The parameter.
    pub parameter: String,
    /// The value.
    pub value: f64,
    /// The equations whose regression gave it; none when it is the model's own.
    pub equations: Vec<String>,
}

/// Starting values of all free parameters that are identifiable (`seen`), in the model's order. Values that were set by hand stay.
pub(crate) fn regressed_values(
    model: &Model,
    runs: &[Run],
    seen: &[bool],
    frequencies: &Frequencies,
    changes: &Changes,
) -> Vec<StartingValue> {
    let domain = Domain::Frequency(frequencies.clone());
    let found = regress(model, runs, &RegressionOptions { domain, ..RegressionOptions::default() }).ok();
    let fits = || found.iter().flat_map(|r| &r.fits);
    let regressed = |name: &str| {
        fits().find_map(|fit| {
            let believed = |r: &&Regressed| r.name == *name && r.run.is_none() && r.partial_f >= PREFERRED;
            let one = fit.parameters.iter().find(believed)?;
            Some((one.value, fit.equations.iter().map(|e| e.equation.clone()).collect::<Vec<_>>()))
        })
    };
    let params = model.definition().params.iter().zip(seen).filter(|(p, seen)| !p.fixed && **seen);
    params
        .map(|(p, _)| {
            let name = &p.quantity.name;
            let by_hand = changes.set.iter().any(|(set, _)| set == name);
            let inside = |v: f64| v.is_finite() && v >= p.lower && v <= p.upper;
            let better = regressed(name).filter(|(v, _)| inside(*v) && !by_hand && !p.per_run);
            let (value, equations) = better.unwrap_or((p.value, Vec::new()));
            StartingValue { parameter: name.clone(), value, equations }
        })
        .collect()
}
