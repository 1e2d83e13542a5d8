//! Likelihoods without a maximum: a variance that is estimated from samples which the model passes through, and a deviation that passes zero. The
//! logarithm of such a number has no least value, so that the place where an iteration ends says nothing.
//!
//! The reciprocal of a variance that was estimated with f degrees of freedom is, on the average, f/(f - 2) times that of the true one: the inverse of a
//! chi-squared number has the mean 1/(f - 2). It is the weight of an output beside the others (Carroll and Cline, Biometrika 75, 1988, of least squares with
//! such weights): with two degrees of freedom or fewer it has no mean, and the more an output is followed the fewer it has. With a covariance of q outputs
//! the law is the inverse of Wishart's, and 2 becomes q + 1 (Press, Applied multivariate analysis, 1982).

use crate::problem::noise::Likelihood;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Why a likelihood has no maximum that could be reported.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Degeneracy {
    /// The noise of these outputs is estimated, and they leave two degrees of freedom or fewer for it.
    Variance {
        /// The outputs.
        outputs: Vec<String>,
        /// Their compared samples.
        samples: usize,
        /// Samples less the sum of their leverages.
        freedom: f64,
    },
    /// The standard deviation that is stated for an output passes zero within a run.
    Deviation {
        /// The output.
        output: String,
        /// What is stated.
        expression: String,
        /// The run.
        run: String,
        /// Time since the run began, in the model's time unit.
        time: f64,
    },
    /// Elsewhere the likelihood is greater than at its maximum here, and the more so the better the model passes through the samples of an output.
    Elsewhere {
        /// The output.
        output: String,
        /// Its compared samples.
        samples: usize,
        /// By how much the logarithm of the likelihood was greater where the search for that place ended.
        gain: f64,
    },
}

/// What gives a likelihood its maximum back where a variance collapses.
const CURE: &str = "state the noise (--noise OUTPUT=DEVIATION), or give all outputs one relative deviation \
                    (`param rel = 0.1 in [0.001, 1]; noise OUTPUT = FLOOR + rel*abs(OUTPUT);` for each)";

impl fmt::Display for Degeneracy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Variance { outputs, samples, freedom } => {
                let names: Vec<String> = outputs.iter().map(|o| format!("`{o}`")).collect();
                let names = names.join(", ");
                write!(
                    f,
                    "the likelihood has no maximum: the model passes through the {samples} samples of {names}, which leave {:.1} degrees of freedom \
                     for a noise of its own, and its weight grows without end; {CURE}",
                    freedom.max(0.0)
                )
            }
            Self::Elsewhere { output, samples, gain } => write!(
                f,
                "the likelihood has no maximum: other values lead the model through the {samples} samples of `{output}` (log-likelihood +{gain:.1}), and \
                 which of both is found depends on the start; {CURE}"
            ),
            Self::Deviation { output, expression, run, time } => write!(
                f,
                "run `{run}`: the stated deviation of `{output}`, {expression}, passes zero at time {time:.4}: a sample there would be exact, and the \
                 likelihood has no maximum; add a floor (`noise {output} = FLOOR + {expression};`)"
            ),
        }
    }
}

/// Degrees of freedom of an estimated variance up to which its reciprocal has no mean.
const NO_MEAN: f64 = 2.0;

/// Of a direction, when degrees of freedom are counted in whole ones.
const HALF: f64 = 0.5;

/// The outputs among `names` whose estimated noise no sample tells; `leverages` (q) are the sums of their leverages. `alone` says that nothing else is
/// compared and nothing is known beforehand: then their weight decides nothing.
pub(crate) fn collapsed(names: &[String], likelihood: &Likelihood, leverages: &[f64], alone: bool) -> Vec<Degeneracy> {
    if alone || leverages.len() != likelihood.counts.len() {
        return Vec::new();
    }
    let compared = likelihood.counts.iter().filter(|n| **n > 0).count() as f64;
    let least = if likelihood.is_full() { compared + 1.0 } else { NO_MEAN };
    let samples = likelihood.samples_of_outputs();
    let few = |o: &usize| {
        let left = samples[*o].map(|samples| samples - leverages[*o]);
        likelihood.counts[*o] > 0 && left.is_some_and(|left| is_too_few(left, leverages[*o], least))
    };
    let told = |o: usize| Degeneracy::Variance {
        outputs: vec![names[o].clone()],
        samples: likelihood.counts[o],
        freedom: samples[o].unwrap_or(0.0) - leverages[o],
    };
    (0..leverages.len()).filter(few).map(told).collect()
}

