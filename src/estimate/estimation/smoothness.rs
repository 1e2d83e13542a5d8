//! Smooth tables (`smooth CL by order 2;`): differences of neighbouring nodes as a Gaussian prior of unknown scale.
//!
//! A row is the m-th derivative of a table along one argument, which is measured in ranges of its axis, times the root of the length
//! that it stands for: the sum of squares is the integral of the squared derivative, wherever the nodes lie (Eilers and
//! Marx 1996 for even ones). Each axis has a weight of its own. The weights are those of the greatest
//! marginal likelihood by Laplace's approximation, by the fixed point of Wood and Fasiolo (Biometrics 73, 2017).
//!
//! The tables of a model at its estimates: values and errors of their nodes, and which of them any run has visited.

use super::Smoothing;
use super::{Estimate, ParameterEstimate, Status};
use crate::iteration::evaluation::Evaluator;
use crate::iteration::likelihood::{LikelihoodCost, of_parameters, space};
use crate::iteration::priors::{PriorRow, Priors};
use crate::problem::method::SmoothBy;
use crate::problem::noise::Likelihood;
use crate::problem::unknowns::Unknowns;
use crate::problem::{Options, Problem};
use crate::uncertainty::cramer_rao::{CramerRao, conclude};
use crate::uncertainty::identifiability::Direction;
use crate::work::Work;
use fdm_grammar::Model as Definition;
use fdm_grammar::model::{Table, TableNode};
use fdm_numeric::elementary::{exp, log};
use fdm_numeric::least_squares::{GaussNewton, Options as StepOptions};
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Simulator, Steps};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// Relative change of every weight at which they count as chosen: a weight is known to a factor at best.
const SETTLED: f64 = 0.01;
/// A weight whose axis bends by fewer effective parameters than this is as good as infinite.
const STRAIGHT: f64 = 0.01;
/// Times the weight at which prior and data say as much: no weight is further away than this factor.
const FURTHEST: f64 = 1e8;

/// The smooth tables of a problem.
pub(crate) struct SmoothTables<'t> {
    tables: Vec<SmoothTable<'t>>,
}

struct SmoothTable<'t> {
    table: &'t Table,
    order: usize,
    /// The unknown of every node that has one.
    unknowns: Vec<usize>,
    /// Rows of weight 1 along each argument.
    axes: Vec<Vec<PriorRow>>,
}

impl<'t> SmoothTables<'t> {
    pub(crate) fn new(tables: &'t [Table], problem: &Problem<'_>, unknowns: &Unknowns) -> Self {
        let smooth = tables.iter().filter_map(|t| Some(SmoothTable::new(t, t.smooth? as usize, problem, unknowns)));
        Self { tables: smooth.filter(|t| !t.unknowns.is_empty()).collect() }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.tables.is_empty()
    }

    fn axes(&self) -> impl Iterator<Item = &[PriorRow]> {
        self.tables.iter().flat_map(|t| t.axes.iter().map(Vec::as_slice))
    }

    /// The rows of all axes with these weights.
    pub(crate) fn rows(&self, weights: &[f64]) -> Vec<PriorRow> {
        let weighted = |(rows, weight): (&[PriorRow], &f64)| {
            let factor = weight.sqrt();
            rows.iter().map(|row| row.times(factor)).collect::<Vec<_>>()
        };
        self.axes().zip(weights).flat_map(weighted).collect()
    }

    /// What there is to be said about every table at these weights.
    pub(crate) fn told(&self, chosen: &Chosen, bound: &CramerRao) -> Vec<Smoothing> {
        let mut weights = chosen.weights.iter();
        let one = |table: &SmoothTable<'_>| {
            let own: Vec<f64> = weights.by_ref().take(table.axes.len()).copied().collect();
            let known = table.axes.iter().zip(&own).map(|(rows, weight)| weight * trace(rows, bound));
            Smoothing {
                table: table.table.quantity.name.clone(),
                order: table.order,
                parameters: table.unknowns.len(),
                effective_parameters: table.unknowns.len() as f64 - known.sum::<f64>(),
                arguments: table.table.arguments.iter().map(|a| a.name.clone()).collect(),
                weights: own,
                settled: chosen.settled,
            }
        };
        self.tables.iter().map(one).collect()
    }
}

