//! Structure determination (Klein and Morelli 2006): which candidates explain the rate of a state or an output, stepwise by partial F, or by
//! orthogonal functions up to the least predicted squared error.

use super::equations::{Equations, Left};
use super::error::RegressionError;
use super::fit::completed;
use super::options::{Domain, RegressionOptions};
use super::regressors::{Series, Signals, rows};
use fdm_system::Model;
use fdm_system::record::Run;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// How a structure is searched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Search {
    /// Candidates are signals, their squares, products and `x*abs(x)`; they come and go by partial F.
    Stepwise(Limits),
    /// Candidates are all products of signals up to this order. Each is made orthogonal to those before it; the one that explains most comes
    /// next, until the predicted squared error rises (Morelli 1995; Chen, Billings and Luo 1989).
    Orthogonal {
        /// Factors of a product.
        order: usize,
    },
}

/// When a candidate comes in and when it goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Least partial F of a candidate that comes in.
    pub enter: f64,
    /// A candidate in the model with a smaller partial F goes.
    pub remove: f64,
    /// Least gain in R^2 of a candidate that comes in.
    pub gain: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { enter: 20.0, remove: 10.0, gain: 0.005 }
    }
}

/// The model after a candidate came or went.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Step {
    /// The candidate.
    pub candidate: String,
    /// Whether it came in; otherwise it went.
    pub entered: bool,
    /// Its partial F when it came or went.
    pub partial_f: f64,
    /// Part of the sum of squares that is explained now.
    pub r_squared: f64,
    /// Predicted squared error, mean square residual plus `p/N` times the variance of the rate (Barron 1984; its bound).
    pub pse: f64,
    /// Sum of squares of every row's residual when that row is left out.
    pub press: f64,
}

/// A structure found stepwise.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Stepwise {
    /// What happened.
    pub steps: Vec<Step>,
    /// Candidates of the model in the order of their names' list, with value, standard error and partial F.
    pub terms: Vec<SelectedTerm>,
    /// Value of the constant, where there is one.
    pub constant: Option<f64>,
    /// Part of the sum of squares that is explained.
    pub r_squared: f64,
    /// Candidates that stayed outside, with their partial F if they came in now.
    pub outside: Vec<(String, f64)>,
}

/// A candidate in the model.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct SelectedTerm {
    /// The candidate.
    pub candidate: String,
    /// Its parameter.
    pub value: f64,
    /// Standard error, for white residuals.
    pub standard_error: f64,
    /// `(value/standard error)^2`.
    pub partial_f: f64,
}

/// Searches the candidates for those that explain `left`; `constant` adds a bias that always stays. Candidates that vanish, or that
/// those in the model already span, never come in.
///
/// # Panics
/// When a candidate has another length than the left side.
pub fn stepwise(left: &[f64], candidates: &[(String, Vec<f64>)], constant: bool, limits: &Limits) -> Stepwise {
    assert!(candidates.iter().all(|(_, c)| c.len() == left.len()), "candidates of another length");
    let search = Candidates::new(left, candidates, constant);
    let (mut chosen, mut steps): (Vec<usize>, Vec<Step>) = (Vec::new(), Vec::new());
    // a candidate that goes could come again for ever
    let most = 4 * candidates.len();
    while steps.len() < most {
        let before = search.fit(&chosen);
        // what explains most of the rest has the largest partial F
        let Some((k, fit)) = search.next(&chosen) else { break };
        if !(fit.last_f() >= limits.enter && fit.r_squared - before.map_or(0.0, |b| b.r_squared) >= limits.gain) {
            break;
        }
        chosen.push(k);
        steps.push(search.step(k, true, fit.last_f(), &fit));
        search.eliminate(&mut chosen, &mut steps, limits);
    }
    search.result(chosen, steps)
}

