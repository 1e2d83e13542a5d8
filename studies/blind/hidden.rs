//! The truth of a case: effects at drawn places with drawn numbers, written into the family's text, and the size of them.

use crate::chance::Chance;
use crate::families::Family;
use fdm::Model;
use fdm::effect::{Candidate, Catalogue, Choice, Kind, NewParam, Scales, Subject};
use fdm_grammar::graph::{Leaf, Node, Signal};
use fdm_grammar::op::ExprId;
use std::collections::{BTreeMap, HashMap};
use std::sync::LazyLock;

/// The catalogue that the tool has.
pub(crate) static INSIDE: LazyLock<Catalogue> = LazyLock::new(Catalogue::standard);
/// Causes that it has not.
pub(crate) static OUTSIDE: LazyLock<Catalogue> = LazyLock::new(|| {
    let source = fdm_grammar::Source::new("outside.fdm", include_str!("outside.fdm"));
    let (catalogue, findings) = Catalogue::read(&source);
    assert!(findings.is_empty(), "{findings:?}");
    catalogue
});

/// An effect and what it is attached to.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Place {
    pub(crate) effect: String,
    pub(crate) targets: Vec<String>,
}

impl Place {
    pub(crate) fn of(candidate: &Candidate) -> Self {
        Self { effect: candidate.effect().name().into(), targets: candidate.targets().to_vec() }
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}({})", self.effect, self.targets.join(", "))
    }
}

/// The part of a model in which an effect sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Part {
    Input,
    Equation,
    Sensor,
}

/// Where the cause enters: an input, the equation of a state, or the sensor of an output. Two for what reaches from one to
/// another.
pub(crate) fn sites(place: &Place, base: &Model) -> Vec<(Part, String)> {
    let definition = base.definition();
    let input = |n: &String| definition.inputs.iter().any(|i| i.quantity.name == *n);
    let output = |n: &String| definition.outputs.iter().any(|o| o.quantity.name == *n);
    let first = &place.targets[0];
    let own = |part| vec![(part, first.clone())];
    match place.effect.as_str() {
        // shaken by the input, seen by the sensor
        "driven_mode" => vec![(Part::Sensor, first.clone()), (Part::Input, place.targets[1].clone())],
        // every equation or sensor that the parameter or the clipped state is in
        "time_varying_parameter" | "state_saturation" => {
            let states = definition.states.iter().map(|s| (Part::Equation, &s.quantity.name, s.rate));
            let outputs = definition.outputs.iter().map(|o| (Part::Sensor, &o.quantity.name, o.expr));
            let reached = states.chain(outputs).filter(|(_, name, root)| *name != first && reaches(base, *root, first));
            reached.map(|(part, name, _)| (part, name.clone())).collect()
        }
        _ if input(first) => own(Part::Input),
        _ if output(first) => own(Part::Sensor),
        _ => own(Part::Equation),
    }
}

/// Whether the equation of a state contains an input, delayed or not.
pub(crate) fn moves(base: &Model, input: &str, state: &str) -> bool {
    let definition = base.definition();
    let wanted = definition.inputs.iter().position(|i| i.quantity.name == input).map(|k| k as u32);
    let rate = definition.states.iter().find(|s| s.quantity.name == state).map(|s| s.rate);
    let is_it = |node: Node| match node {
        Node::Leaf(Leaf::Input(k)) => Some(k) == wanted,
        Node::Leaf(Leaf::Delayed(k)) => {
            matches!(definition.graph.delayed()[k as usize].signal, Signal::Input(k) if Some(k) == wanted)
        }
        _ => false,
    };
    rate.is_some_and(|rate| definition.graph.reachable([rate]).into_iter().any(|e| is_it(definition.graph.node(e))))
}

/// Whether an expression depends on a parameter or a state.
fn reaches(base: &Model, root: ExprId, name: &str) -> bool {
    let definition = base.definition();
    let state = definition.states.iter().position(|s| s.quantity.name == name).map(|k| Leaf::State(k as u32));
    let leaf = state.or(definition.param(name).map(|k| Leaf::Param(k as u32)));
    let below = definition.graph.reachable([root]);
    leaf.is_some_and(|leaf| below.into_iter().any(|e| definition.graph.node(e) == Node::Leaf(leaf)))
}

/// A parameter that sets the size of an effect: for a size s it is `factor*s`, or `factor/s` where the effect vanishes at infinity.
#[derive(Debug, Clone)]
struct Knob {
    name: String,
    factor: f64,
    inverse: bool,
    lower: f64,
    upper: f64,
}

/// A model with effects in it whose sizes are still open.
#[derive(Debug, Clone)]
pub(crate) struct Structure {
    pub(crate) model: Model,
    pub(crate) places: Vec<Place>,
    /// For each effect.
    knobs: Vec<Vec<Knob>>,
    /// All numbers that do not depend on the sizes, by name: those of the base model and nuisances.
    values: BTreeMap<String, f64>,
    /// A size of each effect to begin a search from.
    pub(crate) typical: Vec<f64>,
}

/// A pair of friction and drag coefficients has one sign only.
const POSITIVE: &[&str] = &["quadratic_damping", "coulomb_friction", "bouc_wen", "stribeck"];

impl Structure {
    /// The base model with the true numbers, by name.
    pub(crate) fn bare(base: &Model, theta: &[f64]) -> Self {
        let names = base.definition().params.iter().map(|p| p.quantity.name.clone());
        Self {
            model: base.clone(),
            places: Vec::new(),
            knobs: Vec::new(),
            values: names.zip(theta.iter().copied()).collect(),
            typical: Vec::new(),
        }
    }