impl<'t> SmoothTable<'t> {
    fn new(table: &'t Table, order: usize, problem: &Problem<'_>, unknowns: &Unknowns) -> Self {
        let node = |node: &TableNode| match node {
            TableNode::Number(value) => Some((None, *value)),
            TableNode::Param(name) => {
                let k = problem.params.iter().position(|p| p.quantity.name == *name && !p.per_run)?;
                Some((unknowns.of(0, k), problem.params[k].value))
            }
            TableNode::Expression => None,
        };
        let nodes: Vec<Option<(Option<usize>, f64)>> = table.nodes.iter().map(node).collect();
        let lengths = table.lengths();
        let mut axes = Vec::new();
        for (axis, argument) in table.arguments.iter().enumerate() {
            let stride: usize = lengths[axis + 1..].iter().product();
            let range = argument.axis[argument.axis.len() - 1] - argument.axis[0];
            let mut rows = Vec::new();
            for first in 0..nodes.len() {
                let at = first / stride % lengths[axis];
                let Some(places) = argument.axis.get(at..=at + order) else { continue };
                let places: Vec<f64> = places.iter().map(|x| (x - argument.axis[0]) / range).collect();
                let members: Option<Vec<_>> = (0..=order).map(|k| nodes[first + k * stride]).collect();
                rows.extend(members.and_then(|members| difference(&places, &members)));
            }
            axes.push(rows);
        }
        let mut unknowns: Vec<usize> = nodes.iter().flatten().filter_map(|(unknown, _)| *unknown).collect();
        unknowns.sort_unstable();
        unknowns.dedup();
        Self { table, order, unknowns, axes }
    }

    /// The penalty of one axis over the unknowns.
    fn penalty(&self, axis: usize) -> DMatrix<f64> {
        let mut penalty = DMatrix::zeros(self.unknowns.len(), self.unknowns.len());
        for row in &self.axes[axis] {
            for (i, a) in row.entries() {
                for (j, b) in row.entries() {
                    let place = |unknown: &usize| self.unknowns.binary_search(unknown).ok();
                    if let (Some(i), Some(j)) = (place(i), place(j)) {
                        penalty[(i, j)] += a * b;
                    }
                }
            }
        }
        penalty
    }

    /// For every axis the trace of its penalty times the pseudo-inverse of all, each times its weight: how many directions
    /// it holds by itself.
    fn shares(&self, penalties: &[DMatrix<f64>], weights: &[f64]) -> Vec<f64> {
        let n = self.unknowns.len();
        let mut balanced = DMatrix::<f64>::zeros(n, n);
        let mut weighted = DMatrix::<f64>::zeros(n, n);
        for (penalty, weight) in penalties.iter().zip(weights) {
            let trace = penalty.trace();
            if trace > 0.0 {
                balanced += penalty / trace;
                weighted += penalty * *weight;
            }
        }
        // which directions the penalties know of is not for the weights to say
        let known = balanced.symmetric_eigen();
        let most = known.eigenvalues.iter().copied().fold(0.0, f64::max);
        // part of the largest eigenvalue of a penalty below which one is zero by rounding
        let kept: Vec<usize> = (0..n).filter(|k| known.eigenvalues[*k] > 1e-9 * most).collect();
        let basis = known.eigenvectors.select_columns(&kept);
        let inside = basis.transpose() * &weighted * &basis;
        let Some(inverse) = inside.cholesky().map(|c| c.inverse()) else {
            return weights.iter().map(|_| kept.len() as f64 / weights.len() as f64).collect();
        };
        let share = |(penalty, weight): (&DMatrix<f64>, &f64)| {
            let own = basis.transpose() * penalty * &basis;
            weight * own.component_mul(&inverse).sum()
        };
        penalties.iter().zip(weights).map(share).collect()
    }
}

