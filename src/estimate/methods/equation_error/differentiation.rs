//! Rates of measured states: by polynomials through neighbouring samples (Savitzky and Golay 1964, for any intervals), or by a sine series of the record without
//! the line between its ends, whose coefficients fall as k^-3 while those of white noise stay level (Lanczos; Morelli, "Estimating noise characteristics
//! from flight test data using optimal Fourier smoothing", 1995).

use fdm_numeric::fourier::ComplexFft;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;
use std::f64::consts::PI;

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

/// A record, smoothed.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Smoothed {
    pub(super) values: Vec<f64>,
    pub(super) derivatives: Vec<f64>,
    /// Standard deviation of the noise.
    pub(super) noise: f64,
    /// Where the weight of the series is a half, in cycles per unit of time.
    pub(super) cutoff: f64,
}

/// A sine series of fewer samples has no upper half to find noise in.
pub(super) const FEWEST_SAMPLES: usize = 9;

/// Smooths samples `dt` apart, all present. Without a given cut-off it is where the signal's own series meets its noise.
pub(super) fn smooth(samples: &[f64], dt: f64, cutoff: Option<f64>) -> Smoothed {
    let n = samples.len().saturating_sub(1);
    if samples.len() < FEWEST_SAMPLES {
        return Smoothed {
            values: samples.to_vec(),
            derivatives: vec![f64::NAN; samples.len()],
            noise: 0.0,
            cutoff: 0.0,
        };
    }
    let (first, last) = (end(samples.iter()), end(samples.iter().rev()));
    let slope = (last - first) / n as f64;
    let rest: Vec<f64> = samples.iter().enumerate().map(|(i, z)| z - first - slope * i as f64).collect();
    let mut series = sine_series(&rest);
    let floor = floor(&series);
    let length = n as f64 * dt;
    let place = cutoff.map_or_else(|| crossing(&series, floor), |f| 2.0 * length * f);
    for (k, b) in series.iter_mut().enumerate() {
        *b /= 1.0 + ((k + 1) as f64 / place).powi(6);
    }
    let (values, derivatives) = synthesis(&series, n);
    let line = |i: usize| first + slope * i as f64;
    Smoothed {
        values: values.iter().enumerate().map(|(i, g)| g + line(i)).collect(),
        derivatives: derivatives.iter().map(|d| d / length + slope / dt).collect(),
        noise: (floor * n as f64 / 2.0).sqrt(),
        cutoff: place / (2.0 * length),
    }
}

/// The value at an end of the record: that of a line through the nearest samples.
fn end<'a>(samples: impl Iterator<Item = &'a f64>) -> f64 {
    const NEAREST: usize = 5;
    let near: Vec<f64> = samples.take(NEAREST).copied().collect();
    let middle = 0.5 * (near.len() as f64 - 1.0);
    let mean = near.iter().sum::<f64>() / near.len() as f64;
    let (mut above, mut below) = (0.0, 0.0);
    for (i, z) in near.iter().enumerate() {
        above += (i as f64 - middle) * (z - mean);
        below += (i as f64 - middle).powi(2);
    }
    mean - middle * above / below
}

/// Coefficients b(k), k = 1..n, of `sum b sin(pi k i/n)`.
fn sine_series(rest: &[f64]) -> Vec<f64> {
    let n = rest.len() - 1;
    let mut odd = vec![Complex64::default(); 2 * n];
    for i in 1..n {
        odd[i].re = rest[i];
        odd[2 * n - i].re = -rest[i];
    }
    ComplexFft::new(2 * n).forward(&mut odd);
    (1..n).map(|k| -odd[k].im / n as f64).collect()
}

/// The series and its derivative by i/n at i = 0..=n.
fn synthesis(series: &[f64], n: usize) -> (Vec<f64>, Vec<f64>) {
    let mut fft = ComplexFft::new(2 * n);
    let mut run = |factor: &dyn Fn(usize) -> f64| {
        let mut spectrum = vec![Complex64::default(); 2 * n];
        for (k, b) in series.iter().enumerate() {
            spectrum[k + 1].re = b * factor(k + 1);
        }
        fft.backward(&mut spectrum);
        spectrum.truncate(n + 1);
        spectrum
    };
    let values = run(&|_| 1.0).into_iter().map(|c| c.im).collect();
    let derivatives = run(&|k| PI * k as f64).into_iter().map(|c| c.re).collect();
    (values, derivatives)
}

