//! An experiment from its description to its outcome.

use super::description::{Experiment, Stage};
use super::experiment_error::{ExperimentError, Fault};
use super::flight::Table;
use super::flight::flown;
use super::setting::{Found, run};
use super::setting::{Setting, Shelf};
use super::verdict::checks;
use fdm_estimate::Status;
use fdm_numeric::parallel;
use fdm_results::documents::reproduction::{Check, Outcome};
use std::collections::{BTreeMap, BTreeSet};

/// The records that an experiment makes.
///
/// # Errors
/// [`ExperimentError`], where a model, a name or a signal does not fit, or a truth runs away.
pub fn tables(experiment: &Experiment) -> Result<Vec<Table>, ExperimentError> {
    let made = experiment.records.iter().filter(|r| r.file.is_none());
    let tables: Result<Vec<Vec<Table>>, _> = made
        .map(|record| record.truth.as_ref().map_or(Ok(Vec::new()), |truth| flown(experiment, record, truth)))
        .collect();
    Ok(tables?.into_iter().flatten().collect())
}

/// Makes the records, runs all steps (those that are not long when `thin`), and compares with what was expected.
///
/// # Errors
/// [`ExperimentError`], where the description does not fit its models and records. A fit that goes wrong is a check that has not passed.
pub fn reproduce(experiment: &Experiment, thin: bool) -> Result<Outcome, ExperimentError> {
    let stages = &experiment.stages;
    let mut left_out = vec![false; stages.len()];
    let place = |name: &String| stages.iter().position(|s| s.name == *name);
    for (k, stage) in stages.iter().enumerate() {
        let needs = stage.held.keys().chain(&stage.from).filter_map(place);
        left_out[k] = thin && (stage.long || needs.into_iter().any(|n| left_out[n]));
    }
    let done = evaluated(experiment, &left_out, &checks)?;
    Ok(concluded(experiment, done.into_iter().flatten().collect()))
}

/// Runs all steps that are not left out, each when those that it needs are done; `conclude` says what becomes of one.
///
/// # Errors
/// As [`reproduce`].
pub(super) fn evaluated<T: Clone + Send>(
    experiment: &Experiment,
    left_out: &[bool],
    conclude: &(dyn Fn(&Stage, &Setting, &Found) -> T + Sync),
) -> Result<Vec<Option<(Found, T)>>, ExperimentError> {
    let stages = &experiment.stages;
    let place = |name: &String| stages.iter().position(|s| s.name == *name);
    let mut done: Vec<Option<(Found, T)>> = vec![None; stages.len()];
    let taken = stages.iter().zip(left_out).filter(|(_, out)| !**out).map(|(stage, _)| stage);
    let wanted: BTreeSet<&str> = taken.flat_map(|stage| stage.needed(experiment)).collect();
    let shelf = Shelf::filled(experiment, &wanted)?;
    loop {
        let ready: Vec<usize> = (0..stages.len())
            .filter(|k| done[*k].is_none() && !left_out[*k])
            .filter(|k| stages[*k].held.keys().chain(&stages[*k].from).filter_map(place).all(|n| done[n].is_some()))
            .collect();
        if ready.is_empty() {
            break;
        }
        let earlier: BTreeMap<&str, &Found> =
            stages.iter().zip(&done).filter_map(|(s, d)| Some((s.name.as_str(), &d.as_ref()?.0))).collect();
        let one = |k: &usize| -> Result<(Found, T), ExperimentError> {
            let stage = &stages[*k];
            let setting = Setting::new(experiment, stage, &shelf, &earlier)?;
            let fault =
                |f: Fault| ExperimentError::Faults { file: experiment.folder.join(Experiment::FILE), faults: vec![f] };
            let found = run(stage, &setting).map_err(fault)?;
            let concluded = conclude(stage, &setting, &found);
            Ok((found, concluded))
        };
        let results: Vec<Result<(Found, T), ExperimentError>> = parallel::map(ready.iter(), one);
        for (k, result) in ready.into_iter().zip(results) {
            done[k] = Some(result?);
        }
    }
    Ok(done)
}

fn concluded(experiment: &Experiment, done: Vec<(Found, Vec<Check>)>) -> Outcome {
    let estimated = |found: &Found| {
        let open = |status: Status| !matches!(status, Status::Fixed | Status::Derived | Status::Tied);
        found.parameters.iter().filter(|p| open(p.status)).count()
    };
    let parameters = done.iter().map(|(found, _)| estimated(found)).max().unwrap_or(0);
    let checks: Vec<Check> = done.into_iter().flat_map(|(_, checks)| checks).collect();
    let worst = checks
        .iter()
        .filter_map(|c| c.off)
        .map(f64::abs)
        .fold(None, |a: Option<f64>, z| Some(a.map_or(z, |a| a.max(z))));
    Outcome {
        system: experiment.name.clone(),
        title: experiment.title.clone(),
        source: experiment.source.clone(),
        remark: experiment.remark.clone(),
        passed: checks.iter().all(|c| c.passed) && !checks.is_empty(),
        parameters,
        worst_error_in_standard_errors: worst,
        checks,
    }
}
