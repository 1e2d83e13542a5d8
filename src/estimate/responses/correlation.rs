//! How the random errors of a response at two frequencies correlate: through the window, neighbours see the same noise.

use std::f64::consts::PI;

/// Correlation of the noise of windowed segments `length` long at frequencies (in cycles) `distance` apart: the transform of the square of
/// Hann's window, on which segments that follow each other agree.
pub(super) fn shared(distance: f64, length: f64) -> f64 {
    let u = distance.abs() * length;
    let whole = 0.375 * sinc(u);
    let near = 0.25 * (sinc(u - 1.0) + sinc(u + 1.0));
    let far = 0.0625 * (sinc(u - 2.0) + sinc(u + 2.0));
    (whole + near + far) / 0.375
}

fn sinc(u: f64) -> f64 {
    if u.abs() < 1e-9 { 1.0 } else { fdm_grammar::math::sin(PI * u) / (PI * u) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_transform_of_the_squared_window() {
        let n = 4096;
        for (u, length) in [(0.0, 1.0), (0.4, 3.0), (1.0, 2.0), (1.7, 0.5), (2.5, 1.0), (6.3, 1.0)] {
            let at = |k: usize| (k as f64 + 0.5) / n as f64;
            let weight = |x: f64| (0.5 - 0.5 * (2.0 * PI * x).cos()).powi(2);
            let turn = |x: f64| (2.0 * PI * u * (x - 0.5)).cos();
            let sum: f64 = (0..n).map(at).map(|x| weight(x) * turn(x)).sum();
            let total: f64 = (0..n).map(at).map(weight).sum();
            assert!((shared(u / length, length) - sum / total).abs() < 1e-6, "{u}");
        }
        assert!(shared(3.0, 1.0).abs() < 1e-12, "three resolved frequencies apart nothing is shared");
    }
}
