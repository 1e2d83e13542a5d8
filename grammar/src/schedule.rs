//! Straight-line programs: what the tape interprets, Cranelift translates and `model!` prints as Rust.
//!
//! **In** a checked [`Model`] and its [`Derivatives`]. **Out** [`Schedule`]: six [`Program`]s and the [`Layout`]
//! of their arguments and results. **Never** control flow: a choice is an operation. **Start** at [`Schedule::new`].
//!
//! Everything that depends on parameters alone is computed once per parameter vector by `prepare`, whose results are
//! the `known` array of the other programs. Shared subexpressions are computed once in each program.

use crate::derive::{Derivatives, Jacobian, Pattern, differentiate};
use crate::graph::{Graph, Leaf, Node, Signal};
use crate::model::Model;
use crate::op::{ExprId, Op};
use std::collections::HashMap;
use std::ops::Range;

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
    /// Number of outputs q.
    pub outputs: usize,
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
    /// For each output the state that it is, when it is one and nothing else (q).
    pub observed: Vec<Option<u32>>,
    /// Patterns, named by row and column.
    pub patterns: Patterns,
    /// Where `rates_and_partials` writes.
    pub stage: StageRow,
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

    fn new(model: &Model, by_state: &Pattern, by_delayed: &Pattern) -> Self {
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
    fn slots(&self, n: usize, by_delayed: &Pattern, by_param: &Pattern) -> Vec<u32> {
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

    /// Length of the result of `by_input`.
    pub fn input_slots(&self) -> usize {
        self.patterns.rates_by_input.len() + self.patterns.outputs_by_input.len()
    }
}

/// The six programs of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Schedule {
    /// Sizes, patterns, positions.
    pub layout: Layout,
    /// Parameters to `known`.
    pub prepare: Program,
    /// Rates f.
    pub rates: Program,
    /// Rates and their partials.
    pub rates_and_partials: Program,
    /// Outputs h.
    pub outputs: Program,
    /// Outputs and their partials.
    pub outputs_and_partials: Program,
    /// Partials by inputs (linearisation, checks).
    pub by_input: Program,
}

impl Schedule {
    /// Differentiates the model and orders everything; derivative nodes join the model's graph.
    pub fn new(model: &mut Model) -> Self {
        let d = differentiate(model);
        let rates: Vec<ExprId> = model.states.iter().map(|s| s.rate).collect();
        let outputs: Vec<ExprId> = model.outputs.iter().map(|o| o.expr).collect();
        let with = |head: &[ExprId], jacobians: [&Jacobian; 3]| {
            let tail = jacobians.into_iter().flat_map(|j| j.entries.iter().copied());
            head.iter().copied().chain(tail).collect::<Vec<_>>()
        };
        let full_rates = with(&rates, [&d.rates.state, &d.rates.delayed, &d.rates.param]);
        let full_outputs = with(&outputs, [&d.outputs.state, &d.outputs.delayed, &d.outputs.param]);
        let by_input = [&d.rates.input.entries[..], &d.outputs.input.entries[..]].concat();
        let bodies = [&full_rates[..], &full_outputs[..], &by_input[..]].concat();

        let graph = &model.graph;
        let (known, layout) = known(model, &d, &bodies);
        let mut places: Vec<Option<u32>> = vec![None; graph.nodes().len()];
        known.iter().enumerate().rev().for_each(|(k, e)| places[e.index()] = Some(k as u32));
        let inputs = layout.inputs as u32;
        let placed = |roots: &[ExprId], slots: Vec<u32>, width: usize| {
            linearise(graph, roots, &slots, width, |e, node| match node {
                Node::Leaf(leaf) => Some(match leaf {
                    Leaf::Time => Operand::Time,
                    Leaf::State(k) => Operand::State(k),
                    Leaf::Input(k) => Operand::Drive(k),
                    Leaf::Delayed(k) => Operand::Drive(inputs + k),
                    Leaf::Param(_) => return places[e.index()].map(Operand::Known),
                }),
                Node::Apply(..) => places[e.index()].map(Operand::Known),
                Node::Constant(_) => None,
            })
        };
        let body = |roots: &[ExprId]| placed(roots, (0..roots.len() as u32).collect(), roots.len());
        let (stage, patterns) = (&layout.stage, &layout.patterns);
        let in_stage = stage.slots(layout.states, &patterns.rates_by_delayed, &patterns.rates_by_param);
        let in_order: Vec<u32> = (0..known.len() as u32).collect();
        Self {
            prepare: linearise(graph, &known, &in_order, known.len(), |_, node| match node {
                Node::Leaf(Leaf::Param(k)) => Some(Operand::Known(k)),
                _ => None,
            }),
            rates: body(&rates),
            rates_and_partials: placed(&full_rates, in_stage, stage.width),
            outputs: body(&outputs),
            outputs_and_partials: body(&full_outputs),
            by_input: body(&by_input),
            layout,
        }
    }
}

