//! Symbolic elimination of (j w - A): pivots on the diagonal, block by block of states that influence each other, in an order that fills
//! least; structural zeros are left out.
//!
//! Complex functions of frequency as a graph in which equal expressions are one node; factors that are the same at all frequencies
//! (coefficients, and products of them that the elimination needs) are [`Scalar`]s beside it.

use std::collections::BTreeMap;

/// The eliminated matrix as expressions.
#[derive(Clone)]
pub(super) struct Elimination {
    size: usize,
    /// States in the order of elimination, and the block of each.
    order: Vec<usize>,
    block: Vec<usize>,
    /// Inside blocks, as it was when its pivot was reached; between blocks as it was given.
    entries: Vec<Option<Value>>,
    /// One over the pivots.
    inverse: Vec<Option<Value>>,
}

impl Elimination {
    /// Eliminates the matrix (n by n, row-major), whose diagonal is full; `diagonal` are the real constants on it.
    pub(super) fn new(g: &mut Expressions, mut entries: Vec<Option<Value>>, diagonal: &[Scalar]) -> Self {
        let size = diagonal.len();
        let depends = (0..size).map(|i| (0..size).filter(|j| *j != i && entries[i * size + j].is_some()).collect());
        let blocks = blocks(&depends.collect());
        let (mut inverse, mut block) = (vec![None; size], vec![0; size]);
        for (b, states) in blocks.iter().enumerate() {
            states.iter().for_each(|k| block[*k] = b);
            for (position, &k) in states.iter().enumerate() {
                let Some(pivot) = entries[k * size + k] else { continue };
                let reciprocal = g.pivot(pivot, diagonal[k]);
                inverse[k] = Some(reciprocal);
                let left = &states[position + 1..];
                for &j in left {
                    let Some(across) = entries[k * size + j] else { continue };
                    let across = g.product(reciprocal, across);
                    for &i in left {
                        let Some(down) = entries[i * size + k] else { continue };
                        let product = g.product(down, across);
                        let product = g.negative(product);
                        let jw = false;
                        let sum: Vec<Value> = entries[i * size + j].into_iter().chain([product]).collect();
                        entries[i * size + j] = flattened(g, jw, &sum);
                    }
                }
            }
        }
        Self { size, order: blocks.concat(), block, entries, inverse }
    }

    /// x of (j w - A) x = b.
    pub(super) fn solve(&self, g: &mut Expressions, right: &[Option<Value>]) -> Vec<Option<Value>> {
        let n = self.size;
        let mut x: Vec<Option<Value>> = vec![None; n];
        // what stands on the right once the pivots before are eliminated
        let mut reduced: Vec<Option<Value>> = vec![None; n];
        let mut from = 0;
        while from < n {
            let to = from + self.order[from..].iter().take_while(|k| self.same(**k, self.order[from])).count();
            for at in from..to {
                let k = self.order[at];
                let mut sum: Vec<Value> = right[k].into_iter().collect();
                for &j in &self.order[..from] {
                    self.subtract(g, (k, j), x[j], &mut sum);
                }
                for &j in &self.order[from..at] {
                    let step = self.times_inverse(g, j, reduced[j]);
                    self.subtract(g, (k, j), step, &mut sum);
                }
                reduced[k] = g.sum(false, &sum);
            }
            for at in (from..to).rev() {
                let k = self.order[at];
                let mut sum: Vec<Value> = reduced[k].into_iter().collect();
                for &j in &self.order[at + 1..to] {
                    self.subtract(g, (k, j), x[j], &mut sum);
                }
                let sum = g.sum(false, &sum);
                x[k] = self.times_inverse(g, k, sum);
            }
            from = to;
        }
        x
    }

    /// w of w (j w - A) = c, a row of C (j w - A)^-1.
    pub(super) fn solve_left(&self, g: &mut Expressions, row: &[Option<Value>]) -> Vec<Option<Value>> {
        let n = self.size;
        let mut w: Vec<Option<Value>> = vec![None; n];
        let mut reduced: Vec<Option<Value>> = vec![None; n];
        let mut to = n;
        while to > 0 {
            let last = self.order[to - 1];
            let from = to - self.order[..to].iter().rev().take_while(|k| self.same(**k, last)).count();
            for at in from..to {
                let k = self.order[at];
                let mut sum: Vec<Value> = row[k].into_iter().collect();
                for &i in &self.order[to..] {
                    self.subtract(g, (i, k), w[i], &mut sum);
                }
                for &i in &self.order[from..at] {
                    let step = self.times_inverse(g, i, reduced[i]);
                    self.subtract(g, (i, k), step, &mut sum);
                }
                reduced[k] = g.sum(false, &sum);
            }
            for at in (from..to).rev() {
                let k = self.order[at];
                let mut sum: Vec<Value> = reduced[k].into_iter().collect();
                for &i in &self.order[at + 1..to] {
                    self.subtract(g, (i, k), w[i], &mut sum);
                }
                let sum = g.sum(false, &sum);
                w[k] = self.times_inverse(g, k, sum);
            }
            to = from;
        }
        w
    }

    fn same(&self, a: usize, b: usize) -> bool {
        self.block[a] == self.block[b]
    }

    fn times_inverse(&self, g: &mut Expressions, k: usize, value: Option<Value>) -> Option<Value> {
        let (inverse, value) = (self.inverse[k]?, value?);
        Some(g.product(inverse, value))
    }

