//! What stands in a table for nothing: codes of missing values, and rows that are events and no observations.

use super::note::Note;
use super::options::ReadOptions;
use super::table::Table;
use super::text::{self, Cell};

/// Numbers that laboratories and databases write where there is no value. Ends of converters and of formats may be measured: the doctor doubts them.
const CODES: [f64; 6] = [-999.0, -9999.0, -99_999.0, -999.25, -999.9, -9999.9];
/// What `--missing` says where no number is to be taken for a code.
const NONE: &str = "none";

/// Empties the cells that hold a code: those that were named, and numbers of [`CODES`] far below all others.
pub(crate) fn take_out(table: &mut Table, options: &ReadOptions) {
    let mut notes = Vec::new();
    let guessed = !options.missing.iter().any(|code| code == NONE);
    for column in &mut table.columns {
        let title = column.heading.title.clone();
        let mut told = |code: &str, cells: usize, guessed: bool| {
            let code = code.to_string();
            notes.extend((cells > 0).then(|| Note::Code { column: title.clone(), code, cells, guessed }));
        };
        for code in options.missing.iter().filter(|code| *code != NONE) {
            let cells = match text::scan(code) {
                Cell::Number(value, _) => column.without(|v| v == value),
                _ => column.without_text(code),
            };
            told(code, cells, false);
        }
        if let Some(code) = code_of(&column.values).filter(|_| guessed && column.stamps.is_none()) {
            let cells = column.without(|v| v == code);
            told(&code.to_string(), cells, true);
        }
    }
    table.notes.extend(notes);
    events(table);
}

/// The least of these numbers, where it is a code and further from all others than twice their range.
fn code_of(values: &[f64]) -> Option<f64> {
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    let least = finite().fold(f64::INFINITY, f64::min);
    CODES.contains(&least).then_some(())?;
    let range = |of: &mut dyn Iterator<Item = f64>| {
        of.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, g), v| (l.min(v), g.max(v)))
    };
    let (low, high) = range(&mut finite().filter(|v| *v != least));
    (low <= high && low - least > 2.0 * (high - low)).then_some(least)
}

/// Rows of doses and other events hold no observation: `EVID` or `MDV` of the tables of NONMEM say so of `DV`.
fn events(table: &mut Table) {
    let place = |name: &str| table.columns.iter().position(|c| c.heading.name.eq_ignore_ascii_case(name));
    let (Some(observed), flag) = (place("DV"), place("EVID").or_else(|| place("MDV"))) else { return };
    let Some(flag) = flag else { return };
    let events: Vec<bool> = table.columns[flag].values.iter().map(|v| !v.is_nan() && *v != 0.0).collect();
    let values = &mut table.columns[observed].values;
    let mut left_out = 0;
    for (value, _) in values.iter_mut().zip(&events).filter(|(_, event)| **event) {
        left_out += usize::from(!value.is_nan());
        *value = f64::NAN;
    }
    let count = events.iter().filter(|e| **e).count();
    if count > 0 {
        let (flag, observed) = (&table.columns[flag].heading.title, &table.columns[observed].heading.title);
        let kept = if left_out > 0 { format!(", {left_out} of which hold a number there") } else { String::new() };
        let said =
            format!("{count} row(s) are events by column `{flag}`: nothing in `{observed}` is compared there{kept}");
        table.notes.push(Note::Layout(said));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, missing: &[&str]) -> (Vec<f64>, usize) {
        let mut table = Table::of_text(text.as_bytes().to_vec()).unwrap();
        let missing = missing.iter().map(|m| (*m).to_string()).collect();
        take_out(&mut table, &ReadOptions { missing, ..ReadOptions::default() });
        (table.columns[1].values.clone(), table.notes.len())
    }

    #[test]
    fn codes_are_gaps_where_they_are_far_from_all_values() {
        let gaps = |(values, notes): (Vec<f64>, usize)| (values.iter().filter(|v| v.is_nan()).count(), notes);
        assert_eq!(gaps(read("t,y\n0,1\n1,-999\n2,3\n", &[])), (1, 1));
        assert_eq!(gaps(read("t,y\n0,1\n1,-999\n2,3\n", &["none"])), (0, 0));
        assert_eq!(gaps(read("t,y\n0,-990\n1,-999\n2,-700\n", &[])), (0, 0));
        assert_eq!(gaps(read("t,y\n0,1\n1,77\n2,x\n", &["77", "x"])), (2, 2));
    }

    #[test]
    fn rows_of_events_are_no_observations() {
        let (values, notes) = read("TIME,DV,EVID\n0,0,1\n1,2.5,0\n", &[]);
        assert!(values[0].is_nan() && values[1] == 2.5 && notes == 1);
    }
}
