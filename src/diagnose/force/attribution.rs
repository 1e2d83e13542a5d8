//! Effect, disturbance, unknown cause or nothing: what the evidence adds up to.

use super::coherence::Coherence;
use super::heard::Heard;
use super::leftover::Leftover;
use super::localise::CLEAR;
use super::place::{Kind, Place};
use super::standing::{Standing, rank};
use crate::model::Model;
use serde::Serialize;

/// What a parameter of an effect costs in log-likelihood: it was chosen among many.
const PRICE: f64 = 3.0;
/// Evidence for a force above which something is there, although no effect has a name for it.
const UNKNOWN: f64 = 10.0;
/// Evidence above which a law is there: of 112 records without an effect three had more, by a likelihood that had fewer kinds
/// of laws to choose from.
const LAW: f64 = 1.5;
/// The part of that evidence that a named effect must explain.
const PART: f64 = 0.5;
/// The chance below which residuals are not noise.
const CHANCE: f64 = 0.01;

/// The best effect of a catalogue, fitted.
#[derive(Debug, Clone, Copy)]
pub struct Explained<'a> {
    /// What its residuals say.
    pub evidence: &'a Heard,
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
    /// The same by a force that is one function of states and inputs in all runs.
    pub by_law: f64,
    /// The same by effect and random force.
    pub by_both: Option<f64>,
    /// What is still unexplained after the best effect, in words.
    pub warnings: Vec<String>,
    /// Where something enters that no effect explains, the likeliest first; empty where nothing is left.
    pub sites: Vec<Standing>,
}

/// Weighs the best effect, a random force and an unknown cause against each other.
pub fn attribute(model: &Model, base: &Heard, best: Option<Explained<'_>>) -> Attribution {
    let null = base.places.noise_alone;
    let by_force = base.places.evidence().max(0.0);
    let by_law = base.laws.evidence();
    let price = |e: &Explained<'_>| PRICE * e.params as f64;
    let by_effect = best.map(|e| e.evidence.places.noise_alone - null - price(&e));
    let by_both = best.map(|e| e.evidence.places.with_force - null - price(&e));
    let warnings = warnings(best.map_or(base, |e| e.evidence));
    let effect = by_effect.unwrap_or(0.0).max(0.0);
    let force = by_force > CLEAR && by_force > effect + CLEAR;
    let unexplained = |e: &Explained<'_>| {
        let left = e.evidence.repeats() || e.evidence.places.evidence() > UNKNOWN;
        left && effect < PART * (effect + e.evidence.rest())
    };
    // beside a strong force that does not repeat, noise looks a little like inputs and laws as well
    let verdict = if force && by_law.max(base.leftover.evidence()) < by_force {
        Verdict::Disturbance
    } else if force || best.as_ref().map_or(base.repeats(), unexplained) {
        Verdict::UnknownCause
    } else if effect > 0.0 {
        Verdict::Effect
    } else {
        Verdict::Nothing
    };
    let sites = match verdict {
        Verdict::Disturbance => base.places.forces.iter().filter(|s| s.evidence > 0.0).map(standing).collect(),
        Verdict::UnknownCause => sites(model, base, best),
        _ if !warnings.is_empty() => sites(model, base, best),
        _ => Vec::new(),
    };
    Attribution { verdict, by_effect, by_force, by_law, by_both, warnings, sites }
}

impl Leftover {
    /// Whether something was found.
    fn found(&self) -> bool {
        self.repeatable < CHANCE
    }

    /// Logarithm of the odds, where something was found.
    fn evidence(&self) -> f64 {
        if self.found() { -self.repeatable.max(f64::MIN_POSITIVE).ln() } else { 0.0 }
    }

    /// What stands out most, where anything does.
    fn foremost(&self) -> Option<&Coherence> {
        self.coherences.first().filter(|_| self.found())
    }
}

impl Heard {
    /// Whether something is left that is the same in every run.
    fn repeats(&self) -> bool {
        self.leftover.found() || self.laws.evidence() > LAW
    }

    /// Evidence for what is left, in log-likelihood: of a force, or of the band that looks least like noise.
    fn rest(&self) -> f64 {
        let band = self.leftover.foremost().map_or(0.0, |c| -c.chance.max(f64::MIN_POSITIVE).ln());
        self.places.evidence().max(self.laws.evidence()).max(band)
    }
}

fn standing(site: &super::localise::Site) -> Standing {
    Standing { place: site.place.clone(), evidence: site.evidence }
}

/// Where an unknown cause enters: what the model as it was given lacks, and what the effects leave.
fn sites(model: &Model, base: &Heard, best: Option<Explained<'_>>) -> Vec<Standing> {
    let mut sites: Vec<Standing> = Vec::new();
    let mut add = |place: Place, evidence: f64| match sites.iter_mut().find(|s| s.place == place) {
        Some(known) => known.evidence = known.evidence.max(evidence),
        None => sites.push(Standing { place, evidence }),
    };
    for law in base.laws.list.iter().filter(|law| law.evidence > 0.0) {
        add(law.place.clone(), law.evidence);
    }
    for site in base.places.forces.iter().filter(|s| s.evidence > 0.0) {
        add(site.place.clone(), site.evidence);
    }
    let definition = model.definition();
    for evidence in [Some(base), best.map(|e| e.evidence)].into_iter().flatten() {
        let Some(found) = evidence.leftover.foremost() else { continue };
        let own = evidence.leftover.evidence();
        let output = definition.outputs.iter().position(|o| o.quantity.name == found.output);
        let input = definition.inputs.iter().position(|i| i.quantity.name == found.partner.input());
        if let (Some(output), Some(input)) = (output, input) {
            add(Place { kind: Kind::Output, index: output, name: found.output.clone() }, own);
            add(Place { kind: Kind::Input, index: input, name: found.partner.input().into() }, own);
        }
    }
    rank(model, &mut sites, |s| (&s.place, s.evidence));
    sites
}

/// What says that residuals are not noise.
fn warnings(heard: &Heard) -> Vec<String> {
    let Heard { places, laws, leftover } = heard;
    let mut said = Vec::new();
    let or = |names: Vec<String>| names.join(" or ");
    if places.evidence() > CLEAR {
        let names = or(places.group().map(|s| s.place.to_string()).collect());
        let odds = places.evidence();
        said.push(format!("something still acts on {names}: the odds of a force there are e^{odds:.0} to 1"));
    }
    if laws.evidence() > LAW {
        let names = or(laws.group().map(|l| l.place.to_string()).collect());
        let odds = laws.evidence();
        said.push(format!(
            "what is left follows states and inputs alike in all runs, as something unknown in {names} would: the odds are e^{odds:.0} to 1"
        ));
    }
    said.extend(leftover.foremost().map(ToString::to_string));
    said
}
