//! Which effect is named: scores, the group that cannot be told apart, and what makes an effect acceptable.
//!
//! The experiment that would tell two effects apart.

use super::candidate_model::CandidateModel;
use super::comparison::Comparison;
use super::extended_model::place;
use super::forward_step::{ForwardStep, prior};
use super::free_motion::repeated;
use super::projection::cosine;
use crate::diagnosis::{Alternative, Cause, EffectAt, NewValue, Rejected};
use crate::disturbance::BELIEVED;
use fdm_effects::NewParam;
use fdm_estimate::ParameterEstimate;
use fdm_grammar::syntax::Class;

/// Least score of an effect that is named.
const LEAST: f64 = 3.0;
/// Least gain on the training runs: that of a size of two standard errors. (Wald's size itself says little where an
/// effect has parameters of its own that correlate with it.)
const SIZE: f64 = 2.0;
/// Loss on validation runs beyond which they speak against an effect by themselves: odds of 7 : 1. An effect of which they hold little may lose
/// a little by chance; its score and its chance count that.
const LOSS: f64 = 2.0;

/// Part of a bound within which a value is at it.
const BOUND: f64 = 1e-5;

/// Why a candidate model is not accepted; none when it is.
pub(super) fn objection(step: &ForwardStep<'_>, candidate: &CandidateModel) -> Option<String> {
    if candidate.score() < LEAST {
        let parameters =
            if candidate.cost == 1 { "its parameter".into() } else { format!("its {} parameters", candidate.cost) };
        let kind = match candidate.class {
            Class::Mechanism => String::new(),
            Class::Sensor => format!(" and {:.0} for an effect of a sensor", prior(candidate.class)),
            Class::StandIn => format!(" and {:.0} for a stand-in", prior(candidate.class)),
        };
        return Some(format!(
            "the gain of {:.1} is below the penalty for {parameters} (3 each{kind})",
            candidate.whole_gain()
        ));
    }
    let params = step.simulated[candidate.candidate].attached.params();
    let value = |p: &NewParam| candidate.fitting.shared(&p.name).map(|e| e.value);
    if let Some(sentence) = below_null(params, value) {
        return Some(sentence);
    }
    if let Some((gain, _)) = &candidate.validation
        && *gain < -LOSS
    {
        return Some(format!("on the validation runs it loses {:.1} in log-likelihood", -gain));
    }
    if let Some(repeated) = repeated(step, candidate) {
        return Some(repeated.sentence());
    }
    (candidate.gain < SIZE).then(|| {
        format!("it gains {:.1} on the training runs, below the gain of two standard errors ({SIZE})", candidate.gain)
    })
}

/// Whether nothing speaks against a mechanism but the sign that its joint fit has: the noise found may be the model's own error, and by
/// plain errors the sign may be that of physics.
pub(super) fn has_the_other_sign(step: &ForwardStep<'_>, candidate: &CandidateModel) -> bool {
    let params = step.simulated[candidate.candidate].attached.params();
    let value = |p: &NewParam| candidate.fitting.shared(&p.name).map(|e| e.value);
    let loses = candidate.validation.as_ref().is_some_and(|(gain, _)| *gain < -LOSS);
    candidate.class == Class::Mechanism
        && candidate.score() >= LEAST
        && candidate.gain >= SIZE
        && !loses
        && below_null(params, value).is_some()
}

/// A parameter that physics has at its null or above and a fit below, in a sentence.
pub(super) fn below_null(params: &[NewParam], value: impl Fn(&NewParam) -> Option<f64>) -> Option<String> {
    let wrong = params.iter().filter(|p| p.positive).filter_map(|p| Some((p, value(p)?)));
    let (p, value) = wrong.into_iter().find(|(p, value)| *value < p.null)?;
    Some(format!("its fit wants {} = {value:.4}, where physics has none below {}", p.name, p.null))
}

/// A parameter of an effect whose fit ends at one of its bounds, in a sentence: its value is not what the records say, but where it was stopped.
pub(super) fn at_bound(params: &[NewParam], value: impl Fn(&NewParam) -> Option<f64>) -> Option<String> {
    let near =
        |v: f64, bound: f64| bound.is_finite() && (v - bound).abs() <= BOUND * bound.abs().max(f64::MIN_POSITIVE);
    let estimated = params.iter().filter(|p| !p.fixed && p.begins_as.is_none());
    let (p, v) =
        estimated.filter_map(|p| Some((p, value(p)?))).find(|(p, v)| near(*v, p.lower) || near(*v, p.upper))?;
    Some(format!("its fit ends at the bound {} = {v:.4}", p.name))
}

