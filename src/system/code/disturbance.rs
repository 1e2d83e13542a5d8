//! How many digits of a program's results are worth comparing: every rounding disturbed (the idea of Vignes' stochastic arithmetic, 1993), at
//! points around nominal values that are the same on every machine.

use crate::dynamics::Point;
use fdm_grammar::model::Model;
use fdm_grammar::schedule::{Layout, Operand, Program};

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
        for (k, instruction) in program.instructions.iter().enumerate() {
            let [a, b, c] = instruction.args.map(|o| operand(o, &values));
            let value = match program.call(k) {
                Some((function, operands)) => {
                    let operands: Vec<f64> = operands.iter().map(|o| operand(*o, &values)).collect();
                    function.compute(instruction.op, &operands)
                }
                None => (instruction.op.row().value)(a, b, c),
            };
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

/// Where a model is at home: the middle of the points at which it is looked at.
#[derive(Debug, Clone, PartialEq)]
pub struct Nominal {
    /// Time since the run began, in the model's time unit.
    pub t: f64,
    /// Parameters (p), in the model's order and units.
    pub theta: Vec<f64>,
    /// States (n); `None` for the initial values that the parameters give.
    pub x: Option<Vec<f64>>,
    /// Inputs (m), then delayed signals; `None` for zero inputs and the states themselves.
    pub drive: Option<Vec<f64>>,
}

impl Nominal {
    /// The start values of the parameters at the beginning of a run that nothing drives.
    pub fn start(model: &Model) -> Self {
        Self { t: 0.0, theta: model.start(), x: None, drive: None }
    }
}

/// Shares of the values by which points lie apart, in turn: near ones where the model is certainly defined, far ones
/// where every branch is seen.
const SPREADS: [f64; 6] = [0.1, 1.0, 0.01, 0.3, 3.0, 0.001];

/// Moves numbers about.
pub(super) struct Scatter {
    state: u64,
    spread: f64,
}

impl Scatter {
    /// For the point of this number.
    pub(super) fn new(point: usize) -> Self {
        Self { state: (point as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15), spread: SPREADS[point % SPREADS.len()] }
    }

    /// Between -1 and 1 (Marsaglia's xorshift, multiplied).
    pub(super) fn uniform(&mut self) -> f64 {
        self.state ^= self.state >> 12;
        self.state ^= self.state << 25;
        self.state ^= self.state >> 27;
        let bits = self.state.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11;
        bits as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// A number near this one, or near zero when it is none.
    pub(super) fn around(&mut self, value: f64) -> f64 {
        let value = if value.is_finite() { value } else { 0.0 };
        let scale = if value == 0.0 { 1.0 } else { value.abs() };
        value + self.spread * scale * self.uniform()
    }

    /// A time at or after the beginning.
    pub(super) fn time(&mut self, value: f64) -> f64 {
        self.around(value).abs()
    }

    /// Parameters within their bounds; a step that would leave them goes part of the way to the bound.
    pub(super) fn theta(&mut self, model: &Model, nominal: &[f64]) -> Vec<f64> {
        let within = |(param, value): (&fdm_grammar::model::Param, &f64)| {
            let moved = self.around(*value);
            let bound = if moved < param.lower { param.lower } else { param.upper };
            match (param.lower..=param.upper).contains(&moved) || !value.is_finite() {
                true => moved,
                false => value + 0.9 * self.uniform().abs() * (bound - value),
            }
        };
        model.params.iter().zip(nominal).map(within).collect()
    }

    /// Inputs and delayed signals; where nothing is said, inputs around zero and delayed signals around theirs.
    pub(super) fn drive(&mut self, layout: &Layout, nominal: Option<&[f64]>, x: &[f64]) -> Vec<f64> {
        use fdm_grammar::graph::Signal;
        let value = |k: usize| match (nominal.and_then(|d| d.get(k)), k.checked_sub(layout.inputs)) {
            (Some(value), _) => *value,
            (None, Some(delayed)) => match layout.delayed[delayed] {
                Signal::State(i) => x[i as usize],
                Signal::Input(_) => 0.0,
            },
            (None, None) => 0.0,
        };
        (0..layout.drive()).map(|k| self.around(value(k))).collect()
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

    #[test]
    fn parameters_stay_within_their_bounds() {
        let mut model = blank(0, 0, &[1.0, 0.0, -2.0, 5.0]);
        (model.params[0].lower, model.params[0].upper) = (0.999, 1.001);
        model.params[1].lower = 0.0;
        model.params[2].upper = -1.99;
        for point in 0..200 {
            let theta = Scatter::new(point).theta(&model, &model.start());
            for (p, value) in model.params.iter().zip(&theta) {
                assert!((p.lower..=p.upper).contains(value), "{point}: {value} in [{}, {}]", p.lower, p.upper);
            }
            assert_ne!(theta[3], 5.0);
        }
    }
}
