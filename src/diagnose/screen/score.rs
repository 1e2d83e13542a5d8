//! The gain in likelihood that each direction promises beside everything that was fitted.

/// How a direction depends on the size of its effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// In proportion, of either sign: a derivative at the null value.
    Linear,
    /// The whole difference that this size makes: believed from half to twice as much.
    Finite,
    /// The same for the smallest size that was tried, below which the effect fades to nothing.
    Smallest,
}

/// One simulated direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// The candidate that it belongs to (0, 1, ... without gaps, in order).
    pub candidate: usize,
    /// What the effect's parameter was there; the unit of linear directions.
    pub size: f64,
    /// How it scales.
    pub shape: Shape,
}

/// Below this share of its energy a direction is what was fitted already.
pub(super) const ABSORBED: f64 = 1e-9;

/// A direction against the residual.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Score {
    /// Twice the promised gain in log-likelihood.
    pub(super) statistic: f64,
    /// The multiple of the direction that promises it.
    pub(super) amount: f64,
}

impl Score {
    /// From z = d'r and G = d'd.
    pub(super) fn new(shape: Shape, z: f64, g: f64) -> Self {
        if g <= 0.0 {
            return Self::default();
        }
        let amount = match shape {
            Shape::Linear => z / g,
            Shape::Finite => (z / g).clamp(0.5, 2.0),
            Shape::Smallest => (z / g).clamp(0.0, 2.0),
        };
        // a whole step that would do harm is not taken
        let statistic = (2.0 * amount * z - amount * amount * g).max(0.0);
        Self { statistic, amount }
    }
}

/// The best direction of every candidate by products with the residual z and with itself G; `usable` says which count.
pub(super) fn best(
    directions: &[Direction],
    candidates: usize,
    z: &[f64],
    own: &[f64],
    usable: &[bool],
) -> Vec<(usize, Score)> {
    let mut best = vec![(usize::MAX, Score::default()); candidates];
    for (k, direction) in directions.iter().enumerate() {
        let score = if usable[k] { Score::new(direction.shape, z[k], own[k]) } else { Score::default() };
        let place = &mut best[direction.candidate];
        if place.0 == usize::MAX || score.statistic > place.1.statistic {
            *place = (k, score);
        }
    }
    best
}
