//! Straight-line programs: what the tape interprets, Cranelift translates and `model!` prints as Rust.
//!
//! **In** a checked [`Model`] and its [`Derivatives`]. **Out** [`Schedule`]: the [`Program`]s and the [`Layout`]
//! of their arguments and results. **Never** control flow: a choice is an operation. **Start** at [`Schedule::new`].
//!
//! Everything that depends on parameters alone is computed once per parameter vector by `prepare`, whose results are
//! the `known` array of the other programs. Shared subexpressions are computed once in each program.
//!
//! Which equations are affine in states, inputs and delayed signals, with coefficients of parameters alone: proven on the
//! graph, never tried with numbers.

use crate::derive::{Derivatives, Jacobian, Swollen, differentiate, differentiate_within};
use crate::graph::{Graph, Leaf, Node};
use crate::model::{Model, Origin};
use crate::op::{Args, ExprId, Op};

mod layout;

pub use layout::{Call, EventRow, Instruction, Layout, Operand, Patterns, Placed, Program, StageRow};

pub(crate) use layout::straight_line;

/// The programs of a model; the last three are empty where there are no events, limits or kinks.
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
    /// Guards of all events, which pass zero upwards when they happen, and the values that they set; or the switching functions of the
    /// rates, which pass zero in both directions.
    pub events: Program,
    /// Guards of all events and the values that they set, and their partials by states, inputs, parameters and time.
    pub events_and_partials: Program,
    /// f_t: a row for each state (n), of which structural zeros are not written.
    pub rates_by_time: Program,
}

impl Schedule {
    /// Differentiates the model and orders everything; derivative nodes join the model's graph.
    pub fn new(model: &mut Model) -> Self {
        let d = differentiate(model);
        Self::of(model, &d)
    }

    /// Differentiates the model and orders everything, as long as the graph of the derivatives does not have more nodes
    /// than `most`.
    ///
    /// # Errors
    /// [`Swollen`].
    pub fn within(model: &mut Model, most: usize) -> Result<Self, Swollen> {
        let d = differentiate_within(model, most)?;
        Ok(Self::of(model, &d))
    }

