//! Modes of motion: eigenvalues with damping, frequency, times, and the states that dominate them; both of a pair.

use super::digits::digits;
use super::json::present;
use fdm_grammar::graph::Signal;
use fdm_grammar::model::Quantity;
use fdm_system::Model;
use fdm_system::linear::{Mode, ModeErrors, Modes, Obtained, Trim};
use num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

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
