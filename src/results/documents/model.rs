//! What a model declares and answers: checks, places for effects, responses.

use fdm_effects::{Catalogue, Kind, Places};
use fdm_grammar::graph::show;
use fdm_grammar::model::{Input, Output, Param, Quantity, State};
use fdm_system::Model;
use fdm_system::code::{Discrepancy, Verification};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A model at a glance, and whether its derivatives were confirmed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelDocument {
    /// Its name.
    pub model: String,
    /// What drives it.
    pub inputs: Vec<InputDocument>,
    /// Its states.
    pub states: Vec<StateDocument>,
    /// Its parameters.
    pub parameters: Vec<ParamDocument>,
    /// What follows from them.
    pub derived: Vec<QuantityDocument>,
    /// What is measured.
    pub outputs: Vec<OutputDeclared>,
    /// The derivatives, compared with complex steps.
    pub derivatives: Derivatives,
}

/// A name with its unit and meaning.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct QuantityDocument {
    /// The name.
    pub name: String,
    /// Its unit, as text.
    pub unit: Option<String>,
    /// What it means.
    pub doc: String,
}

/// An input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct InputDocument {
    /// What it is.
    #[serde(flatten)]
    pub quantity: QuantityDocument,
    /// The output whose record it is, where it has no column of its own.
    pub record_of: Option<String>,
}

/// A state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StateDocument {
    /// What it is.
    #[serde(flatten)]
    pub quantity: QuantityDocument,
    /// The intensity of the noise in its equation.
    pub noise: Option<String>,
}

/// A parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParamDocument {
    /// What it is.
    #[serde(flatten)]
    pub quantity: QuantityDocument,
    /// Its start value.
    pub value: f64,
    /// Least admissible value.
    pub lower: Option<f64>,
    /// Greatest admissible value.
    pub upper: Option<f64>,
    /// Whether it is known.
    pub fixed: bool,
    /// Whether every run has its own.
    pub per_run: bool,
    /// Whether it is searched by its logarithm; left out where it is not.
    #[serde(rename = "log", default, skip_serializing_if = "std::ops::Not::not")]
    pub logarithmic: bool,
    /// What is known of it.
    pub prior: Option<PriorDocument>,
}

/// A normal prior.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PriorDocument {
    /// Its mean.
    pub mean: f64,
    /// Its standard deviation.
    pub deviation: f64,
}

/// An output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OutputDeclared {
    /// What it is.
    #[serde(flatten)]
    pub quantity: QuantityDocument,
    /// Standard deviation of its measurement noise, where it is declared.
    pub noise: Option<f64>,
    /// Standard deviation of its measurement noise as an expression, where it is declared so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_model: Option<String>,
}

/// Generated derivatives beside complex steps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Derivatives {
    /// Whether all agree.
    pub passed: bool,
    /// Points at which they were compared.
    pub points: usize,
    /// Points without finite values.
    pub skipped: usize,
    /// Entries that were compared.
    pub compared: usize,
    /// Random directions along which a large model was compared, all variables at once.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub directions: Option<usize>,
    /// The one that differs most.
    pub worst: Option<Discrepancy>,
    /// Entries that differ by too much.
    pub failures: Vec<Discrepancy>,
}

fn finite(v: f64) -> Option<f64> {
    v.is_finite().then_some(v)
}

impl From<&Quantity> for QuantityDocument {
    fn from(q: &Quantity) -> Self {
        Self { name: q.name.clone(), unit: q.unit.as_ref().map(ToString::to_string), doc: q.doc.clone() }
    }
}