    /// The programs of a model with these derivatives, which may be those of parameters that stand in none of its equations.
    pub fn of(model: &Model, d: &Derivatives) -> Self {
        let rates: Vec<ExprId> = model.states.iter().map(|s| s.rate).collect();
        let outputs: Vec<ExprId> = model.outputs.iter().map(|o| o.expr).collect();
        let with = |head: &[ExprId], jacobians: [&Jacobian; 3]| {
            let tail = jacobians.into_iter().flat_map(|j| j.entries.iter().copied());
            head.iter().copied().chain(tail).collect::<Vec<_>>()
        };
        let full_rates = with(&rates, [&d.rates.state, &d.rates.delayed, &d.rates.param]);
        let full_outputs = with(&outputs, [&d.outputs.state, &d.outputs.delayed, &d.outputs.param]);
        let by_input = [&d.rates.input.entries[..], &d.outputs.input.entries[..]].concat();
        let events = events(model, d);
        let by_time = &d.rates_by_time.entries[..];
        let bodies = [&full_rates[..], &full_outputs[..], &by_input[..], &events[..], by_time].concat();

        let graph = &model.graph;
        let (known, layout) = known(model, d, &bodies);
        let mut places: Vec<Option<u32>> = vec![None; graph.nodes().len()];
        known.iter().enumerate().rev().for_each(|(k, e)| places[e.index()] = Some(k as u32));
        let inputs = layout.inputs as u32;
        let placed = |roots: &[ExprId], slots: Vec<u32>, width: usize| {
            straight_line(graph, roots, &slots, width, |e, node| match node {
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
            prepare: straight_line(graph, &known, &in_order, known.len(), |_, node| match node {
                Node::Leaf(Leaf::Param(k)) => Some(Operand::Known(k)),
                _ => None,
            }),
            rates: body(&rates),
            rates_and_partials: placed(&full_rates, in_stage, stage.width),
            outputs: body(&outputs),
            outputs_and_partials: body(&full_outputs),
            by_input: body(&by_input),
            events: body(&events[..layout.event_rows()]),
            events_and_partials: body(&events),
            rates_by_time: {
                let rows = d.rates_by_time.pattern.entries().map(|(_, i, _)| i as u32).collect();
                let cut = !events.is_empty() || !layout.limited.is_empty();
                placed(by_time, rows, if cut { layout.states } else { 0 })
            },
            layout,
        }
    }
}

/// The guards of all events, or the switching functions of the rates, the values that events set, and all partials of these.
fn events(model: &Model, d: &Derivatives) -> Vec<ExprId> {
    let list = model.events();
    let mut all: Vec<ExprId> = list.iter().map(|event| event.guard).collect();
    all.extend_from_slice(&d.kinks);
    all.extend(list.iter().flat_map(|event| event.resets.iter().map(|(_, value)| *value)));
    for jacobian in [&d.events.state, &d.events.input, &d.events.param, &d.events_by_time] {
        all.extend_from_slice(&jacobian.entries);
    }
    all
}

/// Where the values that events set stand.
fn event_rows(model: &Model) -> Vec<EventRow> {
    let list = model.events();
    let mut first = list.len();
    let row = |event: &crate::model::Event| {
        let states: Vec<u32> = event.resets.iter().map(|(state, _)| *state).collect();
        first += states.len();
        EventRow { first: first - states.len(), states }
    };
    list.iter().map(row).collect()
}

/// Expressions as one program, whose `known` array is the parameters themselves; `inputs` is the number of inputs in front
/// of the delayed signals in the drive.
pub fn program(graph: &Graph, roots: &[ExprId], inputs: usize) -> Program {
    let slots: Vec<u32> = (0..roots.len() as u32).collect();
    straight_line(graph, roots, &slots, roots.len(), |_, node| match node {
        Node::Leaf(Leaf::Time) => Some(Operand::Time),
        Node::Leaf(Leaf::State(k)) => Some(Operand::State(k)),
        Node::Leaf(Leaf::Input(k)) => Some(Operand::Drive(k)),
        Node::Leaf(Leaf::Delayed(k)) => Some(Operand::Drive(inputs as u32 + k)),
        Node::Leaf(Leaf::Param(k)) => Some(Operand::Known(k)),
        Node::Apply(..) | Node::Constant(_) => None,
    })
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
    let limits = append(&mut model.limits().flat_map(|(_, l)| [l.lower, l.upper]));
    let limits_by_param = append(&mut d.limits.entries.iter().copied());

    let varies = graph.depends(|leaf| !matches!(leaf, Leaf::Param(_)));
    // a list is no number: its elements are known one by one
    let is_list = |e: ExprId| matches!(graph.node(e), Node::Apply(Op::List, _));
    let is_known = |e: ExprId| !varies[e.index()] && graph.constant(e).is_none() && !is_list(e);
    let mut wanted = vec![false; graph.nodes().len()];
    bodies.iter().for_each(|r| wanted[r.index()] = true);
    for k in (0..wanted.len()).rev() {
        if wanted[k] && (varies[k] || is_list(ExprId(k as u32))) {
            graph.operands(ExprId(k as u32)).iter().for_each(|a| wanted[a.index()] = true);
        }
    }
    known.extend((0..wanted.len() as u32).map(ExprId).filter(|e| wanted[e.index()] && is_known(*e)));

    let layout = Layout {
        states: model.states.len(),
        inputs: model.inputs.len(),
        params: model.params.len(),
        outputs: model.outputs.len(),
        first: first_samples(model),
        vanishing: model.vanishing().collect(),
        wraps: wraps(model),
        delayed: graph.delayed().iter().map(|s| s.signal).collect(),
        known: known.len(),
        initial,
        tau,
        initial_by_param,
        tau_by_param,
        derived,
        limited: model.limits().map(|(k, _)| k as u32).collect(),
        limits,
        limits_by_param,
        events: event_rows(model),
        kinks: d.kinks.len(),
        stage: StageRow::new(model, &d.rates.state.pattern, &d.rates.delayed.pattern),
        observed: model.outputs.iter().map(|o| observed(graph, o.expr)).collect(),
        affine: Affine::of(model),
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
            limits_by_param: d.limits.pattern.clone(),
            events_by_state: d.events.state.pattern.clone(),
            events_by_input: d.events.input.pattern.clone(),
            events_by_param: d.events.param.pattern.clone(),
            events_by_time: d.events_by_time.pattern.clone(),
        },
    };
    (known, layout)
}

fn first_samples(model: &Model) -> Vec<(u32, u32)> {
    let params = model.params.iter().enumerate();
    let sample = |(k, p): (usize, &crate::model::Param)| match p.origin {
        Origin::FirstSample(input) => Some((k as u32, input)),
        _ => None,
    };
    params.filter_map(sample).collect()
}

fn wraps(model: &Model) -> Vec<(u32, f64)> {
    model.outputs.iter().enumerate().filter_map(|(k, o)| Some((k as u32, o.wrap?))).collect()
}

fn observed(graph: &Graph, e: ExprId) -> Option<u32> {
    match graph.node(e) {
        Node::Leaf(Leaf::State(k)) => Some(k),
        _ => None,
    }
}

/// What is affine; time must not occur in it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Affine {
    /// Whether all rates are.
    pub rates: bool,
    /// Which outputs are (q).
    pub outputs: Vec<bool>,
}

