//! How well one output of one run is matched: size and kind of the mismatch.

use serde::{Deserialize, Serialize};

/// How well one output of one run is matched.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct OutputFit {
    /// Name of the output.
    pub name: String,
    /// Name of the run.
    pub run: String,
    /// Compared samples.
    pub compared: usize,
    /// Samples of which only a limit is known that they lie below; they have no residuals.
    #[serde(default, skip_serializing_if = "is_none")]
    pub censored: usize,
    /// Root mean square of the residuals, in the output's unit; none when nothing was compared.
    pub rms: Option<f64>,
    /// Mean of the residuals (measured minus model), in the output's unit.
    pub bias: Option<f64>,
    /// Share of the measured variance that the model explains; none when the measurement does not vary.
    pub r2: Option<f64>,
    /// Theil's inequality coefficient: 0 for a perfect match, 1 for none.
    pub tic: Option<f64>,
    /// What the mismatch consists of; none when there is no mismatch.
    pub tic_parts: Option<TicParts>,
}

fn is_none(count: &usize) -> bool {
    *count == 0
}

/// Theil's proportions of inequality: parts of the mean square residual, which add up to 1.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
pub struct TicParts {
    /// The means differ: an offset.
    pub bias: f64,
    /// The standard deviations differ: the response is too large or too small.
    pub variance: f64,
    /// Measurement and response do not move together: what bias and variance leave. A good model leaves only this.
    pub covariance: f64,
}

impl OutputFit {
    /// Compares one output (index `o` of `q`) of `measured` and `modelled` (N by q); cells with NaN in `measured` are left out.
    pub fn new(name: &str, run: &str, measured: &[f64], modelled: &[f64], o: usize, q: usize) -> Self {
        let cells = || measured.chunks_exact(q).zip(modelled.chunks_exact(q)).map(|(z, y)| (z[o], y[o]));
        let cells = || cells().filter(|(z, _)| !z.is_nan());
        let (mut count, mut sums) = (0, [0.0; 6]);
        for (z, y) in cells() {
            count += 1;
            let v = z - y;
            sums.iter_mut().zip([v * v, z, y, z * z, y * y, v]).for_each(|(sum, part)| *sum += part);
        }
        let n = count as f64;
        let [square, middle, centre, measured_square, modelled_square, offset] = sums.map(|sum| sum / n);
        let (mut spread, mut width) = (0.0, 0.0);
        for (z, y) in cells() {
            spread += (z - middle) * (z - middle);
            width += (y - centre) * (y - centre);
        }
        let (spread, width) = (spread / n, width / n);
        let sizes = measured_square.sqrt() + modelled_square.sqrt();
        // a variance that is the rounding of a constant is none
        let varies = spread > (f64::EPSILON * middle).powi(2);
        let known = |value: f64, known: bool| (count > 0 && known && value.is_finite()).then_some(value);
        Self {
            name: name.into(),
            run: run.into(),
            compared: count,
            censored: 0,
            rms: known(square.sqrt(), true),
            bias: known(offset, true),
            r2: known(1.0 - square / spread, varies),
            tic: known(square.sqrt() / sizes, sizes > 0.0),
            tic_parts: known(square, square > 0.0).map(|_| TicParts::new(square, offset, spread.sqrt() - width.sqrt())),
        }
    }
}

impl TicParts {
    fn new(square: f64, offset: f64, spreads: f64) -> Self {
        let (bias, variance) = ((offset * offset / square).min(1.0), (spreads * spreads / square).min(1.0));
        // twice (1 - r) times both deviations; what rounding leaves below zero is zero
        Self { bias, variance, covariance: (1.0 - bias - variance).max(0.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_the_definitions() {
        let (z, y) = ([1.0, 9.0, 2.0, f64::NAN, 3.0, 9.0], [1.0, 9.0, 2.5, 0.0, 2.0, 9.0]);
        let fit = OutputFit::new("a", "r", &z, &y, 0, 2);
        assert_eq!(fit.compared, 3);
        assert!((fit.rms.expect("compared") - (1.25f64 / 3.0).sqrt()).abs() < 1e-15);
        assert!((fit.bias.expect("compared") - 0.5 / 3.0).abs() < 1e-15);
        assert!((fit.r2.expect("varies") - (1.0 - 1.25 / 2.0)).abs() < 1e-15);
        let tic = (1.25f64 / 3.0).sqrt() / ((14.0f64 / 3.0).sqrt() + (11.25f64 / 3.0).sqrt());
        assert!((fit.tic.expect("sizes") - tic).abs() < 1e-15);
        let constant = OutputFit::new("b", "r", &z, &y, 1, 2);
        assert_eq!((constant.compared, constant.rms, constant.r2, constant.tic_parts), (2, Some(0.0), None, None));
        let none = OutputFit::new("c", "r", &[f64::NAN], &[1.0], 0, 1);
        assert_eq!((none.compared, none.rms, none.tic, none.tic_parts), (0, None, None, None));
    }

    #[test]
    fn the_parts_are_offset_size_and_the_rest() {
        let parts = |y: &dyn Fn(f64) -> f64| {
            let z: Vec<f64> = (0..64).map(|k| (0.3 * k as f64).sin()).collect();
            let y: Vec<f64> = z.iter().map(|z| y(*z)).collect();
            OutputFit::new("a", "r", &z, &y, 0, 1).tic_parts.expect("a mismatch")
        };
        assert!((parts(&|z| z + 0.1).bias - 1.0).abs() < 1e-12, "{:?}", parts(&|z| z + 0.1));
        let (z, y) = ([1.0, -1.0, 1.0, -1.0], [2.0, -2.0, 2.0, -2.0]);
        let larger = OutputFit::new("a", "r", &z, &y, 0, 1).tic_parts.expect("a mismatch");
        assert_eq!(larger, TicParts { bias: 0.0, variance: 1.0, covariance: 0.0 });
        // the textbook form of the rest: 2 (1 - r) times both deviations
        let (z, y) = ([1.0, 3.0, 2.0, 5.0], [1.5, 2.0, 2.5, 4.0]);
        let moment = |a: &[f64; 4], b: &[f64; 4]| {
            let (ma, mb) = (a.iter().sum::<f64>() / 4.0, b.iter().sum::<f64>() / 4.0);
            a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum::<f64>() / 4.0
        };
        let (sz, sy) = (moment(&z, &z).sqrt(), moment(&y, &y).sqrt());
        let square = z.iter().zip(&y).map(|(z, y)| (z - y) * (z - y)).sum::<f64>() / 4.0;
        let found = OutputFit::new("a", "r", &z, &y, 0, 1).tic_parts.expect("a mismatch");
        assert!((found.covariance - 2.0 * (sz * sy - moment(&z, &y)) / square).abs() < 1e-12);
        assert!((found.bias + found.variance + found.covariance - 1.0).abs() < 1e-12);
    }
}
