//! Complex functions of frequency as a graph in which equal expressions are one node.

use super::scalar::{Scalar, Scalars};
use std::collections::BTreeMap;

/// A node, by its position in [`Expressions`]; operands stand before what uses them.
pub(super) type Node = u32;

#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Expression {
    /// Numbers that are there before: inputs, end terms, delay factors.
    Leaf(u32),
    /// 1/(j w + c).
    Pole(Scalar),
    /// 1/p of a pivot that other states have changed; its diagonal began as j w + c.
    Pivot(Node, Scalar),
    /// a b.
    Product(Node, Node),
    /// -j w a, what a derivative by a delay has in front.
    Lag(Node),
    /// j w (or not) + constant + sum of factor times node.
    Sum { jw: bool, constant: Scalar, terms: Vec<(Scalar, Node)> },
}

/// A real factor times a node; without a node the factor alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Value {
    pub(super) factor: Scalar,
    pub(super) node: Option<Node>,
}

/// The graph.
#[derive(Debug, Clone)]
pub(super) struct Expressions {
    pub(super) nodes: Vec<Expression>,
    known: BTreeMap<Expression, Node>,
    pub(super) scalars: Scalars,
}

/// The leaf 1/(j w).
pub(super) const INTEGRAL: u32 = 0;

impl Expressions {
    pub(super) fn new(scalars: Scalars) -> Self {
        Self { nodes: Vec::new(), known: BTreeMap::new(), scalars }
    }

    pub(super) fn node(&mut self, expression: Expression) -> Node {
        if let Some(known) = self.known.get(&expression) {
            return *known;
        }
        let new = self.nodes.len() as Node;
        self.nodes.push(expression.clone());
        self.known.insert(expression, new);
        new
    }

    pub(super) fn leaf(&mut self, leaf: u32) -> Value {
        Value { factor: Scalar::ONE, node: Some(self.node(Expression::Leaf(leaf))) }
    }

    pub(super) fn scaled(&mut self, factor: Scalar, value: Value) -> Value {
        Value { factor: self.scalars.product(factor, value.factor), node: value.node }
    }

    pub(super) fn negative(&mut self, value: Value) -> Value {
        self.scaled(Scalar::MINUS, value)
    }

    pub(super) fn product(&mut self, a: Value, b: Value) -> Value {
        let factor = self.scalars.product(a.factor, b.factor);
        let node = match (a.node, b.node) {
            (Some(a), Some(b)) => Some(self.node(Expression::Product(a.min(b), a.max(b)))),
            (a, b) => a.or(b),
        };
        Value { factor, node }
    }

    /// The sum, with j w added to it or not; nothing when it is structurally zero.
    pub(super) fn sum(&mut self, jw: bool, values: &[Value]) -> Option<Value> {
        let (mut constant, mut terms): (Scalar, Vec<(Scalar, Node)>) = (Scalar::ZERO, Vec::new());
        for value in values.iter().filter(|v| v.factor != Scalar::ZERO) {
            let Some(node) = value.node else {
                constant = self.scalars.sum(constant, value.factor);
                continue;
            };
            match terms.iter_mut().find(|(_, n)| *n == node) {
                Some((factor, _)) => *factor = self.scalars.sum(*factor, value.factor),
                None => terms.push((value.factor, node)),
            }
        }
        match &terms[..] {
            [] if !jw => (constant != Scalar::ZERO).then_some(Value { factor: constant, node: None }),
            [(factor, node)] if !jw && constant == Scalar::ZERO => Some(Value { factor: *factor, node: Some(*node) }),
            _ => {
                let node = self.node(Expression::Sum { jw, constant, terms });
                Some(Value { factor: Scalar::ONE, node: Some(node) })
            }
        }
    }

    /// One over a pivot.
    pub(super) fn pivot(&mut self, pivot: Value, diagonal: Scalar) -> Value {
        // a pivot contains j w, so that it is a sum
        let node = self.materialised(pivot);
        let node = match &self.nodes[node as usize] {
            Expression::Sum { jw: true, constant, terms } if terms.is_empty() => match *constant {
                Scalar::ZERO => self.node(Expression::Leaf(INTEGRAL)),
                constant => self.node(Expression::Pole(constant)),
            },
            _ => self.node(Expression::Pivot(node, diagonal)),
        };
        Value { factor: Scalar::ONE, node: Some(node) }
    }

    /// -j w times a value.
    pub(super) fn lag(&mut self, value: Value) -> Value {
        let Some(node) = value.node else {
            let one = self.node(Expression::Sum { jw: false, constant: Scalar::ONE, terms: Vec::new() });
            return Value { factor: value.factor, node: Some(self.node(Expression::Lag(one))) };
        };
        Value { factor: value.factor, node: Some(self.node(Expression::Lag(node))) }
    }

    /// The node that has the value itself, factor included.
    pub(super) fn materialised(&mut self, value: Value) -> Node {
        match value {
            Value { factor: Scalar::ONE, node: Some(node) } => node,
            Value { factor, node: Some(node) } => {
                self.node(Expression::Sum { jw: false, constant: Scalar::ZERO, terms: vec![(factor, node)] })
            }
            Value { factor, node: None } => {
                self.node(Expression::Sum { jw: false, constant: factor, terms: Vec::new() })
            }
        }
    }

    /// The same value with a factor of 1.
    pub(super) fn plain(&mut self, value: Value) -> Value {
        Value { factor: Scalar::ONE, node: Some(self.materialised(value)) }
    }

    /// The same value with a factor of 1 or -1; a factor alone stays.
    pub(super) fn signed(&mut self, value: Value) -> Value {
        if value.factor == Scalar::MINUS || value.node.is_none() { value } else { self.plain(value) }
    }
}
