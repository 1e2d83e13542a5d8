//! Expressions beside a model: evaluated at one point after the other, for records.

use super::tape::Bytecode;
use crate::dynamics::{Point, Workspace};
use fdm_grammar::graph::Graph;
use fdm_grammar::op::ExprId;
use fdm_grammar::schedule::program;

/// Some expressions of one graph, ready to be evaluated.
#[derive(Debug, Clone)]
pub struct Expressions {
    code: Bytecode,
    work: Workspace,
}

impl Expressions {
    /// Expressions over `states` states, `inputs` inputs and the delayed signals of the graph.
    pub fn new(graph: &Graph, roots: &[ExprId], states: usize, inputs: usize) -> Self {
        let code = Bytecode::new(&program(graph, roots, inputs), states, inputs + graph.delayed().len());
        Self { code, work: Workspace::default() }
    }

    /// Their values, to the front of `out`; `at.known` are the parameters themselves, in the model's order.
    pub fn evaluate(&mut self, at: Point<'_>, out: &mut [f64]) {
        self.code.run(at, out, &mut self.work);
    }
}
