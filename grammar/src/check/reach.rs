//! What names stand for, seen from the text alone: whether a derivative, or a state, is in an expression or in a definition that
//! it refers to.

use super::order::each_operand;
use super::scope::{Scope, SymbolId};
use crate::syntax::{Expr, ExprRef, Role, Value};

/// By symbol, what its definition contains.
pub(super) struct Reach {
    derivative: Vec<bool>,
    state: Vec<bool>,
}

impl Reach {
    /// Looks at every `let` and every output.
    pub(super) fn new(scope: &Scope<'_>) -> Self {
        let count = scope.symbols.len();
        let mut reach = Self { derivative: vec![false; count], state: vec![false; count] };
        let mut users: Vec<Vec<SymbolId>> = vec![Vec::new(); count];
        for (s, symbol) in scope.valid() {
            reach.state[s] = symbol.role == Role::State;
            let (Role::Let | Role::Output, Some(Value::Expr(root))) = (symbol.role, symbol.declaration.value) else {
                continue;
            };
            each_node(scope, root, |e| match e {
                Expr::Call(name, _) if name.text == "der" => reach.derivative[s] = true,
                Expr::Name(name) => {
                    if let Some(used) = scope.find(name) {
                        users[used].push(s);
                    }
                }
                _ => {}
            });
        }
        spread(&users, &mut reach.derivative);
        spread(&users, &mut reach.state);
        reach
    }

    /// Whether an expression contains a derivative.
    pub(super) fn derivative(&self, scope: &Scope<'_>, root: ExprRef) -> bool {
        let mut found = false;
        each_node(scope, root, |e| {
            found |= match e {
                Expr::Call(name, _) => name.text == "der",
                Expr::Name(name) => scope.find(name).is_some_and(|s| self.derivative[s]),
                _ => false,
            };
        });
        found
    }

    /// Whether an expression contains a state.
    pub(super) fn state(&self, scope: &Scope<'_>, root: ExprRef) -> bool {
        let mut found = false;
        each_node(scope, root, |e| {
            found |= matches!(e, Expr::Name(name) if scope.find(name).is_some_and(|s| self.state[s]));
        });
        found
    }
}

/// Marks all users of what is marked.
fn spread(users: &[Vec<SymbolId>], marked: &mut [bool]) {
    let mut open: Vec<SymbolId> = (0..marked.len()).filter(|s| marked[*s]).collect();
    while let Some(s) = open.pop() {
        for user in &users[s] {
            if !std::mem::replace(&mut marked[*user], true) {
                open.push(*user);
            }
        }
    }
}

/// Visits a node and all below it.
pub(super) fn each_node<'a>(scope: &Scope<'a>, root: ExprRef, mut visit: impl FnMut(&'a Expr)) {
    let tree = scope.tree;
    let mut open = vec![root];
    while let Some(e) = open.pop() {
        visit(tree.expr(e));
        each_operand(tree.expr(e), |operand| open.push(operand));
    }
}