/// The row of one difference: the derivative of its order times the root of the length between its first and last node over the order.
fn difference(places: &[f64], members: &[(Option<usize>, f64)]) -> Option<PriorRow> {
    let order = places.len() - 1;
    let factorial: f64 = (1..=order).map(|k| k as f64).product();
    let length = ((places[order] - places[0]) / order as f64).sqrt();
    let (mut entries, mut residual) = (Vec::with_capacity(order + 1), 0.0);
    for (k, (unknown, value)) in members.iter().enumerate() {
        let others = (0..=order).filter(|j| *j != k).map(|j| places[k] - places[j]);
        let entry = length * factorial / others.product::<f64>();
        match unknown {
            Some(unknown) => entries.push((*unknown, entry)),
            None => residual -= entry * value,
        }
    }
    entries.sort_unstable_by_key(|(unknown, _)| *unknown);
    (!entries.is_empty()).then(|| PriorRow::new(&entries, residual))
}

/// The trace of the penalty of these rows times the covariance of the unknowns.
fn trace(rows: &[PriorRow], bound: &CramerRao) -> f64 {
    rows.iter().map(|row| row.variance(|i, j| bound.inverse.covariance(&bound.scale, (i, j)))).sum()
}

/// Weights, and where the unknowns are with them.
pub(crate) struct Chosen {
    pub(crate) weights: Vec<f64>,
    pub(crate) values: Vec<f64>,
    /// Whether the weights came to rest, or were given.
    pub(crate) settled: bool,
}

/// Chooses the weights: an estimation with each choice, begun where the one before ended. None where the start values cannot be
/// simulated, which the estimation itself tells.
pub(crate) fn choose(
    problem: &mut Problem<'_>,
    unknowns: &Unknowns,
    likelihood: &Likelihood,
    options: &Options,
    work: &Work<'_>,
) -> Option<Chosen> {
    let model_tables = std::mem::take(&mut problem.tables);
    let smooth = SmoothTables::new(&model_tables, problem, unknowns);
    let chosen = (!smooth.is_empty()).then(|| choose_for(&smooth, problem, unknowns, likelihood, options, work));
    drop(smooth);
    problem.tables = model_tables;
    chosen.flatten()
}

fn choose_for(
    smooth: &SmoothTables<'_>,
    problem: &mut Problem<'_>,
    unknowns: &Unknowns,
    likelihood: &Likelihood,
    options: &Options,
    work: &Work<'_>,
) -> Option<Chosen> {
    let mut search = Search { smooth, unknowns: unknowns.clone(), likelihood, options };
    let balance = search.balance(problem)?;
    let values = unknowns.start.clone();
    if let SmoothBy::Weights(given) = &options.smooth_by {
        let weights: Vec<f64> = balance.iter().enumerate().map(|(k, b)| given.get(k).copied().unwrap_or(*b)).collect();
        return Some(Chosen { weights, values, settled: true });
    }
    work.doing("smoothness of tables");
    let penalties: Vec<Vec<DMatrix<f64>>> =
        smooth.tables.iter().map(|t| (0..t.axes.len()).map(|axis| t.penalty(axis)).collect()).collect();
    // an estimation before this one, with other steps, has chosen them nearly
    let begun = problem.smoothness.len() == balance.len();
    let mut weights = if begun { problem.smoothness.clone() } else { balance.clone() };
    let mut last: Vec<f64> = vec![0.0; weights.len()];
    let mut settled = false;
    // most choices of weights before the last one is taken
    for _ in 0..40 {
        // what is wrong with the last estimation it tells itself
        let Some((bound, values)) = search.estimate(problem, &weights, work) else { break };
        search.unknowns.start = values;
        if !work.goes_on() {
            break;
        }
        let ahead = search.ahead(&weights, &penalties, &bound);
        settled = true;
        for (k, (step, bends)) in ahead.into_iter().enumerate() {
            // the fixed point is reached by a geometric series of steps: what remains of it is taken at once
            let rate = if last[k] == 0.0 { 0.0 } else { (step / last[k]).clamp(0.0, 0.8) };
            last[k] = step;
            let (low, high) = (balance[k] / FURTHEST, balance[k] * FURTHEST);
            let moved = (weights[k] * exp((step / (1.0 - rate)).clamp(-5.0, 5.0))).clamp(low, high);
            settled &= (moved / weights[k] - 1.0).abs() < SETTLED || bends < STRAIGHT && step >= 0.0;
            weights[k] = moved;
        }
        if settled {
            break;
        }
    }
    Some(Chosen { weights, values: search.unknowns.start, settled })
}

struct Search<'s, 't> {
    smooth: &'s SmoothTables<'t>,
    unknowns: Unknowns,
    likelihood: &'s Likelihood,
    options: &'s Options,
}

