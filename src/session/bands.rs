//! Bands of what a result predicts: by the errors of the parameters, and by these and the noise.

use fdm_estimate::{Fit, Unvisited, unvisited};
use fdm_lab::posterior::{BandError, Bands, Errors, Predicted};
use fdm_lab::requirement::{freedom, with_estimates};
use fdm_results::documents::{FitDocument, ResultDocument};
use fdm_results::store::ResultFolder;
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::Steps;

/// Parameters with a variance, and their part of a covariance (p by p).
fn varying(covariance: &[f64], p: usize, chosen: impl Fn(usize) -> bool) -> (Vec<usize>, Vec<f64>) {
    let columns: Vec<usize> = (0..p).filter(|k| covariance[k * p + k] > 0.0 && chosen(*k)).collect();
    let part = columns.iter().flat_map(|i| columns.iter().map(move |j| covariance[i * p + j])).collect();
    (columns, part)
}

/// Standard deviation of the noise of each output (q) of a result; NaN where it is not known.
fn noise(result: &ResultDocument, model: &Model) -> Vec<f64> {
    let found = result.fit().and_then(|fit| fit.noise_covariance.as_ref());
    let deviation = |k: usize| found.and_then(|c| c.get(k)?.get(k).copied()).map_or(f64::NAN, f64::sqrt);
    (0..model.layout().outputs).map(deviation).collect()
}

/// Of a simulation at the estimates of a result, with those of the fitted run `like` where runs have their own.
pub(crate) fn of_simulation(
    model: &Model,
    folder: &ResultFolder,
    (run, like): (&Run, &str),
    theta: &[f64],
    steps: Steps,
) -> Result<Bands, BandError> {
    let result = folder.result();
    let p = theta.len();
    let covariance = result.covariance(model, like).unwrap_or_else(|| vec![0.0; p * p]);
    let (columns, part) = varying(&covariance, p, |_| true);
    let model = with_estimates(model, theta, Some(&covariance));
    let freedom = fewest(&freedom(result, &model, like), &columns);
    let noise = noise(result, &model);
    let errors = Errors { columns: &columns, covariance: &part };
    let anew = Errors { columns: &[], covariance: &[] };
    Predicted { model: &model, run, steps, theta, errors, anew, noise: &noise, freedom }.bands()
}

/// Of every run of a validation: shared parameters have the errors of the result, those of single runs were estimated anew.
pub fn of_validation(fit: &Fit, folder: &ResultFolder, runs: &[Run]) -> Vec<Result<Bands, BandError>> {
    let found = ResultDocument::from(FitDocument::of(fit));
    let kept = folder.result();
    let params = &fit.model.definition().params;
    let p = params.len();
    let mut all = Vec::with_capacity(runs.len());
    for (run, accuracy) in runs.iter().zip(&fit.integration) {
        let theta = found.theta(&fit.model, &run.name);
        let of =
            |document: &ResultDocument| document.covariance(&fit.model, &run.name).unwrap_or_else(|| vec![0.0; p * p]);
        let (shared, own) = (of(kept), of(&found));
        let (columns, part) = varying(&shared, p, |k| !params[k].per_run);
        let (anew, again) = varying(&own, p, |k| params[k].per_run);
        let mut free = vec![0.0; p * p];
        columns.iter().chain(&anew).for_each(|k| free[k * p + k] = 1.0);
        let model = with_estimates(&fit.model, &theta, Some(&free));
        let freedom = fewest(&freedom(kept, &model, &run.name), &columns);
        let noise = noise(kept, &model);
        let predicted = Predicted {
            model: &model,
            run,
            steps: accuracy.steps.clone(),
            theta: &theta,
            errors: Errors { columns: &columns, covariance: &part },
            anew: Errors { columns: &anew, covariance: &again },
            noise: &noise,
            freedom,
        };
        all.push(predicted.bands());
    }
    all
}

/// Where a run uses tables of a result at places that no run of the fit had visited: their values there are not known.
pub(crate) fn beyond_visited(
    folder: &ResultFolder,
    model: &Model,
    (run, theta): (&Run, &[f64]),
    steps: &Steps,
) -> Vec<String> {
    let Some(fit) = folder.result().fit() else { return Vec::new() };
    let one = |u: Unvisited| {
        format!(
            "run `{}` uses the table `{}` where no run of the fit had visited it ({:.0} % of its samples, the first at time {}): its values there \
             are not known",
            run.name,
            u.table,
            (100.0 * u.part).max(1.0),
            run.time[u.first]
        )
    };
    unvisited(&fit.tables, model, run, theta, steps).into_iter().map(one).collect()
}

/// What bands by errors under coloured noise are worth; none where the residuals of the fit are white.
pub(crate) fn of_coloured_noise(folder: &ResultFolder) -> Option<String> {
    let fit = folder.result().fit()?;
    let in_time = fit.noise_colour.iter().filter(|c| !c.is_white()).map(|c| &c.output);
    let mut names: Vec<String> = in_time.map(|o| format!("`{o}`")).collect();
    names.extend(fit.spectral_colour.iter().filter(|c| !c.is_white()).map(|c| format!("`{}`", c.output)));
    names.dedup();
    (!names.is_empty()).then(|| {
        format!(
            "residuals of {} are coloured: what lasts as long as the record (drift, 1/f) looks like a part of the response, and bands hold less often \
             than in 95 of 100 cases",
            names.join(", ")
        )
    })
}

fn fewest(freedom: &[Option<f64>], columns: &[usize]) -> Option<f64> {
    columns.iter().filter_map(|k| freedom[*k]).reduce(f64::min)
}

/// The kinds of columns of a band, each with a sign and whether noise counts.
pub(crate) const EDGES: [(&str, f64, bool); 4] =
    [("low", -1.0, false), ("high", 1.0, false), ("measured_low", -1.0, true), ("measured_high", 1.0, true)];

/// The edges of the bands of an output around its response (N by q): name, and values. Those of measurements only where the noise is known.
pub(crate) fn edges(bands: &Bands, name: &str, response: &[f64], output: usize, q: usize) -> Vec<(String, Vec<f64>)> {
    let mut columns = Vec::new();
    for (kind, sign, measured) in EDGES {
        let half = if measured { &bands.measurement } else { &bands.response };
        let pairs = response.iter().zip(half).skip(output).step_by(q);
        let values: Vec<f64> = pairs.map(|(y, half)| y + sign * half).collect();
        if !measured || values.iter().any(|v| v.is_finite()) {
            columns.push((format!("{name}_{kind}"), values));
        }
    }
    columns
}
