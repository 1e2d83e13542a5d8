//! Values that depend on the experiment: what the table of conditions says of a name, before the experiment and in it.

use crate::experiments::Experiment;
use crate::expression::{Expr, Sign, binary, name};
use crate::formula::formula;
use crate::tables::{Row, number};

/// A value for each experiment: before it, and in it.
pub(crate) type Phases<T> = Vec<[T; 2]>;

/// What a cell of the table of conditions says; nothing where it is empty or NaN.
pub(crate) fn cell(row: &Row, column: &str) -> Option<Expr> {
    let text = row.get(column)?;
    match number(text) {
        Some(value) => Some(Expr::Number(value)),
        None if text.eq_ignore_ascii_case("nan") => None,
        // tables are read with formulas that can be read
        None => Some(formula(text).unwrap_or_else(|_| name(text))),
    }
}

/// What the table says of a name in every experiment.
pub(crate) fn cells(conditions: &[Row], experiments: &[Experiment], column: &str) -> Phases<Option<Expr>> {
    let of = |k: usize| conditions.get(k).and_then(|row| cell(row, column));
    experiments.iter().map(|e| [of(e.before.unwrap_or(e.condition)), of(e.condition)]).collect()
}

/// A column that every run brings: one value, or one before the experiment and one in it.
#[derive(Debug)]
pub(crate) struct Channel {
    pub(crate) name: String,
    pub(crate) about: String,
    pub(crate) values: Phases<f64>,
}

impl Channel {
    /// Whether it changes during a run.
    pub(crate) fn is_input(&self) -> bool {
        self.values.iter().any(|[before, during]| before != during)
    }
}

/// A value that depends on the experiment, as the model writes it: an expression, and the channel that it needs. `fresh` makes the name of a
/// channel out of a wanted one.
pub(crate) fn written(
    id: &str,
    values: &Phases<Expr>,
    fresh: &mut dyn FnMut(&str) -> String,
) -> (Expr, Option<Channel>) {
    let mut distinct: Vec<&Expr> = Vec::new();
    for value in values.iter().flatten() {
        if !distinct.contains(&value) {
            distinct.push(value);
        }
    }
    if let [one] = distinct[..] {
        return (one.clone(), None);
    }
    let plain = |e: &Expr| match e {
        Expr::Number(v) => Some(*v),
        _ => None,
    };
    let numbers: Option<Vec<[f64; 2]>> = values.iter().map(|[a, b]| Some([plain(a)?, plain(b)?])).collect();
    if let Some(values) = numbers {
        let channel = Channel { name: fresh(id), about: String::new(), values };
        return (name(&channel.name), Some(channel));
    }
    let place = |e: &Expr| distinct.iter().position(|d| *d == e).map_or(0.0, |k| (k + 1) as f64);
    let values: Phases<f64> = values.iter().map(|[a, b]| [place(a), place(b)]).collect();
    let channel = fresh(&format!("{id}_choice"));
    let mut branches: Vec<(Expr, Expr)> = Vec::new();
    for (k, value) in distinct.iter().enumerate() {
        let is = binary(Sign::Equal, name(&channel), Expr::Number((k + 1) as f64));
        branches.push(((*value).clone(), is));
    }
    let otherwise = branches.pop().map_or(Expr::Number(0.0), |(value, _)| value);
    let about = format!("which of its values {id} has");
    (Expr::If(branches, Box::new(otherwise)), Some(Channel { name: channel, about, values }))
}