impl Search<'_, '_> {
    fn steps(&self) -> StepOptions {
        let Options { iterations, gain, tolerance, .. } = *self.options;
        // the last estimation is as exact as was asked for
        StepOptions { iterations, gain, tolerance: tolerance.max(1e-5), ..StepOptions::default() }
    }

    /// For every axis the weight with which its prior says as much about the nodes as the data do at the start values.
    fn balance(&self, problem: &mut Problem<'_>) -> Option<Vec<f64>> {
        let priors = Priors::default();
        let evaluator = Evaluator::new(problem, &self.unknowns, self.likelihood.is_full());
        let (unknowns, likelihood) = (&self.unknowns, self.likelihood);
        let cost = LikelihoodCost { evaluator, unknowns, likelihood, priors: &priors };
        let mut steps = GaussNewton::new(cost, space(unknowns), self.steps());
        steps.start().ok()?;
        let scale = &steps.quadratic.scale;
        let mut balance = Vec::new();
        for table in &self.smooth.tables {
            let data: f64 = table.unknowns.iter().map(|j| scale[*j].powi(2)).sum();
            for rows in &table.axes {
                let trace: f64 = rows.iter().flat_map(PriorRow::entries).map(|(_, entry)| entry * entry).sum();
                balance.push(if trace > 0.0 && data > 0.0 { data / trace } else { 1.0 });
            }
        }
        Some(balance)
    }

    /// Bound and values of an estimation with these weights; none where there is none.
    fn estimate(&self, problem: &mut Problem<'_>, weights: &[f64], work: &Work<'_>) -> Option<(CramerRao, Vec<f64>)> {
        let (unknowns, likelihood) = (&self.unknowns, self.likelihood);
        let priors = Priors::new(problem, unknowns).with(self.smooth.rows(weights));
        let logarithmic = unknowns.searched(problem);
        let searched = logarithmic.as_ref().unwrap_or(unknowns);
        let evaluator = Evaluator::new(problem, searched, likelihood.is_full());
        let cost = LikelihoodCost { evaluator, unknowns: searched, likelihood, priors: &priors };
        let mut steps = GaussNewton::new(cost, space(searched), self.steps());
        steps.run(None, |_, _| Ok(false), &mut work.quiet().monitor(<[f64]>::to_vec)).ok()?;
        if logarithmic.is_some() {
            steps = of_parameters(steps, unknowns, self.steps());
        }
        let bound = conclude(&mut steps)?;
        Some((bound, steps.values))
    }

    /// For every axis how far the logarithm of its weight moves, and by how many effective parameters the table bends along it.
    fn ahead(&self, weights: &[f64], penalties: &[Vec<DMatrix<f64>>], bound: &CramerRao) -> Vec<(f64, f64)> {
        let values = &self.unknowns.start;
        let mut ahead = Vec::with_capacity(weights.len());
        let mut rest = weights;
        for (table, penalties) in self.smooth.tables.iter().zip(penalties) {
            let (own, others) = rest.split_at(table.axes.len());
            rest = others;
            let shares = table.shares(penalties, own);
            for ((rows, weight), share) in table.axes.iter().zip(own).zip(shares) {
                let squares: f64 = rows.iter().map(|row| row.at(values).residual.powi(2)).sum();
                let bends = share - weight * trace(rows, bound);
                if rows.is_empty() {
                    ahead.push((0.0, 0.0));
                    continue;
                }
                // never zero: values that lie on a line to the last bit want an infinite weight
                let step = log(bends.max(1e-12 * share) / (weight * squares).max(f64::MIN_POSITIVE));
                ahead.push((step, bends));
            }
        }
        ahead
    }
}

/// A table at the estimates.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct TableEstimate {
    /// Its name.
    pub table: String,
    /// Its doc string.
    pub doc: String,
    /// The unit of its values.
    pub unit: Option<String>,
    /// `linear`, `cubic` or `pchip`.
    pub method: String,
    /// One to three.
    pub arguments: Vec<TableAxis>,
    /// All nodes, those along the last argument next to each other.
    pub nodes: Vec<NodeEstimate>,
    /// Samples of all runs in each cell between nodes, cells in the order of their first nodes; what lies outside the
    /// range counts where its border is.
    pub samples: Vec<usize>,
}

