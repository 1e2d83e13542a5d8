//! A diagnosis for other programs.

use crate::diagnose::diagnosis::{Cause, Diagnosis, NewValue};
use serde_json::{Value, json};

/// Verdict, causes, misfit, what would have been seen; `extended_model` is where the extended text was written. Numbers that do not exist
/// are null.
pub fn diagnosis_json(d: &Diagnosis, extended_model: Option<&str>) -> Value {
    json!({
        "verdict": d.verdict,
        "family_wise_p": d.family_wise_p,
        "causes": d.causes.iter().map(cause).collect::<Vec<_>>(),
        "misfit": misfit(d),
        "detectable": d.detectable,
        "extended_model": extended_model,
        "ended": d.ended,
        "rejected": d.rejected,
        "searches": d.rounds.iter().map(|r| json!({
            "family_wise_p": r.family_wise_p, "accepted": r.accepted, "ranking": r.ranking,
        })).collect::<Vec<_>>(),
        "biased_parameters": d.biased,
        "gains": d.gains,
        "outputs": d.outputs,
        "left_out": d.left_out,
        "noise_knots": d.noise_knots,
    })
}

fn cause(c: &Cause) -> Value {
    json!({
        "effect": c.place.effect, "targets": c.place.targets, "doc": c.doc,
        "parameters": c.parameters.iter().map(parameter).collect::<Vec<_>>(),
        "gain_train": c.gain_train, "gain_holdout": c.gain_holdout, "gain_predicted": c.gain_predicted,
        "score": c.score, "p": c.p, "group": c.group, "separating_experiment": c.separating_experiment,
    })
}

/// A null may be infinite, which JSON has no number for.
fn parameter(p: &NewValue) -> Value {
    let vanishing = p.null.map(|v| if v.is_finite() { json!(v) } else { json!(v.to_string()) });
    json!({
        "name": p.name, "doc": p.doc, "value": p.value, "standard_error": p.standard_error, "unit": p.unit, "null": vanishing,
    })
}

/// What the model as it stands leaves, beside what noise would leave.
fn misfit(d: &Diagnosis) -> Value {
    let one = |o: &crate::diagnose::diagnosis::OutputGain| {
        json!({
            "run": o.run, "output": o.output, "unit": o.unit, "rms": o.rms_before, "noise_floor": o.noise_floor,
        })
    };
    d.outputs.iter().filter(|o| !o.held_out).map(one).collect()
}