    fn subtract(&self, g: &mut Expressions, (i, j): (usize, usize), value: Option<Value>, sum: &mut Vec<Value>) {
        let (Some(entry), Some(value)) = (self.entries[i * self.size + j], value) else { return };
        let product = g.product(entry, value);
        sum.push(g.negative(product));
    }
}

/// The sum of values of which the first may be a sum itself (an entry that was changed before): one sum of all.
fn flattened(g: &mut Expressions, jw: bool, values: &[Value]) -> Option<Value> {
    if let [Value { factor: Scalar::ONE, node: Some(node) }, rest @ ..] = values
        && let Expression::Sum { jw: inner, constant, terms } = &g.nodes[*node as usize]
    {
        let (inner, constant) = (*inner, *constant);
        let mut all: Vec<Value> = terms.iter().map(|(f, n)| Value { factor: *f, node: Some(*n) }).collect();
        all.push(Value { factor: constant, node: None });
        all.extend_from_slice(rest);
        return g.sum(jw || inner, &all);
    }
    g.sum(jw, values)
}

/// Which states each state's rate depends on, itself left out.
pub(super) type Influences = Vec<Vec<usize>>;

/// Blocks of states that influence each other, each behind those that it depends on, in the order in which they are
/// eliminated.
pub(super) fn blocks(depends: &Influences) -> Vec<Vec<usize>> {
    let mut blocks = components(depends);
    for block in &mut blocks {
        *block = pivots(depends, block);
    }
    blocks
}

/// Strongly connected components (Tarjan 1972, without recursion), each behind those that it depends on.
fn components(depends: &Influences) -> Vec<Vec<usize>> {
    const NEW: usize = usize::MAX;
    let n = depends.len();
    let (mut index, mut low, mut on_stack) = (vec![NEW; n], vec![0; n], vec![false; n]);
    let (mut stack, mut path, mut found, mut count) = (Vec::new(), Vec::new(), Vec::new(), 0);
    for root in 0..n {
        if index[root] != NEW {
            continue;
        }
        path.push((root, 0));
        while let Some((node, next)) = path.pop() {
            if next == 0 {
                (index[node], low[node], on_stack[node]) = (count, count, true);
                count += 1;
                stack.push(node);
            } else {
                low[node] = low[node].min(low[depends[node][next - 1]]);
            }
            let mut next = next;
            let mut deeper = None;
            while let Some(&other) = depends[node].get(next) {
                next += 1;
                if index[other] == NEW {
                    deeper = Some(other);
                    break;
                }
                if on_stack[other] {
                    low[node] = low[node].min(index[other]);
                }
            }
            if let Some(other) = deeper {
                path.push((node, next));
                path.push((other, 0));
                continue;
            }
            if low[node] == index[node] {
                let at = stack.iter().rposition(|s| *s == node).unwrap_or(0);
                let mut component = stack.split_off(at);
                component.iter().for_each(|s| on_stack[*s] = false);
                component.sort_unstable();
                found.push(component);
            }
        }
    }
    found
}

/// Diagonal pivots of a block in the order of least fill (Markowitz 1957); of equals the first.
fn pivots(depends: &Influences, block: &[usize]) -> Vec<usize> {
    let size = block.len();
    let mut full = vec![false; size * size];
    for (i, state) in block.iter().enumerate() {
        for other in &depends[*state] {
            if let Ok(j) = block.binary_search(other) {
                full[i * size + j] = i != j;
            }
        }
    }
    let (mut left, mut order): (Vec<usize>, Vec<usize>) = ((0..size).collect(), Vec::with_capacity(size));
    while !left.is_empty() {
        let cost = |k: usize| {
            let row = left.iter().filter(|j| full[k * size + **j]).count();
            row * left.iter().filter(|i| full[**i * size + k]).count()
        };
        let Some(pivot) = left.iter().copied().min_by_key(|k| cost(*k)) else { break };
        left.retain(|k| *k != pivot);
        for i in left.iter().filter(|i| full[**i * size + pivot]).copied().collect::<Vec<_>>() {
            for j in left.iter().filter(|j| **j != i) {
                full[i * size + j] |= full[pivot * size + j];
            }
        }
        order.push(block[pivot]);
    }
    order
}

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
    fn loops_are_blocks_behind_what_drives_them() {
        // 0 <-> 3 driven by 2, which is driven by 1; 4 is driven by the loop
        let depends = vec![vec![3], vec![], vec![1], vec![0, 2], vec![0, 3]];
        assert_eq!(blocks(&depends), [vec![1], vec![2], vec![0, 3], vec![4]]);
        assert!(blocks(&Vec::new()).is_empty());
    }

    #[test]
    fn the_hub_of_a_star_is_eliminated_last() {
        let depends = vec![vec![1, 2, 3], vec![0], vec![0], vec![0]];
        assert_eq!(blocks(&depends), [vec![1, 2, 0, 3]].map(|b| b.to_vec()));
    }

    #[test]
    fn a_long_chain_needs_no_deep_stack() {
        let n = 3000;
        let depends: Influences = (0..n).map(|i| if i + 1 < n { vec![i + 1] } else { vec![] }).collect();
        let found = blocks(&depends);
        assert_eq!((found.len(), found[0][0], found[n - 1][0]), (n, n - 1, 0));
    }
}

#[cfg(test)]
mod expression_tests {
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