/// How an expression depends on what varies during a run; in this order, each includes those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Degree {
    /// Parameters and constants alone.
    Known,
    Affine,
    Other,
}

impl Affine {
    /// Looks at every equation of a model.
    pub fn of(model: &Model) -> Self {
        let degrees = degrees(&model.graph);
        let affine = |e: ExprId| degrees[e.index()] <= Degree::Affine;
        Self {
            rates: model.states.iter().all(|s| affine(s.rate) && s.limits.is_none() && s.resets.is_empty()),
            outputs: model.outputs.iter().map(|o| affine(o.expr)).collect(),
        }
    }
}

/// For each node whether it is affine.
pub(crate) fn affine_nodes(graph: &Graph) -> Vec<bool> {
    degrees(graph).into_iter().map(|d| d <= Degree::Affine).collect()
}

fn degrees(graph: &Graph) -> Vec<Degree> {
    let mut degrees: Vec<Degree> = Vec::with_capacity(graph.nodes().len());
    for node in graph.nodes() {
        let degree = match node {
            Node::Constant(_) | Node::Leaf(Leaf::Param(_)) => Degree::Known,
            Node::Leaf(Leaf::Time) => Degree::Other,
            Node::Leaf(_) => Degree::Affine,
            Node::Apply(op, args) => combined(*op, args, &degrees),
        };
        degrees.push(degree);
    }
    degrees
}

fn combined(op: Op, args: &Args, degrees: &[Degree]) -> Degree {
    let of = |k: usize| degrees[args[k].index()];
    let highest = (0..op.row().arity).map(of).max().unwrap_or(Degree::Known);
    let affine = match op {
        Op::Add | Op::Sub | Op::Neg => highest == Degree::Affine,
        Op::Mul => highest == Degree::Affine && (of(0) == Degree::Known || of(1) == Degree::Known),
        Op::Div => of(0) == Degree::Affine && of(1) == Degree::Known,
        Op::Select => of(0) == Degree::Known && highest == Degree::Affine,
        _ => false,
    };
    match highest {
        Degree::Known => Degree::Known,
        _ if affine => Degree::Affine,
        _ => Degree::Other,
    }
}

#[cfg(test)]
mod affine_tests {
    use crate::schedule::Schedule;
    use crate::source::Source;

    fn affine(equations: &str) -> (bool, Vec<bool>) {
        let text = format!("model m {{ input u; param a = 1, b = 2; state x, z; {equations} }}");
        let compiled = crate::compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}"));
        let schedule: &Schedule = &compiled.schedule;
        (schedule.layout.affine.rates, schedule.layout.affine.outputs.clone())
    }

    #[test]
    fn coefficients_may_be_any_function_of_parameters() {
        let (rates, outputs) = affine(
            "der(x) = sin(a)*x - z/(a^2 + 1) + (if a > b then u else 2*u); der(z) = -(x + delay(u, 0.1)) + exp(b); \
             output y1 = x*a + 3; output y2 = x*z; output y3 = abs(x); output y4 = u;",
        );
        assert!(rates);
        assert_eq!(outputs, [true, false, false, true]);
    }

    #[test]
    fn products_signs_decisions_and_time_are_not_affine() {
        for bad in ["x*u", "a/x", "sign(x)", "if x > 0 then 1 else 2", "t*a", "x^2", "min(x, 1)"] {
            let (rates, _) = affine(&format!("der(x) = -x + {bad}; der(z) = -z; output y = x;"));
            assert!(!rates, "{bad}");
        }
    }
}
