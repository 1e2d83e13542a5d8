//! Recursive least squares with forgetting: every step of a record corrects the parameters of all its equations, and the whole
//! history is kept (Ren and Feng 2010).
//!
//! An equation `x' = known + sum parameter*column` is discretised by its integral over the step from a sample to the next,
//! `(x(k+1) - x(k))/dt = mean of both ends`, so that it stays linear in its parameters, whatever of them are shared or equal.

use super::equations::{Equations, Left};
use super::error::{Refusal, RegressionError};
use super::fit::completed;
use super::options::RegressionOptions;
use super::preprocessing::Preprocessing;
use super::regression::{Block, Group, Unknown};
use super::regressors::{Places, Rows, Signals};
use fdm_grammar::op::ExprId;
use fdm_system::Model;
use fdm_system::record::Run;
use serde::{Deserialize, Serialize};

/// What can be chosen about the recursion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecursiveOptions {
    /// Weight of a step relative to the one behind it, above 0, at most 1 (no forgetting).
    pub forgetting: f64,
    /// What is done to the records before.
    pub preprocessing: Preprocessing,
}

impl Default for RecursiveOptions {
    fn default() -> Self {
        Self { forgetting: 0.99, preprocessing: Preprocessing::default() }
    }
}

impl RecursiveOptions {
    /// Whether there can be a recursion of this model.
    pub(super) fn check(&self, model: &Model) -> Result<(), RegressionError> {
        if model.definition().has_events() {
            return Err(RegressionError::Events);
        }
        let allowed = self.forgetting > 0.0 && self.forgetting <= 1.0;
        if allowed { Ok(()) } else { Err(RegressionError::Forgetting(self.forgetting)) }
    }
}

/// A parameter of a recursion.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize)]
pub struct RecursiveParameter {
    /// Name.
    pub name: String,
    /// The run whose value it is, for parameters that every run has.
    pub run: Option<String>,
    /// Unit, when one was declared.
    pub unit: Option<String>,
}

/// Where the recursion stood behind a step.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Iterate {
    /// Index of the run.
    pub run: usize,
    /// Time of the sample at the end of the step.
    pub time: f64,
    /// Values, in the order of [`RecursiveEstimates::parameters`].
    pub values: Vec<f64>,
    /// Standard errors, as far as the residuals of the steps are white.
    pub errors: Vec<f64>,
    /// Root mean square of all steps' errors with these values, each equation relative to its rate (equation 23 of the paper).
    pub one_step: f64,
}

/// The history of all parameters along the records.
#[derive(Debug, Clone, PartialEq)]
pub struct RecursiveEstimates {
    /// What is estimated.
    pub parameters: Vec<RecursiveParameter>,
    /// For each of them its index among the model's parameters, and that of its run.
    pub places: Vec<(usize, Option<usize>)>,
    /// One for each step, in the order of the runs and their samples.
    pub iterates: Vec<Iterate>,
    /// Values by least squares of all steps, without forgetting.
    pub batch: Vec<f64>,
    /// The records as they were regressed.
    pub runs: Vec<Run>,
    /// Equations that are no regressions.
    pub refused: Vec<Refusal>,
    /// Free parameters that the recursion does not give; they keep their values.
    pub kept: Vec<String>,
}

/// Standard deviation of the start values, relative to the size that explains a rate by one column: large, so that they are soon
/// forgotten, and small enough that what the record never moves stays where it was.
const OPEN: f64 = 1e3;

