//! Independent numbers in a series.

/// About the mean, of finite numbers.
pub(crate) fn variance(values: impl Iterator<Item = f64>) -> f64 {
    let (mut n, mut mean, mut squares) = (0.0, 0.0, 0.0);
    for v in values.filter(|v| v.is_finite()) {
        n += 1.0;
        let d = v - mean;
        mean += d / n;
        squares += d * (v - mean);
    }
    squares / f64::max(n, 1.0)
}

/// Samples over the sum of autocorrelations up to the first that is not above chance: white residuals count in full.
pub(crate) fn independent_samples(e: &[f64]) -> f64 {
    const LONGEST: usize = 400;
    let n = e.len();
    let power: f64 = e.iter().map(|v| v * v).sum();
    if n < 4 || power <= 0.0 {
        return n as f64;
    }
    let chance = 2.0 / (n as f64).sqrt();
    let mut sum = 1.0;
    for lag in 1..LONGEST.min(n / 3 + 1) {
        let r: f64 = e.iter().zip(&e[lag..]).map(|(a, b)| a * b).sum::<f64>() / power;
        if r < chance {
            break;
        }
        sum += 2.0 * r;
    }
    n as f64 / sum
}