/// An argument of a table.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct TableAxis {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Where the nodes are.
    pub axis: Vec<f64>,
}

/// A node of a table.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct NodeEstimate {
    /// The param that it is; none of a number or an expression.
    pub parameter: Option<String>,
    /// Its value; none of an estimated one that no run visited, which is not known, and of an expression.
    pub value: Option<f64>,
    /// Its standard error, corrected where that was possible.
    pub error: Option<f64>,
    /// Whether a sample of any run lies in one of the cells around it.
    pub visited: bool,
}

impl TableEstimate {
    fn new(table: &Table, samples: Vec<usize>, estimate: &Estimate) -> Self {
        let visited = visited(table, &samples);
        let node = |(node, visited): (&TableNode, bool)| match node {
            TableNode::Number(value) => NodeEstimate { parameter: None, value: Some(*value), error: None, visited },
            TableNode::Expression => NodeEstimate { parameter: None, value: None, error: None, visited },
            TableNode::Param(name) => {
                let own = estimate.parameters.iter().find(|p| p.name == *name && p.run.is_none());
                let open = own.is_some_and(|p| p.status != Status::Fixed);
                let known = own.filter(|_| visited || !open);
                NodeEstimate {
                    parameter: Some(name.clone()),
                    value: known.map(|p| p.value),
                    error: known.and_then(|p| p.error()),
                    visited,
                }
            }
        };
        let axis = |a: &fdm_grammar::model::TableArgument| TableAxis {
            name: a.name.clone(),
            unit: a.unit.as_ref().map(ToString::to_string),
            axis: a.axis.clone(),
        };
        Self {
            table: table.quantity.name.clone(),
            doc: table.quantity.doc.clone(),
            unit: table.quantity.unit.as_ref().map(ToString::to_string),
            method: table.method.clone(),
            arguments: table.arguments.iter().map(axis).collect(),
            nodes: table.nodes.iter().zip(visited).map(node).collect(),
            samples,
        }
    }

    /// Nodes that are estimated and that no run visited.
    pub fn unknown(&self) -> impl Iterator<Item = &NodeEstimate> {
        self.nodes.iter().filter(|n| n.parameter.is_some() && !n.visited)
    }
}

/// For every node whether a cell around it holds a sample.
fn visited(table: &Table, samples: &[usize]) -> Vec<bool> {
    let cells: Vec<usize> = table.lengths().iter().map(|n| n - 1).collect();
    let mut visited = vec![false; table.nodes.len()];
    for (node, visited) in visited.iter_mut().enumerate() {
        let place = table.place(node);
        // a cell lies before or behind the node along each axis
        *visited = (0..1_usize << place.len()).any(|sides| {
            let mut cell = 0;
            for (axis, (at, count)) in place.iter().zip(&cells).enumerate() {
                let Some(along) = at.checked_sub(sides >> axis & 1).filter(|k| k < count) else { return false };
                cell = cell * count + along;
            }
            samples[cell] > 0
        });
    }
    visited
}

/// The cell that arguments lie in, or the nearest; none where one is not a number.
fn cell(table: &Table, arguments: &[f64]) -> Option<usize> {
    let mut cell = 0;
    for (argument, x) in table.arguments.iter().zip(arguments) {
        let axis = &argument.axis;
        let along = axis[1..axis.len() - 1].iter().filter(|from| **from <= *x).count();
        cell = x.is_finite().then_some(cell * (axis.len() - 1) + along)?;
    }
    Some(cell)
}

/// Visits the cells of all tables (by number) that a simulation uses, sample by sample; `whole` is the model with the arguments of its tables as outputs
/// behind its own. None where it cannot be simulated.
fn visit(
    whole: &Model,
    definition: &Definition,
    (run, theta, steps): (&Run, &[f64], &Steps),
    mut visit: impl FnMut(usize, usize, usize),
) -> Option<()> {
    let (q, width) = (definition.outputs.len(), whole.definition().outputs.len());
    let mut y = vec![0.0; run.len() * width];
    Simulator::new(whole.dynamics(), run, steps.clone()).ok()?.simulate(theta, &mut y).ok()?;
    for (sample, row) in y.chunks_exact(width).enumerate() {
        let mut rest = &row[q..];
        for (number, table) in definition.tables.iter().enumerate() {
            let (own, others) = rest.split_at(table.calls.arguments.len() * table.arguments.len());
            rest = others;
            let cells = own.chunks_exact(table.arguments.len()).filter_map(|call| cell(table, call));
            cells.for_each(|cell| visit(number, cell, sample));
        }
    }
    Some(())
}

