//! The text of the model that stands for a unit: states, inputs, parameters and outputs by name, and the unit's functions as their
//! equations.

use crate::archive::{UnitError, Version};
use crate::description::{Description, Variable};
use fdm_grammar::Unit;
use fdm_grammar::check::function_form;
use fdm_grammar::external::{MOST_FUNCTIONS, PREFIX};
use fdm_grammar::syntax::word_use;
use std::collections::BTreeSet;
use std::fmt::Write;

/// How the line begins that says which unit a text stands for.
const HEAD: &str = "// functional mock-up unit ";

/// The key of the unit that a text stands for.
pub(crate) fn key(text: &str) -> Option<&str> {
    text.strip_prefix(HEAD)?.split([' ', '\n']).next()
}

/// The text; functions have the numbers of [`crate::unit::Unit`].
pub(crate) fn written(d: &Description, key: &str) -> Result<String, UnitError> {
    let (n, m, p) = (d.states.len(), d.inputs.len(), d.parameters.len());
    let functions = 2 * n + d.outputs.len();
    // most arguments of all functions of a unit together
    if functions >= MOST_FUNCTIONS as usize || functions.saturating_mul(1 + n + m + p) > 100_000 {
        return Err(UnitError::Unsuited(format!(
            "the unit is too large for a part of a model: {n} states, {m} inputs, {p} parameters, {} outputs",
            d.outputs.len()
        )));
    }
    let mut names = Names::default();
    let states: Vec<String> = d.states.iter().map(|s| names.of(&s.variable.name)).collect();
    let inputs: Vec<String> = d.inputs.iter().map(|v| names.of(&v.name)).collect();
    let parameters: Vec<String> = d.parameters.iter().map(|v| names.of(&v.name)).collect();
    let outputs: Vec<String> = d.outputs.iter().map(|v| names.of(&v.name)).collect();
    let starts: Vec<String> = states.iter().map(|name| names.of(&format!("{name}_start"))).collect();

    // nothing of its file's name: a model is the same from wherever it is read
    let version = if d.version == Version::Two { "2.0" } else { "3.0" };
    let mut text = format!("{HEAD}{key} (FMI {version}, {})\n", plain(&d.tool));
    let _ = writeln!(text, "model {}{} {{", Names::default().of(&d.name), doc(&d.doc));
    let quantity = |v: &Variable| format!("{}{}", unit(v), doc(&about(v)));
    if let Some(time) = d.time_unit.as_ref().filter(|u| is_known(u) && *u != "s") {
        let _ = writeln!(text, "  time [{time}];");
    }
    for (name, v) in inputs.iter().zip(&d.inputs) {
        let _ = writeln!(text, "  input {name}{};", quantity(v));
    }
    for (name, v) in parameters.iter().zip(&d.parameters) {
        let _ =
            writeln!(text, "  param {name} = {}{}{} fixed;", number(v.start.unwrap_or(0.0)), bounds(v), quantity(v));
    }
    let start = |v: &Variable| number(v.start.unwrap_or(0.0));
    let tail = || parameters.iter().cloned();
    let call = |function: usize, arguments: Vec<String>| format!("{PREFIX}{key}_{function}({})", arguments.join(", "));
    let begin = number(d.start_time);
    // a param, so that what the unit computes for its beginning is no constant where it has no parameters
    let clock_start = names.of("start_time");
    if d.states.iter().any(|s| !s.exact) {
        let _ = writeln!(text, "  param {clock_start} = {begin} \"when the unit begins\" fixed;");
    }
    for (k, (name, s)) in states.iter().zip(&d.states).enumerate() {
        let v = &s.variable;
        let first = match s.exact {
            true => format!("{} fixed", number(v.start.unwrap_or(0.0))),
            // what the unit computes when it is initialised, from its parameters and its inputs at their own start values
            false => {
                let others = d.states.iter().map(|s| start(&s.variable)).chain(d.inputs.iter().map(start));
                call(n + d.outputs.len() + k, [clock_start.clone()].into_iter().chain(others).chain(tail()).collect())
            }
        };
        let _ = writeln!(text, "  param {}{} = {first};", starts[k], unit(v));
        let _ = writeln!(text, "  state {name}{} = {};", quantity(v), starts[k]);
    }
    let clock = |moves: bool| if moves { "t".to_string() } else { begin.clone() };
    // where there are events time is told, so that none is missed
    let moves = d.indicators > 0 || d.dependences[..n].iter().any(|on| on.time);
    for (k, name) in states.iter().enumerate() {
        let all = [clock(moves)].into_iter().chain(states.iter().cloned()).chain(inputs.iter().cloned()).chain(tail());
        let _ = writeln!(text, "  der({name}) = {};", call(k, all.collect()));
    }
    for (k, (name, v)) in outputs.iter().zip(&d.outputs).enumerate() {
        let on = &d.dependences[n + k];
        // an input that it does not depend on is left out: it may be computed from the output
        let given = inputs.iter().zip(&d.inputs).zip(&on.inputs);
        let given = given.map(|((name, v), matters)| if *matters { name.clone() } else { start(v) });
        let all =
            [clock(d.indicators > 0 || on.time)].into_iter().chain(states.iter().cloned()).chain(given).chain(tail());
        let _ = writeln!(text, "  output {name}{} = {};", quantity(v), call(n + k, all.collect()));
    }
    text.push_str("}\n");
    Ok(text)
}

