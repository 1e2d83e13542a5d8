//! One straight-line program: constants, instructions, results.

use crate::external;
use crate::graph::{Graph, Node, call, elements};
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

/// The operands of an instruction that calls a function of foreign code; its own [`Instruction::args`] hold the function's number.
#[derive(Debug, Clone, PartialEq)]
pub struct Call {
    /// The position of the instruction.
    pub instruction: u32,
    /// The arguments, then the directions of a derivative, each as long as the arguments.
    pub operands: Vec<Operand>,
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
    /// The calls of foreign code, in the order of their instructions.
    pub calls: Vec<Call>,
    /// What is written where, in ascending order of slots; slots that nothing is written to keep what they held.
    pub results: Vec<Placed>,
    /// Length of the result.
    pub width: usize,
}

impl Program {
    /// The function that an instruction calls, and its operands; none of an instruction that calls no foreign code.
    pub fn call(&self, instruction: usize) -> Option<(external::Function, &[Operand])> {
        let Operand::Constant(number) = self.instructions[instruction].args[0] else { return None };
        let call = self.calls.binary_search_by_key(&instruction, |c| c.instruction as usize).ok()?;
        let function = external::Function::numbered(self.constants[number as usize])?;
        Some((function, &self.calls[call].operands))
    }

    /// What an instruction reads: what is in its row, and the operands of a call.
    pub fn reads(&self, instruction: usize) -> impl Iterator<Item = Operand> + '_ {
        let own = &self.instructions[instruction];
        let call = self.calls.binary_search_by_key(&instruction, |c| c.instruction as usize);
        let call = call.map_or(&[][..], |k| &self.calls[k].operands);
        own.args[..own.op.row().arity].iter().chain(call).copied()
    }
}

/// The place of a constant.
fn constant(program: &mut Program, known: &mut HashMap<u64, u32>, bits: u64) -> Operand {
    let next = program.constants.len() as u32;
    let index = *known.entry(bits).or_insert(next);
    if index == next {
        program.constants.push(f64::from_bits(bits));
    }
    Operand::Constant(index)
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
            Node::Constant(bits) => Some(constant(&mut program, &mut constants, bits)),
            // its elements stand in the calls that have it
            Node::Apply(Op::List, _) => None,
            Node::Apply(op, args) if op.is_external() => {
                let number = place[args[0].index()].unwrap_or(Operand::Time);
                let nothing = constant(&mut program, &mut constants, 0.0_f64.to_bits());
                let (function, lists) = match call(graph, op, args) {
                    Some(call) => call,
                    // what is not known any more is no number
                    None => {
                        place[k] = Some(constant(&mut program, &mut constants, f64::NAN.to_bits()));
                        continue;
                    }
                };
                let n = function.code.arguments();
                let mut operands = vec![nothing; n * lists.len()];
                for (list, own) in lists.iter().zip(operands.chunks_mut(n.max(1))) {
                    let elements = elements(graph, *list);
                    own.iter_mut().rev().zip(elements).for_each(|(o, e)| *o = place[e.index()].unwrap_or(nothing));
                }
                let instruction = program.instructions.len() as u32;
                program.calls.push(Call { instruction, operands });
                program.instructions.push(Instruction { op, args: [number; 3] });
                Some(Operand::Value(instruction))
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
