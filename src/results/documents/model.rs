//! What a model declares and answers: checks, places for effects, responses.
//!
//! Modes of motion: eigenvalues with damping, frequency, times, and the states that dominate them; both of a pair.

use super::digits::digits;
use super::json::present;
use fdm_effects::{Catalogue, Kind, Places};
use fdm_grammar::graph::{Signal, show};
use fdm_grammar::model::{Input, Output, Param, Quantity, State};
use fdm_system::Model;
use fdm_system::code::{Discrepancy, Verification};
use fdm_system::linear::{Mode, ModeErrors, Modes, Obtained, Trim};
use num_complex::Complex64;
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

/// Values of a trim that are listed.
const LISTED: usize = 12;

/// The modes of a model at its trim; where they were left out nothing but the reason.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ModesDocument {
    /// Why there are none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_out: Option<String>,
    /// Every eigenvalue.
    pub modes: Vec<ModeDocument>,
    /// The model's name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Whether delays make infinitely many, of which these are the rightmost.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub infinite: Option<bool>,
    /// The unit of time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<String>,
    /// Where the model was linearised, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub linearised: Option<String>,
    /// Where the model was linearised, in numbers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trim: Option<TrimDocument>,
}

/// An eigenvalue.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModeDocument {
    /// Real part.
    pub re: f64,
    /// Imaginary part.
    pub im: f64,
    /// Damping ratio.
    pub damping: Option<f64>,
    /// Undamped natural frequency, in rad per unit of time.
    pub frequency: f64,
    /// The states that dominate it.
    pub states: Vec<String>,
    /// Their shares.
    pub shares: BTreeMap<String, f64>,
    /// Every component of the eigenvector.
    pub shape: Vec<Component>,
    /// Time to half the amplitude.
    pub time_to_half: Option<f64>,
    /// Time to twice the amplitude.
    pub time_to_double: Option<f64>,
    /// Standard errors: missing where the parameters have none, null where the eigenvalue is not apart from others.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub standard_errors: Option<Option<ModeErrors>>,
}

/// What a state does in a mode: size and phase relative to the state that does most, each in its own unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Component {
    /// The state.
    pub state: String,
    /// Its size.
    pub magnitude: f64,
    /// Its phase in degrees; none where the size is zero.
    pub phase: Option<f64>,
    /// Its unit.
    pub unit: Option<String>,
}

/// Where a model was linearised.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrimDocument {
    /// `not_needed`, `given`, `initial` or `solved`.
    pub obtained: String,
    /// What the equations determined.
    pub solved: Vec<String>,
    /// Values of the states.
    pub states: BTreeMap<String, f64>,
    /// Values of the inputs.
    pub inputs: BTreeMap<String, f64>,
}

impl ModesDocument {
    /// Of a model's modes; `errors` are standard errors mode by mode, empty when there are none.
    pub fn of(model: &Model, trim: &Trim, modes: &Modes, errors: &[Option<ModeErrors>]) -> Self {
        let one = |(k, mode): (usize, &Mode)| {
            let errors = errors.get(k).copied();
            ModeDocument { standard_errors: errors, ..ModeDocument::of(model, mode) }
        };
        let (states, inputs) = values(model, trim);
        let obtained = match trim.obtained {
            Obtained::NotNeeded => "not_needed",
            Obtained::Given => "given",
            Obtained::Initial => "initial",
            Obtained::Solved => "solved",
        };
        let solved = trim.solved.iter().map(|s| name(model, *s)).collect();
        Self {
            left_out: None,
            modes: modes.modes.iter().enumerate().map(one).collect(),
            model: Some(model.name().into()),
            infinite: Some(modes.infinite),
            time: Some(model.definition().time.to_string()),
            linearised: Some(trim_sentence(model, trim)),
            trim: Some(TrimDocument {
                obtained: obtained.into(),
                solved,
                states: states.into_iter().collect(),
                inputs: inputs.into_iter().collect(),
            }),
        }
    }

