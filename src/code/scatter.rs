//! Points around nominal values, the same on every machine and in every run.

use fdm_grammar::model::Model;
use fdm_grammar::schedule::Layout;

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
    fn uniform(&mut self) -> f64 {
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
