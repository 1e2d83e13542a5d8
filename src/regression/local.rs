//! Smoothed local differentiation: the derivative of a polynomial through neighbouring samples (Savitzky and Golay 1964, for any
//! intervals).

use nalgebra::{DMatrix, DVector};

/// Degree of the polynomial.
const DEGREE: usize = 4;

/// Derivatives at all samples; NaN where too few neighbours have a value. Near the ends the window is the outermost one. A
/// window holds at least five samples.
pub(super) fn derivatives(time: &[f64], values: &[f64], points: usize) -> Vec<f64> {
    along(time, values, points, 1)
}

/// Values of the polynomials themselves: the record smoothed.
pub(super) fn smoothed(time: &[f64], values: &[f64], points: usize) -> Vec<f64> {
    let moved = along(time, values, points, 0);
    // too few neighbours: as measured
    values.iter().zip(moved).map(|(v, m)| if m.is_nan() { *v } else { v + m }).collect()
}

/// Derivatives of this order (0 or 1); values are relative to the sample itself.
fn along(time: &[f64], values: &[f64], points: usize, order: usize) -> Vec<f64> {
    let points = points.min(time.len()).max(1);
    let half = points / 2;
    let mut weights: Option<(Vec<f64>, Vec<f64>)> = None;
    (0..time.len())
        .map(|k| {
            let first = k.saturating_sub(half).min(time.len() - points);
            let window = first..first + points;
            if values[k].is_nan() {
                return f64::NAN;
            }
            let present: Vec<usize> = window.filter(|i| !values[*i].is_nan()).collect();
            let span = (time[first + points - 1] - time[first]).max(f64::MIN_POSITIVE);
            let at: Vec<f64> = present.iter().map(|i| (time[*i] - time[k]) / span).collect();
            // the inner windows of an even record are all alike
            let same = weights.as_ref().is_some_and(|(known, _)| {
                known.len() == at.len() && known.iter().zip(&at).all(|(a, b)| (a - b).abs() < 1e-9)
            });
            if !same {
                weights = weights_of(&at, order).map(|w| (at, w));
            }
            let Some((_, weights)) = &weights else { return f64::NAN };
            // relative to the sample itself, so that a large offset leaves no rounding behind
            let sum: f64 = present.iter().zip(weights).map(|(i, w)| w * (values[*i] - values[k])).sum();
            if order == 0 { sum } else { sum / span }
        })
        .collect()
}

/// What the samples at these places contribute to the value or the slope of their polynomial at 0.
fn weights_of(at: &[f64], order: usize) -> Option<Vec<f64>> {
    if at.len() <= DEGREE {
        return None;
    }
    let powers = DMatrix::from_fn(at.len(), DEGREE + 1, |i, j| at[i].powi(j as i32));
    let qr = powers.qr();
    // value = e0' R^-1 Q' values, slope = e1' R^-1 Q' values
    let mut unit = DVector::zeros(DEGREE + 1);
    unit[order] = 1.0;
    let solved = qr.r().transpose().solve_lower_triangular(&unit)?;
    Some((qr.q() * solved).iter().copied().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_are_differentiated_exactly_whatever_the_intervals() {
        let time: Vec<f64> = (0..30).map(|k| 0.1 * f64::from(k) + 0.03 * f64::from(k % 3)).collect();
        let value = |t: f64| 1e3 + t - 2.0 * t * t + 0.3 * t.powi(4);
        let mut values: Vec<f64> = time.iter().map(|t| value(*t)).collect();
        values[7] = f64::NAN;
        let found = derivatives(&time, &values, 9);
        assert!(found[7].is_nan());
        for (k, t) in time.iter().enumerate().filter(|(k, _)| *k != 7) {
            assert!((found[k] - (1.0 - 4.0 * t + 1.2 * t.powi(3))).abs() < 1e-8, "{k}: {}", found[k]);
        }
    }

    #[test]
    fn smoothing_leaves_polynomials_and_takes_noise() {
        let time: Vec<f64> = (0..40).map(|k| 0.1 * f64::from(k)).collect();
        let value = |t: f64| 3.0 - t + 0.2 * t.powi(3);
        let clean: Vec<f64> = time.iter().map(|t| value(*t)).collect();
        let same = smoothed(&time, &clean, 9);
        assert!(same.iter().zip(&clean).all(|(a, b)| (a - b).abs() < 1e-10));
        let rough: Vec<f64> = clean.iter().enumerate().map(|(k, v)| v + if k % 2 == 0 { 0.1 } else { -0.1 }).collect();
        let off = |v: &[f64]| v.iter().zip(&clean).skip(8).take(24).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        assert!(off(&smoothed(&time, &rough, 9)) < 0.2 * off(&rough));
    }

    #[test]
    fn too_few_samples_have_no_derivative() {
        assert!(derivatives(&[0.0, 1.0, 2.0], &[1.0, 2.0, 3.0], 9).iter().all(|v| v.is_nan()));
        assert!(derivatives(&[], &[], 9).is_empty());
    }
}
