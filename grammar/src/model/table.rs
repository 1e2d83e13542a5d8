//! The tables of a model: axes, nodes, where they are called, and how smooth they are.

use super::{Model, Output, Quantity};
use crate::graph::Graph;
use crate::op::ExprId;
use crate::unit::Unit;

/// A function through nodes, as the model declares it; its values stand in the model's expressions.
#[derive(Debug, Clone)]
pub struct Table {
    /// Name, doc, unit of its values.
    pub quantity: Quantity,
    /// The word behind `=`: `linear`, `cubic` or `pchip`.
    pub method: String,
    /// One to three.
    pub arguments: Vec<TableArgument>,
    /// Values at all crossings of the axes, those of the last argument next to each other.
    pub nodes: Vec<TableNode>,
    /// What it is called with.
    pub calls: TableCalls,
    /// `smooth CL by order 2;`: which differences of neighbouring nodes are small.
    pub smooth: Option<u32>,
}

/// An argument of a table.
#[derive(Debug, Clone)]
pub struct TableArgument {
    /// Its name.
    pub name: String,
    /// Its unit, when one was declared.
    pub unit: Option<Unit>,
    /// Where the nodes are, increasing (2 or more).
    pub axis: Vec<f64>,
}

/// What a table is at a node.
#[derive(Debug, Clone, PartialEq)]
pub enum TableNode {
    /// A number.
    Number(f64),
    /// The param of this name.
    Param(String),
    /// An expression of params.
    Expression,
}

/// The arguments of every call of a table, in a graph of their own, so that neither derivatives nor substitutions know of them.
#[derive(Debug, Clone, Default)]
pub struct TableCalls {
    /// Holds the expressions.
    pub graph: Graph,
    /// By call and argument.
    pub arguments: Vec<Vec<ExprId>>,
}

impl Table {
    /// Numbers of nodes along the arguments.
    pub fn lengths(&self) -> Vec<usize> {
        self.arguments.iter().map(|a| a.axis.len()).collect()
    }

    /// The place of a node along each argument, from 0.
    pub fn place(&self, node: usize) -> Vec<usize> {
        let mut rest = node;
        let mut place: Vec<usize> = Vec::with_capacity(self.arguments.len());
        for argument in self.arguments.iter().rev() {
            place.push(rest % argument.axis.len());
            rest /= argument.axis.len();
        }
        place.reverse();
        place
    }
}

impl Model {
    /// The model with the arguments of all calls of its tables as outputs behind its own: table by table, call by call. None where
    /// no table is called.
    pub fn with_table_arguments(&self) -> Option<Self> {
        if self.tables.iter().all(|t| t.calls.arguments.is_empty()) {
            return None;
        }
        let mut model = self.clone();
        for table in &self.tables {
            let all: Vec<ExprId> = table.calls.arguments.iter().flatten().copied().collect();
            let moved = table.calls.graph.rebuild(&all, &mut model.graph, Graph::reference);
            for (k, expr) in moved.into_iter().enumerate() {
                let argument = &table.arguments[k % table.arguments.len()];
                let name =
                    format!("{} of {}, call {}", argument.name, table.quantity.name, k / table.arguments.len() + 1);
                model.outputs.push(Output::new(Quantity { name, doc: String::new(), unit: None }, expr));
            }
        }
        Some(model)
    }
}
