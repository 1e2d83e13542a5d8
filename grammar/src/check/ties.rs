//! `tie Lq = Mp;`: which params are tied, and whether they may be.

use super::kinds::Kinds;
use super::scope::Scope;
use super::start;
use super::stated::{Bond, Known, Part};
use crate::diagnostic::{Code, Diagnostic};
use crate::graph::Leaf;
use crate::model::{Model, Tie};
use crate::source::Span;
use crate::syntax::{Name, Role, StatementKind};

/// Reads all ties; a param has one at most.
pub(super) fn read(scope: &Scope<'_>, findings: &mut Vec<Diagnostic>) -> Vec<Bond> {
    let mut bonds: Vec<Bond> = Vec::new();
    let mut first: Vec<Option<Span>> = vec![None; scope.symbols.len()];
    let mut guesses = 0;
    let lists = scope.tree.statements.iter().filter_map(|s| match &s.kind {
        StatementKind::Tie(list) => Some(list),
        _ => None,
    });
    for (name, root) in lists.flatten() {
        let (subject, root) = (name.span, *root);
        let Some(symbol) = scope.find(&name.text) else {
            findings.extend(undeclared(scope, name, &mut guesses));
            continue;
        };
        if scope.symbols[symbol].role != Role::Param {
            let role = scope.symbols[symbol].role.keyword();
            let message = format!("a tie holds between params; `{}` is declared as {role}", name.text);
            findings.push(Diagnostic::new(Code::WrongName, subject, message).hint("`tie a = b;` where `a` is a param"));
        } else if let Some(earlier) = first[symbol] {
            let message = format!("`{}` is tied a second time", name.text);
            let finding = Diagnostic::new(Code::DeclaredTwice, subject, message).label(earlier, "first tied here");
            findings.push(finding.hint("remove one of them"));
        } else {
            first[symbol] = Some(subject);
            bonds.push(Bond { symbol, subject, root });
        }
    }
    bonds
}

fn undeclared(scope: &Scope<'_>, name: &Name, guesses: &mut usize) -> Option<Diagnostic> {
    if scope.is_suspended(&name.text) {
        return None;
    }
    *guesses += 1;
    let finding = Diagnostic::new(Code::UnknownName, name.span, format!("`{}` is not declared", name.text));
    let near = scope.nearest(&name.text, *guesses, |s| s.role == Role::Param);
    Some(near.into_iter().fold(finding, Diagnostic::hint))
}

/// Tells ties of params that are not free to follow, and priors that a tie leaves without use.
pub(super) fn check(scope: &Scope<'_>, kinds: &Kinds, bonds: &[Bond], known: &[Known], findings: &mut Vec<Diagnostic>) {
    for bond in bonds {
        let symbol = &scope.symbols[bond.symbol];
        let name = symbol.name();
        if kinds.derived[bond.symbol] {
            let message = format!("`{name}` is defined by other params already, so that it cannot be tied");
            let finding = Diagnostic::new(Code::WrongName, bond.subject, message);
            let finding = finding.label(symbol.declaration.name.span, "defined here");
            findings.push(finding.hint("declare it with a number, at which it starts while the tie is off"));
        } else if let Some(fixed) = symbol.declaration.fixed {
            let message = format!("`{name}` is fixed, so that it cannot be tied");
            let finding = Diagnostic::new(Code::WrongAttribute, bond.subject, message).label(fixed, "fixed here");
            findings.push(finding.hint("remove `fixed`: a tied param is not estimated by itself"));
        }
        let priors = known.iter().filter(|k| k.part == Part::Mean && k.symbol == bond.symbol);
        for prior in priors {
            let message = format!("the prior of `{name}` is not used while it is tied");
            let finding = Diagnostic::new(Code::Unused, scope.tree.span(prior.root), message);
            findings
                .push(finding.label(bond.subject, "tied here").hint("give priors for the params that it is tied to"));
        }
    }
}

/// What the ties say of the finished model, in which they are still open: that values in all runs come from values in all runs, and
/// that a tied param starts inside its bounds. The model with its ties on.
pub(super) fn tied(scope: &Scope<'_>, model: &Model, bonds: &[Bond], findings: &mut Vec<Diagnostic>) -> Model {
    let per_run = |k: u32| model.params[k as usize].per_run;
    let own = model.graph.depends(|leaf| matches!(leaf, Leaf::Param(k) if per_run(k)));
    let tied = model.tied(&[]);
    let values = start::values(&tied.graph, &tied.start());
    for Tie { param, expr } in &model.ties {
        let p = &model.params[*param as usize];
        let name = &p.quantity.name;
        let Some(bond) = bonds.iter().find(|b| scope.symbols[b.symbol].name() == name) else { continue };
        let place = scope.tree.span(bond.root);
        if own[expr.index()] && !p.per_run {
            let message = format!("`{name}` has one value for all runs, and is tied to what has one in every run");
            let finding = Diagnostic::new(Code::WrongAttribute, place, message);
            findings.push(finding.hint(format!("`param {name} = ... per run;`")));
        }
        let Some(derived) = tied.derived.iter().find(|d| d.quantity.name == *name) else { continue };
        let value = values[derived.expr.index()];
        if !value.is_finite() {
            let message = format!("what `{name}` is tied to is not finite at the start values of the params");
            findings.push(Diagnostic::new(Code::NotFinite, place, message).hint("choose other start values"));
        } else if value < p.lower || value > p.upper {
            let (lower, upper) = (p.lower, p.upper);
            let message = format!("`{name}` starts at {value} by this tie, outside its bounds [{lower}, {upper}]");
            let finding = Diagnostic::new(Code::OutsideBounds, place, message);
            findings.push(finding.hint("choose other start values, or widen the bounds"));
        }
    }
    tied
}
