//! Sums `sum_k x_k exp(-j w k dt)` of many channels, planned once and by the cheapest way.

use super::direct_sum::DirectSum;
use super::fft::RealFft;
use super::frequencies::Comb;
use num_complex::Complex64;

/// A planned transform of records of one length at one choice of frequencies.
#[derive(Debug)]
pub struct Transform {
    samples: usize,
    channels: usize,
    comb: Comb,
    way: Way,
}

#[derive(Debug)]
enum Way {
    Direct(DirectSum),
    Grid(RealFft),
}

impl Transform {
    /// Plans sums of `samples` samples of `channels` channels.
    pub fn new(samples: usize, channels: usize, comb: &Comb) -> Self {
        let way = match &comb.bins {
            Some(_) => Way::Grid(RealFft::new(samples)),
            None => Way::Direct(DirectSum::new(samples, 0.0, &comb.cycles)),
        };
        Self { samples, channels, comb: comb.clone(), way }
    }

    /// The frequencies.
    pub fn comb(&self) -> &Comb {
        &self.comb
    }

    /// Sums of `rows` (samples by channels), one channel after the other (channels by frequencies).
    ///
    /// # Panics
    /// When `rows` holds another number of samples or channels than was planned.
    pub fn apply(&mut self, rows: &[f64]) -> Vec<Complex64> {
        assert_eq!(rows.len(), self.samples * self.channels, "rows of another shape than was planned");
        let mut sums = vec![Complex64::ZERO; self.channels * self.comb.len()];
        if sums.is_empty() {
            return sums;
        }
        match &mut self.way {
            Way::Direct(plan) => plan.sum(rows, self.channels, self.channels, &mut sums),
            Way::Grid(plan) => {
                let Some(bins) = &self.comb.bins else { return sums };
                for (c, sums) in sums.chunks_exact_mut(bins.len()).enumerate() {
                    plan.transform(rows.iter().skip(c).step_by(self.channels).copied(), bins.clone(), sums);
                }
            }
        }
        sums
    }
}
