//! Real numbers that are the same at all frequencies: coefficients, and products of them that the elimination needs.

use std::collections::BTreeMap;

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
