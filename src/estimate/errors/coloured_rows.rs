//! Sensitivities and residuals of one run on its even grid, output by output, and what coloured noise makes of them.

use crate::estimate::problem::ProblemRun;
use crate::estimate::unknowns::Unknowns;
use crate::quality::Untested;
use crate::quality::autoregression::AutoRegression;
use crate::quality::sampling::Sampling;
use crate::simulate::{Block, Divergence};

/// One run at the estimates.
pub(in crate::estimate) struct ColouredRows {
    /// Places of the grid.
    pub(in crate::estimate) length: usize,
    /// Time between them.
    pub(in crate::estimate) interval: f64,
    /// Numbers of a row, a multiple of 8: a scaled sensitivity for each column, then zeros.
    pub(in crate::estimate) width: usize,
    /// For each output (q) its rows (length by width); zeros where nothing is compared.
    pub(in crate::estimate) rows: Vec<Vec<f64>>,
    /// For each output (q) its residuals (length); NaN where nothing is compared.
    pub(in crate::estimate) residuals: Vec<Vec<f64>>,
}

/// The colour of the noise of all outputs.
#[derive(Debug, Clone)]
pub(in crate::estimate) struct Colour {
    /// The autoregression of each output (q).
    pub(in crate::estimate) models: Vec<AutoRegression>,
    /// Covariance of the innovations, q by q.
    pub(in crate::estimate) innovations: Vec<f64>,
}

/// What coloured noise makes of a run.
pub(in crate::estimate) struct Filtered {
    /// Sum over all pairs of samples of `S' R^-1 Rvv R^-1 S` (width by width).
    pub(in crate::estimate) middle: Vec<f64>,
    /// For each output the rows of `Rvv R^-1 S` (length by width); zeros where nothing is compared.
    pub(in crate::estimate) images: Vec<Vec<f64>>,
}

/// The grid on which a run is sampled.
///
/// # Errors
/// [`Untested`] when it is not sampled evenly.
pub(in crate::estimate) fn sampling(run: &ProblemRun<'_>) -> Result<Sampling, Untested> {
    let samples = run.response.samples();
    match run.response.time() {
        Some(time) if samples > 2 => Sampling::of(time).map_err(Untested::from),
        _ => Ok(Sampling::counted(samples)),
    }
}

impl ColouredRows {
    /// Simulates a run at `theta`; `scale` is the norm of each column, 0 for those that are left out.
    ///
    /// # Errors
    /// [`Divergence`] as for the response.
    pub(in crate::estimate) fn new(
        run: &mut ProblemRun<'_>,
        unknowns: &Unknowns,
        theta: &[f64],
        scale: &[f64],
        grid: &Sampling,
    ) -> Result<Self, Divergence> {
        let (n, q, width) = (run.response.samples(), run.response.outputs(), scale.len().next_multiple_of(8));
        let (mut y, mut jacobian) = (vec![0.0; n * q], vec![0.0; n * q * width]);
        run.response.sensitivities(theta, &unknowns.columns, &mut |block: Block<'_>| {
            block.copy_to(&mut y, &mut jacobian, width);
        })?;
        let length = grid.length();
        let mut rows = vec![vec![0.0; length * width]; q];
        let mut residuals = vec![vec![f64::NAN; length]; q];
        for (cell, z) in run.measured.iter().enumerate().filter(|(_, z)| !z.is_nan()) {
            let (place, output) = (grid.place[cell / q], cell % q);
            residuals[output][place] = z - y[cell];
            let to = rows[output][place * width..].iter_mut();
            let scaled = jacobian[cell * width..].iter().zip(scale);
            to.zip(scaled).for_each(|(r, (j, s))| *r = if *s > 0.0 { j / s } else { 0.0 });
        }
        Ok(Self { length, interval: grid.interval, width, rows, residuals })
    }

    /// Runs the noise's filters over the rows, weighted by `inverse_noise` (q by q): backward to what each innovation does,
    /// and forward again to what the noise looks like.
    pub(in crate::estimate) fn filter(&self, colour: &Colour, inverse_noise: &[f64]) -> Filtered {
        let (q, width) = (self.rows.len(), self.width);
        let memory = colour.models.iter().map(|m| m.memory(self.length)).max().unwrap_or(0);
        let effects: Vec<Vec<f64>> = (0..q)
            .map(|a| {
                let mut rows = vec![0.0; memory * width];
                rows.resize((memory + self.length) * width, 0.0);
                self.weigh(&inverse_noise[a * q..(a + 1) * q], &mut rows[memory * width..]);
                colour.models[a].backward(&mut rows, width);
                rows
            })
            .collect();
        let mut middle = vec![0.0; width * width];
        let mut images = Vec::with_capacity(q);
        for a in 0..q {
            let mut image = vec![0.0; (memory + self.length) * width];
            for (effect, covariance) in effects.iter().zip(&colour.innovations[a * q..(a + 1) * q]) {
                add(*covariance, effect, &mut image);
            }
            add_products(&effects[a], &image, width, &mut middle);
            colour.models[a].forward(&mut image, width);
            image.drain(..memory * width);
            let missing = self.residuals[a].iter().enumerate().filter(|(_, v)| v.is_nan());
            missing.for_each(|(i, _)| image[i * width..(i + 1) * width].fill(0.0));
            images.push(image);
        }
        Filtered { middle, images }
    }

    fn weigh(&self, weights: &[f64], to: &mut [f64]) {
        for (rows, weight) in self.rows.iter().zip(weights) {
            add(*weight, rows, to);
        }
    }

    /// What fitting takes off the sums of lagged products of an output's residuals, for lags 0 to `most`: with P the
    /// projection on the sensitivities, the residuals have the covariance (1 - P) Rvv (1 - P)'. `inverse` is the Cramer-Rao
    /// covariance of this run's columns, `covariance` the corrected one (width by width).
    pub(in crate::estimate) fn taken(
        &self,
        output: usize,
        image: &[f64],
        inverse: &[f64],
        covariance: &[f64],
        most: usize,
    ) -> Vec<f64> {
        let (width, rows) = (self.width, &self.rows[output]);
        let mut half = vec![0.0; rows.len()];
        for ((h, s), g) in half.chunks_mut(width).zip(rows.chunks(width)).zip(image.chunks(width)) {
            for (j, h) in h.iter_mut().enumerate() {
                *h = dot(&inverse[j * width..(j + 1) * width], g)
                    - 0.5 * dot(&covariance[j * width..(j + 1) * width], s);
            }
        }
        let lag = |k: usize| {
            let shift = (k * width).min(rows.len());
            dot(&rows[shift..], &half[..rows.len() - shift]) + dot(&rows[..rows.len() - shift], &half[shift..])
        };
        (0..=most).map(lag).collect()
    }
}

fn add(factor: f64, from: &[f64], to: &mut [f64]) {
    if factor != 0.0 {
        to.iter_mut().zip(from).for_each(|(t, f)| *t += factor * f);
    }
}

/// Adds the sum of outer products of two lists of rows.
fn add_products(a: &[f64], b: &[f64], width: usize, sums: &mut [f64]) {
    for (a, b) in a.chunks(width).zip(b.chunks(width)) {
        for (a, row) in a.iter().zip(sums.chunks_mut(width)) {
            add(*a, b, row);
        }
    }
}

/// In eight sums side by side, for lengths that are multiples of 8.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    for (a, b) in a.as_chunks::<8>().0.iter().zip(b.as_chunks::<8>().0) {
        for l in 0..8 {
            sums[l] += a[l] * b[l];
        }
    }
    sums.iter().sum()
}
