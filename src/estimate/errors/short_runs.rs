//! The runs of an estimation that are too short to tell the colour of their noise by themselves, or have no even times.

use super::averaged::Average;
use super::coloured::is_long;
use super::coloured_rows::ColouredRows;
use super::combination::Member;
use super::noise_colour::{NoiseColour, Uncorrected};
use super::sandwich::Sandwich;
use crate::estimate::noise::Weights;
use crate::estimate::problem::Problem;
use crate::quality::autoregression::AutoRegression;
use crate::quality::ladder::Ladder;
use nalgebra::DMatrix;

/// Runs whose noise is averaged over all that is possible.
pub(super) struct ShortRuns {
    runs: Vec<usize>,
    average: Average,
    /// Their middle (n by n, row-major).
    pub(super) middle: Vec<f64>,
}

impl ShortRuns {
    /// Those among all runs; none when all are long. `noise` is that of the fit.
    ///
    /// # Errors
    /// [`Uncorrected::NotFinite`].
    pub(super) fn of(
        runs: &[ColouredRows],
        sandwich: &Sandwich<'_>,
        noise: &Weights,
        prior: &[(usize, f64)],
    ) -> Result<Option<Self>, Uncorrected> {
        let (long, short): (Vec<usize>, Vec<usize>) = (0..runs.len()).partition(|r| is_long(&runs[*r]));
        if short.is_empty() {
            return Ok(None);
        }
        let n = sandwich.conclusion.inverse.chosen.len();
        let mut middles: Vec<Vec<f64>> = runs.iter().map(|r| vec![0.0; r.width * r.width]).collect();
        let inverse_noise = noise.inverse();
        long.iter().for_each(|r| middles[*r] = runs[*r].information(&inverse_noise));
        let others = DMatrix::from_row_slice(n, n, &sandwich.gather(&middles, prior));
        let member = |r: &usize| Member { rows: &runs[*r], places: sandwich.places(*r) };
        let members: Vec<Member<'_>> = short.iter().map(member).collect();
        let rows: Vec<&ColouredRows> = members.iter().map(|m| m.rows).collect();
        let average = Average::new(&members, &inverse_noise, &correlated(&rows, &noise.covariance), others);
        let average = average.ok_or(Uncorrected::NotFinite)?;
        let middle = average.middle().as_slice().to_vec();
        Ok(Some(Self { runs: short, average, middle }))
    }

    /// Gives the covariance (n by n) the variances of the average, beside the middle of all others (n by n), and adds how little is known of them
    /// to the degrees of freedom.
    ///
    /// # Errors
    /// [`Uncorrected::NotFinite`].
    pub(super) fn settle(
        &self,
        sandwich: &Sandwich<'_>,
        others: &[f64],
        covariance: &mut [f64],
        freedom: &mut [f64],
    ) -> Result<(), Uncorrected> {
        let n = freedom.len();
        let square = |values: &[f64]| DMatrix::from_row_slice(n, n, values);
        let variances = self.average.variances(&square(&sandwich.conclusion.inverse.values), &square(others));
        let variances = variances.ok_or(Uncorrected::NotFinite)?;
        let factor = |j: usize| match covariance[j * n + j] {
            variance if variance > 0.0 => (variances[j].0 / variance).sqrt(),
            _ => 1.0,
        };
        let factors: Vec<f64> = (0..n).map(factor).collect();
        covariance.iter_mut().enumerate().for_each(|(k, c)| *c *= factors[k / n] * factors[k % n]);
        for (freedom, (_, own)) in freedom.iter_mut().zip(&variances) {
            *freedom = 1.0 / (1.0 / *freedom + 1.0 / own);
        }
        Ok(())
    }

    /// What was found of the noise of each output; `covariance` is that of the fit (q by q).
    pub(super) fn report(&self, problem: &Problem<'_>, covariance: &[f64]) -> Vec<NoiseColour> {
        let names: Vec<String> = self.runs.iter().map(|r| problem.runs[*r].name.clone()).collect();
        let q = problem.outputs.len();
        let model = |o: usize| {
            let variance = covariance[o * q + o] * self.average.scale(o);
            match self.average.correlations(o) {
                Some(r) => {
                    let r: Vec<f64> = r.iter().map(|r| r * variance).collect();
                    Ladder::of(&r).model(r.len() - 1)
                }
                None => AutoRegression::white(variance),
            }
        };
        let colour =
            |o: usize| NoiseColour::new(problem.outputs[o].clone(), names.clone(), self.average.interval, &model(o));
        (0..q).filter(|o| self.average.compares(*o)).map(colour).collect()
    }
}

/// The covariance of the noise: that of the fit (q by q), and where the fit takes outputs for independent with what the residuals have
/// in common, less the fewer samples tell it.
fn correlated(runs: &[&ColouredRows], covariance: &[f64]) -> DMatrix<f64> {
    let q = covariance.len().isqrt();
    let mut matrix = DMatrix::from_row_slice(q, q, covariance);
    if (0..q * q).any(|k| k / q != k % q && covariance[k] != 0.0) {
        return matrix;
    }
    for a in 0..q {
        for b in 0..a {
            let both = runs.iter().flat_map(|r| r.residuals[a].iter().zip(&r.residuals[b]));
            let mut sums = [0.0; 4];
            for (x, y) in both.filter(|(x, y)| !x.is_nan() && !y.is_nan()) {
                sums.iter_mut().zip([x * y, x * x, y * y, 1.0]).for_each(|(s, v)| *s += v);
            }
            let [product, left, right, samples] = sums;
            let size = (left * right).sqrt();
            if size > 0.0 {
                let told = samples / (samples + 2.0 * q as f64);
                matrix[(a, b)] = told * product / size * (matrix[(a, a)] * matrix[(b, b)]).sqrt();
                matrix[(b, a)] = matrix[(a, b)];
            }
        }
    }
    matrix
}
