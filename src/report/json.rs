//! Estimates for other programs.

use super::remarks::{estimate_remarks, fit_remarks};
use crate::Model;
use crate::estimate::{Estimate, Fit, StartSummary, Symmetric, Termination, by_confidence};
use crate::quality::{OutputFit, OutputQuality};
use serde_json::{Value, json};

/// Parameters, outputs, cost and how the iteration ended, in the model's units. Numbers that do not exist are null.
pub fn fit_json(fit: &Fit) -> Value {
    let e = &fit.estimate;
    let integration: Vec<Value> = e
        .runs
        .iter()
        .zip(&fit.integration)
        .map(|(run, a)| {
            let samples = run.response.len() / e.outputs.len().max(1);
            json!({
                "run": run.run, "integrator": a.steps.scheme().to_string(), "steps": a.steps.total(samples),
                "steps_per_interval": a.steps.most(), "spacing": a.steps, "error": finite(a.error),
            })
        })
        .collect();
    let mut document = estimate_json(&fit.model, e);
    if !fit.quality.is_empty() {
        document["outputs"] = quality_json(&fit.model, &fit.quality).into();
        document["remarks"] = json!(fit_remarks(fit));
    }
    let way = json!({
        "integration": integration,
        "rescue": fit.rescue,
        "rescue_message": fit.rescue.as_ref().map(ToString::to_string),
        "substituted": fit.substituted,
        "shooting": fit.shooting,
        "by_length": fit.by_length,
        "confidence": by_confidence(&fit.by_length),
        "weights": fit.reweighting,
        "starts": if fit.starts.is_empty() { Value::Null } else { starts_json(&fit.starts) },
    });
    if let (Value::Object(document), Value::Object(way)) = (&mut document, way) {
        document.extend(way);
    }
    document
}

/// What is the same for every estimate, however it was reached.
pub(super) fn estimate_json(model: &Model, e: &Estimate) -> Value {
    json!({
        "model": model.name(),
        "parameters": e.parameters,
        "outputs": e.outputs.iter().map(|o| output(model, o)).collect::<Vec<_>>(),
        "cost": e.cost,
        "termination": word(&e.termination),
        "message": e.termination.to_string(),
        "iterations": e.iterations,
        "aids": e.aids.iter().map(ToString::to_string).collect::<Vec<_>>(),
        "evaluations": { "with_sensitivities": e.evaluations.0, "without": e.evaluations.1 },
        "drawn_by_noise": e.drawn,
        "undetermined": e.undetermined,
        "determined_by_prior": e.determined_by_prior,
        "covariance": { "parameters": e.covered, "values": rows(&e.covariance) },
        "correlations": { "parameters": e.covered, "values": rows(&e.correlations) },
        "corrected_covariance": { "parameters": e.covered, "values": rows(&e.corrected_covariance) },
        "noise_colour": e.colours,
        "uncorrected": e.uncorrected.as_ref().map(ToString::to_string),
        "noise_covariance": e.noise.as_ref().map(rows),
        "condition": e.condition,
        "history": e.history,
        "remarks": estimate_remarks(e),
    })
}

/// Residuals of every output of every run: size, parts of Theil's coefficient, whiteness, spectrum, distribution, correlation with inputs.
pub fn quality_json(model: &Model, quality: &[OutputQuality]) -> Vec<Value> {
    let one = |q: &OutputQuality| {
        let mut value = output(model, &q.fit);
        value["whiteness"] = json!(q.whiteness);
        value["spectrum"] = json!(q.spectrum);
        value["distribution"] = json!(q.distribution);
        value["inputs"] = json!(q.inputs);
        value["untested"] = json!(q.untested.map(|u| u.to_string()));
        value
    };
    quality.iter().map(one).collect()
}

fn output(model: &Model, o: &OutputFit) -> Value {
    let declared = model.definition().outputs.iter().find(|d| d.quantity.name == o.name);
    let unit = declared.and_then(|d| d.quantity.unit.as_ref()).map(ToString::to_string);
    json!({
        "name": o.name, "run": o.run, "unit": unit, "rms": o.rms, "mean": o.bias, "r2": o.r2, "tic": o.tic,
        "tic_parts": o.tic_parts, "compared": o.compared,
    })
}

/// What came out of each start.
pub fn starts_json(starts: &[StartSummary]) -> Value {
    let start = |s: &StartSummary| {
        json!({
            "start": s.number, "cost": s.cost, "iterations": s.iterations,
            "termination": s.termination.as_ref().map(word), "message": s.message,
            "minimum": s.minimum, "distance": s.distance, "values": s.values,
        })
    };
    starts.iter().map(start).collect()
}

/// One word for each way in which an estimation can end.
fn word(termination: &Termination) -> &'static str {
    match termination {
        Termination::Converged(_) => "converged",
        Termination::IterationLimit => "iteration_limit",
        Termination::NoProgress => "no_progress",
        Termination::Diverged { .. } => "diverged",
        Termination::Unanswered { .. } => "unanswered",
        Termination::NotFinite { .. } => "not_finite",
        Termination::Interrupted => "interrupted",
    }
}

fn rows(matrix: &Symmetric) -> Vec<&[f64]> {
    matrix.values.chunks(matrix.size.max(1)).collect()
}

fn finite(v: f64) -> Option<f64> {
    v.is_finite().then_some(v)
}
