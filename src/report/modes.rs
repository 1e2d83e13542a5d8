//! Modes of motion: eigenvalues with damping, frequency, time to half or double, and the states that dominate them.

use super::table::{aligned_right, plain, trimmed};
use fdm_results::documents::{digits, trim_sentence};
use fdm_system::Model;
use fdm_system::linear::{Mode, ModeErrors, Modes, Trim};

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
