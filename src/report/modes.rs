//! Modes of motion: eigenvalues with damping, frequency, time to half or double, and the states that dominate them.

use super::table::{aligned_right, digits, plain, trimmed};
use crate::Model;
use crate::linear::{Mode, ModeErrors, Modes, Obtained, Trim};
use fdm_grammar::graph::Signal;
use fdm_grammar::model::Quantity;
use num_complex::Complex64;
use serde_json::{Map, Value, json};

/// Values of a trim that are listed.
const LISTED: usize = 12;

/// One row for each mode, a pair in one; `errors` are standard errors mode by mode, empty when there are none.
pub fn modes_table(model: &Model, trim: &Trim, modes: &Modes, errors: &[Option<ModeErrors>]) -> String {
    let time = model.definition().time.to_string();
    let with = !errors.is_empty();
    let frequency = format!("frequency [rad/{time}]");
    let (half, double) = (format!("half [{time}]"), format!("double [{time}]"));
    let mut header = vec!["eigenvalue"];
    header.extend(with.then_some("standard error"));
    header.push("damping");
    header.extend(with.then_some("standard error"));
    header.push(&frequency);
    header.extend(with.then_some("standard error"));
    header.extend([half.as_str(), double.as_str(), "states"]);
    let mut table = plain(&header);
    for (k, mode) in modes.modes.iter().enumerate().filter(|(_, m)| m.s.im >= 0.0) {
        table.add_row(row(model, mode, with.then(|| errors.get(k).copied().flatten())));
    }
    (0..header.len() - 1).for_each(|column| aligned_right(&mut table, column));
    let mut text = trimmed(&table);
    if modes.infinite {
        text.push_str("\ndelayed states give infinitely many modes; these are the rightmost\n");
    }
    if modes.modes.iter().any(|m| m.slopes.is_none()) {
        text.push_str("\nan eigenvalue that is not apart from others has no standard error\n");
    }
    text.push_str(&format!("\n{}\n", trim_sentence(model, trim)));
    text
}

/// The cells of a mode; with standard errors where there are such.
fn row(model: &Model, mode: &Mode, errors: Option<Option<ModeErrors>>) -> Vec<String> {
    let short = |v: Option<f64>| v.map_or(String::new(), |v| digits(v, 4));
    let error = |of: fn(&ModeErrors) -> f64| errors.map(|e| e.map_or(String::new(), |e| digits(of(&e), 3)));
    let pair = mode.s.im != 0.0;
    let value =
        if pair { format!("{} ± {}j", digits(mode.s.re, 5), digits(mode.s.im, 5)) } else { digits(mode.s.re, 5) };
    let of_value = errors.map(|e| match e {
        Some(e) if pair => format!("{} and {}", digits(e.re, 3), digits(e.im, 3)),
        Some(e) => digits(e.re, 3),
        None => String::new(),
    });
    let mut cells = vec![value];
    cells.extend(of_value);
    cells.push(short(mode.damping()));
    cells.extend(error(|e| e.damping));
    cells.push(digits(mode.frequency(), 5));
    cells.extend(error(|e| e.frequency));
    cells.extend([short(mode.time_to_half()), short(mode.time_to_double()), dominant(model, mode).join(", ")]);
    cells
}

fn dominant(model: &Model, mode: &Mode) -> Vec<String> {
    mode.dominant().map(|k| model.definition().states[k].quantity.name.clone()).collect()
}

/// The same for other programs: every eigenvalue, both of a pair.
pub fn modes_json(model: &Model, trim: &Trim, modes: &Modes, errors: &[Option<ModeErrors>]) -> Value {
    let states = &model.definition().states;
    let one = |(k, mode): (usize, &Mode)| {
        let shares = mode.dominant().filter_map(|d| mode.states.iter().find(|(state, _)| *state == d));
        let mut value = json!({
            "re": mode.s.re, "im": mode.s.im, "damping": mode.damping(), "frequency": mode.frequency(),
            "states": dominant(model, mode),
            "shares": shares.map(|(state, share)| (states[*state].quantity.name.clone(), json!(share))).collect::<Map<_, _>>(),
            "shape": mode.shape.iter().zip(states).map(|(v, state)| component(*v, &state.quantity)).collect::<Vec<_>>(),
            "time_to_half": mode.time_to_half(), "time_to_double": mode.time_to_double(),
        });
        if let Some(e) = errors.get(k) {
            value["standard_errors"] = json!(e.map(|e| json!({
                "re": e.re, "im": e.im, "covariance": e.covariance, "damping": e.damping, "frequency": e.frequency,
            })));
        }
        value
    };
    let named = |signals: Named| signals.into_iter().map(|(n, v)| (n, json!(v))).collect::<Map<_, _>>();
    let (state_values, input_values) = values(model, trim);
    json!({
        "model": model.name(),
        "modes": modes.modes.iter().enumerate().map(one).collect::<Vec<_>>(),
        "infinite": modes.infinite,
        "time": model.definition().time.to_string(),
        "linearised": trim_sentence(model, trim),
        "trim": {
            "obtained": word(trim.obtained),
            "solved": trim.solved.iter().map(|s| name(model, *s)).collect::<Vec<_>>(),
            "states": named(state_values), "inputs": named(input_values),
        },
    })
}

/// What a state does in a mode: size and phase relative to the state that does most, each in its own unit.
fn component(v: Complex64, state: &Quantity) -> Value {
    // of a mirrored mode the greatest has the phase minus zero
    let phase = if v == Complex64::ZERO { None } else { Some(v.arg().to_degrees() + 0.0) };
    let unit = state.unit.as_ref().map(ToString::to_string);
    json!({ "state": state.name, "magnitude": v.norm(), "phase": phase, "unit": unit })
}

fn word(obtained: Obtained) -> &'static str {
    match obtained {
        Obtained::NotNeeded => "not_needed",
        Obtained::Given => "given",
        Obtained::Initial => "initial",
        Obtained::Solved => "solved",
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
            format!("linearised at a trim that was solved from the equations for {}{rest}", names.join(", "))
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
