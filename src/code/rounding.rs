//! A program with every rounding disturbed: how many digits of its results are worth comparing (the idea of Vignes'
//! stochastic arithmetic, 1993).

use crate::dynamics::Point;
use fdm_grammar::schedule::{Operand, Program};

/// Evaluates programs, and moves each result of an operation by up to one unit of the last place.
pub(super) struct Rounding {
    state: u64,
    values: Vec<f64>,
}

impl Rounding {
    /// No disturbance: what the programs say.
    pub(super) fn exact() -> Self {
        Self { state: 0, values: Vec::new() }
    }

    /// A disturbance of its own for each number.
    pub(super) fn disturbed(number: usize) -> Self {
        Self { state: (number as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1, values: Vec::new() }
    }

    /// The results of a program; slots that it does not write stay zero.
    pub(super) fn evaluate(&mut self, program: &Program, at: Point<'_>) -> Vec<f64> {
        let operand = |operand: Operand, values: &[f64]| match operand {
            Operand::Value(k) => values[k as usize],
            Operand::Constant(k) => program.constants[k as usize],
            Operand::Time => at.t,
            Operand::State(k) => at.x[k as usize],
            Operand::Drive(k) => at.drive[k as usize],
            Operand::Known(k) => at.known[k as usize],
        };
        let mut values = std::mem::take(&mut self.values);
        values.clear();
        for instruction in &program.instructions {
            let [a, b, c] = instruction.args.map(|o| operand(o, &values));
            let value = (instruction.op.row().value)(a, b, c);
            // conditions are decisions, not numbers with a last place
            values.push(if instruction.op.is_condition() { value } else { self.round(value) });
        }
        let mut results = vec![0.0; program.width];
        for result in &program.results {
            results[result.slot as usize] = operand(result.operand, &values);
        }
        self.values = values;
        results
    }

    /// A result, moved.
    pub(super) fn round(&mut self, value: f64) -> f64 {
        if self.state == 0 {
            return value;
        }
        self.state ^= self.state << 13;
        self.state ^= self.state >> 7;
        self.state ^= self.state << 17;
        match self.state >> 62 {
            0 => value.next_up(),
            1 => value.next_down(),
            _ => value,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::code::specimen::blank;
    use fdm_grammar::Schedule;
    use fdm_grammar::graph::Leaf;
    use fdm_grammar::op::{Build, Op};

    #[test]
    fn digits_that_cancel_are_seen() {
        let mut model = blank(2, 0, &[]);
        let g = &mut model.graph;
        let [x, y] = [0, 1].map(|k| g.leaf(Leaf::State(k)));
        let (sum, product) = (g.apply(Op::Add, &[x, y]), g.apply(Op::Mul, &[x, y]));
        model.states[0].rate = product;
        model.states[1].rate = g.apply(Op::Sub, &[sum, x]);
        let rates = Schedule::new(&mut model).rates;
        let at = Point { t: 0.0, x: &[1e8, 1.0], drive: &[], known: &[] };
        let exact = Rounding::exact().evaluate(&rates, at);
        assert_eq!(exact, [1e8, 1.0]);
        let spread = |k: usize| {
            let errors = (0..20).map(|n| (Rounding::disturbed(n).evaluate(&rates, at)[k] - exact[k]) / exact[k]);
            errors.fold(0.0, |m: f64, e| m.max(e.abs()))
        };
        assert!(spread(0) < 1e-15 && spread(1) > 1e-9, "{} {}", spread(0), spread(1));
    }
}