/// Takes the candidates in the order in which their parts that are orthogonal to those before explain most, as long as the predicted
/// squared error falls; `constant` as in [`stepwise`].
///
/// # Panics
/// When a candidate has another length than the left side.
pub fn orthogonal(left: &[f64], candidates: &[(String, Vec<f64>)], constant: bool) -> Stepwise {
    assert!(candidates.iter().all(|(_, c)| c.len() == left.len()), "candidates of another length");
    let search = Candidates::new(left, candidates, constant);
    let (mut chosen, mut steps): (Vec<usize>, Vec<Step>) = (Vec::new(), Vec::new());
    let mut least = search.pse(search.left.norm_squared(), 0);
    while let Some((k, fit)) = search.next(&chosen) {
        let step = search.step(k, true, fit.last_f(), &fit);
        if step.pse >= least {
            break;
        }
        least = step.pse;
        chosen.push(k);
        steps.push(step);
    }
    search.result(chosen, steps)
}

struct Candidates<'a> {
    candidates: &'a [(String, Vec<f64>)],
    /// Columns without their mean where there is a constant.
    columns: Vec<DVector<f64>>,
    left: DVector<f64>,
    means: Vec<f64>,
    mean: f64,
    constant: bool,
}

/// A regression on some candidates.
struct Fit {
    values: Vec<f64>,
    errors: Vec<f64>,
    partial_f: Vec<f64>,
    r_squared: f64,
    residual: DVector<f64>,
    /// Diagonal of the projection on the columns.
    leverage: Vec<f64>,
}

impl Fit {
    fn last_f(&self) -> f64 {
        self.partial_f.last().copied().unwrap_or(0.0)
    }
}

/// A column nearer than this to those in the model is spanned by them.
const SPANNED: f64 = 1e-9;

impl<'a> Candidates<'a> {
    fn new(left: &[f64], candidates: &'a [(String, Vec<f64>)], constant: bool) -> Self {
        let mean = |v: &[f64]| if constant { v.iter().sum::<f64>() / v.len().max(1) as f64 } else { 0.0 };
        let means: Vec<f64> = candidates.iter().map(|(_, c)| mean(c)).collect();
        let about = |v: &[f64], m: f64| DVector::from_iterator(v.len(), v.iter().map(|v| v - m));
        let columns = candidates.iter().zip(&means).map(|((_, c), m)| about(c, *m)).collect();
        Self { candidates, columns, left: about(left, mean(left)), means, mean: mean(left), constant }
    }

    /// The candidate whose part that is orthogonal to the chosen ones explains most of what they leave, and the regression with it.
    fn next(&self, chosen: &[usize]) -> Option<(usize, Fit)> {
        let basis = (!chosen.is_empty())
            .then(|| DMatrix::from_fn(self.left.len(), chosen.len(), |i, j| self.columns[chosen[j]][i]).qr().q());
        let explained = |k: usize| {
            let column = &self.columns[k];
            let size = column.norm();
            let mut own = column.clone();
            // once more for what rounding left
            for basis in basis.iter().flat_map(|q| [q, q]) {
                own -= basis * basis.tr_mul(&own);
            }
            let part = own.norm();
            (size.is_finite() && part > SPANNED * size).then(|| (own.dot(&self.left) / part).powi(2))
        };
        let outside = (0..self.columns.len()).filter(|k| !chosen.contains(k));
        let mut found: Vec<(usize, f64)> = outside.filter_map(|k| Some((k, explained(k)?))).collect();
        found.sort_by(|a, b| b.1.total_cmp(&a.1));
        found.into_iter().find_map(|(k, _)| Some((k, self.with(chosen, k)?)))
    }

    fn with(&self, chosen: &[usize], k: usize) -> Option<Fit> {
        let all: Vec<usize> = chosen.iter().copied().chain([k]).collect();
        self.fit(&all)
    }

