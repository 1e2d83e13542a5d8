//! Distribution functions and quantiles. A tail is the probability of a value above the given one.
//!
//! Parameters that belong to no distribution (degrees of freedom that are not positive, NaN) give none.

use statrs::distribution::{Beta, ChiSquared, Continuous, ContinuousCDF, FisherSnedecor, Normal, StudentsT};

/// Probability of a standard normal deviate below `z`.
pub fn normal_cdf(z: f64) -> f64 {
    Normal::standard().cdf(z)
}

/// Logarithm of the probability of a standard normal deviate below `z`, also where that is no number: there by the first terms of Mills'
/// ratio (Abramowitz & Stegun 1964, 26.2.12), right to 1e-9.
pub fn log_normal_cdf(z: f64) -> f64 {
    if z > -30.0 {
        return normal_cdf(z).ln();
    }
    let s = 1.0 / (z * z);
    -0.5 * z * z - (-z * (2.0 * std::f64::consts::PI).sqrt()).ln() + (1.0 - s + 3.0 * s * s - 15.0 * s.powi(3)).ln()
}

/// Logarithm of the gamma function.
pub fn log_gamma(x: f64) -> f64 {
    statrs::function::gamma::ln_gamma(x)
}

/// Probability of a standard normal deviate above `z`, accurate where it is small.
pub fn normal_tail(z: f64) -> f64 {
    Normal::standard().sf(z)
}

/// The standard normal deviate that lies above a share `p` of all.
pub fn normal_quantile(p: f64) -> f64 {
    Normal::standard().inverse_cdf(p)
}

/// Probability of a chi-squared variate above `value`.
pub fn chi_squared_tail(value: f64, degrees: f64) -> Option<f64> {
    ChiSquared::new(degrees).ok().map(|law| law.sf(value))
}

/// The value that a chi-squared variate stays below with probability `p`.
pub fn chi_squared_quantile(p: f64, degrees: f64) -> Option<f64> {
    ChiSquared::new(degrees).ok().map(|law| law.inverse_cdf(p))
}

/// Probability of a variate of Fisher's F distribution above `value`, for numerator and denominator degrees of freedom.
pub fn f_tail(value: f64, [numerator, denominator]: [f64; 2]) -> Option<f64> {
    FisherSnedecor::new(numerator, denominator).ok().map(|law| law.sf(value))
}

/// The value that a beta variate of the shapes `[a, b]` stays below with probability `p`.
pub fn beta_quantile(p: f64, [a, b]: [f64; 2]) -> Option<f64> {
    Beta::new(a, b).ok().map(|law| law.inverse_cdf(p))
}

/// Student's t distribution.
#[derive(Debug, Clone, Copy)]
pub struct Student(StudentsT);

impl Student {
    /// The distribution of so many degrees of freedom; none where these are not positive.
    pub fn new(degrees: f64) -> Option<Self> {
        StudentsT::new(0.0, 1.0, degrees).ok().map(Self)
    }

    /// The density at `t`.
    pub fn density(&self, t: f64) -> f64 {
        self.0.pdf(t)
    }

    /// Probability of a value below `t`.
    pub fn cdf(&self, t: f64) -> f64 {
        self.0.cdf(t)
    }

    /// Probability of a value above `t`, accurate where it is small.
    pub fn tail(&self, t: f64) -> f64 {
        self.0.sf(t)
    }

    /// The value that lies above a share `p` of all.
    pub fn quantile(&self, p: f64) -> f64 {
        self.0.inverse_cdf(p)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of printed tables (Abramowitz & Stegun, chapter 26).
    #[test]
    fn values_are_those_of_tables() {
        let near = |found: Option<f64>, table: f64| {
            assert!(found.is_some_and(|v| (v / table - 1.0).abs() < 2e-4), "{found:?} {table}");
        };
        near(Some(normal_cdf(1.0)), 0.841_345);
        near(Some(normal_tail(3.0)), 0.001_349_9);
        near(Some(normal_quantile(0.975)), 1.959_964);
        near(chi_squared_tail(18.307, 10.0), 0.05);
        near(chi_squared_quantile(0.95, 10.0), 18.307);
        near(f_tail(3.326, [5.0, 10.0]), 0.05);
        near(beta_quantile(0.5, [2.0, 2.0]), 0.5);
        near(Student::new(10.0).map(|law| law.quantile(0.975)), 2.228);
        near(Student::new(10.0).map(|law| law.tail(2.228_139)), 0.025);
        assert!(Student::new(0.0).is_none() && chi_squared_tail(1.0, -1.0).is_none());
    }
}
