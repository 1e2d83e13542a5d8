//! The tables of a model at its estimates: values and errors of their nodes, and which of them any run has visited.

use crate::estimate::{Estimate, ParameterEstimate, Status};
use crate::uncertainty::identifiability::Direction;
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

/// Adds the tables of a model to an estimate: `thetas` are all parameters of each run there, simulated by `steps`. Nodes of smooth tables
/// that no run visited have a value by their neighbours alone, and are said to be unvisited.
pub(crate) fn add_tables(estimate: &mut Estimate, model: &Model, runs: &[Run], thetas: &[Vec<f64>], steps: &[Steps]) {
    let definition = model.definition();
    let Some(extended) = definition.with_table_arguments().filter(|_| !estimate.runs.is_empty()) else { return };
    let (whole, q) = (model.sketched(extended), definition.outputs.len());
    let width = whole.definition().outputs.len();
    let cells = |table: &Table| table.lengths().iter().map(|n| n - 1).product();
    let mut samples: Vec<Vec<usize>> = definition.tables.iter().map(|t| vec![0; cells(t)]).collect();
    for ((run, theta), steps) in runs.iter().zip(thetas).zip(steps) {
        let mut y = vec![0.0; run.len() * width];
        let Ok(mut simulator) = Simulator::new(whole.dynamics(), run, steps.clone()) else { return };
        if simulator.simulate(theta, &mut y).is_err() {
            return;
        }
        for row in y.chunks_exact(width) {
            let mut rest = &row[q..];
            for (table, samples) in definition.tables.iter().zip(&mut samples) {
                let (own, others) = rest.split_at(table.calls.arguments.len() * table.arguments.len());
                rest = others;
                let cells = own.chunks_exact(table.arguments.len()).filter_map(|call| cell(table, call));
                cells.for_each(|cell| samples[cell] += 1);
            }
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
