//! A fit by the filter-error method: start values, steps, the minimum, a second look at the steps, errors.
//!
//! Why a filter cannot be run over a model.

use super::likelihood::{Deviation, Lost, Setting};
use super::scoring::{Found, minimise};
use crate::estimation::{Estimate, ParameterEstimate, RunFit, Symmetric, matches};
use crate::examined::interpolation::uncompared;
use crate::methods::ignored;
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::fit::IntegrationFault;
use crate::methods::output_error::noise_model::{refused, without_output_noise};
use crate::methods::output_error::options::FitOptions;
use crate::methods::output_error::single::{changed, starts};
use crate::problem::method::{Domain, Method};
use crate::problem::noise::Weights;
use crate::residuals::run_quality;
use crate::uncertainty::cramer_rao::CramerRao;
use crate::uncertainty::parameters::Statistics;
use crate::uncertainty::sandwich::Uncorrected;
use crate::work::Budget;
use crate::work::Termination;
use crate::work::Work;
use fdm_numeric::quadratic::Inverse;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Accuracy, Scheme, Steps, UNSOUND, WorstError};
use std::fmt;

/// Estimates by the filter-error method.
#[derive(Debug, Clone)]
pub struct FilterFit {
    /// Estimates and how they were reached. Its responses are predictions from one sample to the next, its residuals innovations.
    pub fit: Fit,
    /// Standard deviations of the measurement noise that were estimated, by output.
    pub deviations: Vec<ParameterEstimate>,
    /// Intensities so small that the record does not tell them from none; they stand at 0.
    pub not_identifiable: Vec<String>,
}

/// Changes of the likelihood's logarithm by halved steps that are of no consequence to any estimate.
const FINE: f64 = 1e-4;
/// Information about the logarithm of an intensity below which the record does not notice it.
const SILENT: f64 = 0.05;

/// Estimates a model's parameters, the intensities of the noise in its equations and the measurement noise by maximum likelihood with an
/// extended Kalman filter: all that `fdm fit --method filter-error` does, but reading and printing.
///
/// Of the options changes, noise, iterations and steps are heeded; others that were given are refused.
///
/// # Errors
/// [`FilterError`]; a fit that ran and went wrong is an [`Estimate`] with its [`Termination`].
pub fn fit_filter(
    model: &Model,
    runs: &[Run],
    options: &FitOptions,
    work: &Work<'_>,
) -> Result<FilterFit, FilterError> {
    let budget = Budget::new(work, options.options.total);
    let work = &work.unkept().within(&budget);
    let model = changed(model, &options.changes)?;
    let refused = refused(&model, &options.options.noise, Method::FilterError, Domain::Time);
    if let Some(refused) = refused.or_else(|| ignored(options, Method::FilterError, Domain::Time)) {
        return Err(FilterError::Fit(FitError::Strategy(refused)));
    }
    let model = without_output_noise(&model);
    let start = starts(&model, runs, &options.changes);
    let mut setting = Setting::new(&model, runs, &start, &options.options)?;
    let mut values = setting.unknowns.start.clone();
    let mut steps = match options.per_interval {
        Some(count) => vec![Steps::equal(Scheme::RungeKutta, count); runs.len()],
        None => chosen(&setting, &values, 1)?,
    };
    work.begin(&|| setting.unknowns.names(&setting.problem));
    let (mut passes, mut history, mut round) = ((0, 0), Vec::new(), 0);
    loop {
        round += 1;
        let mut likelihood = setting.likelihood(&steps)?;
        let (coordinates, priors) = (setting.coordinates(&values), setting.priors());
        let start = (&values[..], options.options.iterations);
        let mut found = match minimise(&mut likelihood, &coordinates, &priors, start, work) {
            Ok(found) => found,
            Err(lost) => return Ok(nothing(&model, &mut setting, &values, lost)),
        };
        passes = (passes.0 + likelihood.passes.0, passes.1 + likelihood.passes.1);
        history.append(&mut found.history);
        values.clone_from(&found.values);
        let stopped = work.stop_after(&found.termination).is_some() || options.per_interval.is_some();
        // looks at the steps
        if !stopped && round < 3 {
            let finer = chosen(&setting, &values, steps.first().map_or(1, Steps::most))?;
            if finer != steps {
                steps = finer;
                continue;
            }
        }
        found.history = history;
        drop(likelihood);
        return concluded(&model, &mut setting, found, &steps, passes);
    }
}

