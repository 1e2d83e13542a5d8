//! What a step of the evaluation works on: its model, its runs, its start values, and what the truth is.
//!
//! A step of the evaluation: its estimation is run, and what came out is collected under the names by which it can be expected.
//!
//! The combination of parameters that a record determines least: the eigenvector of the relative covariance with the largest eigenvalue.

use super::description::{Experiment, Record, Stage, Task};
use super::experiment_error::{ExperimentError, Fault};
use super::flight::{Table, flown};
use fdm_estimate::equation_error::Regression;
use fdm_estimate::residuals::OutputQuality;
use fdm_estimate::{
    Changes, Direction, Estimate, FilterFit, FitOptions, Identified, Method, Noise, ParameterEstimate, Status, Work,
    best_iterate, by_confidence, changed, identify,
};
use fdm_grammar::model::{Origin, Param};
use fdm_system::Model;
use fdm_system::linear::{LinearModel, Modes, Values};
use fdm_system::record::{ReadOptions, Run, channels, read};
use nalgebra::DMatrix;
use num_complex::Complex64;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// All records of an experiment as files.
pub(super) struct Shelf {
    /// Names of runs and their files, for each record.
    files: BTreeMap<String, Vec<(String, PathBuf)>>,
    /// Holds what was made.
    _made: tempfile::TempDir,
}

impl Shelf {
    /// Makes what is to be made of these records.
    pub(super) fn filled(experiment: &Experiment, wanted: &BTreeSet<&str>) -> Result<Self, ExperimentError> {
        let unwritable = |e: std::io::Error| {
            let (file, reason) = (std::env::temp_dir(), fdm_results::store::reason(&e));
            ExperimentError::Unreadable { file, reason }
        };
        let made = tempfile::tempdir().map_err(unwritable)?;
        let mut files = BTreeMap::new();
        for record in experiment.records.iter().filter(|r| wanted.contains(r.name.as_str())) {
            let named = |table: &Table| Ok((table.name.clone(), table.write(made.path())?));
            let places: Result<Vec<_>, ExperimentError> = match (&record.file, &record.truth) {
                (Some(file), _) => Ok(vec![(record.name.clone(), experiment.folder.join(file))]),
                (None, Some(truth)) => flown(experiment, record, truth)?.iter().map(named).collect(),
                (None, None) => Ok(Vec::new()),
            };
            files.insert(record.name.clone(), places?);
        }
        Ok(Self { files, _made: made })
    }

    /// The runs of some records for a model.
    fn runs(&self, names: &[String], model: &Model, stage: &Stage) -> Result<Vec<Run>, ExperimentError> {
        let declared = model.definition().inputs.iter().filter(|i| i.is_declared() && !i.known);
        let names_of = declared.map(|i| i.quantity.name.clone());
        let straight = names_of.filter(|name| !stage.hold.contains(name)).collect();
        let options = ReadOptions {
            map: stage.map.iter().map(|(channel, column)| (channel.clone(), column.clone())).collect(),
            from: stage.window.map(|w| w[0]),
            to: stage.window.map(|w| w[1]),
            every: stage.every.unwrap_or(1),
            hold: stage.hold.clone(),
            // an experiment is explicit: what it does not hold goes in straight lines, as it was flown
            linear: straight,
            ..ReadOptions::default()
        };
        let channels = channels(model.definition());
        let mut runs = Vec::new();
        for (name, file) in names.iter().filter_map(|n| self.files.get(n)).flatten() {
            let (run, _) = read(file, &channels, &options)?;
            runs.push(Run { name: name.clone(), ..run });
        }
        Ok(runs)
    }

    /// The record that a run belongs to.
    fn record_of(&self, run: &str) -> Option<&str> {
        let has = |files: &[(String, PathBuf)]| files.iter().any(|(name, _)| name == run);
        self.files.iter().find(|(_, files)| has(files)).map(|(record, _)| record.as_str())
    }
}

