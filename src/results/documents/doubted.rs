//! Initial values that the data contradict, in a sentence.

use super::digits::{digits, digits_by_error};
use fdm_estimate::{DoubtedInitial, DoubtedInitials, MovedParameter};

/// Most states and parameters that are named.
const NAMED: usize = 3;

/// What the record says, what the text says, what to write, and what becomes of the parameters.
pub(super) fn sentence(doubted: &DoubtedInitials) -> Option<String> {
    let far = |v: &DoubtedInitial| v.error.map_or(f64::INFINITY, |error| ((v.found - v.stated) / error).abs());
    let mut states: Vec<&DoubtedInitial> = Vec::new();
    for value in &doubted.values {
        match states.iter_mut().find(|known| known.state == value.state) {
            Some(known) if far(value) > far(known) => *known = value,
            Some(_) => {}
            None => states.push(value),
        }
    }
    let first = states.first()?;
    let runs = doubted.values.iter().filter(|v| v.state == first.state).count();
    let one = |v: &&DoubtedInitial| {
        let unit = v.unit.as_ref().map_or(String::new(), |u| format!(" {u}"));
        let run = if runs > 1 { format!(" in {}", v.run) } else { String::new() };
        let (found, stated) = (by_error(v.found, v.error), digits(v.stated, 3));
        format!("with `{}` at {found}{unit}{run}, the text says {stated}", v.state)
    };
    let stated: Vec<String> = states.iter().take(NAMED).map(one).collect();
    let free: Vec<String> = states.iter().map(|v| format!("{} = free", v.state)).collect();
    let moved =
        |m: &MovedParameter| format!("{} {} in place of {}", m.name, by_error(m.value, m.error), digits(m.before, 3));
    let moved: Vec<String> = doubted.parameters.iter().take(NAMED).map(moved).collect();
    let then = if moved.is_empty() { String::new() } else { format!("; then {}", moved.join(", ")) };
    let gain = digits(doubted.gain, 3);
    Some(format!(
        "the record begins {}: write `state {};`, log-likelihood +{gain}{then}",
        stated.join("; "),
        free.join(", ")
    ))
}

/// A value with the digits that its error leaves.
fn by_error(value: f64, error: Option<f64>) -> String {
    let places = error.and_then(|error| digits_by_error(value, error, 3)).unwrap_or(3);
    digits(value, places)
}
