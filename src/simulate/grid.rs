//! Where the integrator steps: a whole number of equal steps between neighbouring samples.

/// The steps of one run; chosen once per fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Time of each sample (N).
    samples: Vec<f64>,
    /// Steps between neighbouring samples; 0 where there is nothing to integrate.
    per_interval: usize,
    /// Beginning and length of each step.
    steps: Vec<(f64, f64)>,
}

impl Grid {
    /// `per_interval` steps between any two samples; 0 for a model without states.
    pub fn new(samples: &[f64], per_interval: usize) -> Self {
        let mut steps = Vec::with_capacity(samples.len().saturating_sub(1) * per_interval);
        for pair in samples.windows(2) {
            let h = (pair[1] - pair[0]) / per_interval as f64;
            steps.extend((0..per_interval).map(|k| (pair[0] + h * k as f64, h)));
        }
        Self { samples: samples.to_vec(), per_interval, steps }
    }

    /// Steps between neighbouring samples.
    pub fn per_interval(&self) -> usize {
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

    /// The sample that stands at the beginning of a step, if one does.
    #[inline]
    pub fn sample_at(&self, step: usize) -> Option<usize> {
        if self.per_interval <= 1 {
            return Some(step);
        }
        step.is_multiple_of(self.per_interval).then(|| step / self.per_interval)
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_fill_uneven_intervals() {
        let g = Grid::new(&[0.0, 1.0, 4.0], 3);
        assert_eq!(g.steps(), 6);
        assert_eq!((g.step(1), g.step(4)), ((1.0 / 3.0, 1.0 / 3.0), (2.0, 1.0)));
        assert_eq!((g.sample_at(3), g.sample_at(4)), (Some(1), None));
    }
}