    /// With one more effect, its nuisances drawn off the grid of the catalogue; nothing where it does not fit.
    pub(crate) fn with(&self, candidate: &Candidate, scales: &dyn Scales, chance: &mut Chance) -> Option<Self> {
        let subject = Subject::new(self.model.source(), self.model.definition()).ok()?;
        let plain = candidate.apply(&subject, scales, &Choice::new()).ok()?;
        let nuisances: Vec<&NewParam> = plain.params().iter().filter(|p| p.nuisance).collect();
        let choice: HashMap<String, f64> = nuisances.iter().map(|p| (p.local.clone(), drawn(p, chance))).collect();
        let extension = candidate.apply(&subject, scales, &choice).ok()?;
        let model = Model::from_text("model.fdm", extension.text()).ok()?;
        let mut made = Self { model, ..self.clone() };
        made.places.push(Place::of(candidate));
        let mut knobs = Vec::new();
        let sizes: Vec<&NewParam> =
            extension.params().iter().filter(|p| !p.nuisance && p.begins_as.is_none()).collect();
        for p in extension.params().iter().filter(|p| p.nuisance || p.begins_as.is_some()) {
            made.values.insert(p.name.clone(), choice.get(&p.local).copied().unwrap_or(p.start));
        }
        let name = candidate.effect().name();
        for (k, p) in sizes.iter().enumerate() {
            let inverse = p.null.is_infinite();
            let sign = if POSITIVE.contains(&name) || p.lower >= 0.0 { 1.0 } else { chance.sign() };
            // of a square and a cube, each has its share at the input's size
            let share = if sizes.len() > 1 { chance.between(0.3, 1.0) } else { 1.0 };
            let scale = if name == "input_curvature" {
                scales.size(&candidate.targets()[0], 1.0).powi(-(k as i32 + 1))
            } else {
                1.0
            };
            knobs.push(Knob {
                name: p.name.clone(),
                factor: sign * share * scale,
                inverse,
                lower: p.lower,
                upper: p.upper,
            });
        }
        let typical = match sizes.first()? {
            p if p.null.is_infinite() => 1.0 / p.trials.get(p.trials.len() / 2)?,
            p if candidate.kind() == Kind::Finite => *p.trials.get(p.trials.len() / 2)?,
            _ => 0.01,
        };
        made.typical.push(typical.abs().max(1e-12));
        made.knobs.push(knobs);
        Some(made)
    }

    /// Numbers of the model for sizes of its effects; nothing where one leaves its bounds.
    pub(crate) fn theta(&self, sizes: &[f64]) -> Option<Vec<f64>> {
        let mut theta = self.model.definition().start();
        let at = |name: &str| self.model.definition().param(name);
        for (name, value) in &self.values {
            theta[at(name)?] = *value;
        }
        for (knobs, size) in self.knobs.iter().zip(sizes) {
            for knob in knobs {
                let value = if knob.inverse { knob.factor / size } else { knob.factor * size };
                if value < knob.lower || value > knob.upper {
                    return None;
                }
                theta[at(&knob.name)?] = value;
            }
        }
        Some(theta)
    }

    /// Names and numbers of the effects' own parameters.
    pub(crate) fn own(&self, theta: &[f64], base: &Model) -> Vec<(String, f64)> {
        let names = self.model.definition().params.iter().map(|p| p.quantity.name.clone());
        names.zip(theta.iter().copied()).filter(|(n, _)| base.definition().param(n).is_none()).collect()
    }
}

/// What a grid of one value stands for, to both sides.
const ALONE: f64 = 2.5;

/// A number between the ends of the grid and a little beyond, not on it.
fn drawn(p: &NewParam, chance: &mut Chance) -> f64 {
    let ends = p.trials.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), v| (a.min(v.abs()), b.max(v.abs())));
    let (low, high) = match ends {
        _ if p.trials.is_empty() => (p.lower, p.upper),
        (low, high) if low == high => (low / ALONE, high * ALONE),
        ends => ends,
    };
    chance.log_between(low * 0.9, high * 1.1).clamp(p.lower, p.upper)
}

/// Candidates that can be the truth in a family, by the names of their effects.
pub(crate) fn menu(family: &Family, base: &Model, catalogue: &Catalogue) -> BTreeMap<String, Vec<Candidate>> {
    let subject = Subject::new(base.source(), base.definition()).expect("a text that compiles");
    let mut menu: BTreeMap<String, Vec<Candidate>> = BTreeMap::new();
    for candidate in catalogue.places(&subject).candidates {
        let name = candidate.effect().name();
        let on_rate = !["bouc_wen", "stribeck", "coulomb_friction", "quadratic_damping"].contains(&name)
            || family.rates.contains(&candidate.targets()[0].as_str());
        if candidate.kind() != Kind::Variance && !family.senseless.contains(&name) && on_rate {
            menu.entry(candidate.effect().signature()).or_default().push(candidate);
        }
    }
    menu
}

/// States into whose equation a disturbance can enter.
pub(crate) fn disturbed(base: &Model) -> Vec<String> {
    let subject = Subject::new(base.source(), base.definition()).expect("a text that compiles");
    let places = INSIDE.places(&subject).candidates;
    places.iter().filter(|c| c.kind() == Kind::Variance).map(|c| c.targets()[0].clone()).collect()
}