    /// `None` for no columns, columns that span each other, or fewer rows than columns.
    fn fit(&self, chosen: &[usize]) -> Option<Fit> {
        let (n, p) = (self.left.len(), chosen.len());
        let taken = p + usize::from(self.constant);
        if p == 0 || n <= taken {
            return None;
        }
        let scale: Vec<f64> = chosen.iter().map(|k| self.columns[*k].norm()).collect();
        let rounding = |k: &usize| 1e-12 * self.means[*k].abs() * (n as f64).sqrt();
        if chosen.iter().zip(&scale).any(|(k, s)| !s.is_finite() || *s <= rounding(k).max(f64::MIN_POSITIVE)) {
            return None;
        }
        let matrix = DMatrix::from_fn(n, p, |i, j| self.columns[chosen[j]][i] / scale[j]);
        let qr = matrix.clone().qr();
        let (q, r) = (qr.q(), qr.r());
        if (0..p).any(|j| r[(j, j)].abs() < SPANNED) {
            return None;
        }
        let inverse = r.clone().try_inverse()?;
        let solution = &inverse * q.tr_mul(&self.left);
        let residual = &self.left - matrix * &solution;
        let variance = residual.norm_squared() / (n - taken) as f64;
        let values: Vec<f64> = solution.iter().zip(&scale).map(|(v, s)| v / s).collect();
        let errors: Vec<f64> = (0..p).map(|j| inverse.row(j).norm() * variance.sqrt() / scale[j]).collect();
        let partial_f = values.iter().zip(&errors).map(|(v, e)| (v / e).powi(2)).collect();
        let leverage = (0..n).map(|i| q.row(i).norm_squared()).collect();
        let r_squared = 1.0 - residual.norm_squared() / self.left.norm_squared();
        Some(Fit { values, errors, partial_f, r_squared, residual, leverage })
    }

    fn step(&self, k: usize, entered: bool, partial_f: f64, fit: &Fit) -> Step {
        let n = self.left.len() as f64;
        let own = if self.constant { 1.0 / n } else { 0.0 };
        let left_out = |(v, h): (&f64, &f64)| (v / (1.0 - h - own).max(f64::EPSILON)).powi(2);
        Step {
            candidate: self.candidates[k].0.clone(),
            entered,
            partial_f,
            r_squared: fit.r_squared,
            pse: self.pse(fit.residual.norm_squared(), fit.values.len()),
            press: fit.residual.iter().zip(&fit.leverage).map(left_out).sum(),
        }
    }

    /// Predicted squared error of a regression on so many candidates that leaves a sum of squares.
    fn pse(&self, rest: f64, candidates: usize) -> f64 {
        let n = self.left.len().max(1) as f64;
        let p = (candidates + usize::from(self.constant)) as f64;
        rest / n + self.left.norm_squared() / n * p / n
    }

    fn eliminate(&self, chosen: &mut Vec<usize>, steps: &mut Vec<Step>, limits: &Limits) {
        while chosen.len() > 1 {
            let Some(fit) = self.fit(chosen) else { return };
            let least = fit.partial_f.iter().enumerate().min_by(|(_, a), (_, b)| a.total_cmp(b));
            let Some((place, f)) = least.filter(|(_, f)| **f < limits.remove) else { return };
            let (k, f) = (chosen.remove(place), *f);
            if let Some(fit) = self.fit(chosen) {
                steps.push(self.step(k, false, f, &fit));
            }
        }
    }

    fn result(&self, mut chosen: Vec<usize>, steps: Vec<Step>) -> Stepwise {
        chosen.sort_unstable();
        let fit = self.fit(&chosen);
        let name = |k: usize| self.candidates[k].0.clone();
        let term = |(j, fit): (usize, &Fit)| SelectedTerm {
            candidate: name(chosen[j]),
            value: fit.values[j],
            standard_error: fit.errors[j],
            partial_f: fit.partial_f[j],
        };
        let terms = fit.iter().flat_map(|fit| (0..chosen.len()).map(move |j| (j, fit))).map(term).collect();
        let explained: f64 =
            fit.iter().flat_map(|f| f.values.iter().zip(&chosen)).map(|(v, k)| v * self.means[*k]).sum();
        let outside = (0..self.candidates.len()).filter(|k| !chosen.contains(k));
        let outside = outside.map(|k| (name(k), self.with(&chosen, k).map_or(0.0, |f| f.last_f()))).collect();
        let r_squared = fit.as_ref().map_or(0.0, |f| f.r_squared);
        Stepwise { steps, terms, constant: self.constant.then_some(self.mean - explained), r_squared, outside }
    }
}

/// What explains the rate of one state, or one output.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Structure {
    /// `der(x)`, or the output.
    pub equation: String,
    /// The search.
    pub found: Stepwise,
}

/// What is explained and its candidates, the rows of all runs behind each other.
#[derive(Debug, Clone, Default)]
struct Table {
    left: Vec<f64>,
    columns: Vec<(String, Vec<f64>)>,
}

/// More signals than this make so many products that chance finds a structure; then they stand alone.
const MOST_SIGNALS: usize = 12;

