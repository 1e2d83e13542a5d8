//! A step of the evaluation: its estimation is run, and what came out is collected under the names by which it can be expected.

use super::description::{Method, Stage};
use super::experiment_error::Fault;
use super::setting::Setting;
use super::weakest::Weakest;
use crate::Model;
use crate::estimate::{
    Changes, Direction, Estimate, Fit, FitOptions, Options, ParameterEstimate, Status, by_confidence, fit, fit_spectra,
};
use crate::linear::{LinearModel, Modes, Values};
use crate::quality::OutputQuality;
use crate::regression::regress;
use fdm_grammar::model::Origin;
use num_complex::Complex64;
use std::collections::BTreeMap;

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

/// Runs a step.
///
/// # Errors
/// [`Fault`] for words that it does not have; a fit that fails is [`Found::astray`].
pub(super) fn run(stage: &Stage, setting: &Setting) -> Result<Found, Fault> {
    match stage.method {
        Method::Oe => Ok(in_time(stage, setting)),
        Method::Fd => in_frequency(stage, setting),
        Method::Regress => by_regression(stage, setting),
        Method::Modes => Ok(modes(setting)),
    }
}

fn in_time(stage: &Stage, setting: &Setting) -> Found {
    let fit = match fit(&setting.model, &setting.runs, &stage.in_time(setting), &mut ()) {
        Ok(fit) => fit,
        Err(e) => return Found::gone(e),
    };
    let mut found = Found::of(&fit.estimate, fit.estimate.parameters.clone());
    found.judged("", &fit.quality);
    found.order = by_confidence(&fit.by_length).into_iter().map(|s| s.name).collect();
    if !setting.others.is_empty() && found.astray.is_none() {
        match predicted(&fit, setting) {
            Ok(other) => found.judged("predicted ", &other.quality),
            Err(reason) => found.astray = Some(reason),
        }
    }
    found
}

/// Runs that took no part, with initial states and biases of their own.
fn predicted(fit_: &Fit, setting: &Setting) -> Result<Fit, String> {
    let shared =
        fit_.model.definition().params.iter().filter(|p| !p.per_run && !p.fixed && p.origin == Origin::Declared);
    let names: Vec<String> = shared.map(|p| p.quantity.name.clone()).collect();
    let value = |name: &String| Some((name.clone(), fit_.estimate.parameter(name, None)?.value));
    let changes = Changes { set: names.iter().filter_map(value).collect(), fix: names, ..Changes::default() };
    let options =
        FitOptions { changes, options: Options { colour: false, ..Options::default() }, ..FitOptions::default() };
    fit(&fit_.model, &setting.others, &options, &mut ()).map_err(|e| e.to_string())
}

fn in_frequency(stage: &Stage, setting: &Setting) -> Result<Found, Fault> {
    let fit = match fit_spectra(&setting.model, &setting.runs, &stage.in_frequency(setting)?, &mut ()) {
        Ok(fit) => fit,
        Err(e) => return Ok(Found::gone(e)),
    };
    let mut found = Found::of(&fit.estimate, fit.parameters());
    fit.finish.iter().for_each(|finish| found.judged("", &finish.quality));
    if !setting.others.is_empty() && found.astray.is_none() {
        match fit.predict(&setting.others, &mut ()) {
            Ok(other) => found.judged("predicted ", &other.quality),
            Err(e) => found.astray = Some(e.to_string()),
        }
    }
    Ok(found)
}

fn by_regression(stage: &Stage, setting: &Setting) -> Result<Found, Fault> {
    let mut params = setting.model.definition().params.clone();
    if let Err(mistakes) = setting.changes.apply(&mut params) {
        return Ok(Found::gone(mistakes.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")));
    }
    let model = setting.model.with_params(params);
    let regression = match regress(&model, &setting.runs, &stage.by_regression()?) {
        Ok(regression) => regression,
        Err(e) => return Ok(Found::gone(e)),
    };
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
            unit: p.unit.clone(),
            status: Status::Estimated,
            start: None,
            lower: None,
            upper: None,
        }));
    }
    Ok(found)
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