/// Follows the parameters of every equation that is linear in them and whose state is measured, from the model's values on.
///
/// # Errors
/// [`RegressionError`]: no equation is a regression, or the records do not serve.
pub fn recursive(
    model: &Model,
    runs: &[Run],
    options: &RecursiveOptions,
) -> Result<RecursiveEstimates, RegressionError> {
    options.check(model)?;
    if runs.is_empty() {
        return Err(RegressionError::NoRuns);
    }
    let definition = model.definition();
    let mut equations = Equations::of_rates(definition);
    if equations.equations.is_empty() {
        return Err(RegressionError::NoEquation(equations.refused));
    }
    let runs: Result<Vec<Run>, _> = runs.iter().map(|run| options.preprocessing.of(run)).collect();
    let runs = completed(definition, &runs?)?;
    let (stretches, mut filters) = sized(definition, &equations, &runs)?;
    let parameters: Vec<Unknown> = filters.iter().flat_map(|f| f.unknowns.iter().copied()).collect();
    let given = |k: usize| parameters.iter().any(|u| u.param as usize == k);
    let free = definition.params.iter().enumerate().filter(|(k, p)| !p.fixed && !given(*k));
    let kept = free.map(|(_, p)| p.quantity.name.clone()).collect();
    let batch = filters.iter().flat_map(|f| f.batch.iter().copied()).collect();
    let iterates = followed(&mut filters, &stretches, &runs, options.forgetting);
    let named = |u: &Unknown| {
        let quantity = &definition.params[u.param as usize].quantity;
        let unit = quantity.unit.as_ref().map(ToString::to_string);
        RecursiveParameter { name: quantity.name.clone(), run: u.run.map(|r| runs[r].name.clone()), unit }
    };
    Ok(RecursiveEstimates {
        places: parameters.iter().map(|u| (u.param as usize, u.run)).collect(),
        parameters: parameters.iter().map(named).collect(),
        iterates,
        batch,
        refused: std::mem::take(&mut equations.refused),
        kept,
        runs,
    })
}

/// The steps of completed runs, and a recursion for each group of equations, weighed and scaled by these steps.
pub(super) fn sized(
    definition: &fdm_grammar::Model,
    equations: &Equations,
    runs: &[Run],
) -> Result<(Vec<Block>, Vec<Filter>), RegressionError> {
    let mut stretches = Vec::new();
    for (k, run) in runs.iter().enumerate() {
        stretches.extend(steps_of(definition, equations, run, k)?);
    }
    let mut filters = Vec::new();
    for members in super::fit::groups(equations) {
        let own: Vec<&Block> = stretches.iter().filter(|s| members.contains(&s.equation)).collect();
        filters.extend(Filter::new(definition, equations, &own, runs)?);
    }
    Ok((stretches, filters))
}

/// The steps of a run as rows of all equations.
pub(super) fn steps_of(
    definition: &fdm_grammar::Model,
    equations: &Equations,
    run: &Run,
    number: usize,
) -> Result<Vec<Block>, RegressionError> {
    let signals = Signals::new(definition, &equations.graph, &equations.readings, run, &at_frequencies())?;
    let mut stretches = Vec::new();
    for (k, equation) in equations.equations.iter().enumerate() {
        let columns = equation.columns.iter().map(|(_, column)| *column);
        let roots: Vec<ExprId> = std::iter::once(equation.known).chain(columns).collect();
        let Left::Rate(state) = equation.left else { continue };
        let Some(state) = &signals.states[state] else { continue };
        let begin = signals.evaluate_at(definition, &equations.graph, &roots, false);
        let end = signals.evaluate_at(definition, &equations.graph, &roots, true);
        let mean = |series: usize, sample: usize| 0.5 * (begin[series][sample - 1] + end[series][sample]);
        let slope = |sample: usize| (state[sample] - state[sample - 1]) / (run.time[sample] - run.time[sample - 1]);
        let whole = |sample: &usize| {
            slope(*sample).is_finite() && (0..roots.len()).all(|series| mean(series, *sample).is_finite())
        };
        let samples: Vec<usize> = (1..run.len()).filter(whole).collect();
        let own = |param: u32| definition.params[param as usize].per_run.then_some(number);
        let unknowns = equation.columns.iter().map(|(param, _)| Unknown { param: *param, run: own(*param) }).collect();
        let rows = Rows {
            left: samples.iter().map(|s| slope(*s) - mean(0, *s)).collect(),
            measured: samples.iter().map(|s| slope(*s)).collect(),
            columns: (1..roots.len()).map(|c| samples.iter().map(|s| mean(c, *s)).collect()).collect(),
            places: Places::Samples(samples),
            independent: 1.0,
        };
        stretches.push(Block { equation: k, run: number, rows, unknowns });
    }
    Ok(stretches)
}

