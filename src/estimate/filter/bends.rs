//! Curvature that the expected information does not have, learned from the gradients along the way.

use std::collections::VecDeque;

/// Steps that are remembered.
const REMEMBERED: usize = 12;
/// Standard errors of a step beyond which the cost is no quadratic, and what was met before belongs elsewhere.
const NEAR: f64 = 1.0;
/// Curvature along a step below this part of what its lengths promise is rounding, or none that a minimum has.
const LEAST: f64 = 1e-8;

/// The latest steps and by how much the gradient changed along each. Where the observed information differs from the expected one by more than
/// a half of it, scoring swings about the minimum and creeps to it; with the updates of Broyden, Fletcher, Goldfarb and Shanno (Nocedal and Wright,
/// chapter 6), begun anew at every point with the information there, it converges faster than linearly.
#[derive(Debug, Default)]
pub(super) struct Bends {
    last: Option<(Vec<f64>, Vec<f64>)>,
    steps: VecDeque<(Vec<f64>, Vec<f64>)>,
}

impl Bends {
    /// Remembers the step to this point, the largest part of which was `moved` standard errors.
    pub(super) fn meet(&mut self, point: &[f64], gradient: &[f64], moved: f64) {
        if moved > NEAR {
            self.steps.clear();
        } else if let Some((before, slope)) = &self.last {
            let less = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
            let (step, change) = (less(point, before), less(gradient, slope));
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let (along, lengths) = (dot(&step, &change), (dot(&step, &step) * dot(&change, &change)).sqrt());
            if along > LEAST * lengths && along.is_finite() {
                if self.steps.len() == REMEMBERED {
                    self.steps.pop_front();
                }
                self.steps.push_back((step, change));
            }
        }
        self.last = Some((point.to_vec(), gradient.to_vec()));
    }

    /// Gives the information (P by P) the curvature that was met.
    pub(super) fn bend(&self, information: &mut [f64]) {
        for (step, change) in &self.steps {
            let size = step.len();
            let own: Vec<f64> =
                (0..size).map(|i| (0..size).map(|j| information[i * size + j] * step[j]).sum::<f64>()).collect();
            let held: f64 = own.iter().zip(step).map(|(a, s)| a * s).sum();
            let met: f64 = change.iter().zip(step).map(|(y, s)| y * s).sum();
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_a_quadratic_give_its_curvature() {
        let curvature = [4.0, 1.0, 1.0, 3.0];
        let gradient = |p: [f64; 2]| [4.0 * p[0] + p[1], p[0] + 3.0 * p[1]];
        let mut bends = Bends::default();
        // conjugate steps: each is met exactly by the last matrix
        for point in [[1.0, 1.0], [0.0, 1.0], [0.25, 0.0]] {
            bends.meet(&point, &gradient(point), 0.5);
        }
        let mut information = vec![1.0, 0.0, 0.0, 1.0];
        bends.bend(&mut information);
        for (found, truth) in information.iter().zip(curvature) {
            assert!((found - truth).abs() < 1e-12, "{information:?}");
        }
    }

    #[test]
    fn downward_bends_are_not_believed() {
        let mut bends = Bends::default();
        bends.meet(&[0.0], &[1.0], 0.0);
        bends.meet(&[1.0], &[0.5], 0.5);
        let mut information = vec![2.0];
        bends.bend(&mut information);
        assert_eq!(information, [2.0]);
        bends.meet(&[2.0], &[7.5], 9.0);
        bends.bend(&mut information);
        assert_eq!(information, [2.0], "a long step tells nothing of here");
    }
}
