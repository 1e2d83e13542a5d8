//! The tables of a model at its estimates: values and errors of their nodes, and which of them any run has visited.

use crate::estimation::estimate::{Estimate, ParameterEstimate, Status};
use crate::uncertainty::identifiability::Direction;
use fdm_grammar::Model as Definition;
use fdm_grammar::model::{Table, TableNode};
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Simulator, Steps};
use serde::{Deserialize, Serialize};

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