/// Signals without rates: the steps themselves are the differences.
fn at_frequencies() -> RegressionOptions {
    use fdm_system::spectrum::Frequencies;
    let domain = super::options::Domain::Frequency(Frequencies::Grid { lowest: None, highest: None });
    RegressionOptions { domain, ..RegressionOptions::default() }
}

/// The recursion of equations that share parameters.
pub(super) struct Filter {
    pub(super) unknowns: Vec<Unknown>,
    /// One over the residual of each equation, by its number.
    pub(super) weights: Vec<(usize, f64)>,
    /// Root mean square of each weighted column: values are multiplied by it.
    pub(super) scale: Vec<f64>,
    /// Scaled values.
    values: Vec<f64>,
    /// A square root L of their covariance L L' where residuals are 1: start and end of it are far apart (Potter 1963).
    root: Vec<f64>,
    /// Standard deviation of scaled values at the beginning.
    pub(super) open: f64,
    along: Vec<f64>,
    gain: Vec<f64>,
    row: Vec<f64>,
    /// Sum of squared innovations with forgetting, over their factors, and their number.
    squares: f64,
    count: f64,
    batch: Vec<f64>,
    /// Sums over all rows, relative to the rates: left squared, left times columns, columns times columns, scaled.
    moments: (f64, Vec<f64>, Vec<f64>),
    rows: f64,
}

impl Filter {
    /// None when the records move no column of these equations.
    fn new(
        definition: &fdm_grammar::Model,
        equations: &Equations,
        own: &[&Block],
        runs: &[Run],
    ) -> Result<Option<Self>, RegressionError> {
        let blocks: Vec<&Block> = own.iter().copied().filter(|b| !b.rows.left.is_empty()).collect();
        let mut names: Vec<String> = blocks.iter().map(|b| equations.name(definition, b.equation)).collect();
        names.dedup();
        let group = Group::new(blocks, names.join(", "));
        if group.unknowns.is_empty() {
            return Ok(None);
        }
        let called = |u: &Unknown| {
            let name = &definition.params[u.param as usize].quantity.name;
            u.run.map_or_else(|| name.clone(), |r| format!("{name} ({})", runs[r].name))
        };
        let names: Vec<String> = group.unknowns.iter().map(called).collect();
        let solved = group.solve(&names, &RegressionOptions::default())?;
        let p = group.unknowns.len();
        let sizes = |of: &dyn Fn(usize) -> f64| -> Vec<(usize, f64)> {
            let mut found: Vec<(usize, f64, usize)> = Vec::new();
            for (k, block) in group.blocks.iter().enumerate() {
                let (sum, count) = (of(k), block.rows.left.len());
                match found.iter_mut().find(|f| f.0 == block.equation) {
                    Some(f) => (f.1, f.2) = (f.1 + sum, f.2 + count),
                    None => found.push((block.equation, sum, count)),
                }
            }
            found.into_iter().map(|(e, sum, count)| (e, (sum / count as f64).sqrt())).collect()
        };
        let square = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>();
        let rates = sizes(&|k| square(&group.blocks[k].rows.measured));
        let left = sizes(&|k| square(&solved.residuals[k]));
        let over = |(residual, rate): (&(usize, f64), &(usize, f64))| {
            (residual.0, 1.0 / residual.1.max(1e-9 * rate.1).max(f64::MIN_POSITIVE))
        };
        let weights: Vec<(usize, f64)> = left.iter().zip(&rates).map(over).collect();
        let batch = solved.components[solved.chosen - 1].values.clone();
        let mut filter = Self { batch, ..Self::of(group.unknowns.clone(), weights, vec![0.0; p]) };
        filter.prepare(definition, &group, &rates);
        Ok(Some(filter))
    }

