//! The road of a fit in the frequency domain.

use super::error::{SpectralError, Unanswered};
use super::initial_conditions::{FinishInTime, LastFinish};
use super::initial_conditions::{UnobservableMode, longest, unobservable_modes};
use super::initial_conditions::{found_later, in_time, values_of};
use super::options::SpectralOptions;
use super::regressor_noise::SimulatedNoise;
use super::setting::{Setting, band, weight};
use super::setting::{StartingValue, regressed_values};
use crate::estimation::smoothness::add_tables;
use crate::estimation::solve::estimate;
use crate::estimation::{Estimate, ParameterEstimate};
use crate::methods::output_error::error::{FitError, StrategyError};
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::noise_model::{refused, without_output_noise};
use crate::methods::output_error::options::after;
use crate::methods::output_error::single::{changed, starts};
use crate::problem::Options;
use crate::problem::method::{Domain, Method, SmoothBy};
use crate::problem::noise::Noise;
use crate::work::Budget;
use crate::work::Work;
use fdm_grammar::carried::CarriedTerm;
use fdm_system::linear::Trim;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Scheme, Steps};
use fdm_system::spectrum::{Bridge, Frequencies, Spectrum};
use nalgebra::DMatrix;
use num_complex::Complex64;
use std::sync::PoisonError;

/// Measured and modelled spectra of one run.
#[derive(Debug, Clone, PartialEq)]
pub struct RunSpectrum {
    /// Name of the run.
    pub run: String,
    /// Angular frequencies (M), in radians per unit of time.
    pub omega: Vec<f64>,
    /// Measured outputs, q by M.
    pub measured: Vec<Complex64>,
    /// The model's outputs, q by M.
    pub modelled: Vec<Complex64>,
}

/// Estimates from spectra, and how they were reached.
#[derive(Debug, Clone)]
pub struct SpectralFit {
    /// The model with the changes that were asked for.
    pub model: Model,
    /// Estimates, their errors and the iteration. Outputs and residuals are of coefficients, real and imaginary parts one after the other.
    pub estimate: Estimate,
    /// End values of the states, found together with the parameters.
    pub end_points: Vec<ParameterEstimate>,
    /// Spectra of all runs; empty when nothing could be computed at the start values.
    pub spectra: Vec<RunSpectrum>,
    /// Lowest and highest frequency, in cycles per unit of time.
    pub band: (f64, f64),
    /// Effective number of independent frequencies of all runs.
    pub independent: f64,
    /// Channels with long gaps: the run, and what was done about them.
    pub bridged: Vec<(String, Bridge)>,
    /// Nonlinear terms that are measured regressors: computed from records, as known inputs.
    pub measured_regressors: Vec<CarriedTerm>,
    /// Where the model was linearised, when that matters.
    pub trim: Option<Trim>,
    /// Free parameters that are not identifiable in the frequency domain.
    pub not_identifiable: Vec<String>,
    /// Inputs that do not move in the band of any run.
    pub unexcited: Vec<String>,
    /// Outputs whose residuals are multiples of each other, where their full covariance was asked for: it is singular.
    pub dependent: Vec<String>,
    /// Starting values from equation error; empty when they were the model's own.
    pub starting_values: Vec<StartingValue>,
    /// Why a response could not be computed, when that ended the estimation.
    pub unanswered: Option<Unanswered>,
    /// Unstable modes that no output shows or no input moves: the frequency domain cannot see them, and there is no finish in the time domain.
    pub unobservable: Vec<UnobservableMode>,
    /// Initial states, biases and what else the frequency domain does not see, found in the time domain with the rest held.
    pub finish: Option<Fit>,
    /// Why there is no such fit although it was asked for.
    pub unfinished: Option<FitError>,
}

