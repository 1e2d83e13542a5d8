//! Cramer-Rao covariance on both sides of what the noise really does: `D middle D`.

use super::conclusion::Conclusion;
use crate::estimate::iteration::priors::PriorRow;
use crate::estimate::unknowns::Unknowns;

/// Where the columns of the runs stand among the unknowns.
pub(in crate::estimate) struct Sandwich<'f> {
    pub(in crate::estimate) unknowns: &'f Unknowns,
    pub(in crate::estimate) conclusion: &'f Conclusion,
}

impl Sandwich<'_> {
    /// The place of each column of a run in the covariance.
    pub(in crate::estimate) fn places(&self, run: usize) -> Vec<Option<usize>> {
        let chosen = &self.conclusion.inverse.chosen;
        let columns = 0..self.unknowns.columns.len();
        columns.map(|c| chosen.binary_search(&self.unknowns.position(run, c)).ok()).collect()
    }

    /// The norm of each column of a run, 0 for those that are not part of the covariance.
    pub(in crate::estimate) fn scale(&self, run: usize) -> Vec<f64> {
        let norm = |(c, place): (usize, Option<usize>)| {
            place.map_or(0.0, |_| self.conclusion.scale[self.unknowns.position(run, c)])
        };
        self.places(run).into_iter().enumerate().map(norm).collect()
    }

    /// Prior information, which the noise does not touch.
    pub(in crate::estimate) fn prior(&self, priors: impl Iterator<Item = PriorRow>) -> Vec<(usize, f64)> {
        let place = |row: PriorRow| {
            let k = self.conclusion.inverse.chosen.binary_search(&row.unknown).ok()?;
            Some((k, (row.weight / self.conclusion.scale[row.unknown]).powi(2)))
        };
        priors.filter_map(place).collect()
    }

    /// The covariance, chosen by chosen, from the middle of each run (square, its columns first) and the priors.
    pub(in crate::estimate) fn covariance(&self, middles: &[impl AsRef<[f64]>], prior: &[(usize, f64)]) -> Vec<f64> {
        self.around(&self.gather(middles, prior))
    }

    /// The middle of all, chosen by chosen, from that of each run (square, its columns first) and the priors.
    pub(in crate::estimate) fn gather(&self, middles: &[impl AsRef<[f64]>], prior: &[(usize, f64)]) -> Vec<f64> {
        let n = self.conclusion.inverse.chosen.len();
        let mut middle = vec![0.0; n * n];
        for (run, own) in middles.iter().map(AsRef::as_ref).enumerate() {
            let (places, width) = (self.places(run), own.len().isqrt());
            for (i, a) in places.iter().enumerate() {
                for (j, b) in places.iter().enumerate() {
                    if let (Some(a), Some(b)) = (a, b) {
                        middle[a * n + b] += own[i * width + j];
                    }
                }
            }
        }
        prior.iter().for_each(|(k, information)| middle[k * n + k] += information);
        middle
    }

    /// The covariance (n by n) with this middle.
    pub(in crate::estimate) fn around(&self, middle: &[f64]) -> Vec<f64> {
        let n = self.conclusion.inverse.chosen.len();
        let inverse = &self.conclusion.inverse.values;
        let covariance = product(&product(inverse, middle, n), inverse, n);
        (0..n * n).map(|k| 0.5 * (covariance[k] + covariance[k % n * n + k / n])).collect()
    }

    /// Rows of the Cramer-Rao covariance for the columns of one run (width by chosen).
    pub(in crate::estimate) fn columns(&self, run: usize, width: usize) -> Vec<f64> {
        let inverse = &self.conclusion.inverse;
        let (n, mut rows) = (inverse.chosen.len(), vec![0.0; width * self.conclusion.inverse.chosen.len()]);
        for (place, row) in self.places(run).into_iter().zip(rows.chunks_mut(n.max(1))) {
            if let Some(k) = place {
                row.copy_from_slice(&inverse.values[k * n..(k + 1) * n]);
            }
        }
        rows
    }

    /// Cramer-Rao covariance and corrected covariance of the columns of one run (width by width).
    pub(in crate::estimate) fn of_run(&self, run: usize, covariance: &[f64], width: usize) -> [Vec<f64>; 2] {
        let (n, places) = (self.conclusion.inverse.chosen.len(), self.places(run));
        [&self.conclusion.inverse.values[..], covariance].map(|from| {
            let mut to = vec![0.0; width * width];
            for (i, a) in places.iter().enumerate() {
                for (j, b) in places.iter().enumerate() {
                    if let (Some(a), Some(b)) = (a, b) {
                        to[i * width + j] = from[a * n + b];
                    }
                }
            }
            to
        })
    }
}

fn product(a: &[f64], b: &[f64], n: usize) -> Vec<f64> {
    let mut c = vec![0.0; n * n];
    let width = n.max(1);
    for (row, to) in a.chunks(width).zip(c.chunks_mut(width)) {
        for (factor, b) in row.iter().zip(b.chunks(width)) {
            to.iter_mut().zip(b).for_each(|(c, b)| *c += factor * b);
        }
    }
    c
}
