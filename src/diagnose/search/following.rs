//! Inputs that follow the states, as under a controller or a pilot, and what that hides.
//!
//! Under feedback an input is a function of what it moves. What an effect adds is then hard to tell from what the fitted parameters add,
//! however long the record: an effect of which little is left beside them could be there, and nobody would see it.

use super::measured::states_and_outputs;
use super::round::Runs;
use super::stage::Stage;
use crate::diagnose::diagnosis::{Detectable, Following, FollowingInput};
use nalgebra::{DMatrix, DVector};

/// Part of an input's variance that its states explain, from which it is said to follow them.
const FOLLOWS: f64 = 0.7;
/// Part of an effect that is left beside the fitted parameters, below which it is called hidden.
const HIDDEN: f64 = 0.03;
/// Singular values below this part of the largest are none.
const RANK: f64 = 1e-8;

/// What follows what on the runs that are learned from; none where every input is its own.
pub(super) fn following(stage: &Stage, runs: Runs<'_>, detectable: &[Detectable]) -> Option<Following> {
    let definition = stage.model.definition();
    let (n, m) = (definition.states.len(), definition.inputs.len());
    let (states, _) = states_and_outputs(stage, runs.all);
    let of = |k: usize| -> Option<FollowingInput> {
        let (mut rows, mut own) = (Vec::new(), Vec::new());
        for (run, states) in runs.train().iter().zip(&states) {
            let input: Vec<f64> = run.inputs.iter().skip(k).step_by(m).copied().collect();
            let columns: Vec<Vec<f64>> = (0..n).map(|s| states.iter().skip(s).step_by(n).copied().collect()).collect();
            rows.push(columns.iter().map(|column| about_mean(column)).collect::<Vec<_>>());
            own.extend(about_mean(&input));
        }
        let share = explained(&rows, &own)?;
        let input = definition.inputs[k].quantity.name.clone();
        (share >= FOLLOWS).then_some(FollowingInput { input, explained: share })
    };
    let inputs: Vec<FollowingInput> = (0..m).filter_map(of).collect();
    let hidden = detectable.iter().filter(|d| d.smallest.is_none() || d.distinct < HIDDEN);
    let hidden = hidden.map(|d| d.place.clone()).collect();
    (!inputs.is_empty()).then_some(Following { inputs, hidden })
}

fn about_mean(values: &[f64]) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    values.iter().map(|v| v - mean).collect()
}

/// The part of a signal's variance that columns (of each run) explain by least squares; none where nothing moves.
fn explained(runs: &[Vec<Vec<f64>>], signal: &[f64]) -> Option<f64> {
    let whole: f64 = signal.iter().map(|v| v * v).sum();
    let width = runs.first()?.len();
    let mut columns: Vec<Vec<f64>> = (0..width).map(|c| runs.iter().flat_map(|run| run[c].clone()).collect()).collect();
    columns.retain(|column| column.iter().all(|v| v.is_finite()) && column.iter().any(|v| *v != 0.0));
    // columns of one size, so that small singular values speak of likeness and not of units
    for column in &mut columns {
        let size = column.iter().map(|v| v * v).sum::<f64>().sqrt();
        column.iter_mut().for_each(|v| *v /= size);
    }
    if columns.is_empty() || whole <= 0.0 || !whole.is_finite() || signal.len() <= 2 * columns.len() {
        return None;
    }
    let design = DMatrix::from_fn(signal.len(), columns.len(), |row, column| columns[column][row]);
    let target = DVector::from_column_slice(signal);
    let (gram, right) = (design.tr_mul(&design), design.tr_mul(&target));
    let solved = gram.svd(true, true).solve(&right, RANK).ok()?;
    let left = (&target - &design * solved).norm_squared();
    Some((1.0 - left / whole).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_is_explained_by_what_it_is_made_of() {
        let wave = |w: f64| (0..200).map(|k| (w * f64::from(k)).sin()).collect::<Vec<f64>>();
        let (a, b) = (wave(0.11), wave(0.27));
        let sum: Vec<f64> = a.iter().zip(&b).map(|(a, b)| 3.0 * a - 1e3 * b).collect();
        let all = explained(&[vec![a.clone(), b.clone(), a.clone()]], &sum).unwrap_or(0.0);
        assert!(all > 1.0 - 1e-9, "{all}");
        let part = explained(&[vec![a.clone()]], &b).unwrap_or(1.0);
        assert!(part < 0.1 && explained(&[vec![vec![0.0; 200]]], &b).is_none(), "{part}");
        assert!(explained(&[vec![a]], &[0.0; 200]).is_none());
    }
}