/// Mean square of the coefficients where there is noise only: the upper half.
fn floor(series: &[f64]) -> f64 {
    let upper = &series[series.len() / 2..];
    upper.iter().map(|b| b * b).sum::<f64>() / upper.len() as f64
}

/// Where the signal's coefficients are as large as the noise's: behind the last group of them that stands out of the floor.
fn crossing(series: &[f64], floor: f64) -> f64 {
    const GROUP: usize = 5;
    // the mean of five squares of normal deviates passes 4.1 in one of a thousand cases
    const STANDS_OUT: f64 = 4.1;
    let energy = |group: &[f64]| group.iter().map(|b| b * b).sum::<f64>() / group.len() as f64;
    let last = series.chunks(GROUP).rposition(|group| energy(group) > STANDS_OUT * floor);
    let Some(group) = last else { return 1.0 };
    // the mean energy of the group is that of the power law at its place; from there it falls as k^-6
    let place = ((group * GROUP) as f64 + 0.5 * (GROUP as f64 + 1.0)).min(series.len() as f64);
    let ratio = energy(&series[group * GROUP..((group + 1) * GROUP).min(series.len())]) / floor.max(f64::MIN_POSITIVE);
    (place * (ratio - 1.0).max(1.0).powf(1.0 / 6.0)).min(2.0 * series.len() as f64)
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

#[cfg(test)]
mod sine_tests {
    use super::*;
    use fdm_numeric::random::Normal;

    #[test]
    fn noise_is_found_and_taken_off() {
        let (dt, n, sigma) = (0.02, 1500, 0.05);
        let mut normal = Normal(3);
        let signal = |t: f64| (0.9 * t).sin() + 0.3 * (2.3 * t + 1.0).cos() + 0.1 * t + 5.0;
        let rate = |t: f64| 0.9 * (0.9 * t).cos() - 0.69 * (2.3 * t + 1.0).sin() + 0.1;
        let time: Vec<f64> = (0..n).map(|k| dt * k as f64).collect();
        let noisy: Vec<f64> = time.iter().map(|t| signal(*t) + sigma * normal.next()).collect();
        let found = smooth(&noisy, dt, None);
        assert!((found.noise / sigma - 1.0).abs() < 0.1, "{}", found.noise);
        let rms = |v: &[f64], truth: &dyn Fn(f64) -> f64| {
            let inner = 50..n - 50;
            (inner.clone().map(|k| (v[k] - truth(time[k])).powi(2)).sum::<f64>() / inner.len() as f64).sqrt()
        };
        let (value, slope) = (rms(&found.values, &signal), rms(&found.derivatives, &rate));
        assert!(value < 0.25 * sigma && slope < 0.05, "{value} {slope}, cut-off {}", found.cutoff);
        assert!(found.cutoff > 0.3 && found.cutoff < 3.0, "{}", found.cutoff);
        let fixed = smooth(&noisy, dt, Some(1.0));
        assert!((fixed.cutoff - 1.0).abs() < 1e-12 && rms(&fixed.values, &signal) < 0.5 * sigma);
    }

    #[test]
    fn without_noise_nothing_is_lost() {
        let time: Vec<f64> = (0..801).map(|k| 0.01 * f64::from(k)).collect();
        let clean: Vec<f64> = time.iter().map(|t| (1.5 * t).sin()).collect();
        let found = smooth(&clean, 0.01, None);
        let inner = 20..780;
        let worst = inner.map(|k| (found.derivatives[k] - 1.5 * (1.5 * time[k]).cos()).abs()).fold(0.0, f64::max);
        assert!(worst < 0.02, "{worst}");
        assert!(smooth(&[1.0; 4], 1.0, None).derivatives.iter().all(|d| d.is_nan()));
    }
}
