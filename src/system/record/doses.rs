//! Doses of the tables of NONMEM and Monolix (AMT, RATE, ADDL, II beside DV): an input that enters a model by its derivative alone is the amount given so far.
//!
//! `der(depot) = der(dose) - ka*depot` with an amount that rises at once is a bolus, and with one that rises in a straight line an infusion: one word for
//! both, with the derivatives that every input has. An input is a function of time, so that "at once" is a rise within [`AT_ONCE`] of the time to the next row.

use super::channel::{Channels, Plan};
use super::error::{Fault, Problem};
use super::note::Note;
use super::options::ReadOptions;
use super::samples::Samples;
use super::table::Table;

/// Part of the time to the next row in which a dose is given at once: what a rate k does within it, `k` times the interval times this, is rounding beside a
/// response that is sampled at all; and times since 1970 in seconds still tell it from nothing.
const AT_ONCE: f64 = 1e-9;

/// An amount that is given from one time to another.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Dose {
    amount: f64,
    from: f64,
    /// None where it is given at once.
    to: Option<f64>,
}

fn place(table: &Table, name: &str) -> Option<usize> {
    table.headings().position(|h| h.name.eq_ignore_ascii_case(name))
}

/// Whether an input (by index) enters rates by its derivative.
fn is_given(channels: &Channels, input: usize) -> bool {
    channels.slopes.iter().any(|s| s.of as usize == input && !s.shown)
}

/// The options with the columns of such tables for what has no column of its name: AMT for the one input that is given, DV for the one output.
pub(crate) fn conventions(table: &Table, channels: &Channels, options: &ReadOptions) -> ReadOptions {
    let mut options = options.clone();
    let lacks = |name: &str| place(table, name).is_none() && !options.map.iter().any(|(channel, _)| channel == name);
    let inputs: Vec<&str> = (0..channels.inputs.len())
        .filter(|k| is_given(channels, *k))
        .map(|k| channels.inputs[k].name.as_str())
        .filter(|name| lacks(name))
        .collect();
    let outputs = channels.outputs.iter().map(|c| c.name.as_str());
    let outputs: Vec<&str> = outputs.filter(|name| lacks(name) && !options.without.iter().any(|w| w == name)).collect();
    let one_kind = place(table, "DVID").is_none_or(|k| distinct(table.columns[k].values.iter().copied()) < 2);
    let mut added = Vec::new();
    for (names, column, usable) in [(inputs, "AMT", true), (outputs, "DV", one_kind)] {
        if let ([name], Some(at), true) = (&names[..], place(table, column), usable) {
            added.push(((*name).to_string(), table.columns[at].heading.title.clone()));
        }
    }
    options.map.extend(added);
    options
}

fn distinct(values: impl Iterator<Item = f64>) -> usize {
    let mut seen: Vec<f64> = values.filter(|v| !v.is_nan()).collect();
    seen.sort_unstable_by(f64::total_cmp);
    seen.dedup();
    seen.len()
}

/// The inputs (by index) that are read from amounts of doses.
pub(crate) fn inputs(table: &Table, plan: &Plan, channels: &Channels) -> Vec<usize> {
    let amounts = place(table, "AMT").filter(|_| place(table, "DV").or_else(|| place(table, "EVID")).is_some());
    let of = |k: &usize| Some(plan.inputs[*k].column) == amounts && !channels.inputs[*k].known;
    (0..plan.inputs.len()).filter(of).collect()
}

/// Puts the amounts given so far into the samples of the inputs that are read from doses.
///
/// # Errors
/// Doses of a kind that is not read, each with the next thing to do.
pub(crate) fn give(
    parts: &mut [Samples],
    (table, plan): (&Table, &Plan),
    channels: &Channels,
    notes: &mut Vec<Note>,
) -> Result<(), Vec<Problem>> {
    let (inputs, time) = (inputs(table, plan, channels), plan.time.as_ref());
    let Some(amounts) = place(table, "AMT") else { return Ok(()) };
    let count = table.columns[amounts].values.iter().filter(|v| **v > 0.0).count();
    let (Some(time), false) = (time, inputs.is_empty()) else {
        let unread = !plan.inputs.iter().any(|source| source.column == amounts);
        if unread && count > 0 && channels.timed && place(table, "DV").is_some() {
            let said = format!(
                "column `AMT` holds {count} dose(s), and no input takes them: where they do not stand in the model already, declare \
                 `input dose;` with the unit of an amount, and add der(dose) to the rate of the state that is dosed"
            );
            notes.push(Note::Layout(said));
        }
        return Ok(());
    };
    let doses = read(table, amounts, time.column).map_err(|p| vec![p])?;
    for input in inputs {
        let name = &channels.inputs[input].name;
        if !is_given(channels, input) {
            let hint = format!(
                "write der({name}) in the rate of the state that is dosed: the input is then the amount given so far"
            );
            let fault = Fault::Dose { found: "an amount".into(), why: "which is given at an instant and is no signal" };
            return Err(vec![fault.anywhere().column(&table.columns[amounts].heading.title).hint(hint)]);
        }
        let source = &plan.inputs[input];
        let own: Vec<Dose> = doses.iter().map(|d| Dose { amount: source.convert(d.amount), ..*d }).collect();
        parts.iter_mut().for_each(|samples| into(samples, input, channels.inputs.len(), &own));
        let early = parts.first().and_then(|s| s.time.first()).copied().unwrap_or(f64::NEG_INFINITY);
        let before = own.iter().filter(|d| d.from < early).count();
        let left = if before > 0 {
            format!("; {before} before the first row that is used are not given")
        } else {
            String::new()
        };
        let said = format!("input `{name}` is the amount given so far, by {} dose(s) of column `AMT`{left}", own.len());
        notes.push(Note::Layout(said));
    }
    Ok(())
}

