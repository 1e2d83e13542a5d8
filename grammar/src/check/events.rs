//! Events: `when x > limit { v = -0.5*v; }`. A condition that becomes true gives states new values.
//!
//! A condition becomes a guard, a number that passes zero upwards when the condition becomes true: `a > b` is `a - b`, `and` the lesser of
//! two guards, `or` the greater. So the instant is a root, and its derivatives are those of the guard. At equality a
//! condition is neither here nor there: `>` and `>=` are the same event.

use super::expressions::{Expressions, Indices};
use super::kinds::Kinds;
use super::scope::Scope;
use super::stated::{Known, Part};
use crate::diagnostic::{Code, Diagnostic};
use crate::model::{Model, Reset};
use crate::op::{Build, ExprId, Op};
use crate::syntax::{BinarySign, Expr, ExprRef, StatementKind, UnarySign};

/// By state of the model what events make of it, in the order of the text.
pub(super) fn read(
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
