//! How often something happened, and what so many trials tell of how often it does: the interval of Clopper and Pearson.

use serde::Serialize;
use statrs::distribution::{Beta, ContinuousCDF};

/// So many of so many.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Share {
    /// How often it happened.
    pub hits: usize,
    /// Of so many.
    pub of: usize,
    /// The share; 0 of none.
    pub share: f64,
    /// The interval that holds the true share in 95 % of cases or more (Clopper and Pearson).
    pub interval: [f64; 2],
}

/// Probability on each side of the interval.
const TAIL: f64 = 0.025;

impl Share {
    /// `hits` of `of`.
    pub fn new(hits: usize, of: usize) -> Self {
        let (k, n) = (hits as f64, of as f64);
        let quantile = |a: f64, b: f64, p: f64| Beta::new(a, b).map_or(f64::NAN, |beta| beta.inverse_cdf(p));
        let lower = if hits == 0 { 0.0 } else { quantile(k, n - k + 1.0, TAIL) };
        let upper = if hits >= of { 1.0 } else { quantile(k + 1.0, n - k, 1.0 - TAIL) };
        Self { hits, of, share: if of > 0 { k / n } else { 0.0 }, interval: [lower, upper] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_those_of_the_tables() {
        let close = |got: [f64; 2], want: [f64; 2]| {
            assert!((got[0] - want[0]).abs() < 1e-4 && (got[1] - want[1]).abs() < 1e-4, "{got:?} {want:?}");
        };
        // Clopper and Pearson (1934); 0 of 10 has the closed form 1 - 0.025^(1/10)
        close(Share::new(0, 10).interval, [0.0, 1.0 - 0.025f64.powf(0.1)]);
        close(Share::new(10, 10).interval, [0.025f64.powf(0.1), 1.0]);
        close(Share::new(3, 10).interval, [0.066_740, 0.652_453]);
        close(Share::new(950, 1000).interval, [0.934_597, 0.962_678]);
        assert_eq!(Share::new(0, 0).interval, [0.0, 1.0]);
    }
}