/// The doses of a table, in the unit of the column.
fn read(table: &Table, amounts: usize, time: usize) -> Result<Vec<Dose>, Problem> {
    let cell = |name: &str, row: usize| place(table, name).map_or(0.0, |k| table.columns[k].values[row]);
    let number = |name: &str, row: usize| Some(cell(name, row)).filter(|v| !v.is_nan()).unwrap_or_default();
    let refused = |name: &str, row: usize, why: &'static str, hint: &str| {
        let fault = Fault::Dose { found: cell(name, row).to_string(), why };
        fault.at(table.line(row)).column(name).hint(hint)
    };
    let mut doses = Vec::new();
    let given = |row: &usize| table.columns[amounts].values[*row] > 0.0;
    if let Some(row) = (0..table.rows()).find(|row| number("EVID", *row) >= 3.0) {
        let hint = "give each part between resets a number of its own in a column, and name it by --runs-by";
        return Err(refused("EVID", row, "a reset of the system, which ends a run", hint));
    }
    let compartments = (0..table.rows()).filter(given).map(|row| number("CMT", row));
    if distinct(compartments) > 1 {
        let row = (0..table.rows()).find(given).unwrap_or_default();
        let hint = "write the amounts of each compartment into a column and an input of its own";
        return Err(refused("CMT", row, "doses of several compartments, and the model has one input for them", hint));
    }
    for row in (0..table.rows()).filter(given) {
        if number("SS", row) > 0.0 {
            let hint = "write the doses before it, with ADDL and II in a row at an earlier time";
            return Err(refused("SS", row, "a dose in steady state, whose past is not in the table", hint));
        }
        let (rate, amount) = (number("RATE", row), table.columns[amounts].values[row]);
        if rate < 0.0 {
            let hint = "write the rate, or 0 for a dose at once; a duration that is estimated stands in the model";
            return Err(refused("RATE", row, "a code for a rate that a model determines", hint));
        }
        let (more, every) = (number("ADDL", row), number("II", row));
        if more > 0.0 && every <= 0.0 {
            return Err(refused(
                "ADDL",
                row,
                "more doses without the interval between them (II)",
                "write it into column `II`",
            ));
        }
        for k in 0..=more as usize {
            let from = table.columns[time].values[row] + k as f64 * every;
            doses.push(Dose { amount, from, to: (rate > 0.0).then(|| from + amount / rate) });
        }
    }
    Ok(doses)
}

/// Puts an input into the samples, with the instants between rows at which it begins and ends to rise.
fn into(samples: &mut Samples, input: usize, m: usize, doses: &[Dose]) {
    let (Some(first), Some(last)) = (samples.time.first().copied(), samples.time.last().copied()) else { return };
    let mut knots: Vec<f64> = doses.iter().filter(|d| first <= d.from && d.from < last).map(|d| d.from).collect();
    knots.extend(samples.time.iter().copied());
    knots.sort_unstable_by(f64::total_cmp);
    let end = |d: &Dose| {
        d.to.unwrap_or_else(|| {
            let next = knots.get(knots.partition_point(|t| *t <= d.from)).copied().unwrap_or(d.from);
            (d.from + AT_ONCE * (next - d.from)).max(d.from.next_up())
        })
    };
    let rises: Vec<(f64, f64, f64)> =
        doses.iter().filter(|d| first <= d.from && d.from < last).map(|d| (d.from, end(d), d.amount)).collect();
    for (from, to, _) in &rises {
        [*from, *to].into_iter().filter(|t| *t < last).for_each(|t| insert(samples, t, m));
    }
    for (row, t) in samples.inputs.chunks_exact_mut(m).zip(&samples.time) {
        let so_far = |(from, to, amount): &(f64, f64, f64)| amount * ((t - from) / (to - from)).clamp(0.0, 1.0);
        row[input] = rises.iter().map(so_far).sum();
    }
}

/// A row at a time that has none: the inputs as they go there, nothing measured.
fn insert(samples: &mut Samples, t: f64, m: usize) {
    let at = samples.time.partition_point(|s| *s < t);
    if samples.time.get(at) == Some(&t) || at == 0 {
        return;
    }
    let share = (t - samples.time[at - 1]) / (samples.time[at] - samples.time[at - 1]);
    let (before, behind) = (&samples.inputs[(at - 1) * m..][..m], &samples.inputs[at * m..][..m]);
    let row: Vec<f64> = before.iter().zip(behind).map(|(a, b)| if a == b { *a } else { a + share * (b - a) }).collect();
    let q = samples.unsampled.len();
    samples.time.insert(at, t);
    samples.inputs.splice(at * m..at * m, row);
    samples.measured.splice(at * q..at * q, std::iter::repeat_n(f64::NAN, q));
    samples.unsampled.iter_mut().for_each(|count| *count += 1);
    samples.limits.iter_mut().filter(|limit| limit.0 >= at).for_each(|limit| limit.0 += 1);
    samples.inserted.iter_mut().filter(|k| **k >= at).for_each(|k| *k += 1);
    samples.inserted.push(at);
}
