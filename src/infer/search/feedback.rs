//! Inputs that move with the states, whether a controller or a pilot closes the loop, and what that hides.
//!
//! Where an input is nearly a function of what it moves, what an effect adds is hard to tell from what the fitted parameters add,
//! however long the record: an effect of which little is left beside them could be there, and nobody would see it.
//!
//! That an input moves with the states is no feedback yet: an open-loop input moves them. Feedback has a cause in the outputs. Of the
//! residual of each output its own past and the inputs are taken off; what is left is new (noise, a gust), and whatever the model
//! lacks of the inputs' effect is not in it. Only a loop brings it into the input later (Granger 1969; Ljung 1999, 13.4).

use crate::candidates::extended_model::states_and_outputs;
use crate::candidates::fitted_model::FittedModel;
use crate::candidates::runs::Runs;
use crate::diagnosis::{CorrelatedInput, EffectAt, Feedback};
use fdm_grammar::graph::Leaf;
use fdm_numeric::statistics::chi_squared_tail;
use fdm_system::record::Run;
use nalgebra::{Cholesky, DMatrix, DVector};

/// Samples that a loop may take, and of which past is taken off.
const LAGS: usize = 8;
/// The chance below which the new part of outputs is in an input, over all inputs.
const CHANCE: f64 = 1e-3;
/// Share of the diagonal that is added where columns are nearly dependent.
const RIDGE: f64 = 1e-10;

/// Part of an input's variance that its states explain, from which it is said to follow them.
const FOLLOWS: f64 = 0.7;
/// Singular values below this part of the largest are none.
const RANK: f64 = 1e-8;

