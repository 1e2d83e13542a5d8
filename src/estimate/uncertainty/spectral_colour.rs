//! Whether the noise of an output is equally strong at all frequencies that were compared: the cumulated power of the residuals beside a straight line
//! (Bartlett 1955; the distance of Kolmogorov and Smirnov, in the form of Stephens 1974).

use super::spectral_rows::{SpectralRows, independent};
use crate::residuals::whiteness::SIGNIFICANT;
use serde::{Deserialize, Serialize};

/// Fewest independent coefficients for a test.
const FEWEST: f64 = 10.0;
/// Terms of the law of Kolmogorov.
const TERMS: i32 = 20;

/// The power of an output's residuals over frequency.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct SpectralColour {
    /// Name of the output.
    pub output: String,
    /// Probability of a cumulated power as far from a straight line, were the noise white.
    pub p_value: f64,
    /// Whether the power is larger at low frequencies than at high ones.
    pub falls: bool,
}

impl SpectralColour {
    /// Whether nothing speaks against white noise (at one percent).
    pub fn is_white(&self) -> bool {
        self.p_value >= SIGNIFICANT
    }

    /// Of an output in all runs, whose residuals have the leverage corrections `taken` (q by q by M for each run); none of too few coefficients.
    pub(super) fn of(name: &str, output: usize, runs: &[SpectralRows], taken: &[Vec<f64>]) -> Option<Self> {
        let mut power: Vec<(f64, f64)> = Vec::new();
        for (run, taken) in runs.iter().zip(taken) {
            let count = run.omega.len();
            let q = run.residuals.len() / count.max(1);
            let own = run.residuals[output * count..].iter().zip(&taken[(output * q + output) * count..]);
            let compared = run.omega.iter().zip(own).filter(|(_, (v, _))| !v.is_nan());
            power.extend(compared.map(|(w, (v, taken))| (*w, v.norm_sqr() + taken)));
        }
        power.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let band = power.last()?.0 - power.first()?.0;
        // closer than one cycle in the record coefficients repeat each other
        let effective = (independent(runs) * band + 1.0).min(power.len() as f64);
        let values: Vec<f64> = power.into_iter().map(|(_, p)| p).collect();
        let (distance, falls) = farthest(&values)?;
        (effective >= FEWEST).then(|| Self { output: name.into(), p_value: chance(distance, effective), falls })
    }
}

/// The largest distance of the cumulated power from a straight line, and whether it lies above it; none without power.
fn farthest(power: &[f64]) -> Option<(f64, bool)> {
    let total: f64 = power.iter().sum();
    let (mut sum, mut above, mut below) = (0.0, 0.0_f64, 0.0_f64);
    for (k, p) in power.iter().enumerate() {
        below = below.max(k as f64 / power.len() as f64 - sum / total);
        sum += p;
        above = above.max(sum / total - (k + 1) as f64 / power.len() as f64);
    }
    (total > 0.0 && total.is_finite()).then_some((above.max(below), above > below))
}

/// Probability of a larger distance among so many independent values.
fn chance(distance: f64, count: f64) -> f64 {
    let root = count.sqrt();
    let x = (root + 0.12 + 0.11 / root) * distance;
    // below this the series does not converge, and nothing is significant
    if x < 0.3 {
        return 1.0;
    }
    let term = |j: i32| if j % 2 == 1 { 2.0 } else { -2.0 } * (-2.0 * f64::from(j * j) * x * x).exp();
    (1..=TERMS).map(term).sum::<f64>().clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_numeric::random::Stream;

    #[test]
    fn white_noise_is_white_and_noise_that_falls_is_not() {
        let mut random = Stream::seeded(57);
        let mut significant = |slope: f64| {
            let one = |_: i32| {
                let draw = |k: i32| {
                    let [a, b] = [random.normal_by_inversion(), random.normal_by_inversion()];
                    (a * a + b * b) * (1.0 + slope * (1.0 - f64::from(k) / 80.0))
                };
                let power: Vec<f64> = (0..80).map(draw).collect();
                let (distance, _) = farthest(&power).expect("power");
                chance(distance, 80.0) < SIGNIFICANT
            };
            (0..1000).map(one).filter(|s| *s).count()
        };
        let (white, falling) = (significant(0.0), significant(9.0));
        assert!((2..=20).contains(&white) && falling > 900, "{white} {falling}");
        // the value of Kolmogorov's law at five percent
        assert!((chance(0.01358, 1e4) - 0.05).abs() < 1e-3);
    }
}
