//! `param k per group aircraft`, once the groups of the runs are known: a param for each group, `k[A]` and `k[B]`, and
//! `let k = (aircraft=A)*k[A] + (aircraft=B)*k[B]`, where `known aircraft=A` is 1 in the runs of its group and 0 in the others.

use crate::source::{Groups, Span};
use crate::syntax::{
    BinarySign, Declaration, Expr, ExprRef, Membership, Name, Role, Statement, StatementKind, SyntaxTree, Value,
};

/// What the value that says whether a run belongs to a group is called.
fn membership(grouping: &str, group: &str) -> String {
    format!("{grouping}={group}")
}

/// What the param of one group is called.
pub fn of_group(param: &str, group: &str) -> String {
    format!("{param}[{group}]")
}

/// Writes out the params of groupings that are known; the others stay params that all runs share.
pub(crate) fn write_out(mut tree: SyntaxTree, groups: &Groups) -> SyntaxTree {
    let mut shared: Vec<(String, Vec<String>)> = Vec::new();
    let mut used: Vec<&String> = Vec::new();
    let mut statements = Vec::with_capacity(tree.statements.len());
    for Statement { kind, span } in std::mem::take(&mut tree.statements) {
        let StatementKind::Declare(Role::Param, list) = kind else {
            statements.push(Statement { kind, span });
            continue;
        };
        let (mut params, mut sums) = (Vec::new(), Vec::new());
        for d in list {
            let known = d.group.as_ref().and_then(|g| groups.get_key_value(&g.text));
            let Some((grouping, names)) = known.filter(|(_, names)| !names.is_empty()) else {
                params.push(d);
                continue;
            };
            if !used.contains(&grouping) {
                used.push(grouping);
            }
            let own: Vec<String> = names.iter().map(|group| of_group(&d.name.text, group)).collect();
            sums.push(sum(&mut tree, &d, grouping, names));
            params.extend(own.iter().map(|name| Declaration {
                name: Name { text: name.clone(), span: d.name.span },
                group: None,
                ..d.clone()
            }));
            shared.push((d.name.text.clone(), own));
        }
        for (role, list) in [(Role::Param, params), (Role::Let, sums)] {
            if !list.is_empty() {
                statements.push(Statement { kind: StatementKind::Declare(role, list), span });
            }
        }
    }
    for grouping in used {
        let span = tree.name.span;
        let one = |group: &String| Declaration {
            membership: Some(Membership { grouping: grouping.clone(), group: group.clone() }),
            ..Declaration::new(Name { text: membership(grouping, group), span }, span)
        };
        let list = groups[grouping].iter().map(one).collect();
        statements.push(Statement { kind: StatementKind::Declare(Role::Known, list), span });
    }
    tree.statements = statements;
    believed(&mut tree, &shared);
    tree
}

/// `let k = (aircraft=A)*k[A] + ...`
fn sum(tree: &mut SyntaxTree, d: &Declaration, grouping: &str, names: &[String]) -> Declaration {
    let span = d.name.span;
    let mut push = |expr: Expr| {
        tree.expressions.push((expr, span));
        ExprRef(tree.expressions.len() as u32 - 1)
    };
    let mut sum: Option<ExprRef> = None;
    for group in names {
        let is = push(Expr::Name(membership(grouping, group)));
        let own = push(Expr::Name(of_group(&d.name.text, group)));
        let term = push(Expr::Binary(BinarySign::Multiply, is, own, Span::default()));
        sum = Some(sum.map_or(term, |sum| push(Expr::Binary(BinarySign::Add, sum, term, Span::default()))));
    }
    let (doc, unit) = (d.doc.clone(), d.unit.clone());
    Declaration { doc, unit, value: sum.map(Value::Expr), ..Declaration::new(d.name.clone(), d.span) }
}

/// What was believed of a param is believed of that of every group.
fn believed(tree: &mut SyntaxTree, shared: &[(String, Vec<String>)]) {
    let SyntaxTree { statements, expressions, .. } = tree;
    for statement in statements {
        let StatementKind::Prior(list) = &mut statement.kind else { continue };
        let mut all = Vec::with_capacity(list.len());
        for (subject, belief) in list.drain(..) {
            let (expr, span) = expressions[subject.0 as usize].clone();
            let Some((_, own)) = shared.iter().find(|(name, _)| matches!(&expr, Expr::Name(n) if n == name)) else {
                all.push((subject, belief));
                continue;
            };
            for name in own {
                expressions.push((Expr::Name(name.clone()), span));
                all.push((ExprRef(expressions.len() as u32 - 1), belief));
            }
        }
        *list = all;
    }
}
