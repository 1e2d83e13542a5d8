//! An answer beside the truth: what was right, in numbers. Every run counts; one that fails is wrong in everything.

use crate::answer::{Answer, Named};
use crate::case::Case;
use crate::hidden::{INSIDE, Part, Place, moves, sites};
use crate::plan::Hides;
use crate::twins::{NEAR, SAME};
use fdm::Model;
use fdm::effect::{Choice, Subject};
use serde::{Deserialize, Serialize};

/// One line of the results.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Outcome {
    pub(crate) case: String,
    pub(crate) family: String,
    pub(crate) hides: String,
    pub(crate) colour: String,
    pub(crate) level: f64,
    /// Effects that were hidden.
    pub(crate) truth: Vec<String>,
    /// Input, equation, sensor.
    pub(crate) part: String,
    /// Oracle gain on the fitted runs.
    pub(crate) gain: f64,
    /// The same on the held-out run.
    #[serde(default)]
    pub(crate) gain_validation: f64,
    /// What the nearest other effect of the catalogue lacks over all runs, in nats; 6 or more where it is none.
    pub(crate) lead: f64,
    /// Why there is no answer.
    pub(crate) failure: Option<String>,
    pub(crate) verdict: String,
    pub(crate) p: f64,
    /// Causes that were named, in order.
    pub(crate) named: Vec<String>,
    pub(crate) group: usize,
    /// The first cause is the truth; of a pair, both are causes.
    pub(crate) top: bool,
    /// The truth is in the group of the first cause; of a pair, each in a group of its own.
    pub(crate) grouped: bool,
    /// No more causes than there are.
    pub(crate) only: bool,
    /// The first place that was told is right, or one of the first two.
    pub(crate) place: bool,
    pub(crate) place_in_two: bool,
    /// The tool said that it does not know the cause.
    pub(crate) warned: bool,
    /// The part of the first cause is that of the truth.
    pub(crate) same_part: bool,
    /// Gain of what was named on the held-out run over that of the true structure, both fitted in the true metric.
    pub(crate) validation_ratio: Option<f64>,
    pub(crate) seconds: f64,
}

impl Outcome {
    pub(crate) fn detected(&self) -> bool {
        self.failure.is_none() && self.p < 0.01
    }

    /// Whether what was named explains the held-out run as well as the truth does, up to three nats: then nothing is left to warn of.
    pub(crate) fn explained(&self) -> bool {
        self.validation_ratio.is_some_and(|ratio| (1.0 - ratio) * self.gain_validation < 3.0)
    }

    /// Whether the line is that of a case with one effect of the catalogue.
    pub(crate) fn is(&self, hides: Hides) -> bool {
        self.hides == hides.name()
    }
}

/// The outcome of a case.
pub(crate) fn score(case: &Case, answer: &Result<Answer, String>, seconds: f64) -> Outcome {
    let (truth, spec) = (&case.truth, case.spec);
    let mut outcome = Outcome {
        case: spec.name(),
        family: spec.family.name.into(),
        hides: spec.hides.name().into(),
        colour: spec.colour.name().into(),
        level: spec.level,
        truth: truth.places.iter().map(Place::to_string).collect(),
        part: truth.sites.first().map_or("", |s| part_name(s.0)).into(),
        gain: truth.gain,
        gain_validation: truth.gain_validation,
        lead: truth.rivals.iter().map(|r| r.1).filter(|lead| *lead >= SAME).fold(NEAR, f64::min),
        failure: None,
        verdict: String::new(),
        p: 0.0,
        named: Vec::new(),
        group: 0,
        top: false,
        grouped: false,
        only: false,
        place: false,
        place_in_two: false,
        warned: false,
        same_part: false,
        validation_ratio: Some(0.0),
        seconds,
    };
    let answer = match answer {
        Ok(answer) => answer,
        Err(why) => {
            outcome.failure = Some(why.clone());
            return outcome;
        }
    };
    outcome.verdict.clone_from(&answer.verdict);
    outcome.p = answer.p;
    outcome.named = answer.causes.iter().map(|c| c.place.to_string()).collect();
    outcome.group = answer.causes.first().map_or(0, |c| told_apart(case, &c.group));
    outcome.warned = answer.verdict == "unknown_cause" || answer.unexplained;
    let found = answer.verdict == "effect_found";
    if !truth.places.is_empty() && spec.hides != Hides::Gust && spec.hides != Hides::Outside {
        outcome.top = found && named(case, &answer.causes, |c| vec![c.place.clone()]);
        outcome.grouped = found && named(case, &answer.causes, |c| c.group.clone());
        outcome.only = answer.causes.len() == truth.places.len();
    }
    let told: Vec<Vec<(Part, String)>> = places_told(case, answer);
    let right = |sites: &Vec<(Part, String)>| sites.iter().any(|s| truth.sites.iter().any(|t| t.1 == s.1));
    outcome.place = told.first().is_some_and(right);
    outcome.place_in_two = told.iter().take(2).any(right);
    let part = answer.causes.first().and_then(|c| sites(&c.place, &case.base).first().map(|s| s.0));
    outcome.same_part = part.is_some_and(|p| truth.sites.iter().any(|s| s.0 == p));
    outcome.validation_ratio = (truth.gain_validation > 3.0)
        .then(|| held_out_gain(case, if found { &answer.causes } else { &[] }).unwrap_or(0.0) / truth.gain_validation);
    outcome
}

