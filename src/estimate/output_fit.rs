//! How well one output of one run is matched.

use serde::Serialize;

/// How well one output of one run is matched.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OutputFit {
    /// Name of the output.
    pub name: String,
    /// Name of the run.
    pub run: String,
    /// Compared samples.
    pub compared: usize,
    /// Root mean square of the residuals, in the output's unit; none when nothing was compared.
    pub rms: Option<f64>,
    /// Mean of the residuals (measured minus model), in the output's unit.
    pub bias: Option<f64>,
    /// Share of the measured variance that the model explains; none when the measurement does not vary.
    pub r2: Option<f64>,
    /// Theil's inequality coefficient: 0 for a perfect match, 1 for none.
    pub tic: Option<f64>,
}

impl OutputFit {
    /// Compares one output (index `o` of `q`) of `measured` and `modelled` (N by q).
    pub(super) fn new(name: &str, run: &str, measured: &[f64], modelled: &[f64], o: usize, q: usize) -> Self {
        let cells = || {
            let both = measured.iter().zip(modelled).skip(o).step_by(q);
            both.map(|(z, y)| (*z, *y)).filter(|(z, _)| !z.is_nan())
        };
        let n = cells().count();
        let mean = |value: &dyn Fn(f64, f64) -> f64| cells().map(|(z, y)| value(z, y)).sum::<f64>() / n as f64;
        let square = mean(&|z, y| (z - y) * (z - y));
        let middle = mean(&|z, _| z);
        let spread = mean(&|z, _| (z - middle) * (z - middle));
        let sizes = mean(&|z, _| z * z).sqrt() + mean(&|_, y| y * y).sqrt();
        // a variance that is the rounding of a constant is none
        let varies = spread > (f64::EPSILON * middle).powi(2);
        let known = |value: f64, known: bool| (n > 0 && known && value.is_finite()).then_some(value);
        Self {
            name: name.into(),
            run: run.into(),
            compared: n,
            rms: known(square.sqrt(), true),
            bias: known(mean(&|z, y| z - y), true),
            r2: known(1.0 - square / spread, varies),
            tic: known(square.sqrt() / sizes, sizes > 0.0),
        }
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
        assert_eq!((constant.compared, constant.rms, constant.r2), (2, Some(0.0), None));
        let none = OutputFit::new("c", "r", &[f64::NAN], &[1.0], 0, 1);
        assert_eq!((none.compared, none.rms, none.tic), (0, None, None));
    }
}
