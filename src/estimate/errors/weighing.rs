//! What it costs that outputs are weighed by noise that the residuals tell.
//!
//! With few frequencies the weights are uncertain, and estimates scatter more than with true ones; the information that they promise is too large besides.
//! The middle of the sandwich grows by `2 sum_o 2/v(o) (A(o) - A(o) D A(o))`, A the information of one output, D the inverse of all, v the degrees of freedom of
//! the output's noise (Kenward and Roger 1997, for the variances of a diagonal covariance). One output alone needs no weights, and nothing is added.

use super::sandwich::Sandwich;
use super::spectral_rows::SpectralRows;
use nalgebra::DMatrix;

/// Fewest degrees of freedom by which the noise of an output is known.
const FEWEST: f64 = 2.0;

/// What is added to the middle (n by n).
pub(super) fn weighing(runs: &[SpectralRows], sandwich: &Sandwich<'_>, weights: &[f64]) -> Vec<f64> {
    let inverse = &sandwich.conclusion.inverse;
    let n = inverse.chosen.len();
    let known = DMatrix::from_row_slice(n, n, &inverse.values);
    let mut added = DMatrix::zeros(n, n);
    for (o, cells) in sandwich.conclusion.cells.iter().enumerate() {
        let Some(cells) = cells else { continue };
        let own = information(runs, sandwich, weights, o);
        // what fitting takes off
        let freedom = (cells - known.component_mul(&own).sum()).max(FEWEST);
        added += (4.0 / freedom) * (&own - &own * &known * &own);
    }
    added.as_slice().to_vec()
}

/// What one output tells (n by n).
fn information(runs: &[SpectralRows], sandwich: &Sandwich<'_>, weights: &[f64], output: usize) -> DMatrix<f64> {
    let (n, q) = (sandwich.conclusion.inverse.chosen.len(), weights.len().isqrt());
    let mut own = DMatrix::zeros(n, n);
    for (r, run) in runs.iter().enumerate() {
        let places = sandwich.places(r);
        let chosen = || places.iter().enumerate().filter_map(|(c, place)| place.map(|place| (c, place)));
        for b in (0..q).filter(|b| weights[output * q + b] != 0.0) {
            for ((c, i), (d, j)) in chosen().flat_map(|left| chosen().map(move |right| (left, right))) {
                let planes = run.plane(output, c).iter().zip(run.plane(b, d));
                let product: f64 = planes.map(|(s, t)| s.re * t.re + s.im * t.im).sum();
                // half of each order, so that it is symmetric
                own[(i, j)] += 0.5 * weights[output * q + b] * product;
                own[(j, i)] += 0.5 * weights[output * q + b] * product;
            }
        }
    }
    own
}
