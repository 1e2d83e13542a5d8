//! Where the integrator steps: a whole number of equal steps between neighbouring samples.

/// The steps of one run; chosen once per fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Time of each sample (N).
    samples: Vec<f64>,
    /// Steps between neighbouring samples; 0 where there is nothing to integrate.
    per_interval: usize,
}

impl Grid {
    /// `per_interval` steps between any two samples; 0 for a model without states.
    pub fn new(samples: &[f64], per_interval: usize) -> Self {
        Self { samples: samples.to_vec(), per_interval }
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
    pub fn steps(&self) -> usize {
        self.samples.len().saturating_sub(1) * self.per_interval
    }

    /// The sample that stands at the beginning of a step, if one does.
    #[inline]
    pub fn sample_at(&self, step: usize) -> Option<usize> {
        if self.per_interval <= 1 {
            return Some(step);
        }
        step.is_multiple_of(self.per_interval).then(|| step / self.per_interval)
    }

    /// Beginning and length of a step.
    #[inline]
    pub fn step(&self, k: usize) -> (f64, f64) {
        let (interval, within) =
            if self.per_interval == 1 { (k, 0) } else { (k / self.per_interval, k % self.per_interval) };
        let (from, to) = (self.samples[interval], self.samples[interval + 1]);
        let h = (to - from) / self.per_interval as f64;
        (from + h * within as f64, h)
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
