//! The cubic Hermite interpolant of a step: weights of the states at both ends and of the rates at both ends.
//!
//! On [0, h] the cubic takes x0, x1 and the slopes f0, f1. Sums with these weights are linear in the four, so that
//! sensitivities are interpolated by the same ones.

use super::super::moments::{add, stages};

/// Weights of x0, x1, f0 and f1.
pub(in super::super) type Four = [f64; 4];

/// Weights for the value and for the slope at one place.
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct Weights {
    pub(in super::super) value: Four,
    pub(in super::super) slope: Four,
}

/// What a part of a step contributes to the three stage values of a later step that sees it delayed, and to the
/// three slopes.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Share {
    pub(super) value: [Four; 3],
    pub(super) slope: [Four; 3],
}

/// The three-point Gauss rule on [0, 1]: exact for a cubic times a moment's weight.
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

impl Weights {
    /// At a distance behind the beginning of a step of length h.
    #[inline]
    pub(in super::super) fn new(distance: f64, h: f64) -> Self {
        let s = distance / h;
        let (q, c) = (s * s, s * s * s);
        Self {
            value: [2.0 * c - 3.0 * q + 1.0, 3.0 * q - 2.0 * c, h * (c - 2.0 * q + s), h * (c - q)],
            slope: [6.0 * (q - s) / h, 6.0 * (s - q) / h, 3.0 * q - 4.0 * s + 1.0, 3.0 * q - 2.0 * s],
        }
    }
}

impl Share {
    /// The share of `part` (from, to) of the step `piece` (beginning, length), all seen through the window (beginning,
    /// length); times are the delayed signal's own.
    pub(super) fn new(piece: (f64, f64), part: (f64, f64), window: (f64, f64)) -> Self {
        let (mut value, mut slope) = ([[0.0; 3]; 4], [[0.0; 3]; 4]);
        let length = part.1 - part.0;
        for (abscissa, weight) in GAUSS {
            let t = part.0 + abscissa * length;
            let (s, amount) = ((t - window.0) / window.1, weight * length / window.1);
            let at = Weights::new(t - piece.0, piece.1);
            for k in 0..4 {
                add(&mut value[k], s, amount * at.value[k]);
                add(&mut slope[k], s, amount * at.slope[k]);
            }
        }
        Self { value: by_stage(value), slope: by_stage(slope) }
    }

    /// The share of a part in which the signal stands still: the weight of its value in each stage value.
    pub(super) fn constant(part: (f64, f64), window: (f64, f64)) -> [f64; 3] {
        let (mut moments, length) = ([0.0; 3], part.1 - part.0);
        for (abscissa, weight) in GAUSS {
            let t = part.0 + abscissa * length;
            add(&mut moments, (t - window.0) / window.1, weight * length / window.1);
        }
        stages(moments)
    }
}

/// From the moments of each weight to the weights of each stage value.
fn by_stage(moments: [[f64; 3]; 4]) -> [Four; 3] {
    let mut weights = [[0.0; 4]; 3];
    for (k, moments) in moments.into_iter().enumerate() {
        for (stage, value) in stages(moments).into_iter().enumerate() {
            weights[stage][k] = value;
        }
    }
    weights
}

/// A weighted sum of the four.
#[inline(always)]
pub(in super::super) fn sum(weights: &Four, of: &Four) -> f64 {
    ((weights[0] * of[0] + weights[1] * of[1]) + weights[2] * of[2]) + weights[3] * of[3]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_seen_without_delay_has_its_own_values() {
        let f = |t: f64| 1.0 - 2.0 * t;
        let of = [f(1.0), f(3.0), -2.0, -2.0];
        let whole = Share::new((1.0, 2.0), (1.0, 3.0), (1.0, 2.0));
        for (stage, t) in [1.0, 2.0, 3.0].into_iter().enumerate() {
            assert!((sum(&whole.value[stage], &of) - f(t)).abs() < 1e-12, "stage {stage}");
            assert!((sum(&whole.slope[stage], &of) + 2.0).abs() < 1e-11, "slope {stage}");
        }
    }

    #[test]
    fn parts_add_up_and_slopes_are_derivatives_by_the_shift() {
        let of = [0.3, -1.2, 2.0, -0.7];
        let at = |begin: f64| -> [f64; 3] {
            let window = (begin, 1.5);
            let before = Share::constant((begin, 0.0), window);
            let cut = 0.4;
            let [first, second] = [(0.0, cut), (cut, begin + 1.5)].map(|part| Share::new((0.0, 2.0), part, window));
            std::array::from_fn(|k| of[0] * before[k] + sum(&first.value[k], &of) + sum(&second.value[k], &of))
        };
        let (begin, step) = (-0.6, 1e-6);
        let whole = Share::new((0.0, 2.0), (0.0, 0.9), (begin, 1.5));
        let (low, high) = (at(begin - step), at(begin + step));
        for stage in 0..3 {
            let difference = (high[stage] - low[stage]) / (2.0 * step);
            assert!((difference - sum(&whole.slope[stage], &of)).abs() < 1e-7, "stage {stage}");
        }
    }
}
