//! `fdm export --to petab`: a result and the records that it was made from, as a problem of PEtab.

use crate::deliver::{refuse_standing, write_folder};
use crate::failure::{Ending, Failure, OrFailure, ended};
use fdm_estimate::Noise;
use fdm_petab::{Deviation, Record, Unsuited, problem};
use fdm_results::documents::FitDocument;
use fdm_session::load::ModelOrResult;
use fdm_session::simulate::fitted_runs;
use fdm_system::Model;
use fdm_system::record::Run;
use std::path::Path;

pub(crate) fn run(subject: &ModelOrResult, folder: &Path) -> Ending {
    refuse_standing(folder)?;
    let (model, result) = subject.load()?;
    crate::export::without_units(&model)?;
    let Some(result) = result else { return Err(Failure::input([Unsuited::NoRuns])) };
    if !subject.set.is_empty() {
        return Err(Failure::input(["--set: a problem holds the values of its result, at which its noise was found"]));
    }
    let Some(fit) = result.result().fit() else { return Err(Failure::input([Unsuited::NoRuns])) };
    let deviations = deviations(&model, fit, &result.manifest().noise)?;
    let runs = fitted_runs(&result, None, &model)?;
    let runs: Vec<Run> =
        runs.iter().map(|r| r.with_measured(model.definition())).collect::<Result<_, _>>().or_failure()?;
    let thetas: Vec<Vec<f64>> =
        runs.iter().map(|r| result.theta(&model, &r.name, None)).collect::<Result<_, _>>().or_failure()?;
    let records: Vec<Record<'_>> = runs
        .iter()
        .zip(&thetas)
        .map(|(run, theta)| Record {
            name: &run.name,
            time: &run.time,
            inputs: &run.inputs,
            held: &run.held,
            measured: &run.measured,
            theta,
        })
        .collect();
    let files = problem(model.definition(), &records, &deviations).or_failure()?;
    let files: Vec<_> = files.into_iter().map(|file| (file.path, file.text.into_bytes())).collect();
    write_folder(folder, &files)?;
    ended(true)
}

/// The noise of every output, by which the result was judged. One that was estimated is the root mean square of the residuals, at which the
/// likelihood is greatest; the covariance of a result is larger, since it allows for the parameters that were fitted.
fn deviations(model: &Model, fit: &FitDocument, noise: &Noise) -> Result<Vec<Deviation>, Failure> {
    let refused = |what: &str| Err(Failure::input([what]));
    if fit.loss.is_some() {
        return refused(
            "the residuals were not judged by their squares (--loss), and a problem of normal noise judges them so",
        );
    }
    let outputs = &model.definition().outputs[..];
    let given = match noise.clone().or_declared(outputs) {
        Noise::Full => {
            return refused("the noise of the outputs is correlated (--noise full), which PEtab has no place for");
        }
        Noise::Given(given) => given,
        Noise::Diagonal => Vec::new(),
    };
    let one = |(o, output): (usize, &fdm_grammar::model::Output)| {
        if output.noise_model.is_some() {
            return Deviation::Stated;
        }
        if let Some(deviation) = given.get(o).copied().flatten() {
            return Deviation::Known(deviation);
        }
        let own = || fit.outputs.iter().filter(|own| own.name == output.quantity.name);
        let squares: f64 = own().filter_map(|own| Some(own.rms?.powi(2) * own.compared as f64)).sum();
        let count: usize = own().map(|own| own.compared).sum();
        Deviation::Open((squares / count.max(1) as f64).sqrt())
    };
    Ok(outputs.iter().enumerate().map(one).collect())
}
