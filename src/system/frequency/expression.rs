//! Complex functions of frequency as a graph in which equal expressions are one node; factors that are the same at all frequencies
//! (coefficients, and products of them that the elimination needs) are [`Scalar`]s beside it.

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

    /// An equal value with a factor of 1.
    pub(super) fn plain(&mut self, value: Value) -> Value {
        Value { factor: Scalar::ONE, node: Some(self.materialised(value)) }
    }

    /// An equal value with a factor of 1 or -1; a factor alone stays.
    pub(super) fn signed(&mut self, value: Value) -> Value {
        if value.factor == Scalar::MINUS || value.node.is_none() { value } else { self.plain(value) }
    }
}

/// One of the numbers, by its position in [`Scalars`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct Scalar(pub(super) u32);

impl Scalar {
    pub(super) const ZERO: Self = Self(0);
    pub(super) const ONE: Self = Self(1);
    pub(super) const MINUS: Self = Self(2);
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Operation {
    Constant(i8),
    Given(u32),
    Negative(Scalar),
    Product(Scalar, Scalar),
    Sum(Scalar, Scalar),
}

/// The numbers and how they follow from the given ones; equal ones are kept once.
#[derive(Debug, Clone)]
pub(super) struct Scalars {
    operations: Vec<Operation>,
    known: BTreeMap<Operation, Scalar>,
    /// Given numbers that were seen to be 1 or -1: multiplications by them are left out.
    units: Vec<Option<i8>>,
}

impl Scalars {
    /// `units[i]` says that the given number i counts as that one.
    pub(super) fn new(units: Vec<Option<i8>>) -> Self {
        let mut scalars = Self { operations: Vec::new(), known: BTreeMap::new(), units };
        for constant in [0, 1, -1] {
            scalars.push(Operation::Constant(constant));
        }
        scalars
    }

    fn push(&mut self, operation: Operation) -> Scalar {
        if let Some(known) = self.known.get(&operation) {
            return *known;
        }
        let new = Scalar(self.operations.len() as u32);
        self.operations.push(operation);
        self.known.insert(operation, new);
        new
    }

    pub(super) fn given(&mut self, index: usize) -> Scalar {
        match self.units.get(index).copied().flatten() {
            Some(unit) => self.push(Operation::Constant(unit)),
            None => self.push(Operation::Given(index as u32)),
        }
    }

    pub(super) fn negative(&mut self, a: Scalar) -> Scalar {
        match self.operations[a.0 as usize] {
            Operation::Constant(c) => self.push(Operation::Constant(-c)),
            Operation::Negative(b) => b,
            _ => self.push(Operation::Negative(a)),
        }
    }

    /// The sign stands outside of a product, so that products that differ in sign only are one.
    pub(super) fn product(&mut self, a: Scalar, b: Scalar) -> Scalar {
        match (self.operations[a.0 as usize], self.operations[b.0 as usize]) {
            (Operation::Constant(0), _) | (_, Operation::Constant(0)) => Scalar::ZERO,
            (Operation::Constant(1), _) => b,
            (_, Operation::Constant(1)) => a,
            (Operation::Constant(_), _) => self.negative(b),
            (_, Operation::Constant(_)) => self.negative(a),
            (Operation::Negative(a), _) => {
                let positive = self.product(a, b);
                self.negative(positive)
            }
            (_, Operation::Negative(b)) => {
                let positive = self.product(a, b);
                self.negative(positive)
            }
            _ => self.push(Operation::Product(a.min(b), a.max(b))),
        }
    }

    pub(super) fn sum(&mut self, a: Scalar, b: Scalar) -> Scalar {
        match (a, b) {
            (Scalar::ZERO, b) => b,
            (a, Scalar::ZERO) => a,
            _ => self.push(Operation::Sum(a.min(b), a.max(b))),
        }
    }

    /// Computes all from the given ones.
    pub(super) fn evaluate(&self, given: &[f64], values: &mut Vec<f64>) {
        values.clear();
        for operation in &self.operations {
            let value = match *operation {
                Operation::Constant(c) => f64::from(c),
                Operation::Given(i) => given[i as usize],
                Operation::Negative(a) => -values[a.0 as usize],
                Operation::Product(a, b) => values[a.0 as usize] * values[b.0 as usize],
                Operation::Sum(a, b) => values[a.0 as usize] + values[b.0 as usize],
            };
            values.push(value);
        }
    }
}

/// Which of the given numbers are 1 or -1.
pub(super) fn units_of(given: &[f64]) -> Vec<Option<i8>> {
    let unit = |value: &f64| match *value {
        1.0 => Some(1),
        -1.0 => Some(-1),
        _ => None,
    };
    given.iter().map(unit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_vanish_and_signs_stand_outside() {
        let mut scalars = Scalars::new(units_of(&[1.0, 3.0, -1.0, 5.0]));
        let [one, three, minus, five] = [0, 1, 2, 3].map(|i| scalars.given(i));
        assert_eq!((one, minus), (Scalar::ONE, Scalar::MINUS));
        assert_eq!(scalars.product(one, three), three);
        let negative = scalars.product(minus, three);
        let fifteen = scalars.product(five, three);
        let product = scalars.product(negative, five);
        assert_eq!(scalars.negative(product), fifteen);
        let sum = scalars.sum(product, five);
        let mut values = Vec::new();
        scalars.evaluate(&[1.0, 3.0, -1.0, 5.0], &mut values);
        assert_eq!((values[product.0 as usize], values[sum.0 as usize]), (-15.0, -10.0));
    }
}
