//! Samples of which only a limit is known that they lie below (left-censored): method M3 of Beal (2001), the likelihood of Tobin (1958).
//!
//! With the deviation s of the noise such a sample has the probability `Phi(u)`, `u = (L - y)/s`. Minus its logarithm has the gradient `-lambda du` and the second
//! derivative `lambda (lambda + u)` by u, `lambda = phi(u)/Phi(u)`. A row `sqrt(lambda (lambda + u)) du` with the residual `sqrt(lambda/(lambda + u))` has both: a step
//! of Gauss and Newton is one of Newton in u. By `y/s` and `1/s` this likelihood and that of samples with values are convex (Olsen 1978), so that
//! their rows are taken by these.

use fdm_numeric::statistics::normal_cdf;
use fdm_system::record::{Censored, Run};
use std::f64::consts::TAU;

/// The normal law below `u`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Below {
    /// Logarithm of the probability.
    pub(super) logarithm: f64,
    /// `lambda`, its derivative.
    ratio: f64,
    /// `lambda + u`.
    excess: f64,
}

impl Below {
    pub(super) fn new(u: f64) -> Self {
        let density = -0.5 * (u * u + TAU.ln());
        if u > -5.0 {
            let probability = normal_cdf(u);
            let ratio = density.exp() / probability;
            return Self { logarithm: probability.ln(), ratio, excess: ratio + u };
        }
        // the continued fraction of Mills' ratio (Abramowitz & Stegun 1964, 26.2.14): differences of nearly equal numbers are avoided
        let rest = (2..=40).rev().fold(-u, |rest, k| f64::from(k) / rest - u);
        let (ratio, excess) = (1.0 / rest - u, 1.0 / rest);
        Self { logarithm: density - ratio.ln(), ratio, excess }
    }

    /// What the row of u is multiplied by.
    pub(super) fn weight(&self) -> f64 {
        (self.ratio * self.excess).sqrt()
    }

    /// The residual; that of a sample with the value L far above the limit.
    pub(super) fn residual(&self) -> f64 {
        (self.ratio / self.excess).sqrt()
    }
}

/// The limits of a run's samples (N by q), NaN where there are none; empty where no sample has one.
pub(super) fn limits(censored: &[Censored], run: &Run, q: usize) -> Vec<f64> {
    let mut own = censored.iter().filter(|c| c.run == run.name && c.output < q).peekable();
    if own.peek().is_none() {
        return Vec::new();
    }
    let mut limits = vec![f64::NAN; run.len() * q];
    for sample in own {
        // parts and thinned records have fewer samples
        if let Ok(at) = run.time.binary_search_by(|t| t.total_cmp(&sample.time))
            && run.measured[at * q + sample.output].is_nan()
        {
            limits[at * q + sample.output] = sample.limit;
        }
    }
    limits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_the_logarithm_on_both_sides_of_the_fraction() {
        let log = |u: f64| Below::new(u).logarithm;
        for u in [-80.0, -12.0, -5.1, -4.9, -1.0, 0.0, 0.7, 3.0, 6.0] {
            let (h, below) = (1e-4, Below::new(u));
            let slope = (log(u + h) - log(u - h)) / (2.0 * h);
            assert!((below.ratio - slope).abs() < 1e-6 * (1.0 + slope), "{u}: {below:?} {slope}");
            let bend = (Below::new(u - h).ratio - Below::new(u + h).ratio) / (2.0 * h);
            assert!((below.weight().powi(2) - bend).abs() < 1e-6, "{u}: {below:?} {bend}");
            assert!((below.weight() * below.residual() - below.ratio).abs() < 1e-12 * below.ratio);
        }
        // the normal law of `numeric` is right to ten digits there
        let step = log(-5.0 + 1e-9) - log(-5.0 - 1e-9);
        assert!((step - 2e-9 * Below::new(-5.0).ratio).abs() < 1e-10, "{step}");
        let far = Below::new(50.0);
        assert_eq!((far.logarithm, far.weight(), far.residual()), (0.0, 0.0, 0.0));
    }
}