pub(crate) fn part_name(part: Part) -> &'static str {
    ["input", "equation", "sensor"][part as usize]
}

/// Members of a group; those that are the truth in another name count once.
fn told_apart(case: &Case, group: &[Place]) -> usize {
    let (same, others): (Vec<&Place>, Vec<&Place>) = group.iter().partition(|p| is_truth(case, p));
    others.len() + usize::from(!same.is_empty())
}

/// Whether a place is that of the truth, or the truth in another name.
fn is_truth(case: &Case, place: &Place) -> bool {
    let same = |(rival, lacking): &(Place, f64)| rival == place && *lacking < SAME;
    case.truth.places.contains(place) || case.truth.rivals.iter().any(same)
}

/// Whether each truth is among the names of a cause of its own; a single truth among those of the first.
fn named(case: &Case, causes: &[Named], names: impl Fn(&Named) -> Vec<Place>) -> bool {
    let truth = &case.truth;
    match &truth.places[..] {
        [_] => causes.first().is_some_and(|c| names(c).iter().any(|n| is_truth(case, n))),
        both => both.iter().all(|t| causes.iter().take(2).any(|c| names(c).contains(t))) && causes.len() >= both.len(),
    }
}

/// The places that an answer tells, the likeliest first.
fn places_told(case: &Case, answer: &Answer) -> Vec<Vec<(Part, String)>> {
    if !answer.sites.is_empty() {
        return (0..answer.sites.len()).map(|k| with_its_equation(case, &answer.sites[k..])).collect();
    }
    let groups = answer.causes.iter().flat_map(|c| std::iter::once(&c.place).chain(&c.group));
    let mut told: Vec<Vec<(Part, String)>> = Vec::new();
    for place in groups {
        let sites = sites(place, &case.base);
        if !told.contains(&sites) {
            told.push(sites);
        }
    }
    told
}

/// The first of these sites; one that is an input stands for the equation that follows it as well, where the input reaches that
/// equation: a force there and a force on the input are then one and the same, or nearly.
fn with_its_equation(case: &Case, sites: &[(String, String)]) -> Vec<(Part, String)> {
    let part = |kind: &str| match kind {
        "input" => Part::Input,
        "equation" => Part::Equation,
        _ => Part::Sensor,
    };
    let (kind, name) = &sites[0];
    let mut told = vec![(part(kind), name.clone())];
    let next = sites.iter().find(|(kind, _)| kind == "equation");
    if let Some((_, state)) = next.filter(|(_, state)| kind == "input" && moves(&case.base, name, state)) {
        told.push((Part::Equation, state.clone()));
    }
    told
}

/// The gain of the named causes on the held-out run: written into the model, fitted to the other runs in the true metric from what
/// the tool found, and judged there.
fn held_out_gain(case: &Case, causes: &[Named]) -> Option<f64> {
    let (train, held) = case.runs.split_at(2);
    let before = case.oracle().cost(&case.base, held, &case.fitted.theta);
    let mut model = case.base.clone();
    let mut values: Vec<(String, f64)> = case
        .base
        .definition()
        .params
        .iter()
        .zip(&case.fitted.theta)
        .map(|(p, v)| (p.quantity.name.clone(), *v))
        .collect();
    for cause in causes {
        let subject = Subject::new(model.source(), model.definition()).ok()?;
        let places = INSIDE.places(&subject);
        let extension = places.find(&cause.place.to_string())?.apply(&subject, &case.known, &Choice::new()).ok()?;
        model = Model::from_text("model.fdm", extension.text()).ok()?;
        values.extend(cause.parameters.iter().cloned());
    }
    let mut theta = model.definition().start();
    for (name, value) in values {
        if let Some(k) = model.definition().param(&name) {
            let p = &model.definition().params[k];
            theta[k] = value.clamp(p.lower, p.upper);
        }
    }
    let fitted = case.oracle().fit(&model, train, &theta)?;
    Some(0.5 * (before - case.oracle().cost(&model, held, &fitted.theta)))
}
