//! How far states may go: `limit x in [a, b];`, `limit x in [a, b] smooth w;`.
//!
//! All rates see a state whose limits are hard inside them. A simulation cuts an explicit step where the state meets its limit, holds it
//! there while its rate pushes outwards, and cuts it again where that ends. Implicit steps, and those of models with events or delays,
//! move it as if there were no limits and take it back at their end, with the limit's own sensitivity. Elsewhere `der(x)` means the derivative that the state has: zero at a limit while
//! the rate pushes outwards. A smooth limit is an expression: the outward part of the rate fades out over the width.
//!
//! Events: `when x > limit { v = -0.5*v; }`. A condition that becomes true gives states new values.
//!
//! A condition becomes a guard, a number that passes zero upwards when the condition becomes true: `a > b` is `a - b`, `and` the lesser of
//! two guards, `or` the greater. So the instant is a root, and its derivatives are those of the guard. At equality a
//! condition is neither here nor there: `>` and `>=` are the same event.

use super::expressions::{Expressions, Indices};
use super::kinds::Kinds;
use super::scope::{Scope, SymbolId};
use super::start;
use super::stated::{Known, Part};
use crate::diagnostic::{Code, Diagnostic};
use crate::graph::{Graph, Leaf, Reference, Signal};
use crate::model::{Model, Origin, Output, Param, Reset, State};
use crate::op::{Build, ExprId, Op};
use crate::syntax::{BinarySign, Expr, ExprRef, Role, StatementKind, UnarySign};

/// The limits of a state, expressions of parameters.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limit {
    pub(super) lower: ExprId,
    pub(super) upper: ExprId,
    /// Over which width the rate fades out; `None` for a hard stop.
    pub(super) width: Option<ExprId>,
}

/// The limits by state of the model; those that leave no room at the start values (by param of the model) are told.
pub(super) fn read(
    scope: &Scope<'_>,
    kinds: &Kinds,
    indices: &Indices,
    expressions: &Expressions,
    known: &[Known],
    start: &[f64],
    findings: &mut Vec<Diagnostic>,
) -> Vec<Option<Limit>> {
    let mut limits = vec![None; scope.valid().filter(|(_, s)| s.role == Role::State).count()];
    let values = start::values(&expressions.graph, start);
    let of = |s: SymbolId, part: Part| known.iter().find(|k| k.symbol == s && k.part == part).map(|k| k.root);
    for k in known.iter().filter(|k| k.part == Part::Lower) {
        let (Some(upper), width) = (of(k.symbol, Part::Upper), of(k.symbol, Part::Width)) else { continue };
        if [k.root, upper].into_iter().chain(width).any(|e| kinds.of(e).broken) {
            continue;
        }
        let [lower, upper_e] = [k.root, upper].map(|e| expressions.of(e));
        let (a, b) = (values[lower.index()], values[upper_e.index()]);
        let name = scope.symbols[k.symbol].name();
        // what is not a number has been told
        if a >= b {
            let message = format!("the limits [{a}, {b}] of `{name}` leave no room");
            let finding = Diagnostic::new(Code::BadBounds, scope.tree.span(k.root), message);
            findings.push(match a > b {
                true => finding.hint(format!("`limit {name} in [{b}, {a}];`")),
                false => finding.hint("what does not move is a `const` or a `param`"),
            });
        }
        let width = width.map(|e| (e, expressions.of(e)));
        if let Some((root, e)) = width
            && (values[e.index()] <= 0.0 || values[e.index()] > 0.5 * (b - a))
        {
            let (w, most) = (values[e.index()], 0.5 * (b - a));
            let message = format!("the width of the limits of `{name}` is {w}, and must be above 0 and at most {most}");
            let finding = Diagnostic::new(Code::BadBounds, scope.tree.span(root), message);
            findings.push(finding.hint("without `smooth` the state stops at once"));
        }
        limits[indices.of[k.symbol] as usize] = Some(Limit { lower, upper: upper_e, width: width.map(|(_, e)| e) });
    }
    limits
}

impl Limit {
    /// This limit in another graph.
    pub(super) fn moved<E>(self, mut to: impl FnMut(ExprId) -> Result<ExprId, E>) -> Result<Self, E> {
        let width = self.width.map(&mut to).transpose()?;
        Ok(Self { lower: to(self.lower)?, upper: to(self.upper)?, width })
    }