/// Steps at which halving them changes the likelihood no more, from a number of steps on.
fn chosen(setting: &Setting<'_>, values: &[f64], least: usize) -> Result<Vec<Steps>, FitError> {
    let equal = |count: usize| vec![Steps::equal(Scheme::RungeKutta, count); setting.runs.len()];
    let cost = |count: usize| -> Result<f64, FitError> {
        Ok(setting.likelihood(&equal(count))?.evaluate(values, false).unwrap_or(f64::NAN))
    };
    let (mut count, mut before) = (least.max(1), cost(least.max(1))?);
    // most steps between samples
    while count < 256 {
        let after = cost(2 * count)?;
        if (after - before).abs() < FINE {
            break;
        }
        (count, before) = (2 * count, after);
    }
    // nothing finite on any steps: the search says where
    Ok(equal(if before.is_nan() { least.max(1) } else { count }))
}

/// Everything that is known at the end.
fn concluded(
    model: &Model,
    setting: &mut Setting<'_>,
    found: Found,
    steps: &[Steps],
    passes: (usize, usize),
) -> Result<FilterFit, FilterError> {
    let mut values = found.values;
    let not_identifiable = without_negligible(setting, &mut values, steps)?;
    let (information, predicted, cost) = {
        let mut likelihood = setting.likelihood(steps)?;
        let cost = likelihood.evaluate(&values, true).unwrap_or(found.cost);
        let predicted: Vec<Vec<f64>> = likelihood.predictions().cloned().collect();
        (likelihood.score.information.clone(), predicted, cost)
    };
    let (integration, worst) = judged(setting, &values, steps, &predicted)?;
    let known = setting.priors().cost(&values);
    let conclusion = conclusion(setting, &values, information);
    let unknowns = setting.unknowns.clone();
    let statistics = Statistics::new(&setting.problem, &unknowns, &values, conclusion.as_ref(), None);
    let (mut parameters, covered, members) = statistics.parameters(&setting.problem, &unknowns, &values);
    parameters.extend(statistics.derived(&mut setting.problem, &unknowns, &values));
    let (covariance, correlations, corrected_covariance) = statistics.matrices(&members);
    let measured = setting.runs.iter().map(|run| (run.name.as_str(), &run.measured[..]));
    let (outputs, results) = matches(&setting.problem.outputs, measured, predicted);
    let estimate = Estimate {
        parameters,
        outputs,
        cost: Some(cost + known),
        log_likelihood: None,
        termination: found.termination,
        iterations: found.history.len().saturating_sub(1),
        fallbacks: Vec::new(),
        evaluations: passes,
        history: found.history,
        covered,
        covariance,
        correlations,
        corrected_covariance,
        colours: Vec::new(),
        spectral_colours: Vec::new(),
        curvature: Vec::new(),
        uncorrected: Some(Uncorrected::Innovations),
        noise_variation: Vec::new(),
        noise: Some(covariance_of(setting, &values)),
        noise_free: Vec::new(),
        leverages: Vec::new(),
        degenerate: Vec::new(),
        bias_corrections: Vec::new(),
        undetermined: statistics.directions,
        determined_by_prior: statistics.by_prior,
        smoothing: Vec::new(),
        tables: Vec::new(),
        condition: conclusion.map(|c| c.inverse.condition),
        runs: results,
    };
    let (estimate, deviations) = apart(setting, estimate);
    let judge = |(run, result): (&Run, &RunFit)| run_quality(model, run, &result.response);
    let quality = setting.runs.iter().zip(&estimate.runs).flat_map(judge).collect();
    let uncompared_inputs = uncompared(model, setting.runs);
    let mut fit = Fit { quality, uncompared_inputs, ..Fit::new(model.clone(), estimate, integration) };
    let faults = setting.runs.iter().zip(&worst).flat_map(|(run, worst)| IntegrationFault::of(&fit, run, worst));
    fit.integration_faults = faults.collect();
    Ok(FilterFit { fit, deviations, not_identifiable })
}

/// Takes the deviations of the noise out of the table of parameters.
fn apart(setting: &Setting<'_>, estimate: Estimate) -> (Estimate, Vec<ParameterEstimate>) {
    let names: Vec<&str> = setting.problem.params[setting.params..].iter().map(|p| &p.quantity.name[..]).collect();
    let ours = |p: &ParameterEstimate| names.contains(&p.name.as_str());
    let deviations = estimate.parameters.iter().filter(|p| ours(p)).cloned().collect();
    (estimate.without(ours), deviations)
}

