//! Noise whose deviation grows with its signal.
//!
//! The deviation of a sample is that of the output times 1 + k |y - c| / s, with c zero or the mean of the run and s the root mean square of
//! y - c. How fast it grows is told by what a sample differs from the mean of its neighbours, in which slow errors of a model are next to
//! nothing. It counts where it is significant (likelihood ratio), and where such differences are a good part of the residual: a large
//! error of the model grows with the signal too.

use fdm_numeric::statistics::chi_squared_tail;

/// Rates that are tried, from the least by a factor.
const RATES: (f64, f64, usize) = (0.1, 1.5, 14);
/// Samples over which a measured signal is averaged, to each side.
const BESIDE: usize = 2;
/// Fewest differences, and the chance of a likelihood ratio among both centres.
const FEWEST: usize = 64;
const CHANCE: f64 = 1e-4;
/// Variance of a difference from the mean of two neighbours, in that of white noise; part of the differences' squares that is independent.
const DIFFERENCE: f64 = 1.5;
const INDEPENDENT: f64 = 0.51;
/// Part of a residual's mean square that white noise explains, at least.
const WHITE: f64 = 0.3;
/// Squares beyond this many variances are cut back: an outlier is no law.
const OUTLIER: f64 = 16.0;

/// How the deviation of an output's noise depends on its signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Growth {
    /// Whether distances are from the mean of each run, or from zero.
    about_mean: bool,
    /// k
    rate: f64,
    /// s
    size: f64,
    /// Root mean square of 1 + k |y - c| / s over the runs it was found in.
    level: f64,
}

/// What one run tells: squares of differences beside distances of the signal.
struct Differences {
    distances: [Vec<f64>; 2],
    squares: Vec<f64>,
}

impl Growth {
    /// Of output `o` of `q`, by residuals and measured samples of runs (N by q each); none where the noise is even.
    pub(crate) fn found(runs: &[(&[f64], &[f64])], (o, q): (usize, usize)) -> Option<Self> {
        let each: Vec<Differences> =
            runs.iter().map(|(residual, measured)| Differences::new(residual, measured, (o, q))).collect();
        let residuals = || runs.iter().flat_map(|(r, _)| r.iter().skip(o).step_by(q)).filter(|r| !r.is_nan());
        let whole = residuals().map(|r| r * r).sum::<f64>() / residuals().count() as f64;
        let squares: Vec<f64> = each.iter().flat_map(|d| d.squares.iter().copied()).collect();
        let count = squares.len();
        let variance = squares.iter().sum::<f64>() / count as f64;
        if count < FEWEST || variance.is_nan() || variance <= DIFFERENCE * WHITE * whole {
            return None;
        }
        let squares: Vec<f64> = squares.into_iter().map(|s| s.min(OUTLIER * variance)).collect();
        let even = loss(&squares, |_| 1.0);
        let mut best: Option<(f64, Self)> = None;
        for (k, about_mean) in [false, true].into_iter().enumerate() {
            let distances: Vec<f64> = each.iter().flat_map(|d| d.distances[k].iter().copied()).collect();
            let size = (distances.iter().map(|d| d * d).sum::<f64>() / count as f64).sqrt();
            if !(size > 0.0 && size.is_finite()) {
                continue;
            }
            for step in 0..RATES.2 {
                let rate = RATES.0 * RATES.1.powi(step as i32);
                let factor = |k: usize| 1.0 + rate * distances[k] / size;
                let gain = even - loss(&squares, factor);
                if best.as_ref().is_none_or(|(g, _)| gain > *g) {
                    let level = ((0..count).map(|k| factor(k).powi(2)).sum::<f64>() / count as f64).sqrt();
                    best = Some((gain, Self { about_mean, rate, size, level }));
                }
            }
        }
        let (gain, growth) = best?;
        let chance = chi_squared_tail(2.0 * INDEPENDENT * gain.max(0.0), 1.0)?;
        (2.0 * chance < CHANCE).then_some(growth)
    }

