//! The expressions of the flattened model, as they are made.

use super::super::broken;
use super::declared::Declared;
use crate::diagnostic::Diagnostic;
use crate::expand::Budget;
use crate::source::Span;
use crate::syntax::{
    BinarySign, Declaration, Expr, ExprRef, Name, Role, Statement, StatementKind, UnarySign, Value, operands,
};

/// An element; `None` is 0 by structure.
pub(super) type Item = Option<ExprRef>;

/// Makes expressions within a budget.
pub(super) struct Writer<'a> {
    pub(super) declared: &'a Declared<'a>,
    pub(super) expressions: Vec<(Expr, Span)>,
    pub(super) budget: &'a mut Budget,
    pub(super) findings: Vec<Diagnostic>,
    /// Definitions of what is needed in several elements.
    pub(super) lets: Vec<Statement>,
}

/// Where a mistake has been told.
pub(super) const BROKEN: ExprRef = ExprRef(0);

impl<'a> Writer<'a> {
    pub(super) fn new(declared: &'a Declared<'a>, budget: &'a mut Budget, findings: Vec<Diagnostic>) -> Self {
        let expressions = vec![(broken(), Span::default())];
        Self { declared, expressions, budget, findings, lets: Vec::new() }
    }

    pub(super) fn tell(&mut self, finding: Diagnostic) {
        // findings beyond this number are not told: nobody reads more
        if self.findings.len() < 100 {
            self.findings.push(finding);
        }
    }

    /// Adds an expression whose operands are there.
    pub(super) fn push(&mut self, expr: Expr, span: Span) -> ExprRef {
        let bytes = match &expr {
            Expr::Name(name) => name.len(),
            Expr::Call(name, _) => name.text.len(),
            _ => 0,
        };
        if !self.budget.spend(1, bytes) {
            let finding = self.budget.finding(span);
            self.findings.extend(finding);
            return BROKEN;
        }
        self.expressions.push((expr, span));
        ExprRef(self.expressions.len() as u32 - 1)
    }

    pub(super) fn number(&mut self, value: f64, span: Span) -> ExprRef {
        self.push(Expr::Number(value), span)
    }

    /// An element, written out.
    pub(super) fn item(&mut self, item: Item, span: Span) -> ExprRef {
        item.unwrap_or_else(|| self.number(0.0, span))
    }

    pub(super) fn binary(&mut self, sign: BinarySign, a: ExprRef, b: ExprRef, place: Place) -> ExprRef {
        self.push(Expr::Binary(sign, a, b, place.sign), place.whole)
    }

    pub(super) fn call(&mut self, function: &str, arguments: Vec<ExprRef>, place: Place) -> ExprRef {
        let name = Name { text: function.into(), span: place.sign };
        self.push(Expr::Call(name, arguments), place.whole)
    }

    /// `a*b`, which is 0 by structure when one of them is.
    pub(super) fn product(&mut self, a: Item, b: Item, place: Place) -> Item {
        Some(self.binary(BinarySign::Multiply, a?, b?, place))
    }

    /// `a + b`, `a - b`
    pub(super) fn sum(&mut self, a: Item, b: Item, minus: bool, place: Place) -> Item {
        let sign = if minus { BinarySign::Subtract } else { BinarySign::Add };
        match (a, b) {
            (Some(a), Some(b)) => Some(self.binary(sign, a, b, place)),
            (None, Some(b)) if minus => Some(self.push(Expr::Unary(UnarySign::Minus, b), place.whole)),
            (a, b) => a.or(b),
        }
    }

    /// A value in a form that can be written several times: what is more than a name or a number gets a name of its
    /// own. Numbers and conditions, which names cannot stand for without a unit or at all, stay what they are.
    pub(super) fn shared(&mut self, e: ExprRef) -> ExprRef {
        let (expr, span) = &self.expressions[e.0 as usize];
        let span = *span;
        let leaf = matches!(expr, Expr::Number(_) | Expr::Name(_));
        if e == BROKEN || leaf || is_condition(expr) || self.is_constant(e) || self.budget.is_spent() {
            return e;
        }
        let text = format!("part {} of an expression", self.lets.len() + 1);
        let mut d = Declaration::new(Name { text: text.clone(), span }, span);
        d.value = Some(Value::Expr(e));
        self.lets.push(Statement { kind: StatementKind::Declare(Role::Let, vec![d]), span });
        self.push(Expr::Name(text), span)
    }

    /// A whole expression once more; does not recurse.
    pub(super) fn copy(&mut self, root: ExprRef) -> ExprRef {
        let mut nodes = Vec::new();
        let mut open = vec![root];
        while let Some(e) = open.pop() {
            if nodes.len() > super::super::MOST_NODES {
                break;
            }
            nodes.push(e);
            operands(&self.expressions[e.0 as usize].0, |operand| open.push(operand));
        }
        // operands stand before their users
        nodes.sort_unstable();
        nodes.dedup();
        let mut copies = Vec::with_capacity(nodes.len());
        for e in &nodes {
            let copied = |old: ExprRef, copies: &[ExprRef]| nodes.binary_search(&old).map_or(BROKEN, |k| copies[k]);
            let (expr, span) = self.expressions[e.0 as usize].clone();
            let expr = moved(expr, |old| copied(old, &copies));
            copies.push(if *e == BROKEN { BROKEN } else { self.push(expr, span) });
        }
        copies.last().copied().unwrap_or(BROKEN)
    }

    /// Whether an expression is made of numbers and consts only.
    pub(super) fn is_constant(&self, root: ExprRef) -> bool {
        let mut open = vec![root];
        while let Some(e) = open.pop() {
            match &self.expressions[e.0 as usize].0 {
                Expr::Name(name) => {
                    if !matches!(name.as_str(), "pi" | "inf") && !self.declared.is_const(name) {
                        return false;
                    }
                }
                expr => operands(expr, |operand| open.push(operand)),
            }
        }
        true
    }
}

/// Where an expression that is made stands in the text: the sign or the name of the function, and all of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub(super) sign: Span,
    pub(super) whole: Span,
}

/// The expression with other operands.
fn moved(expr: Expr, to: impl Fn(ExprRef) -> ExprRef) -> Expr {
    let list = |list: Vec<ExprRef>| list.into_iter().map(&to).collect();
    match expr {
        Expr::Unary(sign, a) => Expr::Unary(sign, to(a)),
        Expr::Binary(sign, a, b, span) => Expr::Binary(sign, to(a), to(b), span),
        Expr::Call(name, arguments) => Expr::Call(name, list(arguments)),
        Expr::If(c, a, b) => Expr::If(to(c), to(a), to(b)),
        Expr::Vector(elements) => Expr::Vector(list(elements)),
        other => other,
    }
}

fn is_condition(expr: &Expr) -> bool {
    use BinarySign::*;
    match expr {
        Expr::Unary(sign, _) => *sign == UnarySign::Not,
        Expr::Binary(sign, ..) => !matches!(sign, Add | Subtract | Multiply | Divide | Power),
        _ => false,
    }
}