/// What a step works on.
pub(super) struct Setting {
    pub(super) model: Model,
    pub(super) runs: Vec<Run>,
    /// Runs that are predicted.
    pub(super) others: Vec<Run>,
    pub(super) changes: Changes,
    /// True values by parameter and, where it has its own there, run.
    truth: BTreeMap<(String, Option<String>), f64>,
}

impl Setting {
    /// Collects it; `earlier` are the results of the steps that this one needs.
    pub(super) fn new(
        experiment: &Experiment,
        stage: &Stage,
        shelf: &Shelf,
        earlier: &BTreeMap<&str, &Found>,
    ) -> Result<Self, ExperimentError> {
        let model = Model::from_file(experiment.folder.join(&stage.model))?;
        let all = || experiment.records.iter().map(|r| r.name.clone()).collect::<Vec<_>>();
        let names = if stage.records.is_empty() { all() } else { stage.records.clone() };
        let (mut runs, mut others) = (Vec::new(), Vec::new());
        if stage.method != Task::Modes {
            runs = shelf.runs(&names, &model, stage)?;
            others = shelf.runs(&stage.predict, &model, stage)?;
        }
        let mut setting = Self { model, runs, others, changes: Changes::default(), truth: BTreeMap::new() };
        setting.find_truth(experiment, &names, shelf)?;
        setting.changes = setting.changed(stage, earlier);
        setting.check_names(experiment, stage, earlier)?;
        Ok(setting)
    }

    fn find_truth(
        &mut self,
        experiment: &Experiment,
        records: &[String],
        shelf: &Shelf,
    ) -> Result<(), ExperimentError> {
        let mut models: BTreeMap<&str, Model> = BTreeMap::new();
        for record in records.iter().filter_map(|name| experiment.record(name)) {
            let Some(file) = record.truth.as_deref().filter(|_| record.file.is_none()) else { continue };
            if !models.contains_key(file) {
                models.insert(file, Model::from_file(experiment.folder.join(file))?);
            }
            let values = true_values(&models[file], record);
            let params = &self.model.definition().params;
            for param in params {
                let name = &param.quantity.name;
                let Some(value) = values.get(name).copied() else { continue };
                if param.per_run {
                    let own = self.runs.iter().filter(|r| shelf.record_of(&r.name) == Some(&record.name));
                    self.truth.extend(own.map(|r| ((name.clone(), Some(r.name.clone())), value)));
                } else {
                    self.truth.entry((name.clone(), None)).or_insert(value);
                }
            }
        }
        Ok(())
    }

    /// The true value of a parameter, or of a parameter of a run.
    pub(super) fn truth(&self, name: &str, run: Option<&str>) -> Option<f64> {
        self.truth.get(&(name.to_string(), run.map(String::from))).copied()
    }

    fn changed(&self, stage: &Stage, earlier: &BTreeMap<&str, &Found>) -> Changes {
        let params = &self.model.definition().params;
        let mut set: BTreeMap<String, f64> = BTreeMap::new();
        let open = |p: &&Param| {
            (!p.fixed || stage.free.contains(&p.quantity.name)) && !p.per_run && p.origin == Origin::Declared
        };
        if stage.off != 0.0 {
            for (k, p) in params.iter().filter(open).enumerate() {
                let factor = if k % 2 == 0 { 1.0 + stage.off } else { 1.0 - stage.off };
                let value = self.truth(&p.quantity.name, None).unwrap_or(p.value) * factor;
                set.insert(p.quantity.name.clone(), value.clamp(p.lower, p.upper));
            }
        }
        if let Some(found) = stage.from.as_deref().and_then(|name| earlier.get(name)) {
            let known =
                found.parameters.iter().filter(|f| f.run.is_none() && params.iter().any(|p| p.quantity.name == f.name));
            set.extend(known.map(|f| (f.name.clone(), f.value)));
        }
        let mut fix = stage.fix.clone();
        for (step, names) in &stage.held {
            let Some(found) = earlier.get(step.as_str()) else { continue };
            for value in found.parameters.iter().filter(|f| names.contains(&f.name)) {
                set.insert(value.name.clone(), value.value);
                fix.push(value.name.clone());
            }
        }
        set.extend(stage.set.iter().map(|(name, value)| (name.clone(), *value)));
        Changes { set: set.into_iter().collect(), fix, free: stage.free.clone() }
    }