/// Whether so many degrees of freedom tell no noise that weighs on an estimate: `followed` parameters follow these samples.
pub(crate) fn is_too_few(freedom: f64, followed: f64, least: f64) -> bool {
    // a leverage is known to rounding, and what follows an output in less than half of a direction follows others in the rest
    followed >= 1.0 - 1e-6 && freedom < least + HALF
}

/// [`is_too_few`] of one variance.
pub(crate) fn tells_no_variance(freedom: f64, followed: f64) -> bool {
    is_too_few(freedom, followed, NO_MEAN)
}

/// Where a deviation passes zero: `(left, right)` of its least values, by the lines through two values on either side. `values` are at even times, a
/// sixteenth of a sample apart, so that the lines hold.
pub(crate) fn passes_zero(values: &[f64]) -> Option<usize> {
    let touches = |v: &[f64]| {
        let [a, b, least, c, d] = *v else { return false };
        let dips = least <= b && least <= c && b < a && c < d;
        if !(dips && v.iter().all(|s| s.is_finite())) {
            return false;
        }
        // where the lines through a, b and through d, c meet
        let (left, right) = (a - b, d - c);
        let part = ((b - c + 2.0 * right) / (left + right)).clamp(0.0, 2.0);
        b - left * part <= ZERO * (b + c)
    };
    values.windows(5).position(touches).map(|first| first + 2)
}

/// Part of its neighbours, a sixteenth of a sample apart, below which a deviation is none: a smaller floor than that is crossed between two samples.
const ZERO: f64 = 0.05;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::noise::Noise;

    #[test]
    fn a_variance_of_two_degrees_of_freedom_is_none_where_it_weighs_beside_others() {
        let names = ["a".to_string(), "b".to_string()];
        let z = [1.0; 12];
        let told = |noise: Noise, leverages: [f64; 2], alone: bool| {
            let likelihood = Likelihood::new(&noise, 2, [&z[..]].into_iter(), 1.0);
            collapsed(&names, &likelihood, &leverages, alone).len()
        };
        assert_eq!(told(Noise::Diagonal, [2.0, 4.0], false), 1, "six samples of b, of which four are followed");
        assert_eq!(told(Noise::Diagonal, [2.0, 3.9], false), 1, "a direction that is followed but for a tenth");
        assert_eq!(told(Noise::Diagonal, [2.0, 3.4], false), 0);
        assert_eq!(told(Noise::Diagonal, [2.0, 4.0], true), 0, "a single weight decides nothing");
        assert_eq!(told(Noise::Given(vec![None, Some(0.1)]), [2.0, 6.0], false), 0, "a known noise is known");
        assert_eq!(told(Noise::Full, [3.0, 3.0], false), 2, "Wishart's law wants one more for each output");
        assert_eq!(told(Noise::Full, [2.4, 2.4], false), 0);
    }

    #[test]
    fn a_deviation_that_passes_zero_is_told_from_one_with_a_floor() {
        let at =
            |s: &dyn Fn(f64) -> f64| passes_zero(&(0..40).map(|k| s(0.05 * f64::from(k) - 1.02)).collect::<Vec<_>>());
        assert_eq!(at(&|x| 0.1 * x.abs()), Some(20));
        assert_eq!(at(&|x| (x + 0.3 * x * x).abs()), Some(20));
        assert_eq!(at(&|x| x * x), Some(20));
        for floor in [0.02, 0.2, 1.0] {
            assert_eq!(at(&|x| floor + 0.8 * x.abs()), None, "{floor}");
        }
        assert_eq!(at(&|x| (0.2 + x * x).sqrt()), None);
        assert_eq!(at(&|x| (-3.0 * x).exp()), None);
    }
}
