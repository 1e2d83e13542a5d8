//! Syntax tree to model: what every name means, what every value may be, which equation belongs to which state,
//! whether the units agree.
//!
//! **In** a [`SyntaxTree`]. **Out** a [`Model`] with warnings, or every mistake that can be found.
//! **Never** stops at the first mistake, never tells its consequences as mistakes of their own (what depends on
//! something broken is broken and silent), and never recurses: the nodes of the text stand in an order in which
//! operands come first, and blocks of them are sorted so that every name is defined before it is used.
//! **Start** at [`check`]; it is the list of passes.

mod argument_units;
mod beginnings;
mod declarations;
mod delays;
mod elimination;
pub mod equations;
mod expressions;
mod functions;
mod influence;
mod interpolation;
mod kinds;
mod knowledge;
mod limits;
mod measures;
mod model;
mod names;
mod order;
mod rates;
mod reach;
mod remedies;
mod scope;
mod start;
mod stated;
mod substitution;
mod tables;
mod ties;
mod units;

#[cfg(test)]
mod tests;

pub use functions::{function_form, function_forms, function_names};
pub use scope::reserved;

use crate::diagnostic::{Code, Diagnostic};
use crate::model::Model;
use crate::syntax::{Role, SyntaxTree};
use expressions::{Expressions, Indices};
use kinds::Kinds;
use order::Blocks;
use scope::Scope;

/// Checks a model as written.
///
/// # Errors
/// Every mistake and warning in the order of the text; at least one of them is an error, unless statements are
/// missing from the tree because the parser could not read (and has told) them: such a tree never makes a model.
pub fn check(tree: &SyntaxTree) -> Result<(Model, Vec<Diagnostic>), Vec<Diagnostic>> {
    let mut findings = Vec::new();
    let model = passes(tree, &mut findings);
    findings.sort_by_key(|f| (f.span, f.code));
    findings.dedup();
    match model {
        Some(model) => Ok((model, findings)),
        None => Err(findings),
    }
}

fn passes(tree: &SyntaxTree, findings: &mut Vec<Diagnostic>) -> Option<Model> {
    let tables = tables::declarations(tree);
    let mut scope = Scope::new(tree, &tables, findings);
    let equations = equations::read(&mut scope, findings);
    let scope = &scope;
    declarations::attributes(scope, findings);
    outputs(scope, findings);

    let known = knowledge::read(scope, findings);
    let bonds = ties::read(scope, findings);
    let mut blocks = Blocks::new(scope, &equations, &bonds, &known);
    let meanings = names::resolve(scope, &blocks, findings);
    let circular = order::sort(scope, &mut blocks, &meanings, findings);
    let kinds = Kinds::new(scope, &blocks, &meanings, &circular, &known, findings);
    let indices = Indices::new(scope, &meanings, &kinds);

    let mut expressions = Expressions::new(scope, &blocks, &meanings, &kinds, &indices, findings);
    let ranges = declarations::ranges(scope, &kinds, &indices, &expressions, findings);
    ties::check(scope, &kinds, &bonds, &known, findings);
    tables::check(scope, &kinds, &expressions, findings);
    tables::smoothness(scope, &kinds, findings);
    let mut params = model::params(scope, &kinds, &indices, &ranges);
    model::first_samples(scope, &indices, &expressions, &mut params);
    let start = model::start(&params);
    let limits = limits::read(scope, &kinds, &indices, &expressions, &known, &start, findings);
    let rates = rates::solve(scope, &equations, &kinds, &indices, &mut expressions, (&params, &limits), findings);
    let resets = limits::read_event(scope, &kinds, &indices, &mut expressions, &known, findings);
    let mut knowledge = knowledge::values(scope, &kinds, &indices, &expressions, &known, findings);
    knowledge.resets = resets;
    start::check(scope, &kinds, &expressions, &known, &start, findings);
    let checked = units::Checked {
        scope,
        blocks: &blocks,
        equations: &equations,
        known: &known,
        meanings: &meanings,
        kinds: &kinds,
        expressions: &expressions,
    };
    units::check(&checked, findings);

    // what is not read yet, or misspelt, may well be used
    let guess = |f: &Diagnostic| GUESSED.contains(&f.code);
    if !scope.is_partial() && !findings.iter().any(guess) {
        influence::unused(scope, &blocks, &meanings, &kinds, findings);
    }
    if scope.is_partial() || findings.iter().any(Diagnostic::is_error) {
        return None;
    }
    let ties = model::ties(&blocks, &indices, &expressions);
    let model = model::assemble(scope, &rates, &kinds, &indices, expressions, (params, ties), knowledge);
    limits::without_delays(scope, &model, findings);
    beginnings::circular(scope, &model, findings);
    let tied = ties::tied(scope, &model, &bonds, findings);
    influence::without_influence(scope, &blocks, &meanings, &tied, findings);
    (!findings.iter().any(Diagnostic::is_error)).then_some(model)
}

/// Mistakes behind which anything may be meant, so that what nothing uses may well be used there.
const GUESSED: [Code; 5] =
    [Code::UnknownName, Code::UnknownFunction, Code::ArgumentCount, Code::NotADerivative, Code::Unsupported];

fn outputs(scope: &Scope<'_>, findings: &mut Vec<Diagnostic>) {
    if !scope.is_partial() && !scope.symbols.iter().any(|s| s.role == Role::Output) {
        let name = &scope.tree.name;
        let message = format!("the model `{}` has no output", name.text);
        let finding = Diagnostic::new(Code::NoOutput, name.span, message);
        findings.push(finding.hint("`output y = ...;` says what is measured"));
    }
}
