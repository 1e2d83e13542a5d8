//! Declarations that nothing uses, and parameters that no output depends on.

use super::kinds::Kinds;
use super::order::{Blocks, Owner};
use super::scope::{Meaning, Scope, SymbolId};
use crate::diagnostic::{Code, Diagnostic};
use crate::graph::{Leaf, Node, Signal};
use crate::model::{Model, Origin, Output};
use crate::op::ExprId;
use crate::syntax::{Role, Value};

/// Warns of inputs, params, consts and lets that no other expression mentions.
pub(super) fn unused(
    scope: &Scope<'_>,
    blocks: &Blocks,
    meanings: &[Meaning],
    kinds: &Kinds,
    findings: &mut Vec<Diagnostic>,
) {
    let used = mentioned(scope, blocks, meanings);
    for (s, symbol) in scope.valid().filter(|(s, _)| !used[*s]) {
        // states and outputs speak for themselves; a param that others define is there to be reported
        if matches!(symbol.role, Role::State | Role::Output) || kinds.derived[s] {
            continue;
        }
        let name = &symbol.declaration.name;
        let message = format!("the {} `{}` is not used", symbol.role.keyword(), name.text);
        findings.push(Diagnostic::new(Code::Unused, name.span, message).hint("remove it or use it in an equation"));
    }
}

/// For each symbol whether an expression that is not its own mentions it.
fn mentioned(scope: &Scope<'_>, blocks: &Blocks, meanings: &[Meaning]) -> Vec<bool> {
    let mut used = vec![false; scope.symbols.len()];
    for block in &blocks.list {
        let own = match block.owner {
            Owner::Value(s) | Owner::Lower(s) | Owner::Upper(s) | Owner::Tie(s) => Some(s),
            Owner::Abscissa(s, _) | Owner::Ordinate(s) | Owner::Like(s) | Owner::Want(s, _) => Some(s),
            Owner::Left(_) | Owner::Right(_) | Owner::Known(_) | Owner::Limit(_) => None,
        };
        for e in blocks.nodes(block) {
            if let Meaning::Symbol(s) | Meaning::Table(s) = meanings[e.0 as usize] {
                used[s] |= own != Some(s);
            }
        }
    }
    used
}

/// Warns of free parameters that no output depends on, directly or through states and delays. Parameters that
/// nothing mentions at all have been told.
pub(super) fn without_influence(
    scope: &Scope<'_>,
    blocks: &Blocks,
    meanings: &[Meaning],
    model: &Model,
    findings: &mut Vec<Diagnostic>,
) {
    let reached = reached_params(model);
    let used = mentioned(scope, blocks, meanings);
    let state = |k: u32| model.states.get(k as usize).and_then(|s| scope.find(&s.quantity.name));
    for (k, param) in model.params.iter().enumerate().filter(|(k, p)| !reached[*k] && !p.fixed) {
        let symbol: Option<SymbolId> = match param.origin {
            Origin::Declared => scope.find(&param.quantity.name).filter(|s| used[*s]),
            Origin::FreeInitial(k) => state(k),
            Origin::FirstSample(_) => None,
        };
        let Some(declaration) = symbol.map(|s| scope.symbols[s].declaration) else { continue };
        let span = match (param.origin, declaration.value) {
            (Origin::FreeInitial(_), Some(Value::Free(span))) => span,
            _ => declaration.name.span,
        };
        let message = format!("no output depends on `{}`, so it cannot be estimated", model.params[k].quantity.name);
        let finding = Diagnostic::new(Code::NoInfluence, span, message);
        findings.push(match param.origin {
            Origin::Declared | Origin::FirstSample(_) => {
                finding.hint("make it `fixed` or add an output that depends on it")
            }
            Origin::FreeInitial(_) => {
                finding.hint("give the state an initial value or add an output that depends on it")
            }
        });
    }
}

/// Which parameters the outputs, the trim and the noise depend on.
fn reached_params(model: &Model) -> Vec<bool> {
    let graph = &model.graph;
    let mut reached = vec![false; model.params.len()];
    let mut seen = vec![false; graph.nodes().len()];
    // what the trim depends on moves the coefficients of the linearised model
    let trim = model.trim.iter().map(|(_, e)| *e);
    // and the intensity of a noise how far the measurement strays from the outputs
    let noise = model.states.iter().filter_map(|s| s.noise);
    let mut open: Vec<ExprId> = model.outputs.iter().flat_map(Output::expressions).chain(trim).chain(noise).collect();
    while let Some(e) = open.pop() {
        if std::mem::replace(&mut seen[e.index()], true) {
            continue;
        }
        let mut state = |k: u32| {
            let state = &model.states[k as usize];
            let limits = state.limits.into_iter().flat_map(|l| [l.lower, l.upper]);
            open.extend([state.rate, state.initial].into_iter().chain(limits).chain(state.of_events()));
        };
        match graph.node(e) {
            Node::Leaf(Leaf::Param(k)) => reached[k as usize] = true,
            Node::Leaf(Leaf::State(k)) => state(k),
            Node::Leaf(Leaf::Delayed(k)) => {
                let delayed = graph.delayed()[k as usize];
                if let Signal::State(k) = delayed.signal {
                    state(k);
                }
                open.push(delayed.tau);
            }
            _ => open.extend_from_slice(graph.operands(e)),
        }
    }
    reached
}
