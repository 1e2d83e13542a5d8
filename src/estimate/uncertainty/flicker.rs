//! 1/f noise of deviation 1 beside a white part: the mean of first-order Gauss-Markov processes whose correlation times lie in equal factors, so that each
//! octave of frequencies has the same power (Keshner 1982). Instruments drift so, and no single correlation time is theirs. As a process of a few states it
//! is filtered exactly at any times, even or not (Kalman 1960).

use super::noise_candidates::{Clock, LEAST, spaced};

/// Factor from one correlation time to the next, at most: the density then leaves 1/f by 3 % at most between the ends.
const STEP: f64 = 4.0;

/// 1/f noise between two correlation times.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Flicker {
    /// Correlation times in units of the clock.
    time_constants: Vec<f64>,
    /// The part of the variance that is white.
    white: f64,
    /// What its correlation decays over.
    pub(super) clock: Clock,
}

/// The filter at each sample.
struct Gain {
    /// What is left of each state since the sample before.
    left: Vec<f64>,
    /// Gain of each state.
    gain: Vec<f64>,
    /// Deviation of the innovation.
    deviation: f64,
}

impl Flicker {
    /// From the shortest correlation time to the longest, both above 0.
    pub(super) fn new([shortest, longest]: [f64; 2], white: f64, clock: Clock) -> Self {
        Self { time_constants: spaced(shortest, longest, STEP).collect(), white, clock }
    }

    /// Variance of each process.
    fn share(&self) -> f64 {
        (1.0 - self.white) / self.time_constants.len() as f64
    }

    /// Correlation of two samples that are `apart`.
    pub(super) fn correlation(&self, apart: f64) -> f64 {
        match apart == 0.0 {
            true => 1.0,
            false => self.share() * self.time_constants.iter().map(|t| (-apart / t).exp()).sum::<f64>(),
        }
    }

    fn gains(&self, moments: &[f64]) -> Vec<Gain> {
        let (m, share) = (self.time_constants.len(), self.share());
        // covariance of the states before the first sample
        let mut p: Vec<f64> = (0..m * m).map(|k| if k / m == k % m { share } else { 0.0 }).collect();
        let mut before = f64::NEG_INFINITY;
        let gain = |t: &f64| {
            let left: Vec<f64> = self.time_constants.iter().map(|own| (-(t - before) / own).exp()).collect();
            before = *t;
            for (k, entry) in p.iter_mut().enumerate() {
                let (i, j) = (k / m, k % m);
                *entry *= left[i] * left[j];
                if i == j {
                    *entry += share * (1.0 - left[i] * left[i]);
                }
            }
            let seen: Vec<f64> = p.chunks_exact(m).map(|row| row.iter().sum()).collect();
            let innovation = (seen.iter().sum::<f64>() + self.white).max(LEAST);
            p.iter_mut().enumerate().for_each(|(k, entry)| *entry -= seen[k / m] * seen[k % m] / innovation);
            let gain = seen.into_iter().map(|s| s / innovation).collect();
            Gain { left, gain, deviation: innovation.sqrt() }
        };
        moments.iter().map(gain).collect()
    }

    /// Makes independent numbers of deviation 1 of columns that have this noise: `L^-1 rows` in place (a row of `width` for each
    /// moment of the clock); returns the logarithm of the determinant of `L L'`.
    pub(super) fn whiten(&self, moments: &[f64], rows: &mut [f64], width: usize) -> f64 {
        let mut states = vec![0.0; self.time_constants.len() * width];
        let mut innovations = vec![0.0; width];
        let mut logarithm = 0.0;
        for (Gain { left, gain, deviation }, row) in self.gains(moments).iter().zip(rows.chunks_exact_mut(width)) {
            logarithm += 2.0 * deviation.ln();
            innovations.copy_from_slice(row);
            for (state, left) in states.chunks_exact_mut(width).zip(left) {
                for (x, innovation) in state.iter_mut().zip(&mut innovations) {
                    *x *= left;
                    *innovation -= *x;
                }
            }
            for (state, gain) in states.chunks_exact_mut(width).zip(gain) {
                state.iter_mut().zip(&innovations).for_each(|(x, innovation)| *x += gain * innovation);
            }
            row.iter_mut().zip(&innovations).for_each(|(value, innovation)| *value = innovation / deviation);
        }
        logarithm
    }

    /// What independent numbers of deviation 1 do through this noise: `L' rows` in place.
    pub(super) fn transpose(&self, moments: &[f64], rows: &mut [f64], width: usize) {
        // what the states after a sample do to all later ones
        let mut states = vec![0.0; self.time_constants.len() * width];
        let mut sums = vec![0.0; width];
        let gains = self.gains(moments);
        for (Gain { left, gain, deviation }, row) in gains.iter().zip(rows.chunks_exact_mut(width)).rev() {
            sums.copy_from_slice(row);
            for (state, (left, gain)) in states.chunks_exact_mut(width).zip(left.iter().zip(gain)) {
                for ((x, sum), own) in state.iter_mut().zip(&mut sums).zip(&*row) {
                    *sum += gain * *x;
                    *x = left * (*x + own);
                }
            }
            row.iter_mut().zip(&sums).for_each(|(value, sum)| *value = deviation * sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_octave_has_the_same_power() {
        // density of the sum of Lorentzians over frequency, times the frequency
        let noise = Flicker::new([0.5, 2000.0], 0.0, Clock::Time);
        let power = |w: f64| noise.time_constants.iter().map(|t| w * t / (1.0 + (w * t).powi(2))).sum::<f64>();
        let all: Vec<f64> = (0..40).map(|k| power(0.005 * 1.1_f64.powi(k))).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        assert!(all.iter().all(|p| (p / mean - 1.0).abs() < 0.03), "{all:?}");
    }
}