    /// Names of parameters that the model does not have.
    fn check_names(
        &self,
        experiment: &Experiment,
        stage: &Stage,
        earlier: &BTreeMap<&str, &Found>,
    ) -> Result<(), ExperimentError> {
        let d = self.model.definition();
        let params = || {
            d.params.iter().map(|p| p.quantity.name.as_str()).chain(d.derived.iter().map(|d| d.quantity.name.as_str()))
        };
        let says = &stage.says;
        let lists = [&stage.fix, &stage.free, &stage.except, &says.undetermined, &says.determined, &says.biased];
        let flat = says.not_identifiable.iter().chain(&says.weak).chain(&says.order).flatten();
        let held = stage.held.values().flatten();
        let named = lists.into_iter().flatten().chain(flat).chain(held).chain(stage.set.keys());
        let place = || format!("step `{}`", stage.name);
        let unknown = named.filter(|name| !params().any(|p| p == name.as_str()));
        let mut faults: Vec<Fault> = unknown.map(|name| Fault::unknown(place(), "parameter", name, params())).collect();
        for (step, names) in &stage.held {
            // what went astray is told by its own check
            let Some(found) = earlier.get(step.as_str()).filter(|f| !f.parameters.is_empty()) else { continue };
            let known = || found.parameters.iter().map(|p| p.name.as_str());
            let lost = names.iter().filter(|name| !known().any(|own| own == name.as_str()));
            faults.extend(lost.map(|name| Fault::unknown(place(), "earlier parameter", name, known())));
        }
        if faults.is_empty() {
            return Ok(());
        }
        Err(ExperimentError::Faults { file: experiment.folder.join(Experiment::FILE), faults })
    }
}

/// Parameters of a truth as a record has them.
fn true_values(truth: &Model, record: &Record) -> BTreeMap<String, f64> {
    let params = truth.definition().params.iter();
    let value = |p: &Param| record.values.get(&p.quantity.name).copied().unwrap_or(p.value);
    params.map(|p| (p.quantity.name.clone(), value(p))).collect()
}

/// What came out of a step.
#[derive(Debug, Clone, Default)]
pub(super) struct Found {
    pub(super) parameters: Vec<ParameterEstimate>,
    /// Everything else that has a name.
    pub(super) figures: BTreeMap<String, f64>,
    /// Combinations that the data do not determine.
    pub(super) directions: Vec<Direction>,
    /// The combination that is known least.
    pub(super) weakest: Option<Weakest>,
    /// Parameters in the order of confidence.
    pub(super) order: Vec<String>,
    /// Eigenvalues.
    pub(super) modes: Vec<Complex64>,
    /// Why there is no minimum.
    pub(super) astray: Option<String>,
}

impl Found {
    fn gone(reason: impl ToString) -> Self {
        Self { astray: Some(reason.to_string()), ..Self::default() }
    }

    fn of(estimate: &Estimate, parameters: Vec<ParameterEstimate>) -> Self {
        let mut found = Self { parameters, directions: estimate.undetermined.clone(), ..Self::default() };
        found.astray = (!estimate.termination.is_good()).then(|| estimate.termination.to_string());
        found.figures.extend(estimate.cost.map(|cost| ("cost".to_string(), cost)));
        found.figures.insert("corrections".into(), estimate.iterations as f64);
        found.weakest = Weakest::of(estimate);
        let squares = estimate.runs.iter().flat_map(|r| &r.residuals).filter(|v| !v.is_nan()).map(|v| v * v).sum();
        found.figures.insert("sum of squares".into(), squares);
        found
    }