    /// Nothing known yet.
    pub(super) fn of(unknowns: Vec<Unknown>, weights: Vec<(usize, f64)>, scale: Vec<f64>) -> Self {
        let p = unknowns.len();
        Self {
            values: vec![0.0; p],
            root: vec![0.0; p * p],
            open: 0.0,
            along: vec![0.0; p],
            gain: vec![0.0; p],
            row: vec![0.0; p],
            squares: 0.0,
            count: 0.0,
            batch: Vec::new(),
            moments: (0.0, vec![0.0; p], vec![0.0; p * p]),
            rows: 0.0,
            scale,
            weights,
            unknowns,
        }
    }

    /// At the model's values, each known as little as this standard deviation says.
    pub(super) fn begin(&mut self, definition: &fdm_grammar::Model, open: f64) {
        let p = self.unknowns.len();
        self.open = open;
        for (j, unknown) in self.unknowns.iter().enumerate() {
            self.values[j] = definition.params[unknown.param as usize].value * self.scale[j];
            self.root[j * p + j] = open;
        }
    }

    fn weight(&self, equation: usize) -> f64 {
        self.weights.iter().find(|(e, _)| *e == equation).map_or(0.0, |(_, w)| *w)
    }

    /// Scales, start values, and the sums by which iterates are judged.
    fn prepare(&mut self, definition: &fdm_grammar::Model, group: &Group<'_>, rates: &[(usize, f64)]) {
        let p = self.unknowns.len();
        let mut counts = vec![0usize; p];
        for block in &group.blocks {
            let weight = self.weight(block.equation);
            for (unknown, column) in block.unknowns.iter().zip(&block.rows.columns) {
                let Ok(j) = self.unknowns.binary_search(unknown) else { continue };
                self.scale[j] += column.iter().map(|v| (v * weight).powi(2)).sum::<f64>();
                counts[j] += column.len();
            }
        }
        for (scale, count) in self.scale.iter_mut().zip(counts) {
            *scale = (*scale / count.max(1) as f64).sqrt().max(f64::MIN_POSITIVE);
        }
        // a rate in units of its residual
        let size = |b: &&Block| rates.iter().find(|(e, _)| *e == b.equation).map_or(0.0, |r| r.1 * self.weight(r.0));
        let size = group.blocks.iter().map(size).fold(1.0, f64::max);
        self.begin(definition, OPEN * size);
        for block in &group.blocks {
            let rate = rates.iter().find(|(e, _)| *e == block.equation).map_or(1.0, |r| r.1);
            let relative = 1.0 / rate.max(f64::MIN_POSITIVE);
            for i in 0..block.rows.left.len() {
                let left = relative * block.rows.left[i];
                self.fill(block, i, relative);
                let (square, by, both) = &mut self.moments;
                *square += left * left;
                for a in 0..p {
                    by[a] += left * self.row[a];
                    (0..p).for_each(|b| both[a * p + b] += self.row[a] * self.row[b]);
                }
                self.rows += 1.0;
            }
        }
    }

    /// A row of scaled columns, times a weight.
    fn fill(&mut self, block: &Block, i: usize, weight: f64) {
        self.row.fill(0.0);
        for (unknown, column) in block.unknowns.iter().zip(&block.rows.columns) {
            if let Ok(j) = self.unknowns.binary_search(unknown) {
                self.row[j] = weight * column[i] / self.scale[j];
            }
        }
    }

    /// Variance of a scaled value where residuals are 1.
    fn variance(&self, j: usize) -> f64 {
        let p = self.values.len();
        self.root[j * p..(j + 1) * p].iter().map(|v| v * v).sum()
    }