    /// The rate that a simulation is given: faded out before smooth limits.
    pub(super) fn faded(self, graph: &mut Graph, state: u32, rate: ExprId) -> ExprId {
        let Some(width) = self.width else { return rate };
        let (x, zero) = (graph.leaf(Leaf::State(state)), graph.number(0.0));
        let mut outward = |room: [ExprId; 2], op: Op| {
            // 3 u^2 - 2 u^3 of what is left of the width: its slope vanishes at both ends
            let room = graph.apply(Op::Sub, &room);
            let (one, two, three) = (graph.number(1.0), graph.number(2.0), graph.number(3.0));
            let part = graph.apply(Op::Div, &[room, width]);
            let part = graph.apply(Op::Max, &[part, zero]);
            let part = graph.apply(Op::Min, &[part, one]);
            let (square, twice) = (graph.apply(Op::Mul, &[part, part]), graph.apply(Op::Mul, &[two, part]));
            let rest = graph.apply(Op::Sub, &[three, twice]);
            let fade = graph.apply(Op::Mul, &[square, rest]);
            let outward = graph.apply(op, &[rate, zero]);
            graph.apply(Op::Mul, &[fade, outward])
        };
        let up = outward([self.upper, x], Op::Max);
        let down = outward([x, self.lower], Op::Min);
        graph.apply(Op::Add, &[up, down])
    }

    /// The derivative that a state has beside its (faded) rate: zero at a hard limit while the rate pushes outwards.
    pub(super) fn held(self, graph: &mut Graph, state: u32, rate: ExprId) -> ExprId {
        if self.width.is_some() {
            return rate;
        }
        let (x, zero) = (graph.leaf(Leaf::State(state)), graph.number(0.0));
        let mut held = rate;
        for (at, op) in [([x, self.lower], Op::Max), ([self.upper, x], Op::Min)] {
            let there = graph.apply(Op::LessEqual, &at);
            let inward = graph.apply(op, &[rate, zero]);
            held = graph.apply(Op::Select, &[there, inward, held]);
        }
        held
    }
}

/// Puts hard limits into effect: runs begin inside, and rates and delays see the state inside, also in the middle of a step that
/// reaches a limit.
pub(super) fn stop(model: &mut Model) {
    if model.states.iter().all(|s| s.limits.is_none()) {
        return;
    }
    let mut graph = Graph::default();
    let mut limits = Vec::with_capacity(model.states.len());
    for state in &model.states {
        let of = |l: crate::model::Limits| model.graph.rebuild(&[l.lower, l.upper], &mut graph, Graph::reference);
        limits.push(state.limits.map(of));
    }
    let inside = |g: &mut Graph, e: ExprId, k: u32| match limits.get(k as usize).and_then(Option::as_deref) {
        Some(&[lower, upper]) => {
            let above = g.apply(Op::Max, &[e, lower]);
            g.apply(Op::Min, &[above, upper])
        }
        _ => e,
    };
    let rates: Vec<ExprId> = model.states.iter().map(|s| s.rate).collect();
    let rates = model.graph.rebuild(&rates, &mut graph, |g, reference| {
        let e = g.reference(reference);
        match reference {
            Reference::Now(Leaf::State(k)) | Reference::Earlier(Signal::State(k), _) => inside(g, e, k),
            _ => e,
        }
    });
    let states = model.states.iter().flat_map(State::beside_rate);
    let others = states.chain(model.outputs.iter().flat_map(Output::expressions));
    let others = others.chain(model.derived.iter().map(|d| d.expr)).chain(model.ties.iter().map(|t| t.expr));
    let others: Vec<ExprId> = others.chain(model.trim.iter().map(|(_, e)| *e)).collect();
    // at a sample a state is inside
    let others = model.graph.rebuild(&others, &mut graph, |g, reference| {
        let e = g.reference(reference);
        if let Reference::Earlier(Signal::State(k), _) = reference { inside(g, e, k) } else { e }
    });
    model.states.iter_mut().zip(rates).for_each(|(s, rate)| s.rate = rate);
    let states = model.states.iter_mut().flat_map(State::beside_rate_mut);
    let places = states.chain(model.outputs.iter_mut().flat_map(Output::expressions_mut));
    let places = places.chain(model.derived.iter_mut().map(|d| &mut d.expr));
    let places = places.chain(model.ties.iter_mut().map(|t| &mut t.expr));
    let places = places.chain(model.trim.iter_mut().map(|(_, e)| e));
    places.zip(others).for_each(|(e, new)| *e = new);
    for (k, state) in model.states.iter_mut().enumerate() {
        let (Some(limits), begin) = (state.limits, state.initial) else { continue };
        state.initial = inside(&mut graph, begin, k as u32);
        // an initial value outside would be moved by nothing
        let free = |p: &&mut Param| p.origin == Origin::FreeInitial(k as u32);
        if let Some(param) = model.params.iter_mut().find(free) {
            let constant = |e: ExprId| graph.constant(e);
            param.lower = constant(limits.lower).unwrap_or(param.lower);
            param.upper = constant(limits.upper).unwrap_or(param.upper);
            param.value = param.value.max(param.lower).min(param.upper);
        }
    }
    model.graph = graph;
}