/// Searches the structure of the rate of every measured state, and of every output that shows no state, among measured states and declared
/// inputs and what the search makes of them.
///
/// # Errors
/// [`RegressionError`], as [`regress`](super::regress); equations are not looked at.
pub fn structure(
    model: &Model,
    runs: &[Run],
    options: &RegressionOptions,
    search: &Search,
) -> Result<Vec<Structure>, RegressionError> {
    if runs.is_empty() {
        return Err(RegressionError::NoRuns);
    }
    let definition = model.definition();
    let equations = Equations::new(definition);
    let measured: Vec<usize> = (0..definition.states.len()).filter(|k| equations.readings[*k].is_some()).collect();
    let shows = |o: &usize| equations.readings.iter().flatten().any(|r| r.output == *o);
    let outputs = (0..definition.outputs.len()).filter(|o| !shows(o));
    let lefts: Vec<Left> = measured.iter().map(|k| Left::Rate(*k)).chain(outputs.map(Left::Output)).collect();
    if measured.is_empty() {
        return Err(RegressionError::NothingMeasured);
    }
    let runs = completed(definition, runs)?;
    let mut tables: Vec<Table> = vec![Table::default(); lefts.len()];
    for run in &runs {
        let signals = Signals::new(definition, &equations.graph, &equations.readings, run, options)?;
        let candidates = candidates(definition, &signals, &measured, search);
        let (names, series): (Vec<String>, Vec<Vec<f64>>) = candidates.into_iter().unzip();
        for (explained, Table { left, columns }) in lefts.iter().zip(&mut tables) {
            let none = vec![f64::NAN; run.len()];
            let Some(explained) = signals.explained(*explained, &none) else { continue };
            let known = vec![0.0; run.len()];
            let made = rows(run, &Series { explained, known: &known, columns: &series }, options)?;
            left.extend(made.left);
            if columns.is_empty() {
                *columns = names.iter().map(|n| (n.clone(), Vec::new())).collect();
            }
            columns.iter_mut().zip(made.columns).for_each(|((_, all), own)| all.extend(own));
        }
    }
    let constant = options.domain == Domain::Time;
    let one = |(explained, Table { left, columns }): (&Left, Table)| Structure {
        equation: explained.name(definition),
        found: match search {
            Search::Stepwise(limits) => stepwise(&left, &columns, constant, limits),
            Search::Orthogonal { .. } => orthogonal(&left, &columns, constant),
        },
    };
    Ok(lefts.iter().zip(tables).filter(|(_, table)| !table.left.is_empty()).map(one).collect())
}

fn candidates(
    definition: &fdm_grammar::Model,
    signals: &Signals<'_>,
    measured: &[usize],
    search: &Search,
) -> Vec<(String, Vec<f64>)> {
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
    if let Search::Orthogonal { order } = search {
        return products(&all, *order);
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

/// All products of at most so many signals, a signal as often as it comes.
pub(super) fn products(signals: &[(String, Vec<f64>)], order: usize) -> Vec<(String, Vec<f64>)> {
    // places of the factors, rising, with their product
    let mut last: Vec<(Vec<usize>, Vec<f64>)> =
        signals.iter().enumerate().map(|(k, s)| (vec![k], s.1.clone())).collect();
    let mut all = last.clone();
    for _ in 1..order {
        let longer = last.iter().flat_map(|(factors, product)| {
            let from = factors.last().copied().unwrap_or(0);
            (from..signals.len()).map(move |k| {
                let values = product.iter().zip(&signals[k].1).map(|(a, b)| a * b).collect();
                (factors.iter().copied().chain([k]).collect::<Vec<_>>(), values)
            })
        });
        last = longer.collect();
        all.extend(last.iter().cloned());
    }
    let named = |factors: &[usize]| {
        let mut powers: BTreeMap<usize, usize> = BTreeMap::new();
        factors.iter().for_each(|k| *powers.entry(*k).or_default() += 1);
        let factor = |(k, n): (&usize, &usize)| match n {
            1 => signals[*k].0.clone(),
            n => format!("{}^{n}", signals[*k].0),
        };
        powers.iter().map(factor).collect::<Vec<_>>().join("*")
    };
    all.into_iter().map(|(factors, values)| (named(&factors), values)).collect()
}
