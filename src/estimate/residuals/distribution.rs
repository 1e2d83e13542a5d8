//! How residuals are distributed, beside the normal distribution with their variance.

use fdm_numeric::statistics::normal_cdf;
use serde::{Deserialize, Serialize};

/// Bins reach so many standard deviations to both sides.
const REACH: f64 = 4.0;
/// Fewest and most bins.
const FEWEST: f64 = 8.0;
const MOST: f64 = 64.0;
/// Residuals beyond so many standard deviations are counted.
const FAR: f64 = 3.0;

/// Residuals about their mean, counted in bins of equal width.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Distribution {
    /// Their standard deviation, in the output's unit.
    pub deviation: f64,
    /// Edges of the bins (K + 1), in standard deviations from the mean.
    pub edges: Vec<f64>,
    /// Residuals in each bin (K).
    pub counts: Vec<usize>,
    /// How many a normal distribution gives on the average (K).
    pub expected: Vec<f64>,
    /// Residuals below the first and above the last bin.
    pub beyond: [usize; 2],
    /// Residuals more than three standard deviations from the mean, and how many a normal distribution gives on the average.
    pub far: (usize, f64),
}

impl Distribution {
    /// Of residuals about their mean, NaN where there is none; none when they do not vary.
    pub(super) fn new(series: &[f64]) -> Option<Self> {
        let present: Vec<f64> = series.iter().copied().filter(|v| !v.is_nan()).collect();
        let n = present.len() as f64;
        let deviation = (present.iter().map(|v| v * v).sum::<f64>() / n).sqrt();
        if !(deviation > 0.0 && deviation.is_finite()) {
            return None;
        }
        // Scott's rule; an even number, so that zero is an edge
        let half = (REACH / (3.49 * n.powf(-1.0 / 3.0))).ceil().clamp(FEWEST / 2.0, MOST / 2.0);
        let width = REACH / half;
        let edges: Vec<f64> = (0..=2 * half as usize).map(|k| (k as f64 - half) * width).collect();
        let (mut counts, mut beyond) = (vec![0; edges.len() - 1], [0, 0]);
        for v in &present {
            let place = ((v / deviation + REACH) / width).floor();
            match place {
                p if p < 0.0 => beyond[0] += 1,
                p if p >= counts.len() as f64 => beyond[1] += 1,
                p => counts[p as usize] += 1,
            }
        }
        let expected = edges.windows(2).map(|e| n * (normal_cdf(e[1]) - normal_cdf(e[0]))).collect();
        let far = present.iter().filter(|v| v.abs() > FAR * deviation).count();
        Some(Self { deviation, edges, counts, expected, beyond, far: (far, 2.0 * n * normal_cdf(-FAR)) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_residual_is_counted_once_and_the_normal_is_that_of_tables() {
        let mut series: Vec<f64> = (0..400).map(|k| ((f64::from(k) + 0.5) / 400.0 - 0.5) * 2.0).collect();
        (series[3], series[7]) = (f64::NAN, 40.0);
        let found = Distribution::new(&series).unwrap();
        assert_eq!(found.counts.iter().sum::<usize>() + found.beyond[0] + found.beyond[1], 399);
        assert_eq!((found.beyond, found.far.0), ([0, 1], 1));
        assert!((found.far.1 - 399.0 * 0.002_699_8).abs() < 1e-3, "{}", found.far.1);
        assert_eq!(found.edges.len(), found.counts.len() + 1);
        assert!((found.expected.iter().sum::<f64>() - 399.0 * 0.999_936_7).abs() < 1e-3);
        assert_eq!(Distribution::new(&[0.0; 9]), None);
    }
}
