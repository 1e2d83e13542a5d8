//! Sizes, patterns and positions of everything that the programs read and write.
//!
//! One straight-line program: constants, instructions, results.

use super::Affine;
use crate::derive::Pattern;
use crate::external;
use crate::graph::{Graph, Node, Signal, call, elements};
use crate::model::Model;
use crate::op::{ExprId, Op};
use std::collections::HashMap;
use std::ops::Range;

/// Sizes, patterns and positions of everything that the programs read and write.
///
/// Results of `rates_and_partials` are arranged for the integrator (see [`StageRow`]); those of
/// `outputs_and_partials` are outputs (q), then the entries of h_x, h_delay, h_theta; of `by_input` the entries of f_u and h_u,
/// each group in the order of its pattern.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// Number of states n.
    pub states: usize,
    /// Number of inputs m.
    pub inputs: usize,
    /// Number of parameters p, fixed ones included.
    pub params: usize,
    /// Parameters (by index) that are the first sample of an input (by index) in every run.
    pub first: Vec<(u32, u32)>,
    /// Number of outputs q.
    pub outputs: usize,
    /// Inputs that are zero outside the record: derivatives of inputs, which keep their values there.
    pub vanishing: Vec<u32>,
    /// Outputs (by index) whose values are the same a period apart, with their periods.
    pub wraps: Vec<(u32, f64)>,
    /// Delayed signals; they follow the inputs in the drive.
    pub delayed: Vec<Signal>,
    /// Length of the array that `prepare` fills.
    pub known: usize,
    /// Initial values in `known`.
    pub initial: Range<usize>,
    /// Delays in `known`, one for each delayed signal.
    pub tau: Range<usize>,
    /// Entries of x0_theta in `known`.
    pub initial_by_param: Range<usize>,
    /// Entries of tau_theta in `known`.
    pub tau_by_param: Range<usize>,
    /// Values of derived parameters in `known`.
    pub derived: Range<usize>,
    /// States (by index) that are held within limits at the end of every step.
    pub limited: Vec<u32>,
    /// Their limits in `known`: the lower and the upper one of each.
    pub limits: Range<usize>,
    /// Entries of the derivatives of the limits in `known`.
    pub limits_by_param: Range<usize>,
    /// What each event sets, in the order of the text.
    pub events: Vec<EventRow>,
    /// Switching functions of the rates, which `events` computes of a model without events: those of `max`, `min`, `abs` and `if`. Code that
    /// does not compute them has none.
    pub kinks: usize,
    /// For each output the state that it is, when it is one and nothing else (q).
    pub observed: Vec<Option<u32>>,
    /// Which equations are linear with a constant.
    pub affine: Affine,
    /// Patterns, named by row and column.
    pub patterns: Patterns,
    /// Where `rates_and_partials` writes.
    pub stage: StageRow,
}

/// Where the values that an event sets stand in the result of `events_and_partials`: behind the guards of all events.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EventRow {
    /// Row of the first of them.
    pub first: usize,
    /// The states that get them, by index.
    pub states: Vec<u32>,
}

/// The result of `rates_and_partials`: rates (n), f_x, the entries of f_delay, then f_theta in lanes.
///
/// f_theta is written where the sensitivities need it: one row per state, one lane per parameter that is not fixed,
/// padded to full vectors and beginning on one. Structural zeros are never written; whoever owns the row clears it once.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct StageRow {
    /// Slot of each entry of f_x, in the order of the pattern: full rows for small models, else entries only.
    pub by_state: Vec<u32>,
    /// Whether f_x is written as full rows (n by n, from slot n on).
    pub dense: bool,
    /// First entry of f_delay.
    pub by_delayed: usize,
    /// First lane of f_theta, a multiple of [`StageRow::VECTOR`].
    pub forcing: usize,
    /// Lanes of each row of f_theta, a multiple of [`StageRow::VECTOR`].
    pub lanes: usize,
    /// Lane of each parameter; none for fixed ones (p).
    pub lane: Vec<Option<u32>>,
    /// Length of the row, a multiple of [`StageRow::VECTOR`].
    pub width: usize,
}

impl StageRow {
    /// Numbers in the widest register.
    pub const VECTOR: usize = 8;
    /// Models with at most this many states have full rows of f_x.
    pub const MOST_DENSE: usize = 6;

