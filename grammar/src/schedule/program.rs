//! One straight-line program: constants, instructions, results.

use crate::graph::{Graph, Node};
use crate::op::{ExprId, Op};
use std::collections::HashMap;

/// Where a program finds a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Operand {
    /// The result of an earlier instruction.
    Value(u32),
    /// An entry of [`Program::constants`].
    Constant(u32),
    /// Time.
    Time,
    /// A state.
    State(u32),
    /// An entry of the drive: inputs first, delayed signals behind them.
    Drive(u32),
    /// In `prepare` a parameter, elsewhere a result of `prepare`.
    Known(u32),
}

/// One operation; its result is value k, where k is its position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Instruction {
    /// What to do.
    pub op: Op,
    /// With what; places beyond the arity repeat the first operand.
    pub args: [Operand; 3],
}

/// A number of the result and the slot that it is written to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Placed {
    /// Position in the result.
    pub slot: u32,
    /// What is written there.
    pub operand: Operand,
}

/// Instructions in order, then results.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Program {
    /// Numbers of the text, each once.
    pub constants: Vec<f64>,
    /// In order of execution.
    pub instructions: Vec<Instruction>,
    /// What is written where, in ascending order of slots; slots that nothing is written to keep what they held.
    pub results: Vec<Placed>,
    /// Length of the result.
    pub width: usize,
}

/// Orders the nodes below `roots`, which go to `slots` (ascending); `given` names nodes that need no instruction.
pub(crate) fn straight_line(
    graph: &Graph,
    roots: &[ExprId],
    slots: &[u32],
    width: usize,
    given: impl Fn(ExprId, Node) -> Option<Operand>,
) -> Program {
    let mut program = Program { width, ..Program::default() };
    let mut constants: HashMap<u64, u32> = HashMap::new();
    let mut place: Vec<Option<Operand>> = vec![None; graph.nodes().len()];
    let mut wanted = vec![false; graph.nodes().len()];
    roots.iter().for_each(|r| wanted[r.index()] = true);
    for k in (0..wanted.len()).rev() {
        let e = ExprId(k as u32);
        if wanted[k] {
            place[k] = given(e, graph.node(e));
            if place[k].is_none() {
                graph.operands(e).iter().for_each(|a| wanted[a.index()] = true);
            }
        }
    }
    for k in 0..place.len() {
        if !wanted[k] || place[k].is_some() {
            continue;
        }
        place[k] = match graph.node(ExprId(k as u32)) {
            Node::Constant(bits) => {
                let next = program.constants.len() as u32;
                let index = *constants.entry(bits).or_insert(next);
                if index == next {
                    program.constants.push(f64::from_bits(bits));
                }
                Some(Operand::Constant(index))
            }
            Node::Apply(op, args) => {
                let first = place[args[0].index()].unwrap_or(Operand::Time);
                let mut operands = [first; 3];
                for (o, a) in operands.iter_mut().zip(&args[..op.row().arity]) {
                    *o = place[a.index()].unwrap_or(first);
                }
                program.instructions.push(Instruction { op, args: operands });
                Some(Operand::Value(program.instructions.len() as u32 - 1))
            }
            // a leaf that is not given cannot be reached: prepare sees parameters only, bodies are given all
            Node::Leaf(_) => None,
        };
    }
    let operand = |root: &ExprId| place[root.index()].unwrap_or(Operand::Time);
    program.results = roots.iter().zip(slots).map(|(r, slot)| Placed { slot: *slot, operand: operand(r) }).collect();
    program
}