impl SpectralFit {
    /// Every parameter of the model: from the spectra, or from the time domain where these do not see it.
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

/// Estimates a model's parameters from the spectra of runs: all that `fdm fit --domain frequency` does, but reading and printing.
///
/// # Errors
/// [`SpectralError`]; a fit that ran and went wrong is an [`Estimate`] with its [`Termination`](crate::Termination).
pub fn fit_spectra(
    model: &Model,
    runs: &[Run],
    options: &SpectralOptions,
    work: &Work<'_>,
) -> Result<SpectralFit, SpectralError> {
    let budget = Budget::new(work, options.options.total);
    let work = &work.unkept().within(&budget);
    let model = changed(model, &options.changes).map_err(SpectralError::of)?;
    if let Some(refused) = refused(&model, &options.options.noise, Method::OutputError, Domain::Frequency) {
        return Err(SpectralError::Strategy(refused));
    }
    if options.options.smooth_by == SmoothBy::Validation {
        let (method, domain) = (Method::OutputError, Domain::Frequency);
        return Err(SpectralError::Strategy(StrategyError::SmoothByValidation { method, domain }));
    }
    let model = without_output_noise(&model);
    let mut setting = Setting::new(&model, runs, options)?;
    let start = starts(&model, runs, &options.changes);
    let mut how = options.options.clone();
    how.noise = of_coefficients(how.noise.or_declared(&model.definition().outputs), &setting);
    let mut first = Vec::new();
    if options.regressed {
        let frequencies = match options.frequencies {
            Frequencies::Grid { lowest: None, highest: None } => {
                Frequencies::Grid { lowest: None, highest: Some(band(&setting.spectra).1) }
            }
            ref chosen => chosen.clone(),
        };
        first = regressed_values(&model, runs, &setting.seen, &frequencies, &options.changes);
    }
    let last = LastFinish::default();
    let free = |k: &usize| !model.definition().params[*k].fixed && !setting.seen[*k];
    let names = |k: usize| model.definition().params[k].quantity.name.clone();
    let not_identifiable: Vec<String> = (0..setting.own()).filter(free).map(names).collect();
    let finish = || FinishInTime { model: &model, runs, unseen: not_identifiable.clone(), last: last.clone(), work };
    let mut found = setting.estimated(&with_first(&model, &start, &first), &how, (finish(), options), work)?;
    let lost = !found.termination.is_good() && work.stop_after(&found.termination).is_none();
    if lost && first.iter().any(|f| !f.equations.is_empty()) {
        // noise in the regressors can lead astray; then the model's own values are tried
        let again = setting.estimated(&start, &how, (finish(), options), work)?;
        if again.termination.is_good() {
            (found, first) = (again, Vec::new());
        }
    }
    let end_points = unscaled_end_points(&found, &setting);
    found = found.without(|p| end_points.iter().any(|e| e.name == p.name));
    let unanswered = setting.reason.lock().unwrap_or_else(PoisonError::into_inner).take();
    let unanswered = unanswered.map(|why| setting.named(why));
    let measured_regressors = std::mem::take(&mut setting.measured_regressors);
    let theta = after(&model, runs, &found, &start);
    let trim = theta.first().map(|theta| setting.linear.trim(theta));
    let inputs = &setting.model.definition().inputs;
    let dependent = if how.noise == Noise::Full { dependent(&found) } else { Vec::new() };
    let mut fit = SpectralFit {
        unexcited: setting.unexcited().into_iter().map(|k| inputs[k].quantity.name.clone()).collect(),
        dependent,
        starting_values: first,
        spectra: compared(&setting, &found),
        band: band(&setting.spectra),
        independent: setting.spectra.iter().map(Spectrum::independent).sum(),
        bridged: bridged(&setting.spectra),
        end_points,
        measured_regressors,
        trim,
        not_identifiable,
        unanswered: unanswered.filter(|_| !found.termination.is_good()),
        unobservable: Vec::new(),
        finish: None,
        unfinished: None,
        model,
        estimate: found,
    };
    fit.unobservable = unobservable_modes(&setting.linear, theta.first().map_or(&[], Vec::as_slice), longest(runs));
    if options.finish && fit.estimate.termination.is_good() && fit.unobservable.is_empty() {
        let made = last.at(&values_of(&fit.model, &fit.estimate));
        match made.unwrap_or_else(|| fit.predict(runs, work)) {
            Ok(finish) => fit.finish = Some(finish),
            Err(e) => fit.unfinished = Some(e),
        }
    }
    let seen = fit.finish.as_ref().map(|finish| after(&fit.model, runs, &finish.estimate, &theta));
    // steps of the simulation that says which nodes of tables were visited
    let steps = vec![Steps::equal(Scheme::default(), 2); runs.len()];
    add_tables(&mut fit.estimate, &fit.model, runs, seen.as_ref().unwrap_or(&theta), &steps);
    Ok(fit)
}

fn bridged(spectra: &[Spectrum]) -> Vec<(String, Bridge)> {
    let of = |s: &Spectrum| s.bridged.iter().map(|bridge| (s.name.clone(), bridge.clone())).collect::<Vec<_>>();
    spectra.iter().flat_map(of).collect()
}

/// Outputs that take part in a linear dependence between residuals.
fn dependent(estimate: &Estimate) -> Vec<String> {
    const NONE: f64 = 1e-9;
    let q = estimate.outputs.iter().filter(|o| Some(&o.run) == estimate.outputs.first().map(|f| &f.run)).count();
    let rows = || estimate.runs.iter().flat_map(|r| r.residuals.chunks_exact(q.max(1)));
    let sum = |a: usize, b: usize| rows().map(|r| r[a] * r[b]).sum::<f64>();
    let correlation = |a: usize, b: usize| sum(a, b) / (sum(a, a) * sum(b, b)).sqrt();
    let matrix = DMatrix::from_fn(q, q, correlation);
    if q < 2 || matrix.iter().any(|v| !v.is_finite()) {
        return Vec::new();
    }
    let eigen = matrix.symmetric_eigen();
    let vanishing: Vec<usize> = (0..q).filter(|k| eigen.eigenvalues[*k] < NONE).collect();
    let part = |o: &usize| vanishing.iter().any(|k| eigen.eigenvectors[(*o, *k)].abs() > 1e-3);
    (0..q).filter(part).map(|o| estimate.outputs[o].name.clone()).collect()
}

/// Known deviations of samples in time as those of real and imaginary parts of coefficients.
fn of_coefficients(noise: Noise, setting: &Setting) -> Noise {
    let longest = setting.spectra.iter().map(|s| s.samples).max().unwrap_or(1) as f64;
    match noise {
        Noise::Given(known) => Noise::Given(known.into_iter().map(|d| d.map(|d| d / (2.0 * longest).sqrt())).collect()),
        other => other,
    }
}

/// End values in the units of their states: those of shorter runs were scaled with their spectra.
fn unscaled_end_points(estimate: &Estimate, setting: &Setting) -> Vec<ParameterEstimate> {
    let own = |name: &str| setting.model.definition().params.iter().any(|p| p.quantity.name == name);
    let derived = |name: &str| setting.model.definition().derived.iter().any(|d| d.quantity.name == name);
    let mut ends = Vec::new();
    for p in estimate.parameters.iter().filter(|p| !own(&p.name) && !derived(&p.name)) {
        let mut p = p.clone();
        let run = setting.spectra.iter().position(|s| Some(&s.name) == p.run.as_ref());
        let factor = 1.0 / run.map_or(1.0, |run| weight(&setting.spectra, run));
        p.value *= factor;
        p.standard_error = p.standard_error.map(|s| s * factor);
        p.corrected_error = p.corrected_error.map(|s| s * factor);
        ends.push(p);
    }
    ends
}

/// Start values with those of regressions in their places.
fn with_first(model: &Model, start: &[Vec<f64>], first: &[StartingValue]) -> Vec<Vec<f64>> {
    let mut start = start.to_vec();
    for value in first.iter().filter(|f| !f.equations.is_empty()) {
        if let Some(k) = model.definition().param(&value.parameter) {
            start.iter_mut().for_each(|theta| theta[k] = value.value);
        }
    }
    start
}

impl Setting {
    /// The estimation from these start values (p of each run).
    fn estimated(
        &self,
        start: &[Vec<f64>],
        options: &Options,
        (finish, choice): (FinishInTime<'_>, &SpectralOptions),
        work: &Work<'_>,
    ) -> Result<Estimate, SpectralError> {
        let mut problem = self.problem(start)?;
        if let Some(noise) = SimulatedNoise::new(self, finish.runs, choice)? {
            problem.regressor_noise = Some(Box::new(noise));
        }
        if choice.finish {
            problem.noise_in_time = Some(Box::new(finish));
        }
        estimate(&mut problem, options, work).map_err(SpectralError::Problem)
    }
}

/// Measured and modelled spectra at the estimates.
fn compared(setting: &Setting, estimate: &Estimate) -> Vec<RunSpectrum> {
    let q = setting.linear.structure().outputs;
    let one = |(r, result): (usize, &crate::estimation::RunFit)| {
        let spectrum = &setting.spectra[r];
        let (count, factor) = (spectrum.omega.len(), 1.0 / weight(&setting.spectra, r));
        let at = |o: usize, k: usize| {
            Complex64::new(result.response[2 * k * q + o], result.response[(2 * k + 1) * q + o]) * factor
        };
        RunSpectrum {
            run: spectrum.name.clone(),
            omega: spectrum.omega.clone(),
            measured: spectrum.outputs.clone(),
            modelled: (0..q).flat_map(|o| (0..count).map(move |k| at(o, k))).collect(),
        }
    };
    estimate.runs.iter().enumerate().map(one).collect()
}
