//! Where the integrator steps: times of the steps of one run, none of which crosses a sample.

use super::steps::Steps;

/// The steps of one run; chosen once per fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Time of each sample (N).
    samples: Vec<f64>,
    /// Beginning and length of each step.
    steps: Vec<(f64, f64)>,
    /// The sample at or before each node: the beginnings of the steps, and the end of the last.
    before: Vec<u32>,
    /// Steps in every interval, when they are as many and equal in all.
    per_interval: Option<usize>,
}

impl Grid {
    /// Steps between samples.
    pub fn new(samples: &[f64], steps: &Steps) -> Self {
        let mut grid = Self { per_interval: steps.per_interval(), ..Self::without_steps(samples) };
        let total = steps.total(samples.len());
        grid.steps.reserve_exact(total);
        grid.before.reserve_exact(total + 1);
        for (interval, pair) in samples.windows(2).enumerate() {
            let whole = pair[1] - pair[0];
            steps.each(interval, |begin, end| {
                grid.steps.push((pair[0] + whole * begin, whole * (end - begin)));
                grid.before.push(interval as u32);
            });
        }
        grid.before.push(samples.len().saturating_sub(1) as u32);
        grid
    }

    /// Samples of a model without states: there is nothing to integrate.
    pub fn without_steps(samples: &[f64]) -> Self {
        Self { samples: samples.to_vec(), steps: Vec::new(), before: Vec::new(), per_interval: None }
    }

    /// Steps in every interval, when they are as many and equal in all.
    #[inline]
    pub fn per_interval(&self) -> Option<usize> {
        self.per_interval
    }

    /// Times of the samples.
    pub fn samples(&self) -> &[f64] {
        &self.samples
    }

    /// Number of steps.
    #[inline]
    pub fn steps(&self) -> usize {
        self.steps.len()
    }

    /// The sample that stands at node k, the beginning of step k or the end of the last step, if one does.
    #[inline]
    pub fn sample_at(&self, node: usize) -> Option<usize> {
        if node == 0 {
            return Some(0);
        }
        let sample = self.before[node];
        (sample != self.before[node - 1]).then_some(sample as usize)
    }

    /// Time at the end of a step: to the bit the beginning of the next.
    pub(super) fn end(&self, k: usize) -> f64 {
        self.steps.get(k + 1).map_or_else(|| self.samples[self.samples.len() - 1], |(t, _)| *t)
    }

    /// Beginning and length of a step.
    #[inline]
    pub fn step(&self, k: usize) -> (f64, f64) {
        self.steps[k]
    }

    /// The sample at or before a step.
    #[inline]
    pub fn sample_before(&self, step: usize) -> usize {
        self.before[step] as usize
    }

    /// The greatest number of steps that touch any stretch of this length.
    pub(super) fn most_within(&self, length: f64) -> usize {
        let (mut first, mut most) = (0, 0);
        for (k, (t, _)) in self.steps.iter().enumerate() {
            while self.steps[first].0 + self.steps[first].1 < t - length {
                first += 1;
            }
            most = most.max(k - first + 1);
        }
        most
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::scheme::Scheme;

    #[test]
    fn steps_fill_uneven_intervals() {
        let g = Grid::new(&[0.0, 1.0, 4.0], &Steps::from(3));
        assert_eq!(g.steps(), 6);
        assert_eq!((g.step(0), g.step(3)), ((0.0, 1.0 / 3.0), (1.0, 1.0)));
        assert_eq!([0, 1, 3, 4, 6].map(|k| g.sample_at(k)), [Some(0), None, Some(1), None, Some(2)]);
        assert_eq!(Grid::without_steps(&[0.0, 1.0]).sample_at(0), Some(0));
    }

    #[test]
    fn uneven_steps_end_on_samples() {
        let steps = Steps::uneven(Scheme::Radau, [&[0.25, 1.0][..], &[1.0]]);
        let g = Grid::new(&[0.0, 2.0, 3.0], &steps);
        assert_eq!((0..3).map(|k| g.step(k)).collect::<Vec<_>>(), [(0.0, 0.5), (0.5, 1.5), (2.0, 1.0)]);
        assert_eq!([0, 1, 2, 3].map(|k| g.sample_at(k)), [Some(0), None, Some(1), Some(2)]);
        assert_eq!((g.sample_before(1), g.sample_before(2)), (0, 1));
        assert!(g.most_within(1.5) == 3 && g.most_within(0.1) == 2);
    }
}