    /// Forgets a part of what was known, but never more than was unknown at the beginning.
    fn forget(&mut self, factor: f64) {
        (self.squares, self.count) = (factor * self.squares, factor * self.count);
        if (0..self.values.len()).all(|j| self.variance(j) < self.open.powi(2)) {
            let wider = factor.sqrt().recip();
            self.root.iter_mut().for_each(|v| *v *= wider);
        }
    }

    /// Takes one row: the gain of equation 19, the update of 21, the covariance of 22 by its square root.
    fn take(&mut self, block: &Block, i: usize) {
        let (p, weight) = (self.values.len(), self.weight(block.equation));
        self.fill(block, i, weight);
        for b in 0..p {
            self.along[b] = (0..p).map(|a| self.root[a * p + b] * self.row[a]).sum();
        }
        let size = 1.0 + self.along.iter().map(|f| f * f).sum::<f64>();
        let expected: f64 = self.row.iter().zip(&self.values).map(|(x, v)| x * v).sum();
        let innovation = weight * block.rows.left[i] - expected;
        self.squares += innovation * innovation / size;
        self.count += 1.0;
        let shrink = 1.0 / (size + size.sqrt());
        for a in 0..p {
            let row = &mut self.root[a * p..(a + 1) * p];
            self.gain[a] = row.iter().zip(&self.along).map(|(l, f)| l * f).sum();
            row.iter_mut().zip(&self.along).for_each(|(l, f)| *l -= shrink * self.gain[a] * f);
            self.values[a] += self.gain[a] * innovation / size;
        }
    }

    /// Sum of the squared errors of all steps with the present values, relative to the rates.
    fn one_step(&self) -> f64 {
        let (square, by, both) = &self.moments;
        let p = self.values.len();
        let inner = |a: usize| self.values[a] * (0..p).map(|b| both[a * p + b] * self.values[b]).sum::<f64>();
        let cross: f64 = by.iter().zip(&self.values).map(|(b, v)| b * v).sum();
        (square - 2.0 * cross + (0..p).map(inner).sum::<f64>()).max(0.0)
    }
}

/// All steps of all runs, one after the other.
pub(super) fn followed(filters: &mut [Filter], stretches: &[Block], runs: &[Run], forgetting: f64) -> Vec<Iterate> {
    let mut next = vec![0usize; stretches.len()];
    let rows: f64 = filters.iter().map(|f| f.rows).sum();
    let mut iterates = Vec::new();
    for (r, run) in runs.iter().enumerate() {
        for sample in 1..run.len() {
            let mut moved = false;
            for filter in filters.iter_mut() {
                let mut forgotten = false;
                for (stretch, next) in stretches.iter().zip(&mut next).filter(|(s, _)| s.run == r) {
                    let mine = stretch.unknowns.iter().any(|u| filter.unknowns.contains(u));
                    if !mine || stretch.rows.places.sample(*next) != Some(sample) {
                        continue;
                    }
                    if !std::mem::replace(&mut forgotten, true) {
                        filter.forget(forgetting);
                    }
                    filter.take(stretch, *next);
                    *next += 1;
                    moved = true;
                }
            }
            if moved {
                iterates.push(iterate(filters, (r, run.time[sample]), rows));
            }
        }
    }
    iterates
}

fn iterate(filters: &[Filter], (run, time): (usize, f64), rows: f64) -> Iterate {
    let (mut values, mut errors) = (Vec::new(), Vec::new());
    for f in filters {
        let p = f.values.len();
        let variance = f.squares / (f.count - p as f64).max(1.0);
        values.extend(f.values.iter().zip(&f.scale).map(|(v, s)| v / s));
        errors.extend((0..p).map(|j| (variance * f.variance(j)).sqrt() / f.scale[j]));
    }
    let one_step = (filters.iter().map(Filter::one_step).sum::<f64>() / rows.max(1.0)).sqrt();
    Iterate { run, time, values, errors, one_step }
}
