//! The different lengths of a run's steps: each needs coefficients of its own.

use crate::simulate::grid::Grid;

/// More different lengths than this are no sampling that recursions are worth their coefficients for.
const MOST: usize = 16;

/// Lengths of steps, and which one each step has.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::simulate) struct Intervals {
    /// The different lengths.
    pub(super) lengths: Vec<f64>,
    /// For each step the position of its length; empty when there is only one.
    of_step: Vec<u8>,
}

impl Intervals {
    /// Lengths that differ by the rounding of times count as one, their mean; none when there are too many.
    pub(in crate::simulate) fn of(grid: &Grid) -> Option<Self> {
        let times = grid.samples();
        let rounding = 8.0 * f64::EPSILON * times.iter().fold(0.0_f64, |m, t| m.max(t.abs()));
        // first and sum of the lengths, and how many there are
        let mut kinds: Vec<(f64, f64, usize)> = Vec::new();
        let mut of_step = Vec::with_capacity(grid.steps());
        for k in 0..grid.steps() {
            let h = grid.step(k).1;
            let kind = match kinds.iter().position(|(first, ..)| (first - h).abs() <= rounding) {
                Some(kind) => kind,
                None if kinds.len() == MOST => return None,
                None => {
                    kinds.push((h, 0.0, 0));
                    kinds.len() - 1
                }
            };
            kinds[kind].1 += h - kinds[kind].0;
            kinds[kind].2 += 1;
            of_step.push(kind as u8);
        }
        if kinds.len() <= 1 {
            of_step.clear();
        }
        let lengths = kinds.iter().map(|(first, sum, count)| first + sum / *count as f64).collect();
        Some(Self { lengths, of_step })
    }

    /// Which length a step has.
    #[inline(always)]
    pub(super) fn of_step(&self, k: usize) -> usize {
        self.of_step.get(k).map_or(0, |kind| *kind as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_of_times_is_no_difference_and_jitter_is() {
        let even: Vec<f64> = (0..5000).map(|k| k as f64 * 0.1).collect();
        let intervals = Intervals::of(&Grid::new(&even, &2.into())).expect("one length");
        assert!((intervals.lengths[0] - 0.05).abs() < 1e-14 && intervals.lengths.len() == 1);
        let rounded: Vec<f64> = (0..50).map(|k| (k as f64 * 1000.0 / 350.0).round() / 1000.0).collect();
        let intervals = Intervals::of(&Grid::new(&rounded, &1.into())).expect("two lengths");
        assert_eq!(intervals.lengths.len(), 2);
        assert!((intervals.lengths[intervals.of_step(0)] - 0.003).abs() < 1e-15);
        let uneven: Vec<f64> = (0..50).map(|k| (k * k) as f64).collect();
        assert!(Intervals::of(&Grid::new(&uneven, &1.into())).is_none());
    }
}
