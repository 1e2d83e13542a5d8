//! The likelihood where its noise is not what it takes it for: widened until its curvature at the fit is that of the corrected errors.
//!
//! With J the information of the likelihood, P that of the priors and C the corrected covariance of the estimates, the score has the covariance
//! `V = (J + P) C (J + P) - P`, and the information to be had is `G = J V^-1 J` (Godambe 1960). In the basis X with `X' J X = 1` and `X' V X = diag(l)`
//! the likelihood of direction k counts 1/l(k) only. So it is raised to the power 1/m, m the geometric mean of the l, and taken at
//! `u0 + K (u - u0)`, `K = X diag(l/m)^(-1/2) X^-1` (the magnitude adjustment of Pauli, Racugno and Ventura, Statistica Sinica 21, 2011, and the
//! curvature adjustment of Ribatet, Cooley and Davison, Statistica Sinica 22, 2012). Power alone keeps the shape of the response as it is; K, which is
//! the unit matrix where all l are equal, does the rest. Where a prior pulls, the slope at the fit is that of the same law: a linear term adds what
//! power and K leave out of it.

use fdm_results::documents::FitDocument;
use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};
use std::f64::consts::PI;

/// Places of the spectrum at which the colour of a noise is summed.
const FREQUENCIES: usize = 1 << 14;
/// What is added to the information, as a part of it, so that what the data do not determine has a basis too.
const RIDGE: f64 = 1e-10;
/// A direction is not widened or narrowed further than the corrected errors of any single parameter, by this factor.
const BEYOND: f64 = 10.0;

/// Corrected errors of a fit, by which a posterior is widened.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrectedErrors {
    /// Parameters and their runs (n).
    pub parameters: Vec<(String, Option<String>)>,
    /// Corrected covariance (n by n, row-major).
    pub covariance: Vec<f64>,
    /// Outputs, and by how much more the square of their residuals scatters than under white noise.
    pub squares: Vec<(String, f64)>,
}

impl CorrectedErrors {
    /// Corrected errors of a fit whose residuals are coloured, or of varying size; none where white noise is what was
    /// found, or where errors were not corrected.
    pub fn of(fit: &FitDocument) -> Option<Self> {
        let varying = || fit.outputs_in_time().iter().any(|o| o.noise_variation.is_some());
        let matrix = &fit.corrected_covariance;
        if matrix.values.is_empty() || !(fit.noise_colour.iter().any(|c| !c.is_white()) || varying()) {
            return None;
        }
        let own = || matrix.parameters.iter().map(|p| &fit.parameters[*p]);
        let n = matrix.parameters.len();
        // errors are what is told of a parameter: what varying noise adds to them stands there alone
        let factor = |(k, p): (usize, &fdm_estimate::ParameterEstimate)| {
            let ratio = p.corrected_error.unwrap_or(f64::NAN) / matrix.values[k][k].sqrt();
            if ratio.is_finite() && ratio > 0.0 { ratio } else { 1.0 }
        };
        let factors: Vec<f64> = own().enumerate().map(factor).collect();
        let entry = |k: usize| matrix.values[k / n][k % n] * factors[k / n] * factors[k % n];
        let covariance: Vec<f64> = (0..n * n).map(entry).collect();
        let parameters = own().map(|p| (p.name.clone(), p.run.clone())).collect();
        let mut squares: Vec<(String, f64)> = Vec::new();
        for output in fit.noise_colour.iter().map(|c| &c.output) {
            if squares.iter().all(|(name, _)| name != output) {
                let own = fit.noise_colour.iter().filter(|c| c.output == *output);
                let each: Vec<f64> = own.map(|c| scatter_of_squares(&c.coefficients)).collect();
                squares.push((output.clone(), each.iter().sum::<f64>() / each.len() as f64));
            }
        }
        covariance.iter().all(|v| v.is_finite()).then_some(Self { parameters, covariance, squares })
    }
}

/// By how much more the mean square of an autoregression scatters than that of white noise: the sum of its squared correlations at all lags, which by
/// Parseval is the mean of its squared spectrum over the square of the mean.
fn scatter_of_squares(coefficients: &[f64]) -> f64 {
    let (mut sum, mut squares) = (0.0, 0.0);
    for k in 0..FREQUENCIES {
        let angle = PI * (k as f64 + 0.5) / FREQUENCIES as f64;
        let (mut re, mut im) = (1.0, 0.0);
        for (lag, a) in coefficients.iter().enumerate() {
            let (sine, cosine) = (angle * (lag + 1) as f64).sin_cos();
            (re, im) = (re - a * cosine, im + a * sine);
        }
        let density = 1.0 / (re * re + im * im);
        (sum, squares) = (sum + density, squares + density * density);
    }
    FREQUENCIES as f64 * squares / (sum * sum)
}

