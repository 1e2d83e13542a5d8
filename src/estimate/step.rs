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
        (0..quadratic.rhs.len()).filter(|j| self.moves(quadratic, *j)).collect()
    }

    /// Those of `unknowns` that can move.
    pub(super) fn movable_among(&self, quadratic: &Quadratic, unknowns: &[usize]) -> Vec<usize> {
        unknowns.iter().copied().filter(|j| self.moves(quadratic, *j)).collect()
    }

    fn moves(&self, quadratic: &Quadratic, j: usize) -> bool {
        let rhs = &quadratic.rhs;
        let held = (self.down[j] == 0.0 && rhs[j] <= 0.0) || (self.up[j] == 0.0 && rhs[j] >= 0.0);
        quadratic.scale[j] > 0.0 && !held
    }

    /// Bends a damped step by the second derivative of the response along it, seen as the `slope` of the cost
    /// (geodesic acceleration, Transtrum and Sethna 2012). Gives the bend relative to the step: a step that is bent too
    /// much is too long to be believed.
    pub(super) fn bend(&self, quadratic: &Quadratic, damping: f64, slope: &[f64], step: &mut [f64]) -> f64 {
        let inside = |j: &usize| self.down[*j] < step[*j] && step[*j] < self.up[*j];
        let moving: Vec<usize> = (0..step.len()).filter(inside).collect();
        let Some(bend) = quadratic.apply_inverse(&moving, damping, slope) else { return f64::INFINITY };
        let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let ratio = 2.0 * norm(&bend) / norm(step);
        for (j, (s, b)) in step.iter_mut().zip(&bend).enumerate() {
            *s = self.clip(j, *s - 0.5 * b);
        }
        ratio
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
    constrained_among(quadratic, room, room.movable(quadratic), damping, step)
}

/// The same among some unknowns that can move; the others keep their part of the step.
pub(super) fn constrained_among(
    quadratic: &Quadratic,
    room: &Room,
    mut free: Vec<usize>,
    damping: f64,
    step: &mut [f64],
) -> bool {
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