/// The candidate model as a cause, accepted at a chance, with the group of those that score about as much.
pub(super) fn cause(step: &ForwardStep<'_>, comparison: &Comparison, (chosen, p): (usize, f64)) -> Cause {
    let candidate = &comparison.models[chosen];
    let attached = &step.simulated[candidate.candidate].attached;
    let least = candidate.score() - BELIEVED;
    let others = comparison.models.iter().enumerate();
    let close = others.filter(|(k, c)| *k == chosen || c.score() > least.max(0.0));
    let alternative = |(_, c): (usize, &CandidateModel)| Alternative {
        place: place(&step.simulated[c.candidate].attached.candidate),
        gain_training: c.gain,
        gain_validation: c.validation.as_ref().map(|(gain, _)| *gain),
        score: c.score(),
        cosine: cosine(&c.direction, &candidate.direction).abs(),
    };
    let mut group: Vec<Alternative> = close.map(alternative).collect();
    let own = place(&attached.candidate);
    group.sort_by_key(|r| r.place != own);
    let separating_experiment = group.get(1).map(|other| separating(&own, &other.place));
    Cause {
        place: own,
        doc: attached.candidate.doc(),
        parameters: attached.params().iter().filter_map(|p| new_value(p, candidate)).collect(),
        gain_training: candidate.gain,
        gain_validation: candidate.validation.as_ref().map(|(gain, _)| *gain),
        gain_predicted: candidate.predicted,
        score: candidate.score(),
        p,
        group,
        separating_experiment,
    }
}

fn new_value(param: &NewParam, candidate: &CandidateModel) -> Option<NewValue> {
    if param.begins_as.is_some() {
        return None;
    }
    let estimate = candidate.fitting.shared(&param.name)?;
    Some(value_of(param, estimate))
}

/// A new parameter with its estimate.
pub(super) fn value_of(param: &NewParam, estimate: &ParameterEstimate) -> NewValue {
    NewValue {
        name: param.name.clone(),
        doc: param.doc.clone(),
        value: estimate.value,
        standard_error: estimate.error(),
        unit: param.unit.as_ref().map(|u| u.text().to_string()),
        null: (!param.nuisance).then_some(param.null),
    }
}

/// A candidate model that was not taken.
pub(super) fn rejected(step: &ForwardStep<'_>, number: usize, candidate: &CandidateModel, reason: String) -> Rejected {
    Rejected {
        place: place(&step.simulated[candidate.candidate].attached.candidate),
        step: number,
        gain_training: candidate.gain,
        gain_validation: candidate.validation.as_ref().map(|(gain, _)| *gain),
        reason,
    }
}

/// Effects that act late, and those that act on size, by name.
const LATE: &[&str] = &["input_delay", "actuator_lag", "output_delay", "sensor_lag", "lag_in_coupling"];
const BY_AMPLITUDE: &[&str] = &[
    "input_dead_zone",
    "input_saturation",
    "input_square",
    "input_cube",
    "input_curvature",
    "input_scale_asymmetry",
    "rate_limit",
    "backlash",
    "quadratic_damping",
    "cubic_stiffness",
    "quadratic_term",
    "coulomb_friction",
    "product_term",
    "state_saturation",
];
const SLOW: &[&str] = &["output_bias_drift", "time_varying_parameter", "slow_mode", "constant_force"];
const STEADY: &[&str] = &["output_bias", "input_bias", "constant_force"];

/// What to measure so that two effects part.
pub(super) fn separating(a: &EffectAt, b: &EffectAt) -> String {
    let (a, b) = if a.effect <= b.effect { (a, b) } else { (b, a) };
    let either = |name: &str| a.effect == name || b.effect == name;
    let both = |list: &[&str]| list.contains(&a.effect.as_str()) && list.contains(&b.effect.as_str());
    let pair = format!("{a} and {b}");
    if either("coulomb_friction") && either("quadratic_damping") {
        return format!(
            "{pair}: free motions from several amplitudes; friction wins at small rates, drag at large ones"
        );
    }
    if either("rate_limit") {
        return format!("{pair}: the same manoeuvre at half and at twice the rate of change of the input");
    }
    if either("time_varying_parameter") || either("output_bias_drift") {
        return format!("{pair}: repeat the runs in reverse order, or begin with the end of the manoeuvre");
    }
    const OF_A_SENSOR: [&str; 6] =
        ["output_scale", "temperature_scale", "output_delay", "sensor_lag", "sensor_position", "thermometer_position"];
    if OF_A_SENSOR.into_iter().any(either) {
        return format!("{pair}: a second sensor of the same quantity, or a manoeuvre through another input");
    }
    if both(LATE) {
        return format!(
            "{pair}: an input with energy at and above one over the time constant (quick doublets, a sweep to high frequency)"
        );
    }
    if both(BY_AMPLITUDE) {
        return format!("{pair}: the manoeuvre at two amplitudes, one a third of the other");
    }
    if both(STEADY) {
        return format!(
            "{pair}: a record that begins away from its equilibrium, or a rest with the input at zero and the output read independently"
        );
    }
    if both(SLOW) {
        return format!("{pair}: a longer record with rests at its beginning and end");
    }
    if a.effect == b.effect {
        return format!("{pair}: a manoeuvre that moves {} and {} independently of each other", of(a), of(b));
    }
    format!("{pair}: a second manoeuvre of other shape and amplitude, and energy where the two differ most")
}

fn of(place: &EffectAt) -> String {
    place.targets.join(", ")
}