    /// Relative deviations at the samples of a run: their mean square is 1 over all that it was found in.
    pub(crate) fn deviations(&self, measured: &[f64], (o, q): (usize, usize)) -> Vec<f64> {
        let signal = smoothed(measured, (o, q));
        let centre = if self.about_mean { mean(&signal) } else { 0.0 };
        signal.iter().map(|y| (1.0 + self.rate * (y - centre).abs() / self.size) / self.level).collect()
    }
}

impl Differences {
    fn new(residual: &[f64], measured: &[f64], (o, q): (usize, usize)) -> Self {
        let signal = smoothed(measured, (o, q));
        let centre = mean(&signal);
        let own: Vec<f64> = residual.iter().skip(o).step_by(q).copied().collect();
        let mut found = Self { distances: [Vec::new(), Vec::new()], squares: Vec::new() };
        for k in 1..own.len().saturating_sub(1) {
            let difference = own[k] - 0.5 * (own[k - 1] + own[k + 1]);
            if difference.is_nan() {
                continue;
            }
            found.squares.push(difference * difference);
            found.distances[0].push(signal[k].abs());
            found.distances[1].push((signal[k] - centre).abs());
        }
        found
    }
}

/// Minus the log-likelihood of squares whose deviations are in these proportions.
fn loss(squares: &[f64], factor: impl Fn(usize) -> f64) -> f64 {
    let (mut logs, mut sum) = (0.0, 0.0);
    for (k, square) in squares.iter().enumerate() {
        let factor = factor(k);
        logs += factor.ln();
        sum += square / (factor * factor);
    }
    logs + 0.5 * squares.len() as f64 * sum.ln()
}

/// A measured signal without most of its noise; the mean where nothing was measured nearby.
fn smoothed(measured: &[f64], (o, q): (usize, usize)) -> Vec<f64> {
    let own: Vec<f64> = measured.iter().skip(o).step_by(q).copied().collect();
    let whole = mean(&own);
    let near = |k: usize| {
        let near = mean(&own[k.saturating_sub(BESIDE)..own.len().min(k + BESIDE + 1)]);
        if near.is_nan() { whole } else { near }
    };
    (0..own.len()).map(near).collect()
}

/// The mean of what was measured.
fn mean(values: &[f64]) -> f64 {
    let (sum, count) = values.iter().filter(|v| !v.is_nan()).fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
    sum / count
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_numeric::random::Stream;

    /// Residual and measured signal of a wave under noise whose deviation is a function of it.
    fn run(seed: u64, deviation: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
        let mut normal = Stream::seeded(seed);
        let wave = |k: usize| 3.0 + 2.0 * (k as f64 * 0.05).sin();
        let residual: Vec<f64> = (0..500).map(|k| deviation(wave(k)) * normal.normal_of_pair()).collect();
        let measured = residual.iter().enumerate().map(|(k, r)| wave(k) + r).collect();
        (residual, measured)
    }

    fn found(deviation: impl Fn(f64) -> f64 + Copy) -> Vec<Option<Growth>> {
        let one = |seed: u64| {
            let (residual, measured) = run(seed, deviation);
            Growth::found(&[(&residual, &measured)], (0, 1))
        };
        (0..40).map(one).collect()
    }

    #[test]
    fn even_noise_is_even() {
        assert!(found(|_| 0.1).iter().flatten().count() == 0);
    }

    #[test]
    fn noise_that_grows_is_seen_as_it_grows() {
        let grows = |y: f64| 0.02 + 0.1 * (y - 3.0).abs();
        let all = found(grows);
        assert!(all.iter().flatten().count() > 36, "{}", all.iter().flatten().count());
        let (_, measured) = run(1, grows);
        let relative = all[1].map(|g| g.deviations(&measured, (0, 1))).unwrap_or_default();
        // at the extremes against where the wave crosses its mean
        let (top, middle) = (relative[31], relative[63]);
        assert!(top / middle > 3.0 && top / middle < 15.0, "{top} {middle}");
    }

    #[test]
    fn an_error_of_the_model_is_no_noise() {
        let (noise, measured) = run(3, |_| 0.02);
        let wrong: Vec<f64> = noise.iter().zip(&measured).map(|(r, y)| r + 0.2 * (y - 3.0)).collect();
        assert_eq!(Growth::found(&[(&wrong, &measured)], (0, 1)), None);
    }
}