/// What follows what on the training runs, with the effects that these hide; none where every input is its own.
pub(crate) fn feedback(current: &FittedModel, runs: Runs<'_>, hidden: Vec<EffectAt>) -> Option<Feedback> {
    let definition = current.model.definition();
    let (n, m) = (definition.states.len(), definition.inputs.len());
    let (states, _) = states_and_outputs(current, runs.all);
    let of = |k: usize| -> Option<CorrelatedInput> {
        let (mut rows, mut own) = (Vec::new(), Vec::new());
        for (run, states) in runs.train().iter().zip(&states) {
            let input: Vec<f64> = run.inputs.iter().skip(k).step_by(m).copied().collect();
            let columns: Vec<Vec<f64>> = (0..n).map(|s| states.iter().skip(s).step_by(n).copied().collect()).collect();
            rows.push(columns.iter().map(|column| about_mean(column)).collect::<Vec<_>>());
            own.extend(about_mean(&input));
        }
        let share = explained(&rows, &own)?;
        let input = definition.inputs[k].quantity.name.clone();
        let looped = || loop_chance(current, runs.train(), k).is_some_and(|p| p < CHANCE / m as f64);
        (share >= FOLLOWS).then(|| CorrelatedInput { input, explained: share, feedback: looped() })
    };
    let inputs: Vec<CorrelatedInput> = (0..m).filter_map(of).collect();
    (!inputs.is_empty()).then_some(Feedback { inputs, hidden })
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

/// The chance that noise alone relates an input as closely to what was new in the outputs before; none where too few samples tell.
fn loop_chance(current: &FittedModel, runs: &[Run], k: usize) -> Option<f64> {
    let definition = current.model.definition();
    let (q, m) = (definition.outputs.len(), definition.inputs.len());
    let residual = |r: usize| current.predictors[r].left_by(&runs[r], &current.response[r]);
    // a held input acts after the sample at which it is set, so that a loop may close within that sample
    let held = runs.iter().all(|run| run.held.get(k).copied().unwrap_or(false));
    let graph = &definition.graph;
    let direct = graph.depends(|leaf| leaf == Leaf::Input(k as u32));
    let at_once: Vec<bool> = definition.outputs.iter().map(|o| held && !direct[o.expr.index()]).collect();
    let signals: Vec<Signals> = (0..runs.len())
        .filter(|r| current.predictors[*r].frequencies().is_none())
        .map(|r| Signals { residual: residual(r), inputs: runs[r].inputs.clone(), outputs: q, kinds: m })
        .collect();
    related(&signals, k, &at_once)
}

/// Residuals (N by q) and inputs (N by m) of a run.
struct Signals {
    residual: Vec<f64>,
    inputs: Vec<f64>,
    outputs: usize,
    kinds: usize,
}

impl Signals {
    fn samples(&self) -> usize {
        self.residual.len() / self.outputs.max(1)
    }

    fn residual(&self, t: usize, o: usize) -> f64 {
        self.residual[t * self.outputs + o]
    }

    fn input(&self, t: usize, k: usize) -> f64 {
        self.inputs[t * self.kinds + k]
    }
}

/// See [`loop_chance`]; `at_once` says of which outputs the input may hold what is new at the same sample.
fn related(runs: &[Signals], k: usize, at_once: &[bool]) -> Option<f64> {
    let (q, m) = (at_once.len(), runs.first()?.kinds);
    // what is new in each output of each run; NaN where that is not known
    let mut new: Vec<Vec<f64>> = runs.iter().map(|run| vec![f64::NAN; run.samples() * q]).collect();
    for (o, at_once) in at_once.iter().enumerate() {
        let from = usize::from(*at_once);
        let row = |run: &Signals, t: usize| -> Vec<f64> {
            let past = (1..=LAGS).flat_map(|lag| (0..q).map(move |o| run.residual(t - lag, o)));
            let inputs = (0..m).flat_map(|j| {
                let first = if j == k { from } else { 0 };
                (first..=LAGS).map(move |lag| run.input(t - lag, j))
            });
            past.chain(inputs).chain([1.0]).collect()
        };
        let found = remainder(runs, row, |run, t| run.residual(t, o))?;
        for ((r, t), value) in found.places.into_iter().zip(found.left.iter()) {
            new[r][t * q + o] = *value;
        }
    }
    let own =
        |run: &Signals, t: usize| -> Vec<f64> { (1..=LAGS).map(|lag| run.input(t - lag, k)).chain([1.0]).collect() };
    let index = |run: &Signals| runs.iter().position(|r| std::ptr::eq(r, run)).unwrap_or(0);
    let all = |run: &Signals, t: usize| -> Vec<f64> {
        let new = &new[index(run)];
        let before = at_once.iter().enumerate().flat_map(|(o, at_once)| {
            let from = usize::from(!*at_once);
            (from..=LAGS).map(move |lag| new[(t - lag) * q + o])
        });
        own(run, t).into_iter().chain(before).collect()
    };
    // the same samples for both, those at which everything is known
    let known = |run: &Signals, t: usize| all(run, t).iter().all(|v| v.is_finite());
    let target = |run: &Signals, t: usize| if known(run, t) { run.input(t, k) } else { f64::NAN };
    let Remainder { places, left: without } = remainder(runs, own, target)?;
    let Remainder { left: with, .. } = remainder(runs, all, target)?;
    let added = at_once.iter().map(|at_once| LAGS + usize::from(*at_once)).sum::<usize>();
    let freedom = places.len().checked_sub(LAGS + 1 + added).filter(|f| *f > added)?;
    let (without, with) = (without.norm_squared(), with.norm_squared());
    // an input that its own past determines has nothing new
    (with > 0.0 && without > 0.0).then(|| chi_squared_tail(freedom as f64 * (without / with).ln(), added as f64))?
}

/// What is left of a signal, and where: run and sample.
struct Remainder {
    places: Vec<(usize, usize)>,
    left: DVector<f64>,
}

/// What least squares by rows of regressors leaves of a signal; none where too few samples are known.
fn remainder(
    runs: &[Signals],
    row: impl Fn(&Signals, usize) -> Vec<f64>,
    target: impl Fn(&Signals, usize) -> f64,
) -> Option<Remainder> {
    let (mut places, mut rows, mut values) = (Vec::new(), Vec::new(), Vec::new());
    for (r, run) in runs.iter().enumerate() {
        for t in 2 * LAGS..run.samples() {
            let (own, value) = (row(run, t), target(run, t));
            if value.is_finite() && own.iter().all(|v| v.is_finite()) {
                places.push((r, t));
                rows.push(own);
                values.push(value);
            }
        }
    }
    let width = rows.first()?.len();
    if rows.len() < 3 * width {
        return None;
    }
    let mut design = DMatrix::from_fn(rows.len(), width, |i, j| rows[i][j]);
    for mut column in design.column_iter_mut() {
        let size = column.norm();
        if size > 0.0 {
            column /= size;
        }
    }
    let mut gram = design.tr_mul(&design);
    (0..width).for_each(|j| gram[(j, j)] += RIDGE);
    let target = DVector::from_vec(values);
    let solved = Cholesky::new(gram)?.solve(&design.tr_mul(&target));
    let left = target - design * solved;
    Some(Remainder { places, left })
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

    /// A first-order vehicle with noise in its output: the input a random multistep, or that of a controller that reads the output.
    fn record(seed: u64, looped: bool) -> Signals {
        use fdm_numeric::random::Stream;
        let mut normal = Stream::seeded(seed);
        let (mut x, mut command) = (0.0, 0.0);
        let (mut residual, mut inputs) = (Vec::new(), Vec::new());
        for t in 0..600 {
            if t % 13 == 0 {
                command = normal.normal_of_pair();
            }
            let noise = 0.05 * normal.normal_of_pair();
            let u = if looped { 0.3 * command - 0.8 * (x + noise) } else { command };
            inputs.push(u);
            // a model that lacks a fifth of the gain
            residual.push(0.2 * x + noise);
            x += 0.1 * (u - x);
        }
        Signals { residual, inputs, outputs: 1, kinds: 1 }
    }

    #[test]
    fn only_a_loop_brings_noise_into_an_input() {
        let p = |seed: u64, looped: bool| related(&[record(seed, looped)], 0, &[true]).unwrap_or(1.0);
        let open: Vec<f64> = (0..40).map(|seed| p(seed, false)).collect();
        assert!(open.iter().filter(|p| **p < 0.05).count() < 8 && open.iter().all(|p| *p > 1e-3), "{open:?}");
        assert!((0..10).all(|seed| p(seed, true) < 1e-6));
    }
}
