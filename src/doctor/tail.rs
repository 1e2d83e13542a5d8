//! The tail of a distribution that nobody knows, from the numbers themselves.

/// An exponential tail above the 75 % quantile. It is fitted by the median of the excesses, so that up to half of them may be faults. Most
/// signals have lighter tails, for which its probabilities are too large: the safe side.
#[derive(Debug, Clone, Copy)]
pub struct Tail {
    /// The 75 % quantile.
    pub start: f64,
    /// Mean excess.
    pub scale: f64,
    /// Numbers it was made from.
    count: f64,
}

impl Tail {
    /// Of sizes (not negative); reorders them. None for fewer than twenty.
    pub fn new(sizes: &mut [f64]) -> Option<Self> {
        const FEWEST: usize = 20;
        let n = sizes.len();
        if n < FEWEST {
            return None;
        }
        let at = n * 3 / 4;
        let (_, start, above) = sizes.select_nth_unstable_by(at, f64::total_cmp);
        let start = *start;
        let middle = above.len() / 2;
        let median = above.select_nth_unstable_by(middle, f64::total_cmp).1.to_owned();
        let scale = ((median - start) / std::f64::consts::LN_2).max(1e-3 * start);
        Some(Self { start, scale, count: n as f64 })
    }

    /// Probability that the greatest of all numbers is above `size`.
    pub fn exceeded(&self, size: f64) -> f64 {
        if self.scale <= 0.0 {
            return if size > self.start { 0.0 } else { 1.0 };
        }
        (0.25 * self.count * (-(size - self.start) / self.scale).exp()).min(1.0)
    }
}
