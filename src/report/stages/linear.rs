//! The linear model at the trim: A, B, C, D and what multiplies delayed signals, as numbers and as expressions.

use super::Shown;
use crate::section::Rows;
use crate::text;
use fdm_grammar::derive::{Jacobian, Partials, differentiate};
use fdm_grammar::graph::{Leaf, Names, show};
use fdm_results::documents::stages::{Coefficient, CoefficientMatrix, LinearStage, StageDocument};
use fdm_results::documents::{digits, trim_sentence};
use fdm_system::Model;
use fdm_system::linear::{LinearModel, Values};

/// Wider matrices are listed entry by entry only.
const MOST_COLUMNS: usize = 12;

/// A coefficient that is not zero everywhere.
struct Entry {
    row: usize,
    column: usize,
    value: f64,
    expression: String,
}

pub(super) fn linear(model: &Model) -> Result<Shown, String> {
    let theta = model.definition().start();
    let mut linear = LinearModel::new(model).map_err(|e| e.to_string())?;
    let mut values = Values::default();
    linear.evaluate(&theta, &mut values).map_err(|e| e.to_string())?;
    let trim = linear.trim(&theta);
    let mut definition = model.definition().clone();
    let d = differentiate(&mut definition);
    let (n, m, q) = (definition.states.len(), definition.inputs.len(), definition.outputs.len());
    let delayed = definition.graph.delayed().len();
    let (mut text, mut stage) = (String::new(), LinearStage { model: model.name().into(), ..LinearStage::default() });
    let matrices = [
        ("A", &mut stage.a, true, 0..n),
        ("B", &mut stage.b, true, n..n + m),
        ("A_delayed", &mut stage.a_delayed, true, n + m..n + m + delayed),
        ("C", &mut stage.c, false, 0..n),
        ("D", &mut stage.d, false, n..n + m),
        ("C_delayed", &mut stage.c_delayed, false, n + m..n + m + delayed),
    ];
    let mut expressions = String::new();
    for (name, place, of_rates, signals) in matrices {
        let rows: Vec<String> = match of_rates {
            true => definition.states.iter().map(|s| format!("der({})", s.quantity.name)).collect(),
            false => definition.outputs.iter().map(|o| o.quantity.name.clone()).collect(),
        };
        let leaf = |k: usize| match k {
            k if k < n => Leaf::State(k as u32),
            k if k < n + m => Leaf::Input((k - n) as u32),
            k => Leaf::Delayed((k - n - m) as u32),
        };
        let columns: Vec<String> = signals.clone().map(|k| definition.leaf(leaf(k))).collect();
        let first = if of_rates { 0 } else { n };
        let range = if of_rates { 0..n } else { n..n + q };
        let terms = linear.structure().terms.iter().zip(&values.terms);
        let inside = terms.filter(|(t, _)| range.contains(&(t.row as usize)) && signals.contains(&(t.signal as usize)));
        let partials = if of_rates { &d.rates } else { &d.outputs };
        let entries: Vec<Entry> = inside
            .map(|(t, value)| {
                let (row, column) = (t.row as usize - first, t.signal as usize - signals.start);
                let e = jacobian(partials, leaf(t.signal as usize)).pattern.row(row).find(|(_, j)| *j == column);
                let e = e.map(|(k, _)| jacobian(partials, leaf(t.signal as usize)).entries[k]);
                let expression = e.map_or(String::new(), |e| show(&definition.graph, e, &definition));
                Entry { row, column, value: *value, expression }
            })
            .collect();
        if !rows.is_empty() && !entries.is_empty() {
            text += &matrix(name, &rows, &columns, &entries);
            let written = |e: &Entry| format!("{name}[{}, {}] = {}\n", rows[e.row], columns[e.column], e.expression);
            expressions += &entries.iter().map(written).collect::<String>();
        }
        *place = document(rows, columns, entries);
    }
    let names = definition.states.iter().map(|s| &s.quantity.name).zip(&trim.states);
    let inputs = definition.inputs.iter().map(|i| &i.quantity.name).zip(&trim.inputs);
    stage.trim = names.chain(inputs).map(|(name, v)| (name.clone(), *v)).collect();
    text += &expressions;
    text += &format!("\n{}\n", trim_sentence(model, &trim));
    Ok(Shown { text, document: StageDocument::Linear(Box::new(stage)) })
}

fn jacobian(partials: &Partials, leaf: Leaf) -> &Jacobian {
    match leaf {
        Leaf::State(_) => &partials.state,
        Leaf::Input(_) => &partials.input,
        _ => &partials.delayed,
    }
}

/// A table of numbers, `.` where nothing can be; a list when it would be too wide.
fn matrix(name: &str, rows: &[String], columns: &[String], entries: &[Entry]) -> String {
    let number = |v: f64| digits(v, 6);
    if columns.len() > MOST_COLUMNS {
        let line = |e: &Entry| format!("{name}[{}, {}] = {}\n", rows[e.row], columns[e.column], number(e.value));
        return entries.iter().map(line).collect::<String>() + "\n";
    }
    let mut table = Rows::over(rows.iter().enumerate());
    table.words(name, |(_, row)| row.to_string());
    for (j, column) in columns.iter().enumerate() {
        table.number(column, |(i, _)| {
            let entry = entries.iter().rfind(|e| e.row == *i && e.column == j);
            entry.map_or(".".into(), |e| number(e.value))
        });
    }
    text::table(table) + "\n"
}

fn document(rows: Vec<String>, columns: Vec<String>, entries: Vec<Entry>) -> CoefficientMatrix {
    let entry = |e: Entry| {
        let (column, row) = (columns[e.column].clone(), rows[e.row].clone());
        Coefficient { column, expression: e.expression, row, value: e.value }
    };
    let entries = entries.into_iter().map(entry).collect();
    CoefficientMatrix { columns, entries, rows }
}
