//! The units of expressions and their arithmetic; each unit is stored once and each product computed once.

use super::scope::SymbolId;
use crate::unit::Unit;
use std::collections::HashMap;

/// What is known of the unit of an expression.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Measure {
    /// A unit, by its number in [`Measures`].
    Known(u32),
    /// A number of the text: pure in products, beside another quantity whatever that is.
    Number,
    /// Not declared; the name that first lacks a unit.
    Unknown(SymbolId),
    /// A mistake that has been told.
    Broken,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Step {
    Product(u32, u32),
    Quotient(u32, u32),
    Power(u32, i32),
    Root(u32, i32),
}

/// Units beyond the range that [`Unit`] can hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct OutOfRange;

/// All units of a model, with the arithmetic of [`Measure`]s.
pub(super) struct Measures {
    units: Vec<Unit>,
    numbers: HashMap<(String, u64), u32>,
    steps: HashMap<Step, Option<u32>>,
}

impl Measures {
    /// The number of the pure number.
    pub(super) const ONE: Measure = Measure::Known(0);
    /// The number of the radian.
    pub(super) const RADIAN: Measure = Measure::Known(1);

    /// Knows the pure number and the radian.
    pub(super) fn new() -> Self {
        let mut measures = Self { units: Vec::new(), numbers: HashMap::new(), steps: HashMap::new() };
        measures.known(Unit::one());
        measures.known(Unit::radian());
        measures
    }

    /// The measure of a unit.
    pub(super) fn known(&mut self, unit: Unit) -> Measure {
        Measure::Known(self.number(unit))
    }

    /// The unit behind a number.
    pub(super) fn unit(&self, k: u32) -> &Unit {
        &self.units[k as usize]
    }

    /// `a*b`, or `a/b`.
    pub(super) fn joined(&mut self, a: Measure, b: Measure, divide: bool) -> Result<Measure, OutOfRange> {
        use Measure::*;
        Ok(match (a, b) {
            (Broken, _) | (_, Broken) => Broken,
            (Unknown(s), _) | (_, Unknown(s)) => Unknown(s),
            (Number, Number) => Number,
            (Known(a), Number) => Known(a),
            (Number, Known(b)) if divide => Known(self.step(Step::Power(b, -1))?),
            (Number, Known(b)) => Known(b),
            (Known(a), Known(b)) if divide => Known(self.step(Step::Quotient(a, b))?),
            (Known(a), Known(b)) => Known(self.step(Step::Product(a, b))?),
        })
    }

    /// The n-th power.
    pub(super) fn power(&mut self, unit: u32, n: i32) -> Result<u32, OutOfRange> {
        self.step(Step::Power(unit, n))
    }

    /// The n-th root.
    pub(super) fn root(&mut self, unit: u32, n: i32) -> Result<u32, OutOfRange> {
        self.step(Step::Root(unit, n))
    }

    /// What two quantities are when they stand side by side (in a sum, a comparison); the two units when they
    /// differ.
    pub(super) fn agreed(&self, a: Measure, b: Measure) -> Result<Measure, (u32, u32)> {
        use Measure::*;
        match (a, b) {
            (Broken, _) | (_, Broken) => Ok(Broken),
            (Known(x), Known(y)) if x == y || self.unit(x).same_size(self.unit(y)) => Ok(a),
            (Known(x), Known(y)) => Err((x, y)),
            (Known(_), _) | (Unknown(_), Number | Unknown(_)) | (Number, Number) => Ok(a),
            (_, Known(_)) | (Number, Unknown(_)) => Ok(b),
        }
    }

    fn number(&mut self, unit: Unit) -> u32 {
        let key = (unit.text().to_string(), unit.factor.to_bits());
        let next = self.units.len() as u32;
        let k = *self.numbers.entry(key).or_insert(next);
        if k == next {
            self.units.push(unit);
        }
        k
    }

    fn step(&mut self, step: Step) -> Result<u32, OutOfRange> {
        if let Some(known) = self.steps.get(&step) {
            return known.ok_or(OutOfRange);
        }
        let unit = match step {
            Step::Product(a, b) => self.unit(a).product(self.unit(b)),
            Step::Quotient(a, b) => self.unit(a).quotient(self.unit(b)),
            Step::Power(a, n) => self.unit(a).power(n),
            Step::Root(a, n) => self.unit(a).root(n),
        };
        let number = unit.map(|unit| self.number(unit));
        self.steps.insert(step, number);
        number.ok_or(OutOfRange)
    }
}

/// "they differ by the factor 3.28084 (1 m is 3.28084 ft)"; `None` when they measure different things.
pub(super) fn factor_between(a: &Unit, b: &Unit) -> Option<String> {
    let (large, small) = if a.factor >= b.factor { (a, b) } else { (b, a) };
    let (scale, _) = large.conversion(small)?;
    let factor = six_digits(scale);
    Some(format!("they differ by the factor {factor} (1 {large} is {factor} {small})"))
}

/// A number as people write it, with six significant digits at most.
pub(super) fn six_digits(value: f64) -> String {
    let rounded: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    if (1e-4..1e7).contains(&rounded.abs()) { rounded.to_string() } else { format!("{rounded:e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_told_in_words() {
        let unit = |text| Unit::parse(text).unwrap();
        let told = |a, b| factor_between(&unit(a), &unit(b));
        assert_eq!(told("m", "ft").as_deref(), Some("they differ by the factor 3.28084 (1 m is 3.28084 ft)"));
        assert_eq!(told("deg", "rad").as_deref(), Some("they differ by the factor 57.2958 (1 rad is 57.2958 deg)"));
        assert_eq!(told("m", "s"), None);
        assert_eq!(six_digits(1e9 / 3.0), "3.33333e8");
    }
}
