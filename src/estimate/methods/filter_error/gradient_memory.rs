//! Curvature that the expected information does not have, learned from the gradients along the way.

use std::collections::VecDeque;

/// Steps that are remembered.
const REMEMBERED: usize = 12;
/// Standard errors of a step beyond which the cost is no quadratic, and what was met before belongs elsewhere.
const NEAR: f64 = 1.0;
/// Curvature along a step below this part of what its lengths promise is rounding, or none that a minimum has.
const LEAST: f64 = 1e-8;

/// The latest steps and by how much the gradient changed along each. Where the observed information differs from the expected
/// one by more than a half of it, scoring swings about the minimum and creeps to it; with the updates of Broyden, Fletcher,
/// Goldfarb and Shanno (Nocedal and Wright, chapter 6), begun anew at every point with the information there, it converges
/// faster than linearly.
#[derive(Debug, Default)]
pub(super) struct GradientMemory {
    last: Option<(Vec<f64>, Vec<f64>)>,
    steps: VecDeque<Step>,
}

/// A step and what the gradient changed along it.
#[derive(Debug)]
struct Step {
    moved: Vec<f64>,
    change: Vec<f64>,
}

impl GradientMemory {
    /// Remembers the step to this point; `information` (P by P) tells how many standard errors long it is.
    pub(super) fn visit(&mut self, point: &[f64], gradient: &[f64], information: &[f64]) {
        let size = point.len();
        if let Some((before, slope)) = &self.last {
            let moved: Vec<f64> = point.iter().zip(before).map(|(a, b)| a - b).collect();
            let change: Vec<f64> = gradient.iter().zip(slope).map(|(a, b)| a - b).collect();
            let errors = moved.iter().enumerate().map(|(j, d)| d.abs() * information[j * size + j].sqrt());
            let along = dot(&moved, &change);
            let lengths = (dot(&moved, &moved) * dot(&change, &change)).sqrt();
            if errors.fold(0.0, f64::max) > NEAR {
                self.steps.clear();
            } else if along > LEAST * lengths && along.is_finite() {
                if self.steps.len() == REMEMBERED {
                    self.steps.pop_front();
                }
                self.steps.push_back(Step { moved, change });
            }
        }
        self.last = Some((point.to_vec(), gradient.to_vec()));
    }

    /// Gives the information (P by P) the curvature that was met.
    pub(super) fn curve(&self, information: &mut [f64]) {
        for Step { moved, change } in &self.steps {
            let size = moved.len();
            let own: Vec<f64> = (0..size).map(|i| dot(&information[i * size..][..size], moved)).collect();
            let (held, met) = (dot(&own, moved), dot(change, moved));
            if !(held > 0.0 && met > 0.0) {
                continue;
            }
            for i in 0..size {
                for j in 0..size {
                    information[i * size + j] += change[i] * change[j] / met - own[i] * own[j] / held;
                }
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// So little information that no step is long.
    const SHORT: [f64; 4] = [1e-2, 0.0, 0.0, 1e-2];

    #[test]
    fn steps_of_a_quadratic_give_its_curvature() {
        let curvature = [4.0, 1.0, 1.0, 3.0];
        let gradient = |p: [f64; 2]| [4.0 * p[0] + p[1], p[0] + 3.0 * p[1]];
        let mut memory = GradientMemory::default();
        // conjugate steps: each is met exactly by the last matrix
        for point in [[1.0, 1.0], [0.0, 1.0], [0.25, 0.0]] {
            memory.visit(&point, &gradient(point), &SHORT);
        }
        let mut information = vec![1.0, 0.0, 0.0, 1.0];
        memory.curve(&mut information);
        for (found, truth) in information.iter().zip(curvature) {
            assert!((found - truth).abs() < 1e-12, "{information:?}");
        }
    }

    #[test]
    fn downward_bends_and_long_steps_are_not_believed() {
        let mut memory = GradientMemory::default();
        memory.visit(&[0.0], &[1.0], &[0.2]);
        memory.visit(&[1.0], &[0.5], &[0.2]);
        let mut information = vec![2.0];
        memory.curve(&mut information);
        assert_eq!(information, [2.0], "the gradient fell along the step");
        memory.visit(&[2.0], &[7.5], &[81.0]);
        memory.curve(&mut information);
        assert_eq!(information, [2.0], "nine standard errors tell nothing of here");
    }
}