/// A likelihood that is widened.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Correction {
    centre: Vec<f64>,
    /// One over the power that the likelihood is raised to.
    pub(super) power: f64,
    /// K (n by n, row-major).
    matrix: Vec<f64>,
    /// Slope of the linear term (n).
    tilt: Vec<f64>,
    /// Least and largest factor of a deviation.
    pub(super) factors: [f64; 2],
}

/// What a correction is made of: all by the n unknowns.
pub(super) struct Known<'a> {
    /// Coordinates of the fit (n).
    pub(super) centre: &'a [f64],
    /// Derivatives of the parameters by their coordinates there (n).
    pub(super) slopes: &'a [f64],
    /// Information of the likelihood about the parameters (n by n).
    pub(super) fisher: &'a [f64],
    /// Priors: one over the variance, and how far the fit is from the mean (n); zeros where there is none.
    pub(super) priors: &'a [(f64, f64)],
    /// Unknowns whose corrected covariance is known (m), and that (m by m).
    pub(super) places: &'a [usize],
    pub(super) covariance: &'a [f64],
    /// Unknown deviations, with what the square of their residuals scatters more.
    pub(super) deviations: &'a [(usize, f64)],
}

impl Correction {
    /// None where the matrices have no such basis.
    pub(super) fn of(known: &Known<'_>) -> Option<Self> {
        let (n, m) = (known.centre.len(), known.places.len());
        let own = |matrix: &[f64], i: usize, j: usize| matrix[known.places[i] * n + known.places[j]];
        // in units of the corrected errors
        let unit: Vec<f64> = (0..m).map(|i| known.covariance[i * m + i].sqrt()).collect();
        if m == 0 || !unit.iter().all(|u| u.is_finite() && *u > 0.0) {
            return None;
        }
        let mut information = DMatrix::from_fn(m, m, |i, j| own(known.fisher, i, j) * unit[i] * unit[j]);
        (0..m).for_each(|i| information[(i, i)] += RIDGE * information[(i, i)].max(RIDGE));
        let covariance = DMatrix::from_fn(m, m, |i, j| known.covariance[i * m + j] / unit[i] / unit[j]);
        let prior = DVector::from_fn(m, |i, _| known.priors[known.places[i]].0 * unit[i] * unit[i]);
        let pull = DVector::from_fn(m, |i, _| {
            let (weight, off) = known.priors[known.places[i]];
            weight * off * unit[i]
        });
        let both = &information + DMatrix::from_diagonal(&prior);
        let scores = &both * &covariance * &both - DMatrix::from_diagonal(&prior);
        let lower = Cholesky::new(information.clone())?.unpack();
        let inverse = lower.clone().try_inverse()?;
        let whitened = &inverse * &scores * inverse.transpose();
        let eigen = SymmetricEigen::new(0.5 * (&whitened + whitened.transpose()));
        // what single parameters say, and a factor: a direction of which the data say nothing has no inflation of its own
        let alone = both.clone().try_inverse()?;
        let ratios: Vec<f64> = (0..m).map(|i| 1.0 / alone[(i, i)]).collect();
        let least = ratios.iter().copied().fold(f64::INFINITY, f64::min) / BEYOND;
        let most = ratios.iter().copied().fold(0.0, f64::max) * BEYOND;
        let inflations = eigen.eigenvalues.map(|l| if l.is_finite() { l.clamp(least, most) } else { 1.0 });
        if !(least > 0.0 && most.is_finite()) {
            return None;
        }
        let power = (inflations.iter().map(|l| l.ln()).sum::<f64>() / m as f64).exp();
        let basis = inverse.transpose() * &eigen.eigenvectors;
        let back = eigen.eigenvectors.transpose() * lower.transpose();
        let root = inflations.map(|l| (power / l).sqrt());
        let moved = &basis * DMatrix::from_diagonal(&root) * &back;
        let left = inflations.map(|l| 1.0 / l - 1.0 / (l * power).sqrt());
        let tilt_of_params = back.transpose() * DMatrix::from_diagonal(&left) * basis.transpose() * pull;
        let mut matrix: Vec<f64> = (0..n * n).map(|k| if k % (n + 1) == 0 { 1.0 } else { 0.0 }).collect();
        let mut tilt = vec![0.0; n];
        let slope = |i: usize| known.slopes[known.places[i]];
        for (i, g) in known.places.iter().enumerate() {
            tilt[*g] = tilt_of_params[i] / unit[i] * slope(i);
            for (j, h) in known.places.iter().enumerate() {
                matrix[g * n + h] = moved[(i, j)] * unit[i] / unit[j] * slope(j) / slope(i);
            }
        }
        for (g, scatter) in known.deviations {
            matrix[g * n + g] = (power / scatter).sqrt();
        }
        let finite = matrix.iter().chain(&tilt).all(|v| v.is_finite());
        let extreme = |of: fn(f64, f64) -> f64, from: f64| inflations.iter().copied().fold(from, of).sqrt();
        let factors = [extreme(f64::min, f64::INFINITY), extreme(f64::max, 0.0)];
        finite.then(|| Self { centre: known.centre.to_vec(), power, matrix, tilt, factors })
    }