/// A table whose estimated values are used where no run of the fit had visited it.
#[derive(Debug, Clone, PartialEq)]
pub struct Unvisited {
    /// The table.
    pub table: String,
    /// The first sample that uses such a cell.
    pub first: usize,
    /// Part of all samples that do.
    pub part: f64,
}

/// The tables that a simulation of a run at `theta` (all parameters) uses where the fit, whose `tables` these are, had no sample; empty where it cannot be
/// simulated. Tables without an estimated node are known everywhere.
pub fn unvisited(tables: &[TableEstimate], model: &Model, run: &Run, theta: &[f64], steps: &Steps) -> Vec<Unvisited> {
    let definition = model.definition();
    let estimated = |t: &&TableEstimate| t.nodes.iter().any(|n| n.parameter.is_some());
    let of = |table: &Table| tables.iter().find(|t| t.table == table.quantity.name).filter(estimated);
    let fitted: Vec<Option<&TableEstimate>> = definition.tables.iter().map(of).collect();
    let Some(extended) = definition.with_table_arguments().filter(|_| fitted.iter().any(Option::is_some)) else {
        return Vec::new();
    };
    // samples of each table, rising, each once
    let mut beyond: Vec<Vec<usize>> = vec![Vec::new(); fitted.len()];
    let new = |number: usize, cell: usize| {
        fitted[number].is_some_and(|t| t.samples.get(cell).is_some_and(|samples| *samples == 0))
    };
    let visited = visit(&model.sketched(extended), definition, (run, theta, steps), |number, cell, sample| {
        if new(number, cell) && beyond[number].last() != Some(&sample) {
            beyond[number].push(sample);
        }
    });
    let one = |(fitted, samples): (&Option<&TableEstimate>, &Vec<usize>)| {
        let (table, first) = ((*fitted)?.table.clone(), *samples.first()?);
        Some(Unvisited { table, first, part: samples.len() as f64 / run.len() as f64 })
    };
    visited.map_or(Vec::new(), |()| fitted.iter().zip(&beyond).filter_map(one).collect())
}

/// Adds the tables of a model to an estimate: `thetas` are all parameters of each run there, simulated by `steps`. Nodes of smooth tables
/// that no run visited have a value by their neighbours alone, and are said to be unvisited.
pub(crate) fn add_tables(estimate: &mut Estimate, model: &Model, runs: &[Run], thetas: &[Vec<f64>], steps: &[Steps]) {
    let definition = model.definition();
    let Some(extended) = definition.with_table_arguments().filter(|_| !estimate.runs.is_empty()) else { return };
    let whole = model.sketched(extended);
    let cells = |table: &Table| table.lengths().iter().map(|n| n - 1).product();
    let mut samples: Vec<Vec<usize>> = definition.tables.iter().map(|t| vec![0; cells(t)]).collect();
    for ((run, theta), steps) in runs.iter().zip(thetas).zip(steps) {
        if visit(&whole, definition, (run, theta, steps), |table, cell, _| samples[table][cell] += 1).is_none() {
            return;
        }
    }
    for (table, samples) in definition.tables.iter().zip(samples) {
        let told = TableEstimate::new(table, samples, estimate);
        if table.smooth.is_some() {
            let unknown: Vec<&str> = told.unknown().filter_map(|n| n.parameter.as_deref()).collect();
            let open = |p: &&mut ParameterEstimate| matches!(p.status, Status::Estimated | Status::NotDetermined);
            for p in estimate.parameters.iter_mut().filter(open).filter(|p| unknown.contains(&p.name.as_str())) {
                p.status = Status::Unvisited;
                (p.standard_error, p.corrected_error) = (None, None);
            }
            // that these are not determined has been said
            let others = |d: &Direction| d.moves.iter().any(|(name, _)| !unknown.contains(&name.as_str()));
            estimate.undetermined.retain(others);
        }
        estimate.tables.push(told);
    }
}
