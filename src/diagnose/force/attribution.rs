//! Effect, disturbance, unknown cause or nothing: what the evidence adds up to.

use super::leftover::Leftover;
use super::localise::{CLEAR, Localisation};
use serde::Serialize;

/// What a parameter of an effect costs in log-likelihood: it was chosen among many.
const PRICE: f64 = 3.0;
/// Evidence for a force above which something is there, although no effect has a name for it.
const UNKNOWN: f64 = 10.0;
/// The part of that evidence that a named effect must explain.
const PART: f64 = 0.5;
/// The chance below which residuals are not noise.
const CHANCE: f64 = 0.01;

/// What the residuals of a fit say, without an effect and with the best one.
#[derive(Debug, Clone, Copy)]
pub struct Evidence<'a> {
    /// Where a force would enter.
    pub places: &'a Localisation,
    /// Whether the residuals are noise.
    pub leftover: &'a Leftover,
}

/// The best effect of a catalogue, fitted.
#[derive(Debug, Clone, Copy)]
pub struct Explained<'a> {
    /// What its residuals say.
    pub evidence: Evidence<'a>,
    /// Parameters that it brought.
    pub params: usize,
}

/// What it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The residuals are noise, or none that the sensors could not make by themselves.
    Nothing,
    /// The effect explains them, if the search finds it significant.
    Effect,
    /// A force that does not repeat: gusts, waves.
    Disturbance,
    /// Something that no effect of the catalogue is.
    UnknownCause,
}

/// Verdict and what it rests on.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Attribution {
    /// What it is.
    pub verdict: Verdict,
    /// Gain in log-likelihood by the best effect beside noise of any smooth spectrum, less what its parameters cost; none
    /// where no effect was fitted.
    pub by_effect: Option<f64>,
    /// The same by a random force at the best place.
    pub by_force: f64,
    /// The same by both.
    pub by_both: Option<f64>,
    /// What is still unexplained after the best effect, in words.
    pub warnings: Vec<String>,
}

/// Weighs the best effect, a random force and an unknown cause against each other.
pub fn attribute(base: Evidence<'_>, best: Option<Explained<'_>>) -> Attribution {
    let null = base.places.noise_alone;
    let by_force = base.places.evidence().max(0.0);
    let price = |e: &Explained<'_>| PRICE * e.params as f64;
    let by_effect = best.map(|e| e.evidence.places.noise_alone - null - price(&e));
    let by_both = best.map(|e| e.evidence.places.with_force - null - price(&e));
    let repeats = base.leftover.repeatable < CHANCE;
    let warnings = best.map_or_else(|| warnings(base), |e| warnings(e.evidence));
    let effect = by_effect.unwrap_or(0.0).max(0.0);
    let force = by_force > CLEAR && by_force > effect + CLEAR;
    let unexplained = |e: &Explained<'_>| {
        let left = e.evidence.leftover.repeatable < CHANCE || e.evidence.places.evidence() > UNKNOWN;
        left && effect < PART * (effect + rest(e.evidence))
    };
    let verdict = if force && !repeats {
        Verdict::Disturbance
    } else if force || best.as_ref().map_or(repeats, unexplained) {
        Verdict::UnknownCause
    } else if effect > 0.0 {
        Verdict::Effect
    } else {
        Verdict::Nothing
    };
    Attribution { verdict, by_effect, by_force, by_both, warnings }
}

/// Evidence for what is left, in log-likelihood: of a force, or of the band that looks least like noise.
fn rest(evidence: Evidence<'_>) -> f64 {
    let band = evidence.leftover.coherences.first().map_or(0.0, |c| -c.chance.max(f64::MIN_POSITIVE).ln());
    evidence.places.evidence().max(band)
}

/// What says that residuals are not noise.
fn warnings(evidence: Evidence<'_>) -> Vec<String> {
    let Evidence { places, leftover } = evidence;
    let mut said = Vec::new();
    if places.evidence() > CLEAR {
        let names: Vec<String> = places.group().map(|s| s.place.to_string()).collect();
        said.push(format!(
            "something still acts on {}: the odds of a force there are e^{:.0} to 1",
            names.join(" or "),
            places.evidence()
        ));
    }
    let found = |pick: fn(&super::leftover::Partner) -> bool| leftover.coherences.iter().find(|c| pick(&c.partner));
    if leftover.repeatable < CHANCE
        && let Some(c) = found(|p| !matches!(p, super::leftover::Partner::Output(_)))
    {
        said.push(c.to_string());
    }
    if leftover.common < CHANCE
        && let Some(c) = found(|p| matches!(p, super::leftover::Partner::Output(_)))
    {
        said.push(c.to_string());
    }
    said
}