/// By state of the model what events make of it, in the order of the text.
pub(super) fn read_event(
    scope: &Scope<'_>,
    kinds: &Kinds,
    indices: &Indices,
    expressions: &mut Expressions,
    known: &[Known],
    findings: &mut Vec<Diagnostic>,
) -> Vec<(u32, Reset)> {
    let mut resets = Vec::new();
    for condition in known {
        let Part::Condition(event) = condition.part else { continue };
        if kinds.of(condition.root).broken {
            continue;
        }
        let guard = match guard(scope, expressions, condition.root) {
            Ok(guard) => guard,
            Err(finding) => {
                findings.push(*finding);
                continue;
            }
        };
        if expressions.graph.constant(guard).is_some() {
            let message = "this condition never changes, so that the event never happens";
            let finding = Diagnostic::new(Code::Unsupported, scope.tree.span(condition.root), message);
            findings.push(finding.hint("compare a state, an input or the time, as in `when x > limit { v = 0; }`"));
            continue;
        }
        let own = known.iter().filter(|k| k.part == Part::Reset(event) && !kinds.of(k.root).broken);
        for k in own {
            let reset = Reset { event: event as u32, guard, value: expressions.of(k.root) };
            resets.push((indices.of[k.symbol], reset));
        }
    }
    resets
}

/// What passes zero upwards when a condition becomes true.
fn guard(scope: &Scope<'_>, expressions: &mut Expressions, root: ExprRef) -> Result<ExprId, Box<Diagnostic>> {
    // no recursion: parts of the condition, operands first
    let (mut open, mut order) = (vec![root], Vec::new());
    while let Some(e) = open.pop() {
        order.push(e);
        match scope.tree.expr(e) {
            Expr::Unary(UnarySign::Not, a) => open.push(*a),
            Expr::Binary(BinarySign::And | BinarySign::Or, a, b, _) => open.extend([*a, *b]),
            _ => {}
        }
    }
    let mut guards: Vec<(ExprRef, ExprId)> = Vec::new();
    for e in order.into_iter().rev() {
        let of = |e: &ExprRef| guards.iter().rev().find(|(own, _)| own == e).map(|(_, guard)| *guard);
        let made = match scope.tree.expr(e) {
            Expr::Unary(UnarySign::Not, a) => of(a).map(|a| expressions.graph.apply(Op::Neg, &[a])),
            Expr::Binary(sign @ (BinarySign::And | BinarySign::Or), a, b, _) => {
                let op = if *sign == BinarySign::And { Op::Min } else { Op::Max };
                of(a).zip(of(b)).map(|(a, b)| expressions.graph.apply(op, &[a, b]))
            }
            Expr::Binary(BinarySign::Greater | BinarySign::GreaterEqual, a, b, _) => {
                let sides = [expressions.of(*a), expressions.of(*b)];
                Some(expressions.graph.apply(Op::Sub, &sides))
            }
            Expr::Binary(BinarySign::Less | BinarySign::LessEqual, a, b, _) => {
                let sides = [expressions.of(*b), expressions.of(*a)];
                Some(expressions.graph.apply(Op::Sub, &sides))
            }
            _ => None,
        };
        let Some(made) = made else {
            let message = "an event happens when something passes something else: its condition is made of `<`, `>`, `and`, `or`, `not`";
            let finding = Diagnostic::new(Code::Unsupported, scope.tree.span(e), message);
            return Err(Box::new(finding.hint("`when x > limit { v = -0.5*v; }`")));
        };
        guards.push((e, made));
    }
    Ok(guards.last().map_or(expressions.nothing, |(_, guard)| *guard))
}

/// Tells events beside delays: what is delayed would have the jumps of an earlier event in the middle of its steps.
pub(super) fn without_delays(scope: &Scope<'_>, model: &Model, findings: &mut Vec<Diagnostic>) {
    if model.graph.delayed().is_empty() || !model.has_events() {
        return;
    }
    let event = |s: &&crate::syntax::Statement| matches!(s.kind, StatementKind::When(_));
    let span = scope.tree.statements.iter().find(event).map_or(scope.tree.name.span, |s| s.span);
    let message = "this model has a delay, and the integrator of events knows no delays";
    let finding = Diagnostic::new(Code::Unsupported, span, message);
    findings.push(finding.hint("shift the delayed record itself, or write a smooth lag: `der(z) = (u - z)/T;`"));
}