    /// Where the likelihood is taken for coordinates u.
    pub(super) fn place(&self, u: &[f64], place: &mut [f64]) {
        let n = u.len();
        for (i, to) in place.iter_mut().enumerate() {
            let row = &self.matrix[i * n..][..n];
            *to = self.centre[i] + row.iter().zip(u).zip(&self.centre).map(|((k, u), c)| k * (u - c)).sum::<f64>();
        }
    }

    /// Logarithm of the widened likelihood at u and its gradient by u, from those where it was taken.
    pub(super) fn widen(&self, u: &[f64], log_likelihood: f64, by_place: &[f64], by_u: &mut [f64]) -> f64 {
        let n = u.len();
        by_u.copy_from_slice(&self.tilt);
        for (i, own) in by_place.iter().enumerate() {
            let row = &self.matrix[i * n..][..n];
            by_u.iter_mut().zip(row).for_each(|(g, k)| *g += own * k / self.power);
        }
        let linear: f64 = self.tilt.iter().zip(u).zip(&self.centre).map(|((t, u), c)| t * (u - c)).sum();
        log_likelihood / self.power + linear
    }

    /// Information (n by n) about u, from that where the likelihood is taken.
    pub(super) fn information(&self, own: &[f64]) -> Vec<f64> {
        let n = self.centre.len();
        let k = DMatrix::from_row_slice(n, n, &self.matrix);
        let wide = k.transpose() * DMatrix::from_row_slice(n, n, own) * k / self.power;
        (0..n * n).map(|p| wide[(p / n, p % n)]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_of_a_first_order_noise_scatter_by_its_correlations() {
        // 1 + 2 sum of rho^2k
        for rho in [0.0, 0.5, 0.9, -0.7, 0.99_f64] {
            let expected = (1.0 + rho * rho) / (1.0 - rho * rho);
            let found = scatter_of_squares(&[rho]);
            assert!((found / expected - 1.0).abs() < 1e-6, "{rho}: {found}, not {expected}");
        }
    }

    #[test]
    fn information_of_a_normal_law_is_that_of_the_corrected_errors() {
        // two parameters with a prior on the first, and one that the corrected errors do not know
        let fisher = [9.0, 3.0, 0.0, 3.0, 4.0, 0.0, 0.0, 0.0, 2.0];
        let priors = [(2.0, 0.7), (0.0, 0.0), (0.0, 0.0)];
        // V = J W with W between 2 and 30
        let v = DMatrix::from_row_slice(2, 2, &[80.0, 12.0, 12.0, 9.0]);
        let j = DMatrix::from_row_slice(2, 2, &[9.0, 3.0, 3.0, 4.0]);
        let p = DMatrix::from_row_slice(2, 2, &[2.0, 0.0, 0.0, 0.0]);
        let d = (&j + &p).try_inverse().unwrap();
        let c = &d * (&v + &p) * &d;
        let covariance: Vec<f64> = (0..4).map(|k| c[(k / 2, k % 2)]).collect();
        let known = Known {
            centre: &[1.0, -2.0, 0.5],
            slopes: &[1.0, 1.0, 1.0],
            fisher: &fisher,
            priors: &priors,
            places: &[0, 1],
            covariance: &covariance,
            deviations: &[],
        };
        let correction = Correction::of(&known).unwrap();
        let wide = correction.information(&fisher);
        let godambe = &j * v.clone().try_inverse().unwrap() * &j;
        for (i, k) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            assert!((wide[i * 3 + k] - godambe[(i, k)]).abs() < 1e-6, "{wide:?} {godambe}");
        }
        assert!((wide[8] - 2.0 / correction.power).abs() < 1e-9);
        // at the fit the likelihood rises as the prior falls; widened it is that of a law around the same place
        let (mut place, mut by_u) = ([0.0; 3], [0.0; 3]);
        correction.place(&[1.0, -2.0, 0.5], &mut place);
        assert_eq!(place, [1.0, -2.0, 0.5]);
        let rises = [2.0 * 0.7, 0.0, 0.0];
        correction.widen(&[1.0, -2.0, 0.5], -3.0, &rises, &mut by_u);
        let expected = &j * v.try_inverse().unwrap() * DVector::from_row_slice(&rises[..2]);
        assert!((by_u[0] - expected[0]).abs() < 1e-6 && (by_u[1] - expected[1]).abs() < 1e-6, "{by_u:?} {expected}");
    }
}