    pub(super) fn new(model: &Model, by_state: &Pattern, by_delayed: &Pattern) -> Self {
        let n = model.states.len();
        let dense = n <= Self::MOST_DENSE;
        let place = |(k, i, j): (usize, usize, usize)| (n + if dense { i * n + j } else { k }) as u32;
        let after_state = n + if dense { n * n } else { by_state.len() };
        let forcing = (after_state + by_delayed.len()).next_multiple_of(Self::VECTOR);
        // shared parameters first, then those of each run: the order in which estimation asks for them
        let mut lane = vec![None; model.params.len()];
        let free = |per_run: bool| {
            let params = model.params.iter().enumerate();
            params.filter(move |(_, p)| !p.fixed && p.per_run == per_run).map(|(k, _)| k)
        };
        let order: Vec<usize> = free(false).chain(free(true)).collect();
        order.iter().enumerate().for_each(|(l, k)| lane[*k] = Some(l as u32));
        let lanes = order.len().next_multiple_of(Self::VECTOR);
        let by_state = by_state.entries().map(place).collect();
        Self { by_state, dense, by_delayed: after_state, forcing, lanes, lane, width: forcing + n * lanes }
    }

    /// Slot of the derivative of rate i by parameter j, which is not fixed.
    pub fn by_param(&self, i: usize, j: usize) -> Option<usize> {
        self.lane[j].map(|lane| self.forcing + i * self.lanes + lane as usize)
    }

    /// Slots in the order rates, f_x, f_delay, f_theta, entries in the order of their patterns.
    pub(super) fn slots(&self, n: usize, by_delayed: &Pattern, by_param: &Pattern) -> Vec<u32> {
        let delayed = (0..by_delayed.len()).map(|k| (self.by_delayed + k) as u32);
        let param = by_param.entries().filter_map(|(_, i, j)| self.by_param(i, j)).map(|slot| slot as u32);
        (0..n as u32).chain(self.by_state.iter().copied()).chain(delayed).chain(param).collect()
    }
}

/// The sparsity of all Jacobians.
#[derive(Debug, Clone, PartialEq)]
pub struct Patterns {
    /// f_x, n by n.
    pub rates_by_state: Pattern,
    /// f_delay, n by delayed signals.
    pub rates_by_delayed: Pattern,
    /// f_theta, n by p.
    pub rates_by_param: Pattern,
    /// f_u, n by m.
    pub rates_by_input: Pattern,
    /// h_x, q by n.
    pub outputs_by_state: Pattern,
    /// h_delay, q by delayed signals.
    pub outputs_by_delayed: Pattern,
    /// h_theta, q by p.
    pub outputs_by_param: Pattern,
    /// h_u, q by m.
    pub outputs_by_input: Pattern,
    /// x0_theta, n by p.
    pub initial_by_param: Pattern,
    /// tau_theta, delayed signals by p.
    pub tau_by_param: Pattern,
    /// limits_theta, two rows for each limited state by p.
    pub limits_by_param: Pattern,
    /// Guards of all events and the values that they set, or switching functions of the rates, by n.
    pub events_by_state: Pattern,
    /// Guards of all events and the values that they set, by m.
    pub events_by_input: Pattern,
    /// Guards of all events and the values that they set, by p.
    pub events_by_param: Pattern,
    /// Guards of all events and the values that they set, by time (one column).
    pub events_by_time: Pattern,
}

impl Layout {
    /// Length of the drive: inputs and delayed signals.
    pub fn drive(&self) -> usize {
        self.inputs + self.delayed.len()
    }

    /// Length of the result of `rates_and_partials`.
    pub fn rate_slots(&self) -> usize {
        self.stage.width
    }

    /// Length of the result of `outputs_and_partials`.
    pub fn output_slots(&self) -> usize {
        let p = &self.patterns;
        self.outputs + p.outputs_by_state.len() + p.outputs_by_delayed.len() + p.outputs_by_param.len()
    }

    /// Guards of all events and the values that they set, or switching functions of the rates.
    pub fn event_rows(&self) -> usize {
        self.kinks + self.events.len() + self.events.iter().map(|event| event.states.len()).sum::<usize>()
    }

    /// Length of the result of `events_and_partials`.
    pub fn event_slots(&self) -> usize {
        let p = &self.patterns;
        let entries = [&p.events_by_state, &p.events_by_input, &p.events_by_param, &p.events_by_time];
        self.event_rows() + entries.map(|pattern| pattern.len()).iter().sum::<usize>()
    }

    /// Length of the result of `by_input`.
    pub fn input_slots(&self) -> usize {
        self.patterns.rates_by_input.len() + self.patterns.outputs_by_input.len()
    }
}

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