    /// No modes, for this reason.
    pub fn without(reason: impl Into<String>) -> Self {
        Self { left_out: Some(reason.into()), ..Self::default() }
    }
}

impl ModeDocument {
    fn of(model: &Model, mode: &Mode) -> Self {
        let states = &model.definition().states;
        let shares = mode.dominant().filter_map(|d| mode.states.iter().find(|(state, _)| *state == d));
        Self {
            re: mode.s.re,
            im: mode.s.im,
            damping: mode.damping(),
            frequency: mode.frequency(),
            states: mode.dominant().map(|k| states[k].quantity.name.clone()).collect(),
            shares: shares.map(|(state, share)| (states[*state].quantity.name.clone(), *share)).collect(),
            shape: mode.shape.iter().zip(states).map(|(v, state)| Component::of(*v, &state.quantity)).collect(),
            time_to_half: mode.time_to_half(),
            time_to_double: mode.time_to_double(),
            standard_errors: None,
        }
    }
}

impl Component {
    fn of(v: Complex64, state: &Quantity) -> Self {
        Self {
            state: state.name.clone(),
            magnitude: v.norm(),
            // of a mirrored mode the greatest has the phase minus zero
            phase: (v != Complex64::ZERO).then(|| v.arg().to_degrees() + 0.0),
            unit: state.unit.as_ref().map(ToString::to_string),
        }
    }
}

/// Where the model was linearised, and how that was found.
pub fn trim_sentence(model: &Model, trim: &Trim) -> String {
    let how = match trim.obtained {
        Obtained::NotNeeded => {
            return "no trim is needed: no coefficient depends on where the model is linearised".into();
        }
        Obtained::Given => "linearised where the model's `trim` says".to_string(),
        Obtained::Initial => "linearised at the initial values, where the rates vanish".to_string(),
        Obtained::Solved => {
            let names: Vec<String> = trim.solved.iter().map(|s| name(model, *s)).take(LISTED).collect();
            let more = trim.solved.len().saturating_sub(LISTED);
            let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
            let assumed: Vec<String> = trim.assumed.iter().map(|s| name(model, *s)).collect();
            let held = match assumed.len() {
                0 => String::new(),
                _ => format!(", with {} held, which the model's `trim` does not name", assumed.join(", ")),
            };
            format!("linearised at a trim that was solved from the equations for {}{rest}{held}", names.join(", "))
        }
    };
    let (states, inputs) = values(model, trim);
    let units = model.definition().states.iter().map(|s| &s.quantity);
    let units = units.chain(model.definition().inputs.iter().map(|i| &i.quantity));
    let shown = |((name, value), quantity): ((String, f64), &Quantity)| {
        let unit = quantity.unit.as_ref().filter(|u| !u.is_one()).map_or(String::new(), |u| format!(" {u}"));
        format!("{name} = {}{unit}", digits(value, 5))
    };
    let all: Vec<String> = states.into_iter().chain(inputs).zip(units).map(shown).take(LISTED).collect();
    let more = (trim.states.len() + trim.inputs.len()).saturating_sub(LISTED);
    let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
    let time = if model.definition().uses_time() { "; t = 0" } else { "" };
    format!("{how}: {}{rest}{time}", all.join(", "))
}

type Named = Vec<(String, f64)>;

/// Names and values of states and inputs.
fn values(model: &Model, trim: &Trim) -> (Named, Named) {
    let definition = model.definition();
    let states = definition.states.iter().map(|s| s.quantity.name.clone()).zip(trim.states.iter().copied());
    let inputs = definition.inputs.iter().map(|i| i.quantity.name.clone()).zip(trim.inputs.iter().copied());
    (states.collect(), inputs.collect())
}

fn name(model: &Model, signal: Signal) -> String {
    match signal {
        Signal::State(k) => model.definition().states[k as usize].quantity.name.clone(),
        Signal::Input(k) => model.definition().inputs[k as usize].quantity.name.clone(),
    }
}
