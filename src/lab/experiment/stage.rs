//! A step of the evaluation: its estimation is run, and what came out is collected under the names by which it can be expected.

use super::description::{Domain, Method, Stage};
use super::experiment_error::Fault;
use super::setting::Setting;
use super::weakest::Weakest;
use fdm_estimate::equation_error::regress;
use fdm_estimate::residuals::OutputQuality;
use fdm_estimate::{
    Direction, Estimate, Noise, ParameterEstimate, Status, Work, best_iterate, by_confidence, changed, fit, fit_filter,
    fit_responses, fit_spectra,
};
use fdm_system::Model;
use fdm_system::linear::{LinearModel, Modes, Values};
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
    match (stage.method, stage.domain) {
        (Method::OutputError, Some(Domain::Frequency)) => in_frequency(stage, setting),
        (Method::OutputError, _) => Ok(in_time(stage, setting)),
        (_, Some(_)) => Err(Fault::Word {
            place: format!("step `{}`", stage.name),
            word: "domain".into(),
            wanted: "the words of this method: it belongs to `output-error`",
        }),
        (Method::FrequencyResponse, None) => Ok(by_responses(stage, setting)),
        (Method::FilterError, None) => Ok(by_filter(stage, setting)),
        (Method::RecursiveLeastSquares, None) => Ok(recursively(stage, setting)),
        (Method::EquationError, None) => by_regression(stage, setting),
        (Method::Modes, None) => Ok(modes(setting)),
    }
}

fn in_time(stage: &Stage, setting: &Setting) -> Found {
    let fit = match fit(&setting.model, &setting.runs, &stage.in_time(setting), &Work::default()) {
        Ok(fit) => fit,
        Err(e) => return Found::gone(e),
    };
    let mut found = Found::of(&fit.estimate, fit.estimate.parameters.clone());
    found.judged("", &fit.quality);
    found.order = by_confidence(&fit.by_length).into_iter().map(|s| s.name).collect();
    if !setting.others.is_empty() && found.astray.is_none() {
        match fit.predict(&setting.others, Noise::default(), &Work::default()) {
            Ok(other) => found.judged("predicted ", &other.quality),
            Err(e) => found.astray = Some(e.to_string()),
        }
    }
    found
}

fn in_frequency(stage: &Stage, setting: &Setting) -> Result<Found, Fault> {
    let fit = match fit_spectra(&setting.model, &setting.runs, &stage.in_frequency(setting)?, &Work::default()) {
        Ok(fit) => fit,
        Err(e) => return Ok(Found::gone(e)),
    };
    let mut found = Found::of(&fit.estimate, fit.parameters());
    fit.finish.iter().for_each(|finish| found.judged("", &finish.quality));
    if !setting.others.is_empty() && found.astray.is_none() {
        match fit.predict(&setting.others, &Work::default()) {
            Ok(other) => found.judged("predicted ", &other.quality),
            Err(e) => found.astray = Some(e.to_string()),
        }
    }
    Ok(found)
}

fn by_responses(stage: &Stage, setting: &Setting) -> Found {
    match fit_responses(&setting.model, &setting.runs, &stage.of_responses(setting), &Work::default()) {
        Ok(fit) => Found::of(&fit.estimate, fit.estimate.parameters.clone()),
        Err(e) => Found::gone(e),
    }
}

/// Deviations of the measurement noise are figures: `noise(y)`.
fn by_filter(stage: &Stage, setting: &Setting) -> Found {
    let found = match fit_filter(&setting.model, &setting.runs, &stage.in_time(setting), &Work::default()) {
        Ok(found) => found,
        Err(e) => return Found::gone(e),
    };
    let mut figures = Found::of(&found.fit.estimate, found.fit.estimate.parameters.clone());
    figures.judged("", &found.fit.quality);
    let whiteness = found.fit.quality.iter().filter_map(|q| Some(q.whiteness.as_ref()?.p_value));
    figures.figures.insert("white p".into(), whiteness.fold(1.0, f64::min));
    for (output, deviation) in setting.model.definition().outputs.iter().zip(&found.deviations) {
        figures.figures.insert(format!("noise({})", output.quantity.name), deviation.value);
    }
    figures
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

fn by_regression(stage: &Stage, setting: &Setting) -> Result<Found, Fault> {
    let model = match changed(&setting.model, &setting.changes) {
        Ok(model) => model,
        Err(e) => return Ok(Found::gone(e)),
    };
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
