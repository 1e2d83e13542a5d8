//! A diagnosis for other programs.

use crate::diagnose::diagnosis::{Cause, Diagnosis, NewValue, Verdict};
use serde_json::{Value, json};

/// Verdict, causes, misfit, what would have been seen; `extended_model` is where the extended text was written. Numbers that do not exist
/// are null.
pub fn diagnosis_json(d: &Diagnosis, extended_model: Option<&str>) -> Value {
    json!({
        "verdict": d.verdict,
        "family_wise_p": d.family_wise_p,
        "causes": d.causes.iter().map(cause).collect::<Vec<_>>(),
        "misfit": d.misfit,
        "detectable": d.detectable,
        "extended_model": extended_model,
        "sites": d.attribution.as_ref().map_or(&[][..], |a| &a.sites),
        "leftover": d.attribution.as_ref().map_or(&[][..], |a| &a.warnings),
        "attribution": d.attribution,
        "force": force(d),
        "suggestions": d.suggestions,
        "ended": d.ended,
        "rejected": d.rejected,
        "searches": d.rounds.iter().map(|r| json!({
            "family_wise_p": r.family_wise_p, "accepted": r.accepted, "ranking": r.ranking,
        })).collect::<Vec<_>>(),
        "biased_parameters": d.biased,
        "gains": d.gains,
        "outputs": d.outputs,
        "following": d.following,
        "left_out": d.left_out,
        "noise_knots": d.noise_knots,
        "domain": if d.spectral.is_some() { "frequency" } else { "time" },
        "band": d.spectral.as_ref().map(|s| s.band),
        "notes": d.spectral.as_ref().map_or(&[][..], |s| &s.notes),
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

/// Whether the verdict rests on a force.
fn is_force(d: &Diagnosis) -> bool {
    matches!(d.verdict, Verdict::Disturbance | Verdict::UnknownCause)
}

/// The course of the likeliest force, run by run, where the verdict rests on one.
fn force(d: &Diagnosis) -> Value {
    let site = d.places.iter().flat_map(|p| p.forces.first()).find(|site| is_force(d) && site.evidence > 0.0);
    site.map_or(Value::Null, |site| json!({ "name": site.place.name, "kind": site.place.kind, "course": site.course }))
}
