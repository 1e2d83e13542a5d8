//! Losses that outliers pull at less than at squares: Huber's (1964) and the likelihood of Student's law (Lange, Little and Taylor 1989).

use super::error::StrategyError;
use fdm_numeric::statistics::{Student, normal_tail};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// What is made of residuals, in units of their scale.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Loss {
    /// Squares: maximum likelihood for normal noise.
    #[default]
    Squares,
    /// Squares up to so many deviations, beyond them proportional to the residual; 1.345 has 95 % of the efficiency of squares under normal noise.
    Huber(f64),
    /// Minus the logarithm of Student's density with so many degrees of freedom.
    Student(f64),
}

/// Huber's tuning constant with 95 % efficiency under normal noise (Holland and Welsch 1977).
const HUBER: f64 = 1.345;
/// Degrees of freedom of Student's law where none are given (Lange, Little and Taylor 1989).
const DEGREES: f64 = 4.0;

impl Loss {
    /// Whether it is that of squares.
    pub fn is_squares(&self) -> bool {
        *self == Self::Squares
    }

    /// Its derivative.
    pub(super) fn influence(self, e: f64) -> f64 {
        match self {
            Self::Squares => e,
            Self::Huber(k) => e.clamp(-k, k),
            Self::Student(degrees) => (degrees + 1.0) * e / (degrees + e * e),
        }
    }

    /// The derivative of that.
    pub(super) fn slope(self, e: f64) -> f64 {
        match self {
            Self::Squares => 1.0,
            Self::Huber(k) => f64::from(u8::from(e.abs() < k)),
            Self::Student(degrees) => (degrees + 1.0) * (degrees - e * e) / (degrees + e * e).powi(2),
        }
    }

    /// The largest slope.
    pub(super) fn steepest(self) -> f64 {
        match self {
            Self::Squares | Self::Huber(_) => 1.0,
            Self::Student(degrees) => (degrees + 1.0) / degrees,
        }
    }

    /// The next estimate of the scale of residuals, from one before: Huber's proposal 2, and maximum likelihood.
    pub(super) fn scale(self, residuals: &[f64], scale: f64) -> f64 {
        let n = residuals.len().max(1) as f64;
        let mean = |f: &dyn Fn(f64) -> f64| residuals.iter().map(|v| f(v / scale)).sum::<f64>() / n;
        match self {
            Self::Squares => scale * mean(&|e| e * e).sqrt(),
            Self::Huber(k) => {
                let (inside, height) = (1.0 - 2.0 * normal_tail(k), density(k));
                let expected = inside - 2.0 * k * height + 2.0 * k * k * normal_tail(k);
                scale * (mean(&|e| e.clamp(-k, k).powi(2)) / expected).sqrt()
            }
            Self::Student(_) => scale * mean(&|e| e * self.influence(e)).sqrt(),
        }
    }

    /// Minus the logarithm of the likelihood of one residual over its scale, without that of squares' constant.
    pub(super) fn cost(self, e: f64) -> f64 {
        match self {
            Self::Squares => 0.5 * e * e,
            Self::Huber(k) if e.abs() <= k => 0.5 * e * e,
            Self::Huber(k) => k * e.abs() - 0.5 * k * k,
            Self::Student(degrees) => 0.5 * (degrees + 1.0) * (e * e / degrees).ln_1p(),
        }
    }

    /// What the constant of its law has beyond that of the normal one, for each residual.
    pub(super) fn constant(self) -> f64 {
        match self {
            Self::Student(degrees) => {
                let height = Student::new(degrees).map_or(f64::NAN, |law| law.density(0.0));
                -(height * TAU.sqrt()).ln()
            }
            _ => 0.0,
        }
    }

    /// What is wrong with its number, if anything.
    pub(super) fn mistake(self) -> Option<StrategyError> {
        match self {
            Self::Huber(k) if !HUBER_NUMBERS.contains(&k) => Some(StrategyError::Loss { value: k }),
            Self::Student(degrees) if !STUDENT_NUMBERS.contains(&degrees) => {
                Some(StrategyError::Loss { value: degrees })
            }
            _ => None,
        }
    }
}

impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Squares => f.write_str("squares"),
            Self::Huber(k) => write!(f, "Huber's loss, squares up to {k} deviations"),
            Self::Student(degrees) => write!(f, "Student's law with {degrees} degrees of freedom"),
        }
    }
}

/// Deviations up to which Huber's loss is one of squares: of fewer next to no residual is squared and scales are lost in rounding,
/// of more every one is, as without the loss.
const HUBER_NUMBERS: RangeInclusive<f64> = 0.01..=100.0;
/// Degrees of freedom of Student's law: of fewer it has no scale that is found, of more it is the normal law.
const STUDENT_NUMBERS: RangeInclusive<f64> = 1.0..=1e6;

impl FromStr for Loss {
    type Err = String;

    /// `squares`, `huber`, `student`, and the last two with a number: `huber:1.5`, `student:3`.
    fn from_str(text: &str) -> Result<Self, String> {
        const WANTED: &str = "`squares`, `huber`, `huber:K` (deviations, from 0.01 to 100; 1 to 3 are sensible), `student` or `student:N` (degrees of freedom, from 1 to 1e6; 3 to 10 are sensible)";
        let wrong = || format!("expected {WANTED}");
        let (word, number) = text.trim().split_once(':').map_or((text.trim(), None), |(word, n)| (word, Some(n)));
        let number = number.map(|n| n.trim().parse::<f64>().map_err(|_| wrong())).transpose()?;
        let loss = match (word, number) {
            ("squares", None) => Self::Squares,
            ("huber", k) => Self::Huber(k.unwrap_or(HUBER)),
            ("student", degrees) => Self::Student(degrees.unwrap_or(DEGREES)),
            _ => return Err(wrong()),
        };
        if loss.mistake().is_some() { Err(wrong()) } else { Ok(loss) }
    }
}

fn density(z: f64) -> f64 {
    (-0.5 * z * z).exp() / TAU.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_numbers_are_read() {
        assert_eq!("huber".parse(), Ok(Loss::Huber(1.345)));
        assert_eq!("student: 3".parse(), Ok(Loss::Student(3.0)));
        assert_eq!("squares".parse(), Ok(Loss::Squares));
        for wrong in ["", "huber:0", "student:0.5", "student:x", "squares:1", "tukey"] {
            assert!(wrong.parse::<Loss>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn influences_are_the_derivatives_of_the_losses_and_have_their_slopes() {
        for loss in [Loss::Squares, Loss::Huber(1.345), Loss::Student(4.0), Loss::Student(1.0)] {
            for e in [-5.0, -1.2, -0.3, 0.0, 0.7, 1.1, 9.0] {
                let h = 1e-5;
                let slope = (loss.cost(e + h) - loss.cost(e - h)) / (2.0 * h);
                assert!((slope - loss.influence(e)).abs() < 1e-8, "{loss} at {e}: {slope}");
                let bend = (loss.influence(e + h) - loss.influence(e - h)) / (2.0 * h);
                assert!((bend - loss.slope(e)).abs() < 1e-8, "{loss} at {e}: {bend}");
                assert!(bend <= loss.steepest() + 1e-8);
            }
        }
    }

    #[test]
    fn scales_are_those_of_normal_noise_and_of_students_law() {
        let mut normal = fdm_numeric::random::Normal(5);
        let plain: Vec<f64> = (0..40_000).map(|_| 0.3 * normal.next()).collect();
        let scale = |loss: Loss, v: &[f64]| (0..100).fold(1.0, |s, _| loss.scale(v, s));
        assert!((scale(Loss::Huber(1.345), &plain) / 0.3 - 1.0).abs() < 0.02);
        let mut student = || {
            let chi = (0..4).map(|_| normal.next().powi(2)).sum::<f64>() / 4.0;
            0.3 * normal.next() / chi.sqrt()
        };
        let heavy: Vec<f64> = (0..40_000).map(|_| student()).collect();
        assert!((scale(Loss::Student(4.0), &heavy) / 0.3 - 1.0).abs() < 0.02);
        assert!((Loss::Student(4.0).constant() - (-(0.375f64 * TAU.sqrt()).ln())).abs() < 1e-12);
    }
}
