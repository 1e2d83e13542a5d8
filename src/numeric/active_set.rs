//! A damped step within bounds: the minimum of a quadratic in a box, by an active set (Stark and Parker 1995).

use crate::quadratic::Quadratic;

/// How far every unknown may go down (not above 0) and up (not below 0), in scaled units.
#[derive(Debug, Clone, Default)]
pub struct StepBounds {
    /// Distance to the lower bound.
    pub down: Vec<f64>,
    /// Distance to the upper bound.
    pub up: Vec<f64>,
}

impl StepBounds {
    /// What is left at `values`.
    pub fn at(values: &[f64], lower: &[f64], upper: &[f64], scale: &[f64]) -> Self {
        let mut bounds = Self::default();
        bounds.measure(values, lower, upper, scale);
        bounds
    }

    /// Measures what the bounds leave at `values`, in place.
    pub fn measure(&mut self, values: &[f64], lower: &[f64], upper: &[f64], scale: &[f64]) {
        for (distances, bound) in [(&mut self.down, lower), (&mut self.up, upper)] {
            let distance = bound.iter().zip(values).zip(scale);
            distances.clear();
            // an unknown without influence has scale 0 and does not move; infinity times 0 must not become NaN
            distances.extend(distance.map(|((b, v), s)| if *b == *v || *s == 0.0 { 0.0 } else { (b - v) * s }));
        }
    }

    /// Unknowns that can move: not those that stand at a bound with the cost falling beyond it, nor those without
    /// influence.
    pub fn movable(&self, quadratic: &Quadratic) -> Vec<usize> {
        (0..quadratic.rhs.len()).filter(|j| self.moves(quadratic, *j)).collect()
    }

    /// Unknowns among `unknowns` that can move.
    pub fn movable_among(&self, quadratic: &Quadratic, unknowns: &[usize]) -> Vec<usize> {
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
    pub fn bend(&self, quadratic: &Quadratic, damping: f64, slope: &[f64], step: &mut [f64]) -> f64 {
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

/// Slopes below this part of the largest one do not release an unknown from its bound.
const FLAT: f64 = 1e-12;

/// The minimum of the damped quadratic inside the bounds. False when the quadratic cannot be solved without damping.
pub fn constrained(quadratic: &Quadratic, bounds: &StepBounds, damping: f64, step: &mut Vec<f64>) -> bool {
    step.clear();
    step.resize(quadratic.rhs.len(), 0.0);
    let all: Vec<usize> = (0..step.len()).collect();
    constrained_among(quadratic, bounds, &all, damping, step)
}

/// The minimum of the damped quadratic among some unknowns; the others keep their part of the step. An active set
/// (Stark and Parker 1995): whoever meets a bound on the way to the minimum of the free ones is held there, and let go
/// when the cost falls inwards.
pub fn constrained_among(
    quadratic: &Quadratic,
    bounds: &StepBounds,
    unknowns: &[usize],
    damping: f64,
    step: &mut [f64],
) -> bool {
    let mut free = bounds.movable_among(quadratic, unknowns);
    for _ in 0..3 * unknowns.len() + 1 {
        if !descend(quadratic, bounds, &mut free, damping, step) {
            return false;
        }
        if free.len() == unknowns.iter().filter(|j| quadratic.scale[**j] > 0.0).count() {
            break;
        }
        let slope = quadratic.slope(damping, step);
        let least = FLAT * slope.iter().chain(&quadratic.rhs).fold(0.0_f64, |m, s| m.max(s.abs()));
        let inwards = |j: usize| match slope[j] {
            s if s > least => step[j] <= bounds.down[j] && bounds.up[j] > bounds.down[j],
            s if s < -least => step[j] >= bounds.up[j] && bounds.up[j] > bounds.down[j],
            _ => false,
        };
        let held = unknowns.iter().copied().filter(|j| quadratic.scale[*j] > 0.0 && !free.contains(j) && inwards(*j));
        let Some(next) = held.reduce(|a, b| if slope[b].abs() > slope[a].abs() { b } else { a }) else { break };
        free.push(next);
        free.sort_unstable();
    }
    true
}

/// Goes to the minimum of the free unknowns; those that meet a bound on the way are not free any more.
fn descend(quadratic: &Quadratic, bounds: &StepBounds, free: &mut Vec<usize>, damping: f64, step: &mut [f64]) -> bool {
    while !free.is_empty() {
        let mut wanted = step.to_vec();
        if !quadratic.solve(free, damping, &mut wanted) {
            return false;
        }
        let part = |j: usize| {
            let bound = if wanted[j] > step[j] { bounds.up[j] } else { bounds.down[j] };
            if wanted[j] == bounds.clip(j, wanted[j]) {
                1.0
            } else {
                ((bound - step[j]) / (wanted[j] - step[j])).max(0.0)
            }
        };
        let least = free.iter().map(|j| part(*j)).fold(1.0, f64::min);
        if least == 1.0 {
            step.copy_from_slice(&wanted);
            break;
        }
        let parts: Vec<f64> = free.iter().map(|j| part(*j)).collect();
        for (j, part) in free.iter().zip(&parts) {
            let further = if *part == least { wanted[*j] } else { step[*j] + least * (wanted[*j] - step[*j]) };
            step[*j] = bounds.clip(*j, further);
        }
        let mut blocked = parts.iter().map(|p| *p == least);
        free.retain(|_| !blocked.next().unwrap_or(false));
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Normal;

    /// A quadratic with four correlated unknowns.
    fn quadratic(seed: u64, precise: bool) -> Quadratic {
        let (mut noise, mut quadratic) = (Normal(seed), Quadratic::default());
        quadratic.begin(4);
        let row = |noise: &mut Normal| -> Vec<f64> {
            let common = noise.next();
            let mut row: Vec<f64> = (0..4).map(|_| noise.next() + 2.0 * common).collect();
            row.push(noise.next());
            row
        };
        for _ in 0..9 {
            let mut row = row(&mut noise);
            if precise {
                quadratic.add_rows(&mut row, &mut Vec::new());
                continue;
            }
            let (hessian, rhs) = quadratic.products();
            for i in 0..4 {
                (i..4).for_each(|j| hessian[4 * i + j] += row[i] * row[j]);
                rhs[i] += row[i] * row[4];
            }
        }
        quadratic.end();
        quadratic
    }

    #[test]
    fn no_point_within_the_bounds_is_lower() {
        for seed in 1..60 {
            for (precise, damping) in [(false, 0.0), (true, 0.0), (false, 0.3), (true, 0.3)] {
                let quadratic = quadratic(seed, precise);
                let mut noise = Normal(1000 + seed);
                let mut side = |sign: f64| (0..4).map(|_| sign * (0.2 * noise.next()).max(0.0)).collect::<Vec<f64>>();
                let bounds = StepBounds { down: side(-1.0), up: side(1.0) };
                let mut step = Vec::new();
                assert!(constrained(&quadratic, &bounds, damping, &mut step));
                let cost = |s: &[f64]| damping / 2.0 * s.iter().map(|v| v * v).sum::<f64>() - quadratic.reduction(s);
                let best = cost(&step);
                assert!((0..4).all(|j| bounds.down[j] <= step[j] && step[j] <= bounds.up[j]));
                for j in 0..4 {
                    for h in [-1e-3, 1e-3] {
                        let mut near = step.clone();
                        near[j] = bounds.clip(j, near[j] + h);
                        assert!(
                            cost(&near) >= best - 1e-12,
                            "seed {seed}: {step:?} in {bounds:?} is not lowest along {j}"
                        );
                    }
                }
            }
        }
    }
}
