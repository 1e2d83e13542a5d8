//! The model as it stands at its fit: where a search begins.

use crate::candidates::error::DiagnosisError;
use crate::candidates::fitted_model::FittedModel;
use crate::candidates::runs::{DiagnosisOptions, Domain, Runs};
use fdm_estimate::{
    Changes, Continuation, Estimate, Fit, FitError, FitOptions, SpectralOptions, Work, fit, fit_spectra, starts,
};
use fdm_grammar::model::Param;
use fdm_system::model::Model;
use fdm_system::record::Run;

/// Parts of the record that are fitted first where the start values lead nowhere.
const SHARES: [f64; 2] = [0.25, 0.5];
/// By how much less likely a minimum is that is another one.
const ANOTHER: f64 = 1.0;
/// Mean R^2 of outputs below which other minima are looked for.
const MATCH: f64 = 0.5;

/// The model at its fit: the likeliest, then other minima that were found on the way.
pub(crate) fn initial_fits(
    model: &Model,
    runs: Runs<'_>,
    options: &DiagnosisOptions,
    work: &Work<'_>,
) -> Result<Vec<FittedModel>, DiagnosisError> {
    let fits = match runs.domain {
        Domain::Time => first_in_time(model, runs, options, work)?,
        Domain::Frequency(spectral) => vec![first_in_lines(model, runs, options, (spectral, work))?],
    };
    // a fit that was stopped is no base
    if work.goes_on() { Ok(fits) } else { Err(DiagnosisError::Stopped) }
}

