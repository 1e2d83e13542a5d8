//! A damped correction within bounds.

use super::quadratic::Quadratic;

/// How far every unknown may go down (not above 0) and up (not below 0), in scaled units.
#[derive(Debug, Clone, Default)]
pub(super) struct Room {
    /// Distance to the lower bound.
    pub(super) down: Vec<f64>,
    /// Distance to the upper bound.
    pub(super) up: Vec<f64>,
}

impl Room {
    /// The room that is left at `values`.
    pub(super) fn at(values: &[f64], lower: &[f64], upper: &[f64], scale: &[f64]) -> Self {
        let scaled = |bound: &[f64]| {
            let distance = bound.iter().zip(values).zip(scale);
            // an unknown without influence has scale 0 and does not move; infinity times 0 must not become NaN
            distance.map(|((b, v), s)| if *b == *v || *s == 0.0 { 0.0 } else { (b - v) * s }).collect()
        };
        Self { down: scaled(lower), up: scaled(upper) }
    }

    /// Unknowns that can move: not those that stand at a bound with the cost falling beyond it, nor those without
    /// influence.
    pub(super) fn movable(&self, quadratic: &Quadratic) -> Vec<usize> {
        let rhs = &quadratic.rhs;
        let held = |j: usize| (self.down[j] == 0.0 && rhs[j] <= 0.0) || (self.up[j] == 0.0 && rhs[j] >= 0.0);
        (0..rhs.len()).filter(|j| quadratic.scale[*j] > 0.0 && !held(*j)).collect()
    }

    fn clip(&self, j: usize, step: f64) -> f64 {
        step.max(self.down[j]).min(self.up[j])
    }
}

/// The minimum of the damped quadratic inside the room: unknowns that would leave it are set to their bounds and the
/// others solved again. False when the quadratic cannot be solved without damping.
pub(super) fn constrained(quadratic: &Quadratic, room: &Room, damping: f64, step: &mut Vec<f64>) -> bool {
    step.clear();
    step.resize(quadratic.rhs.len(), 0.0);
    let mut free = room.movable(quadratic);
    while !free.is_empty() {
        if !quadratic.solve(&free, damping, step) {
            return false;
        }
        let before = free.len();
        free.retain(|j| {
            let inside = room.clip(*j, step[*j]);
            let stays = inside == step[*j];
            step[*j] = inside;
            stays
        });
        if free.len() == before {
            break;
        }
    }
    true
}