/// A number that comes back, in the language's notation.
fn number(value: f64) -> String {
    let text = format!("{value:?}");
    if value < 0.0 { format!("-{}", text.trim_start_matches('-')) } else { text }
}

fn bounds(v: &Variable) -> String {
    let (lower, upper) = v.bounds;
    let said = |value: f64| {
        if value.is_finite() {
            number(value)
        } else if value < 0.0 {
            "-inf".into()
        } else {
            "inf".into()
        }
    };
    let start = v.start.unwrap_or(0.0);
    // bounds that the start value breaks are no bounds
    if (lower.is_finite() || upper.is_finite()) && lower < upper && (lower..=upper).contains(&start) {
        format!(" in [{}, {}]", said(lower), said(upper))
    } else {
        String::new()
    }
}

/// The unit of measurement, where the language knows it.
fn unit(v: &Variable) -> String {
    let known = v.unit.as_ref().filter(|u| is_known(u));
    known.map_or(String::new(), |u| format!(" [{u}]"))
}

fn is_known(unit: &str) -> bool {
    Unit::parse(unit).is_ok() && !unit.contains(['[', ']', '{', '}', ';', '"', '\n'])
}

/// What the unit calls it, where the text has to call it otherwise, and what it says of it.
fn about(v: &Variable) -> String {
    let mut parts = Vec::new();
    if identifier(&v.name) != v.name {
        parts.push(v.name.clone());
    }
    if let Some(own) = v.unit.as_ref().filter(|_| unit(v).is_empty()) {
        parts.push(format!("in {own}"));
    }
    parts.extend(Some(v.doc.clone()).filter(|doc| !doc.is_empty()));
    parts.join("; ")
}

fn doc(text: &str) -> String {
    if text.is_empty() { String::new() } else { format!(" \"{}\"", plain(text)) }
}

/// One line without quotes.
fn plain(text: &str) -> String {
    text.chars()
        .map(|c| {
            if c.is_control() {
                ' '
            } else if c == '"' {
                '\''
            } else {
                c
            }
        })
        .collect()
}

/// Letters, digits and underscores.
fn identifier(name: &str) -> String {
    let mut text: String = name.chars().map(|c| if c.is_ascii_alphanumeric() || c == '_' { c } else { '_' }).collect();
    while text.ends_with('_') && text.len() > 1 && !name.ends_with('_') {
        text.pop();
    }
    if text.starts_with(|c: char| c.is_ascii_digit()) || text.is_empty() {
        text.insert(0, 'v');
    }
    let taken =
        word_use(&text).is_some() || function_form(&text).is_some() || ["t", "pi", "inf"].contains(&text.as_str());
    if taken { text + "_" } else { text }
}

/// Names of the language, each once.
#[derive(Default)]
struct Names {
    taken: BTreeSet<String>,
}

impl Names {
    fn of(&mut self, name: &str) -> String {
        let plain = identifier(name);
        let (mut text, mut next) = (plain.clone(), 2);
        while !self.taken.insert(text.clone()) {
            text = format!("{plain}_{next}");
            next += 1;
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_the_language_and_differ() {
        let mut names = Names::default();
        let made =
            ["body.v", "x[1]", "x[2]", "x_1", "state", "sin", "3d", "α", "der(x)", "t"].map(|name| names.of(name));
        assert_eq!(made, ["body_v", "x_1", "x_2", "x_1_2", "state_", "sin_", "v3d", "_", "der_x", "t_"]);
    }
}