impl ModelDocument {
    /// Of a model and the verification of its derivatives.
    pub fn of(model: &Model, verification: &Verification) -> Self {
        let definition = model.definition();
        let param = |p: &Param| {
            let quantity = QuantityDocument::from(&p.quantity);
            let prior = p.prior.map(|prior| PriorDocument { mean: prior.mean, deviation: prior.deviation });
            let (lower, upper) = (finite(p.lower), finite(p.upper));
            let Param { value, fixed, per_run, logarithmic, .. } = *p;
            ParamDocument { quantity, value, lower, upper, fixed, per_run, logarithmic, prior }
        };
        let input = |i: &Input| {
            let quantity = QuantityDocument::from(&i.quantity);
            let record_of = i.measured.map(|o| definition.outputs[o as usize].quantity.name.clone());
            InputDocument { quantity, record_of }
        };
        let state = |s: &State| {
            let quantity = QuantityDocument::from(&s.quantity);
            StateDocument { quantity, noise: s.noise.map(|e| show(&definition.graph, e, definition)) }
        };
        let output = |o: &Output| {
            let quantity = QuantityDocument::from(&o.quantity);
            let noise_model = o.noise_model.map(|e| show(&definition.graph, e, definition));
            OutputDeclared { quantity, noise: o.noise, noise_model }
        };
        Self {
            model: model.name().into(),
            inputs: definition.inputs.iter().map(input).collect(),
            states: definition.states.iter().map(state).collect(),
            parameters: definition.params.iter().filter(|p| !p.is_recorded()).map(param).collect(),
            derived: definition.derived.iter().map(|d| QuantityDocument::from(&d.quantity)).collect(),
            outputs: definition.outputs.iter().map(output).collect(),
            derivatives: Derivatives {
                passed: verification.passed(),
                points: verification.points,
                skipped: verification.skipped,
                compared: verification.compared,
                directions: Some(verification.directions).filter(|count| *count > 0),
                worst: verification.worst.clone(),
                failures: verification.failures.clone(),
            },
        }
    }
}

/// A text of effects that was checked.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CatalogueDocument {
    /// Every effect with what it is attached to.
    pub effects: Vec<String>,
    /// Whether each vanishes at its null and does something elsewhere.
    pub passed: bool,
}

/// The effects of a catalogue, and where they fit.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct EffectsDocument {
    /// All of them.
    pub effects: Vec<EffectDocument>,
    /// Where they fit.
    pub places: Vec<PlaceDocument>,
    /// Effects that fit more places than are tried, with that number.
    pub limited: BTreeMap<String, usize>,
}

/// An effect.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct EffectDocument {
    /// Its name.
    pub effect: String,
    /// What it is.
    pub doc: String,
    /// `smooth`, `finite` or `noise`.
    pub kind: String,
    /// What it is attached to.
    pub slots: Vec<SlotDocument>,
}

/// What an effect is attached to.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlotDocument {
    /// The slot's name.
    pub name: String,
    /// What may stand there.
    pub kinds: Vec<String>,
}

/// An effect at a place.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlaceDocument {
    /// The effect.
    pub effect: String,
    /// The names that it is attached to.
    pub targets: Vec<String>,
    /// What they are.
    pub kinds: Vec<String>,
    /// What it does there.
    pub doc: String,
}

impl EffectsDocument {
    /// Of a catalogue and the places of a model.
    pub fn of(catalogue: &Catalogue, places: &Places) -> Self {
        let effects = catalogue.effects().map(|e| EffectDocument {
            effect: e.name().to_string(),
            doc: e.doc().to_string(),
            kind: match e.kind() {
                Kind::Smooth => "smooth",
                Kind::Finite => "finite",
                Kind::Variance => "noise",
            }
            .into(),
            slots: e
                .tree()
                .slots
                .iter()
                .map(|s| SlotDocument {
                    name: s.name.text.to_string(),
                    kinds: s.kinds.iter().map(|k| k.word().to_string()).collect(),
                })
                .collect(),
        });
        let candidates = places.candidates.iter().map(|c| PlaceDocument {
            effect: c.effect().name().to_string(),
            targets: c.targets().to_vec(),
            kinds: c.kinds().iter().map(|k| k.word().to_string()).collect(),
            doc: c.doc(),
        });
        Self {
            effects: effects.collect(),
            places: candidates.collect(),
            limited: places.crowded.iter().map(|c| (c.effect.clone(), c.limit)).collect(),
        }
    }
}

/// The response of a model to the inputs of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResponseDocument {
    /// The run.
    pub run: String,
    /// Columns: time, inputs, states, outputs.
    pub channels: Vec<ChannelDocument>,
    /// The method.
    pub integrator: String,
    /// Steps of the whole run.
    pub steps: usize,
    /// Most steps in one interval between samples.
    pub steps_per_interval: usize,
    /// Estimated integration error, as a part of each output's range.
    pub integration_error: Option<f64>,
    /// Where the response left the finite numbers.
    pub divergence: Option<Diverged>,
}

/// A column.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChannelDocument {
    /// Its name.
    pub name: String,
    /// Its unit, as text.
    pub unit: Option<String>,
    /// Its values; none where they are not finite.
    pub values: Vec<Option<f64>>,
}

/// Where a response left the finite numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diverged {
    /// When.
    pub time: f64,
    /// Before which sample.
    pub sample: usize,
    /// Which state, where that is known.
    pub state: Option<String>,
}
