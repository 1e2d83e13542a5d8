//! Estimates for other programs.

use crate::estimate::{Fit, StartSummary, Termination, by_confidence};
use serde_json::{Value, json};

/// Parameters, outputs, cost and how the iteration ended, in the model's units. Numbers that do not exist are null.
pub fn fit_json(fit: &Fit) -> Value {
    let e = &fit.estimate;
    let outputs: Vec<Value> = e
        .outputs
        .iter()
        .map(|o| {
            let output = fit.model.definition().outputs.iter().find(|d| d.quantity.name == o.name);
            let unit = output.and_then(|d| d.quantity.unit.as_ref()).map(ToString::to_string);
            json!({
                "name": o.name, "run": o.run, "unit": unit, "rms": o.rms, "mean": o.bias, "r2": o.r2, "tic": o.tic,
                "compared": o.compared,
            })
        })
        .collect();
    let integration: Vec<Value> = e
        .runs
        .iter()
        .zip(&fit.integration)
        .map(|(run, a)| json!({ "run": run.run, "steps_per_interval": a.per_interval, "error": finite(a.error) }))
        .collect();
    json!({
        "model": fit.model.name(),
        "parameters": e.parameters,
        "outputs": outputs,
        "cost": e.cost,
        "termination": word(&e.termination),
        "message": e.termination.to_string(),
        "iterations": e.iterations,
        "evaluations": { "with_sensitivities": e.evaluations.0, "without": e.evaluations.1 },
        "undetermined": e.undetermined,
        "determined_by_prior": e.determined_by_prior,
        "covariance": { "parameters": e.covered, "values": rows(&e.covariance) },
        "correlations": { "parameters": e.covered, "values": rows(&e.correlations) },
        "noise_covariance": e.noise.as_ref().map(rows),
        "condition": e.condition,
        "history": e.history,
        "integration": integration,
        "starts": starts(fit),
        "rescue": fit.rescue,
        "rescue_message": fit.rescue.as_ref().map(ToString::to_string),
        "substituted": fit.substituted,
        "shooting": fit.shooting,
        "by_length": fit.by_length,
        "confidence": by_confidence(&fit.by_length),
        "weights": fit.reweighting,
    })
}

/// What came out of each start; null when there was only one.
fn starts(fit: &Fit) -> Value {
    let start = |s: &StartSummary| {
        json!({
            "start": s.number, "cost": s.cost, "iterations": s.iterations,
            "termination": s.termination.as_ref().map(word), "message": s.message,
            "minimum": s.minimum, "distance": s.distance, "values": s.values,
        })
    };
    if fit.starts.is_empty() { Value::Null } else { fit.starts.iter().map(start).collect() }
}

/// One word for each way in which an estimation can end.
fn word(termination: &Termination) -> &'static str {
    match termination {
        Termination::Converged(_) => "converged",
        Termination::IterationLimit => "iteration_limit",
        Termination::NoProgress => "no_progress",
        Termination::Diverged { .. } => "diverged",
        Termination::NotFinite { .. } => "not_finite",
        Termination::Interrupted => "interrupted",
    }
}

fn rows(matrix: &crate::estimate::Symmetric) -> Vec<&[f64]> {
    matrix.values.chunks(matrix.size.max(1)).collect()
}

fn finite(v: f64) -> Option<f64> {
    v.is_finite().then_some(v)
}