    /// The worst over the runs of each figure of an output.
    fn judged(&mut self, prefix: &str, quality: &[OutputQuality]) {
        for q in quality.iter().map(|q| &q.fit) {
            for (kind, value, worse) in
                [("rms", q.rms, f64::max as fn(f64, f64) -> f64), ("tic", q.tic, f64::max), ("r2", q.r2, f64::min)]
            {
                let Some(value) = value else { continue };
                let entry = self.figures.entry(format!("{prefix}{kind}({})", q.name)).or_insert(value);
                *entry = worse(*entry, value);
            }
        }
    }
}

impl Found {
    /// Deviations of the measurement noise are figures: `noise(y)`.
    fn filtered(&mut self, filter: &FilterFit) {
        let whiteness = filter.fit.quality.iter().filter_map(|q| Some(q.whiteness.as_ref()?.p_value));
        self.figures.insert("white p".into(), whiteness.fold(1.0, f64::min));
        for (output, deviation) in filter.fit.model.definition().outputs.iter().zip(&filter.deviations) {
            self.figures.insert(format!("noise({})", output.quantity.name), deviation.value);
        }
    }
}

/// Runs a step.
///
/// # Errors
/// [`Fault`] for words that it does not have; a fit that fails is [`Found::astray`].
pub(super) fn run(stage: &Stage, setting: &Setting) -> Result<Found, Fault> {
    match (stage.method, stage.domain) {
        (Task::Estimation(Method::OutputError), _) | (_, None) => {}
        (_, Some(_)) => {
            return Err(Fault::Word {
                place: format!("step `{}`", stage.name),
                word: "domain".into(),
                wanted: "the words of this method: it belongs to `output-error`",
            });
        }
    }
    match stage.method {
        Task::Estimation(method) => Ok(estimated(setting, &stage.of_method(method, setting)?)),
        Task::RecursiveLeastSquares => Ok(recursively(stage, setting)),
        Task::Modes => Ok(modes(setting)),
    }
}

fn estimated(setting: &Setting, options: &FitOptions) -> Found {
    let identified = match identify(&setting.model, &setting.runs, options, &Work::default()) {
        Ok(identified) => identified,
        Err(e) => return Found::gone(e),
    };
    let mut found = match (&identified, identified.estimate()) {
        (Identified::EquationError { regression, .. }, _) => return by_regression(regression),
        (Identified::Spectra(fit), _) => Found::of(&fit.estimate, fit.parameters()),
        (_, Some(estimate)) => Found::of(estimate, estimate.parameters.clone()),
        (_, None) => Found::default(),
    };
    identified.in_time().iter().for_each(|fit| found.judged("", &fit.quality));
    match &identified {
        Identified::OutputError(fit) => {
            found.order = by_confidence(&fit.by_length).into_iter().map(|s| s.name).collect();
        }
        Identified::FilterError(filter) => found.filtered(filter),
        _ => {}
    }
    if !setting.others.is_empty() && found.astray.is_none() {
        match identified.predict(&setting.others, Noise::default(), &Work::default()) {
            Ok(other) => other.iter().for_each(|other| found.judged("predicted ", &other.quality)),
            Err(e) => found.astray = Some(e.to_string()),
        }
    }
    found
}

/// The best iterate; the errors of its simulation, of the last one's and of least squares without forgetting are figures.
fn recursively(stage: &Stage, setting: &Setting) -> Found {
    let model = match changed(&setting.model, &setting.changes) {
        Ok(model) => model,
        Err(e) => return Found::gone(e),
    };
    let best = match best_iterate(&model, &setting.runs, &stage.recursively()) {
        Ok(best) => best,
        Err(e) => return Found::gone(e),
    };
    let (recursion, mut found) = (&best.recursion, Found::default());
    let last = recursion.iterates.len().saturating_sub(1);
    let figures = [
        ("error of the best iterate", best.error_of(best.best)),
        ("error of the last iterate", best.error_of(last)),
        ("error of least squares", best.batch_error),
        ("time of the best iterate", recursion.iterates.get(best.best).map(|i| i.time)),
    ];
    found.figures.extend(figures.into_iter().filter_map(|(name, value)| Some((name.to_string(), value?))));
    let Some(iterate) = recursion.iterates.get(best.best) else { return Found::gone("there is no iterate") };
    found.parameters = (recursion.parameters.iter().zip(&iterate.values).zip(&iterate.errors))
        .map(|((p, value), error)| ParameterEstimate {
            name: p.name.clone(),
            run: p.run.clone(),
            value: *value,
            standard_error: Some(*error),
            corrected_error: None,
            degrees_of_freedom: None,
            unit: p.unit.clone(),
            status: Status::Estimated,
            start: None,
            lower: None,
            upper: None,
            limit: None,
            logarithmic: false,
        })
        .collect();
    found
}