/// What `prepare` computes: initial values, delays, their partials, derived parameters, and every expression of
/// parameters alone on which something that varies depends.
fn known(model: &Model, d: &Derivatives, bodies: &[ExprId]) -> (Vec<ExprId>, Layout) {
    let graph = &model.graph;
    let mut known: Vec<ExprId> = Vec::new();
    let mut append = |list: &mut dyn Iterator<Item = ExprId>| {
        let start = known.len();
        known.extend(list);
        start..known.len()
    };
    let initial = append(&mut model.states.iter().map(|s| s.initial));
    let tau = append(&mut graph.delayed().iter().map(|s| s.tau));
    let initial_by_param = append(&mut d.initial.entries.iter().copied());
    let tau_by_param = append(&mut d.tau.entries.iter().copied());
    let derived = append(&mut model.derived.iter().map(|s| s.expr));

    let varies = graph.depends(|leaf| !matches!(leaf, Leaf::Param(_)));
    let is_known = |e: ExprId| !varies[e.index()] && graph.constant(e).is_none();
    let mut wanted = vec![false; graph.nodes().len()];
    bodies.iter().for_each(|r| wanted[r.index()] = true);
    for k in (0..wanted.len()).rev() {
        if wanted[k] && varies[k] {
            graph.operands(ExprId(k as u32)).iter().for_each(|a| wanted[a.index()] = true);
        }
    }
    known.extend((0..wanted.len() as u32).map(ExprId).filter(|e| wanted[e.index()] && is_known(*e)));

    let layout = Layout {
        states: model.states.len(),
        inputs: model.inputs.len(),
        params: model.params.len(),
        outputs: model.outputs.len(),
        delayed: graph.delayed().iter().map(|s| s.signal).collect(),
        known: known.len(),
        initial,
        tau,
        initial_by_param,
        tau_by_param,
        derived,
        stage: StageRow::new(model, &d.rates.state.pattern, &d.rates.delayed.pattern),
        observed: model.outputs.iter().map(|o| observed(graph, o.expr)).collect(),
        patterns: Patterns {
            rates_by_state: d.rates.state.pattern.clone(),
            rates_by_delayed: d.rates.delayed.pattern.clone(),
            rates_by_param: d.rates.param.pattern.clone(),
            rates_by_input: d.rates.input.pattern.clone(),
            outputs_by_state: d.outputs.state.pattern.clone(),
            outputs_by_delayed: d.outputs.delayed.pattern.clone(),
            outputs_by_param: d.outputs.param.pattern.clone(),
            outputs_by_input: d.outputs.input.pattern.clone(),
            initial_by_param: d.initial.pattern.clone(),
            tau_by_param: d.tau.pattern.clone(),
        },
    };
    (known, layout)
}

fn observed(graph: &Graph, e: ExprId) -> Option<u32> {
    match graph.node(e) {
        Node::Leaf(Leaf::State(k)) => Some(k),
        _ => None,
    }
}

/// Orders the nodes below `roots`, which go to `slots` (ascending); `given` names nodes that need no instruction.
fn linearise(
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