/// Intensities that the record does not notice are put to 0, where they may be.
fn without_negligible(setting: &Setting<'_>, values: &mut [f64], steps: &[Steps]) -> Result<Vec<String>, FitError> {
    let mut likelihood = setting.likelihood(steps)?;
    let (mut not_identifiable, size) = (Vec::new(), values.len());
    if likelihood.evaluate(values, true).is_err() {
        return Ok(not_identifiable);
    }
    let information = likelihood.score.information.clone();
    for j in (0..size).filter(|j| setting.is_intensity(*j) && setting.unknowns.lower[*j] == 0.0) {
        let (kept, scale) = (values[j], values[j] * values[j]);
        if information[j * size + j] * scale < SILENT {
            values[j] = 0.0;
            if likelihood.evaluate(values, false).is_err() {
                values[j] = kept;
                continue;
            }
            not_identifiable.push(setting.problem.params[setting.unknowns.owner(j).1].quantity.name.clone());
        }
    }
    Ok(not_identifiable)
}

/// The steps of each run, how far predictions with half of them are off, as a part of each output's range, and where that is too far.
fn judged(
    setting: &Setting<'_>,
    values: &[f64],
    steps: &[Steps],
    predicted: &[Vec<f64>],
) -> Result<(Vec<Accuracy>, Vec<Vec<WorstError>>), FitError> {
    let halved: Vec<Steps> = steps.iter().map(Steps::halved).collect();
    let mut likelihood = setting.likelihood(&halved)?;
    let whole = likelihood.evaluate(values, false).is_ok();
    let q = setting.noise.len();
    let error = |(fine, coarse): (&Vec<f64>, &Vec<f64>)| {
        let of = |o: usize| {
            let pairs = || fine.iter().zip(coarse).skip(o).step_by(q);
            let range = pairs().fold((f64::INFINITY, f64::NEG_INFINITY), |r, (y, _)| (r.0.min(*y), r.1.max(*y)));
            let off = pairs().map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            if off == 0.0 { 0.0 } else { off / (range.1 - range.0) }
        };
        (0..q).map(of).fold(0.0, f64::max)
    };
    let errors = likelihood.predictions().zip(predicted).map(error);
    let errors = errors.map(|e| if whole { e } else { f64::INFINITY });
    let accuracies = steps.iter().zip(errors).map(|(steps, error)| Accuracy { steps: steps.clone(), error }).collect();
    let fine = likelihood.predictions();
    let worst = fine.zip(predicted).zip(steps).map(|((f, c), steps)| WorstError::between(c, f, q, steps, UNSOUND));
    Ok((accuracies, worst.collect()))
}

/// The information of the likelihood as the statistics of an estimate take it; none when nothing was estimated.
fn conclusion(setting: &Setting<'_>, values: &[f64], information: Vec<f64>) -> Option<CramerRao> {
    let size = values.len();
    if size == 0 || information.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let bounds = setting.unknowns.lower.iter().zip(&setting.unknowns.upper);
    let inside: Vec<bool> = values.iter().zip(bounds).map(|(v, (lo, hi))| lo < v && v < hi).collect();
    let mut believed = information.clone();
    let priors = setting.priors();
    for row in priors.rows(values) {
        for (i, a) in row.entries() {
            row.entries().iter().for_each(|(j, b)| believed[i * size + j] += a * b);
        }
    }
    let (scale, inverse) = Inverse::of_products(&believed, &inside);
    let noise = Weights {
        cost: 0.0,
        beside: 0.0,
        rounding: 0.0,
        covariance: covariance_of(setting, values).values,
        whitener: Vec::new(),
        exact: vec![false; setting.noise.len()],
        scatter: 1.0,
    };
    let without_priors = (!priors.is_empty()).then(|| Inverse::of_products(&information, &inside));
    let samples = vec![None; setting.noise.len()];
    let (held, leverages) = (Vec::new(), Vec::new());
    Some(CramerRao { scale, inside, inverse, held, noise: Some(noise), samples, leverages, without_priors })
}

/// R at these values, diagonal.
fn covariance_of(setting: &Setting<'_>, values: &[f64]) -> Symmetric {
    let q = setting.noise.len();
    let mut covariance = Symmetric { size: q, values: vec![0.0; q * q] };
    for (o, noise) in setting.noise.iter().enumerate() {
        let deviation = match noise {
            Deviation::Known(known) => *known,
            Deviation::Unknown(k) => setting.unknowns.of(0, *k).map_or(f64::NAN, |j| values[j]),
        };
        covariance.values[o * q + o] = deviation * deviation;
    }
    covariance
}

