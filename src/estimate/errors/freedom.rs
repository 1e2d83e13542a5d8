//! How well a corrected error is known itself: its degrees of freedom.
//!
//! A corrected variance stands on autoregressions that were estimated. With the weights w of an estimate on the noise of an output, and b what each
//! innovation does to it, the variance is `V = s^2 sum_t b(t)^2`. The coefficients a have the covariance `s^2/N G^-1` (G the autocovariances of the
//! noise), and `dV/da(m) = 2 s^2 sum_t b(t) u(t + m)`, where u is b filtered once more. What follows for the variance of V gives the degrees of
//! freedom of a chi-squared law with that spread (Satterthwaite 1946); intervals are then those of Student's law.

use super::coloured_rows::{Colour, ColouredRows};
use nalgebra::{Cholesky, DMatrix, DVector};

/// What is known of the noise of one output, from so many samples.
struct Part {
    /// By estimate: its share in the variance.
    size: Vec<f64>,
    /// By estimate: its derivatives by the coefficients.
    slopes: Vec<DVector<f64>>,
}

/// A run whose noise was estimated.
pub(super) struct Known<'g> {
    pub(super) rows: &'g ColouredRows,
    /// The place of every estimate in its columns (width by n, row-major): the columns of the Cramer-Rao covariance.
    pub(super) places: &'g [f64],
    pub(super) colour: &'g Colour,
    /// Samples of each output.
    pub(super) samples: Vec<f64>,
}

/// Degrees of freedom of the `n` corrected variances; infinite where nothing is uncertain.
pub(super) fn freedom(runs: &[Known<'_>], inverse_noise: &[f64], variances: &[f64]) -> Vec<f64> {
    let mut spread = vec![0.0; variances.len()];
    for run in runs {
        for output in 0..run.colour.models.len() {
            if run.samples[output] > 0.0 {
                run.add_spread(output, inverse_noise, &mut spread);
            }
        }
    }
    spread.iter().zip(variances).map(|(spread, variance)| 2.0 * variance * variance / spread).collect()
}

impl Known<'_> {
    /// Adds the variance of what an output contributes to each corrected variance.
    fn add_spread(&self, output: usize, inverse_noise: &[f64], spread: &mut [f64]) {
        let model = &self.colour.models[output];
        let (order, n) = (model.coefficients.len(), spread.len());
        let mut part = Part { size: vec![0.0; n], slopes: vec![DVector::zeros(order); n] };
        part.add(self.rows, self.places, (self.colour, output), inverse_noise);
        let samples = self.samples[output];
        let r = model.autocovariances(order);
        let law = Cholesky::new(DMatrix::from_fn(order, order, |i, j| r[i.abs_diff(j)]));
        for (j, total) in spread.iter_mut().enumerate() {
            *total += 2.0 * part.size[j] * part.size[j] / samples;
            if let Some(law) = law.as_ref().filter(|_| order > 0) {
                *total += model.variance / samples * part.slopes[j].dot(&law.solve(&part.slopes[j]));
            }
        }
    }
}

impl Part {
    fn add(&mut self, rows: &ColouredRows, places: &[f64], (colour, output): (&Colour, usize), inverse_noise: &[f64]) {
        let (q, width, n) = (colour.models.len(), rows.width, self.size.len());
        let model = &colour.models[output];
        let memory = model.memory(rows.length);
        let mut effects = vec![0.0; (memory + rows.length) * width];
        rows.weigh(&inverse_noise[output * q..(output + 1) * q], &mut effects[memory * width..]);
        model.backward(&mut effects, width);
        let mut again = effects.clone();
        model.backward(&mut again, width);
        let mut own = [vec![0.0; memory + rows.length], vec![0.0; memory + rows.length]];
        for j in 0..n {
            for (series, rows) in own.iter_mut().zip([&effects, &again]) {
                for (value, row) in series.iter_mut().zip(rows.chunks_exact(width)) {
                    *value = row.iter().enumerate().map(|(c, v)| v * places[c * n + j]).sum();
                }
            }
            let [b, u] = &own;
            self.size[j] += model.variance * b.iter().map(|b| b * b).sum::<f64>();
            for m in 1..=model.coefficients.len() {
                let product: f64 = b.iter().zip(&u[m.min(u.len())..]).map(|(b, u)| b * u).sum();
                self.slopes[j][m - 1] += 2.0 * model.variance * product;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::autoregression::AutoRegression;
    use crate::quality::ladder::Ladder;

    fn rows() -> ColouredRows {
        let (length, width) = (60, 8);
        let mut rows = vec![vec![0.0; length * width]; 2];
        for (o, rows) in rows.iter_mut().enumerate() {
            for i in 0..length {
                rows[i * width] = (0.2 * i as f64 + o as f64).sin();
                rows[i * width + 1] = 1.0 / (1.0 + i as f64);
            }
        }
        ColouredRows::of(1.0, width, rows, vec![vec![0.5; length]; 2])
    }

    fn part(rows: &ColouredRows, model: &AutoRegression) -> Part {
        let order = model.coefficients.len();
        let colour = Colour { models: vec![AutoRegression::white(1.0), model.clone()], innovations: Vec::new() };
        let mut places = vec![0.0; rows.width * 2];
        places[..4].copy_from_slice(&[1.0, 0.3, -0.4, 2.0]);
        let mut part = Part { size: vec![0.0; 2], slopes: vec![DVector::zeros(order); 2] };
        part.add(rows, &places, (&colour, 1), &[1.0, 0.2, 0.2, 2.0]);
        part
    }

    #[test]
    fn slopes_are_those_of_the_variance() {
        let rows = rows();
        let model = Ladder::of(&[2.0, 1.4, 0.6, 0.3]).model(3);
        let found = part(&rows, &model);
        for m in 0..3 {
            let at = |step: f64| {
                let mut moved = model.clone();
                moved.coefficients[m] += step;
                part(&rows, &moved).size
            };
            let (above, below) = (at(1e-5), at(-1e-5));
            for (slopes, (above, below)) in found.slopes.iter().zip(above.iter().zip(&below)) {
                let want = (above - below) / 2e-5;
                // the filters end where their influence has fallen to a thousandth
                assert!((slopes[m] / want - 1.0).abs() < 5e-3, "{m}: {} {want}", slopes[m]);
            }
        }
    }

    #[test]
    fn white_noise_is_known_by_its_samples() {
        let rows = rows();
        let colour =
            Colour { models: vec![AutoRegression::white(1.0), AutoRegression::white(1.0)], innovations: Vec::new() };
        let mut places = vec![0.0; rows.width];
        places[0] = 1.0;
        let run = |samples: Vec<f64>| Known { rows: &rows, places: &places, colour: &colour, samples };
        // the second output says nothing: its weight is nothing
        let known = |samples| {
            let mut size = Part { size: vec![0.0], slopes: vec![DVector::zeros(0)] };
            size.add(&rows, &places, (&colour, 0), &[1.0, 0.0, 0.0, 0.0]);
            freedom(&[run(samples)], &[1.0, 0.0, 0.0, 0.0], &size.size)[0]
        };
        assert!((known(vec![58.0, 58.0]) - 58.0).abs() < 1e-9);
        assert!((known(vec![58.0, 0.0]) - 58.0).abs() < 1e-9);
    }
}
