//! What to measure so that two effects part.

use crate::diagnosis::EffectAt;

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
pub(crate) fn separating(a: &EffectAt, b: &EffectAt) -> String {
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