/// The filter leaves the finite numbers already at the start.
fn nothing(model: &Model, setting: &mut Setting<'_>, values: &[f64], lost: Lost) -> FilterFit {
    let unknowns = setting.unknowns.clone();
    let statistics = Statistics::new(&setting.problem, &unknowns, values, None, None);
    let (parameters, covered, _) = statistics.parameters(&setting.problem, &unknowns, values);
    let Lost { run, divergence: d } = lost;
    let termination = Termination::Diverged {
        run: setting.runs[run].name.clone(),
        time: d.time,
        state: d.state,
        sample: d.sample,
        event: d.event,
    };
    let empty = Symmetric::default;
    let estimate = Estimate {
        parameters,
        outputs: Vec::new(),
        cost: None,
        log_likelihood: None,
        termination,
        iterations: 0,
        fallbacks: Vec::new(),
        evaluations: (1, 0),
        history: Vec::new(),
        covered,
        covariance: empty(),
        correlations: empty(),
        corrected_covariance: empty(),
        colours: Vec::new(),
        spectral_colours: Vec::new(),
        curvature: Vec::new(),
        uncorrected: Some(Uncorrected::NoDegreesOfFreedom),
        noise_variation: Vec::new(),
        noise: None,
        noise_free: Vec::new(),
        leverages: Vec::new(),
        degenerate: Vec::new(),
        bias_corrections: Vec::new(),
        undetermined: Vec::new(),
        determined_by_prior: Vec::new(),
        smoothing: Vec::new(),
        tables: Vec::new(),
        condition: None,
        runs: Vec::new(),
    };
    let (estimate, deviations) = apart(setting, estimate);
    FilterFit { fit: Fit::new(model.clone(), estimate, Vec::new()), deviations, not_identifiable: Vec::new() }
}

/// Why nothing was estimated.
#[derive(Debug, Clone, PartialEq)]
pub enum FilterError {
    /// As for any fit.
    Fit(FitError),
    /// No equation carries noise: the filter would never correct a state.
    NoProcessNoise,
    /// The past of a state would have to be part of what is filtered.
    DelayedState {
        /// Name of the state.
        state: String,
    },
    /// The covariance of the measurement noise is diagonal.
    FullNoise,
    /// The smoothness of tables is chosen by output error alone.
    SmoothTable {
        /// Name of the table.
        table: String,
    },
    /// A filter knows of no states that stop.
    Limit {
        /// Name of the state.
        state: String,
    },
    /// A filter knows of no events.
    Events,
    /// An intensity moves by parts of itself, and 0 has none.
    StartsAtZero {
        /// Name of the parameter.
        parameter: String,
    },
}

impl fmt::Display for FilterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fit(e) => write!(f, "{e}"),
            Self::NoProcessNoise => write!(
                f,
                "the model says nowhere that noise enters its equations: `param q = 0.1; noise der(x) = q;` lets white noise of intensity q \
                 into the equation of x and estimates q; without such noise `--method output-error` is the right one"
            ),
            Self::DelayedState { state } => write!(
                f,
                "the state `{state}` is delayed: its past would have to be filtered too; delay the measurement in the record, or \
                 put `measured(.)` in its place (delayed inputs are no obstacle)"
            ),
            Self::FullNoise => write!(
                f,
                "--noise full has no part in the filter-error method: the noise of the outputs is independent there, and what they have \
                 in common is noise of the equations"
            ),
            Self::SmoothTable { table } => write!(
                f,
                "`smooth {table}` has no part in the filter-error method; fit it with `--method output-error`, fix its nodes at what was found, \
                 and leave the statement out"
            ),
            Self::Limit { state } => write!(
                f,
                "the state `{state}` has a limit, which the filter-error method does not know; fit with `--method output-error`, or \
                 write `limit {state} in [...] smooth ...;`"
            ),
            Self::Events => f.write_str(
                "the model has events (`when`), which the filter-error method does not know; fit with `--method output-error`",
            ),
            Self::StartsAtZero { parameter } => write!(
                f,
                "`{parameter}` is the intensity of a noise and starts at 0, from where no way leads up; start it above 0 \
                 (`--set {parameter}=...`), or fix it"
            ),
        }
    }
}

impl std::error::Error for FilterError {}

impl From<FitError> for FilterError {
    fn from(error: FitError) -> Self {
        Self::Fit(error)
    }
}