fn by_regression(regression: &Regression) -> Found {
    let mut found = Found::default();
    for fit in &regression.fits {
        for equation in &fit.equations {
            found.figures.insert(format!("r2({})", equation.equation), equation.r_squared);
            found.figures.insert(format!("components({})", equation.equation), fit.chosen as f64);
        }
        found.parameters.extend(fit.parameters.iter().map(|p| ParameterEstimate {
            name: p.name.clone(),
            run: p.run.clone(),
            value: p.value,
            standard_error: Some(p.standard_error),
            corrected_error: p.coloured_error,
            degrees_of_freedom: None,
            unit: p.unit.clone(),
            status: Status::Estimated,
            start: None,
            lower: None,
            upper: None,
            limit: None,
            logarithmic: false,
        }));
    }
    found
}

/// Eigenvalues of the model as it stands.
fn modes(setting: &Setting) -> Found {
    let found = eigenvalues(&setting.model);
    found.map_or_else(Found::gone, |modes| Found { modes, ..Found::default() })
}

fn eigenvalues(model: &Model) -> Result<Vec<Complex64>, String> {
    let mut linear = LinearModel::new(model).map_err(|e| e.to_string())?;
    let mut values = Values::default();
    linear.evaluate(&model.definition().start(), &mut values).map_err(|e| e.to_string())?;
    let modes = Modes::new(linear.structure(), &values).map_err(|e| e.to_string())?;
    Ok(modes.modes.iter().map(|m| m.s).collect())
}

/// The combination that is known least.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Weakest {
    /// Parameters and their parts, relative to their values; the largest first.
    pub(super) parts: Vec<(String, f64)>,
    /// Standard error of the combination, relative to the values.
    pub(super) error: f64,
}

/// Parts that are smaller are not named.
const PART: f64 = 0.1;

impl Weakest {
    /// Of the shared parameters; those that belong to a run are left to take what values they need. None when nothing is covered.
    pub(super) fn of(estimate: &Estimate) -> Option<Self> {
        let full = &estimate.corrected_covariance;
        let matrix = if full.size == estimate.covered.len() { full } else { &estimate.covariance };
        let of = |row: &usize| -> Option<&ParameterEstimate> { estimate.parameters.get(*estimate.covered.get(*row)?) };
        let shared = |row: &usize| of(row).is_some_and(|p| p.run.is_none() && p.value != 0.0);
        let rows: Vec<usize> = (0..matrix.size).filter(shared).collect();
        let values: Vec<f64> = rows.iter().filter_map(of).map(|p| p.value).collect();
        let relative =
            DMatrix::from_fn(rows.len(), rows.len(), |i, j| matrix.at(rows[i], rows[j]) / (values[i] * values[j]));
        if rows.is_empty() || relative.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let eigen = relative.symmetric_eigen();
        let largest = (0..rows.len()).max_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]))?;
        let vector = eigen.eigenvectors.column(largest);
        let first = vector.iter().fold(0.0, |a: f64, v| if v.abs() > a.abs() { *v } else { a });
        let names = rows.iter().filter_map(of).map(|p| p.name.clone());
        let mut parts: Vec<(String, f64)> =
            names.zip(vector.iter().map(|v| v / first)).filter(|(_, v)| v.abs() > PART).collect();
        parts.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
        Some(Self { parts, error: eigen.eigenvalues[largest].max(0.0).sqrt() })
    }
}
