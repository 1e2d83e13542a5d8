//! A variance of which several values are possible, and the interval of a number that has it.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// Most values that are kept apart.
const MOST: usize = 64;
/// Weights below this are nothing.
const NOTHING: f64 = 1e-9;
/// What intervals leave out.
const OUTSIDE: f64 = 0.05;
/// Fewest degrees of freedom, and those from which on Student's law is the normal law.
const FREEDOM: [f64; 2] = [3.0, 1e6];
/// Halvings of an interval in which a number is sought.
const HALVINGS: usize = 50;

/// Values of a variance and how likely each is.
#[derive(Debug, Clone)]
pub(super) struct Mixture(Vec<(f64, f64)>);

impl Mixture {
    /// A variance that is known.
    pub(super) fn known(variance: f64) -> Self {
        Self(vec![(1.0, variance)])
    }

    /// Variances with these weights.
    pub(super) fn of(values: impl Iterator<Item = (f64, f64)>) -> Self {
        Self(values.filter(|(weight, _)| *weight > NOTHING).collect())
    }

    /// Nothing yet.
    pub(super) fn none() -> Self {
        Self(Vec::new())
    }

    /// Adds what is possible besides, with this weight.
    pub(super) fn or(&mut self, other: &Self, weight: f64) {
        let values = other.0.iter().map(|(w, v)| (w * weight, *v));
        self.0.extend(values.filter(|(weight, _)| *weight > NOTHING));
    }

    /// The sum with another variance that is independent of this.
    pub(super) fn plus(&self, other: &Self) -> Self {
        let pairs = self.0.iter().flat_map(|(w, v)| other.0.iter().map(move |(x, u)| (w * x, v + u)));
        let all: Vec<(f64, f64)> = pairs.filter(|(weight, _)| *weight > NOTHING).collect();
        let logarithm = |v: f64| v.max(f64::MIN_POSITIVE).ln();
        let range = |(low, high): (f64, f64), (_, v): &(f64, f64)| (low.min(logarithm(*v)), high.max(logarithm(*v)));
        let (low, high) = all.iter().fold((f64::INFINITY, f64::NEG_INFINITY), range);
        let mut bins = [(0.0, 0.0); MOST];
        for (weight, v) in all {
            let part = if high > low { (logarithm(v) - low) / (high - low) } else { 0.0 };
            let bin = &mut bins[((part * MOST as f64) as usize).min(MOST - 1)];
            *bin = (bin.0 + weight, bin.1 + weight * v);
        }
        Self::of(bins.into_iter().map(|(weight, sum)| (weight, sum / weight)))
    }

    /// Mean of the logarithms, as a variance.
    pub(super) fn geometric_mean(&self) -> f64 {
        let all: f64 = self.0.iter().map(|(w, _)| w).sum();
        (self.0.iter().map(|(w, v)| w * v.max(f64::MIN_POSITIVE).ln()).sum::<f64>() / all).exp()
    }

    /// Half the interval that holds 95 % of a number with such a variance, each known by so many degrees of freedom; all are above 0.
    fn reach(&self, freedom: f64) -> Option<f64> {
        let law = StudentsT::new(0.0, 1.0, freedom.clamp(1.0, FREEDOM[1])).ok()?;
        let all: f64 = self.0.iter().map(|(w, _)| w).sum();
        let beyond = |c: f64| self.0.iter().map(|(w, v)| 2.0 * w * law.cdf(-c / v.sqrt())).sum::<f64>() / all;
        let one = law.inverse_cdf(1.0 - OUTSIDE / 2.0);
        let ends = self.0.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), (_, v)| (l.min(v.sqrt()), h.max(v.sqrt())));
        let (mut low, mut high) = (one * ends.0, one * ends.1);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            (low, high) = if beyond(middle) > OUTSIDE { (middle, high) } else { (low, middle) };
            if high - low < 1e-6 * high {
                break;
            }
        }
        Some(0.5 * (low + high))
    }

    /// The variance and the degrees of freedom whose interval by Student's law is that of the mixture: the geometric mean, as long as
    /// there are such degrees. None where numbers are not finite, or nothing varies.
    pub(super) fn student(&self, freedom: f64) -> Option<(f64, f64)> {
        let sound = |(_, v): &(f64, f64)| *v > 0.0 && v.is_finite();
        if self.0.is_empty() || !self.0.iter().all(sound) || freedom.is_nan() {
            return None;
        }
        let (variance, reach) = (self.geometric_mean(), self.reach(freedom)?);
        let quantile = |f: f64| StudentsT::new(0.0, 1.0, f).map_or(f64::NAN, |l| l.inverse_cdf(1.0 - OUTSIDE / 2.0));
        let [fewest, most] = FREEDOM;
        let ratio = reach / variance.sqrt();
        if ratio >= quantile(fewest) {
            return Some(((reach / quantile(fewest)).powi(2), fewest));
        }
        if ratio <= quantile(most) {
            return Some(((reach / quantile(most)).powi(2), most));
        }
        let (mut low, mut high) = (fewest.ln(), most.ln());
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            (low, high) = if quantile(middle.exp()) > ratio { (middle, high) } else { (low, middle) };
            if high - low < 1e-6 {
                break;
            }
        }
        Some((variance, (0.5 * (low + high)).exp()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_value_is_students_law() {
        let (variance, freedom) = Mixture::known(4.0).student(12.0).expect("finite");
        assert!((variance - 4.0).abs() < 1e-9 && (freedom / 12.0 - 1.0).abs() < 1e-3, "{variance} {freedom}");
        let (variance, freedom) = Mixture::known(4.0).plus(&Mixture::known(5.0)).student(1e9).expect("finite");
        assert!((variance - 9.0).abs() < 1e-3 && freedom > 1e5, "{variance} {freedom}");
    }

    #[test]
    fn what_is_not_finite_has_no_interval() {
        for variance in [0.0, f64::NAN, f64::INFINITY] {
            assert_eq!(Mixture::known(variance).student(12.0), None);
        }
        assert_eq!(Mixture::known(1.0).student(f64::NAN), None);
        assert_eq!(Mixture::none().student(12.0), None);
    }

    #[test]
    fn the_interval_is_that_of_the_mixture() {
        for values in [vec![(0.9, 1.0), (0.1, 20.0)], vec![(0.5, 1.0), (0.3, 2.0), (0.2, 3.0)]] {
            let mixture = Mixture::of(values.clone().into_iter());
            let (variance, freedom) = mixture.student(30.0).expect("finite");
            let half = variance.sqrt() * crate::estimate::quantile(Some(freedom));
            let law = StudentsT::new(0.0, 1.0, 30.0).expect("a law");
            let outside: f64 = values.iter().map(|(w, v)| 2.0 * w * law.cdf(-half / v.sqrt())).sum();
            assert!((outside - 0.05).abs() < 1e-4, "{outside}");
        }
    }

    #[test]
    fn sums_keep_means_and_weights() {
        let one = Mixture::of([(0.7, 1.0), (0.3, 9.0)].into_iter());
        let sum = one.plus(&one);
        let mean = |m: &Mixture| m.0.iter().map(|(w, v)| w * v).sum::<f64>();
        assert!((mean(&sum) - 2.0 * mean(&one)).abs() < 1e-12);
        assert!((sum.0.iter().map(|(w, _)| w).sum::<f64>() - 1.0).abs() < 1e-12 && sum.0.len() == 3);
    }
}