/// The model at its fit to spectra. Held-out runs have values of their own only where these show them, and are fitted with their own
/// noise.
fn first_in_lines(
    model: &Model,
    runs: Runs<'_>,
    options: &DiagnosisOptions,
    (spectral, work): (&SpectralOptions, &Work<'_>),
) -> Result<FittedModel, DiagnosisError> {
    let (changes, how) = (options.fit.changes.clone(), options.fit.options.clone());
    let start = starts(model, runs.all, &changes);
    let how = SpectralOptions { changes, options: how, ..spectral.clone() };
    let fitted = fit_spectra(model, runs.train(), &how, &work.quiet())?;
    if let Some(why) = &fitted.unanswered {
        return Err(DiagnosisError::NoFit(why.to_string()));
    }
    let model = fitted.model.clone();
    let of = |(run, start): (&Run, &Vec<f64>)| {
        let each = model.definition().params.iter().zip(start);
        each.map(|(p, start)| {
            let owner = p.per_run.then_some(run.name.as_str());
            fitted.estimate.parameter(&p.quantity.name, owner).map_or(*start, |e| e.value)
        })
        .collect()
    };
    let theta = runs.all.iter().zip(&start).map(of).collect();
    FittedModel::new(model, runs, theta)
}

/// The model at its fits by plain output error.
fn first_in_time(
    model: &Model,
    runs: Runs<'_>,
    options: &DiagnosisOptions,
    work: &Work<'_>,
) -> Result<Vec<FittedModel>, DiagnosisError> {
    let mut how = options.fit.clone();
    how.options.colour = false;
    let fits = plainly(model, runs.train(), &how, work)?;
    if fits[0].estimate.runs.is_empty() {
        return Err(DiagnosisError::NoFit(fits[0].estimate.termination.to_string()));
    }
    if let Some(fault) = fits[0].integration_faults.iter().find(|fault| fault.is_severe()) {
        return Err(DiagnosisError::NoFit(fault.to_string()));
    }
    let mut stages = fits.iter().map(|fitted| with_validation_runs(fitted, runs, (&how, work)));
    let likeliest = stages.next().into_iter().collect::<Result<Vec<FittedModel>, _>>()?;
    Ok(likeliest.into_iter().chain(stages.filter_map(Result::ok)).collect())
}

/// An extended model as a plain fit from these values has it: where it has not ended yet, as far as it came.
///
/// # Errors
/// Why there is none, in words.
pub(crate) fn plain_fit(
    current: &FittedModel,
    theta: &[Vec<f64>],
    runs: Runs<'_>,
    (options, work): (&DiagnosisOptions, &Work<'_>),
) -> Result<FittedModel, String> {
    let mut params = current.params().to_vec();
    for (param, value) in params.iter_mut().zip(theta.iter().flatten()).filter(|(p, _)| !p.fixed && !p.per_run) {
        param.value = value.clamp(param.lower, param.upper);
    }
    let how = once(options);
    let fits = plainly(&current.model.with_params(params), runs.train(), &how, work).map_err(|e| e.to_string())?;
    let best = fits.first().ok_or("it has no end")?;
    with_validation_runs(best, runs, (&how, work)).map_err(|e| e.to_string())
}

/// Values of all runs with what belongs to each of them by output error, and what they share as it is; none where there is no response.
pub(crate) fn own_fit(
    current: &FittedModel,
    theta: &[Vec<f64>],
    runs: Runs<'_>,
    (options, work): (&DiagnosisOptions, &Work<'_>),
) -> Option<Vec<Vec<f64>>> {
    let params = current.params();
    if !params.iter().any(|p| p.per_run && !p.fixed) {
        return Some(theta.to_vec());
    }
    let held = params.iter().zip(theta.first()?).map(|(p, value)| match p.per_run {
        true => p.clone(),
        false => Param { value: value.clamp(p.lower, p.upper), fixed: true, ..p.clone() },
    });
    let model = current.model.with_params(held.collect());
    let how = once(options);
    let mut found = Vec::new();
    for (some, first) in [(runs.train(), 0), (runs.validation(), runs.train)] {
        if some.is_empty() {
            continue;
        }
        let fitted = fit(&model, some, &how, &work.quiet()).ok()?;
        let of = |(run, theta): (&Run, &Vec<f64>)| -> Vec<f64> {
            let each = params.iter().zip(theta);
            each.map(|(p, value)| {
                let own = p.per_run.then(|| fitted.estimate.parameter(&p.quantity.name, Some(&run.name))).flatten();
                own.map_or(*value, |e| e.value)
            })
            .collect()
        };
        found.extend(some.iter().zip(&theta[first..]).map(of));
    }
    Some(found)
}

/// As `fit` would from the values given, without fallback strategies.
fn once(options: &DiagnosisOptions) -> FitOptions {
    let mut how = options.fit.clone();
    // they are in the model already
    how.changes = Changes::default();
    how.options.colour = false;
    how.bare = true;
    how.continuation = Continuation::Never;
    how
}

/// A fit to the training runs, with what belongs to each of the validation ones fitted there.
pub(crate) fn with_validation_runs(
    fitted: &Fit,
    runs: Runs<'_>,
    (how, work): (&FitOptions, &Work<'_>),
) -> Result<FittedModel, DiagnosisError> {
    let model = fitted.model.clone();
    let reached = |run: &Run, start: &[f64], estimate: &Estimate| -> Vec<f64> {
        let each = model.definition().params.iter().zip(start);
        each.map(|(p, start)| {
            let owner = p.per_run.then_some(run.name.as_str());
            estimate.parameter(&p.quantity.name, owner).map_or(*start, |e| e.value)
        })
        .collect()
    };
    let start = starts(&model, runs.all, &how.changes);
    let mut theta: Vec<Vec<f64>> =
        runs.train().iter().zip(&start).map(|(run, start)| reached(run, start, &fitted.estimate)).collect();
    if !runs.validation().is_empty() {
        let shared: Vec<(String, f64)> = model
            .definition()
            .params
            .iter()
            .zip(&theta[0])
            .filter(|(p, _)| !p.per_run && !p.is_recorded())
            .map(|(p, v)| (p.quantity.name.clone(), v.max(p.lower).min(p.upper)))
            .collect();
        let names = shared.iter().map(|(name, _)| name.clone()).collect();
        let changes = Changes { set: shared, fix: names, free: Vec::new() };
        let validation =
            plainly(&model, runs.validation(), &FitOptions { changes, ..how.clone() }, work)?.swap_remove(0);
        for (run, start) in runs.validation().iter().zip(&start[runs.train..]) {
            let mut own = reached(run, start, &validation.estimate);
            let each = model.definition().params.iter().zip(own.iter_mut().zip(&theta[0]));
            each.filter(|(p, _)| !p.per_run).for_each(|(_, (own, shared))| *own = *shared);
            theta.push(own);
        }
    }
    FittedModel::new(model, runs, theta)
}

/// Fits from the start values alone, where that ends at a minimum that is a match at all; else along a growing part of the record too,
/// and the better of both is taken. A model that lacks something leaves smooth residuals, for which a fit by itself would go through all
/// its fallback strategies; here they are what is looked for. These come last, where no way ends at a minimum that is a match: the likeliest is then
/// the first, and minima that are less likely follow.
pub(crate) fn plainly(model: &Model, runs: &[Run], how: &FitOptions, work: &Work<'_>) -> Result<Vec<Fit>, FitError> {
    if how.continuation != Continuation::Auto {
        return Ok(vec![fit(model, runs, how, &work.quiet())?]);
    }
    let by = |continuation: Continuation| fit(model, runs, &FitOptions { continuation, ..how.clone() }, &work.quiet());
    let sound = |fit: &Fit| fit.estimate.termination.is_good();
    let cost = |fit: &Fit| fit.estimate.cost.unwrap_or(f64::INFINITY);
    // of a minimum where no step helps (two roots that meet) and one that is a poor match, the likelier is nearer to the truth
    let sort = |fits: &mut Vec<Fit>| fits.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
    let mut fits: Vec<Fit> = Vec::new();
    for predictor in [Continuation::Never, Continuation::Shares(SHARES.to_vec())] {
        fits.extend(by(predictor).ok().filter(|fit| cost(fit).is_finite()));
        sort(&mut fits);
        if fits.first().is_some_and(|best| sound(best) && is_match(&best.estimate)) {
            fits.truncate(1);
            return Ok(fits);
        }
    }
    match fit(model, runs, how, &work.quiet()) {
        Ok(found) if fits.is_empty() || cost(&found).is_finite() => fits.push(found),
        Err(why) if fits.is_empty() => return Err(why),
        _ => (),
    }
    sort(&mut fits);
    let others = fits.split_off(1);
    let another = |fit: &Fit| sound(fit) && cost(fit) > cost(&fits[0]) + ANOTHER;
    let others: Vec<Fit> = others.into_iter().filter(another).collect();
    fits.extend(others);
    Ok(fits)
}

/// Whether most of what was measured is explained.
fn is_match(estimate: &Estimate) -> bool {
    let told: Vec<f64> = estimate.outputs.iter().filter_map(|o| o.r2).map(|r2| r2.max(-1.0)).collect();
    told.is_empty() || told.iter().sum::<f64>() / told.len() as f64 > MATCH
}
