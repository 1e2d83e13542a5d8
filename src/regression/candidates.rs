//! Candidate regressors of a model's signals, and the structure of each measured rate among them.

use super::equations::Equations;
use super::fit::completed;
use super::options::{Domain, RegressionOptions};
use super::refusal::RegressionError;
use super::rows::{Series, rows};
use super::signals::Signals;
use super::stepwise::{Limits, Stepwise, stepwise};
use crate::Model;
use crate::record::Run;
use serde::Serialize;

/// What explains the rate of one state.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Structure {
    /// The state.
    pub state: String,
    /// The search.
    pub found: Stepwise,
}

/// The rate of one state and its candidates, the rows of all runs behind each other.
#[derive(Debug, Clone, Default)]
struct Table {
    left: Vec<f64>,
    columns: Vec<(String, Vec<f64>)>,
}

/// More signals than this make so many products that chance finds a structure; then squares and products are left out.
const MOST_SIGNALS: usize = 12;

/// Searches the structure of the rate of every measured state among measured states, declared inputs, their squares, products
/// and `x*abs(x)`.
///
/// # Errors
/// [`RegressionError`], as [`regress`](super::regress); equations are not looked at.
pub fn structure(
    model: &Model,
    runs: &[Run],
    options: &RegressionOptions,
    limits: &Limits,
) -> Result<Vec<Structure>, RegressionError> {
    if runs.is_empty() {
        return Err(RegressionError::NoRuns);
    }
    let definition = model.definition();
    let equations = Equations::new(definition);
    let measured: Vec<usize> = (0..definition.states.len()).filter(|k| equations.readings[*k].is_some()).collect();
    if measured.is_empty() {
        return Err(RegressionError::NothingMeasured);
    }
    let runs = completed(definition, runs)?;
    let mut tables: Vec<Table> = vec![Table::default(); measured.len()];
    for run in &runs {
        let signals = Signals::new(definition, &equations.graph, &equations.readings, run, options)?;
        let candidates = candidates(definition, &signals, &measured);
        let (names, series): (Vec<String>, Vec<Vec<f64>>) = candidates.into_iter().unzip();
        for (k, Table { left, columns }) in measured.iter().zip(&mut tables) {
            let Some(state) = &signals.states[*k] else { continue };
            let none = vec![f64::NAN; run.len()];
            let rate = signals.rates[*k].as_ref().unwrap_or(&none);
            let known = vec![0.0; run.len()];
            let made = rows(run, &Series { state, rate, known: &known, columns: &series }, options)?;
            left.extend(made.left);
            if columns.is_empty() {
                *columns = names.iter().map(|n| (n.clone(), Vec::new())).collect();
            }
            columns.iter_mut().zip(made.columns).for_each(|((_, all), own)| all.extend(own));
        }
    }
    let constant = options.domain == Domain::Time;
    let one = |(k, Table { left, columns }): (&usize, Table)| Structure {
        state: definition.states[*k].quantity.name.clone(),
        found: stepwise(&left, &columns, constant, limits),
    };
    Ok(measured.iter().zip(tables).map(one).collect())
}

fn candidates(definition: &fdm_grammar::Model, signals: &Signals<'_>, measured: &[usize]) -> Vec<(String, Vec<f64>)> {
    let m = signals.run.held.len();
    let states = measured.iter().filter_map(|k| {
        let values = signals.states[*k].clone()?;
        Some((definition.states[*k].quantity.name.clone(), values))
    });
    let inputs = definition.inputs.iter().enumerate().filter(|(_, i)| i.is_declared()).map(|(k, input)| {
        (input.quantity.name.clone(), signals.run.inputs.iter().skip(k).step_by(m).copied().collect())
    });
    let mut all: Vec<(String, Vec<f64>)> = states.chain(inputs).collect();
    let count = all.len();
    if count > MOST_SIGNALS {
        return all;
    }
    for a in 0..count {
        for b in a..count {
            let product = all[a].1.iter().zip(&all[b].1).map(|(x, y)| x * y).collect();
            let name = if a == b { format!("{}^2", all[a].0) } else { format!("{}*{}", all[a].0, all[b].0) };
            all.push((name, product));
        }
        let sized = all[a].1.iter().map(|x| x * x.abs()).collect();
        all.push((format!("{0}*abs({0})", all[a].0), sized));
    }
    all
}
