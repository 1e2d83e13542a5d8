//! What one more column would add to a linearised model under given weights, in closed form.

use crate::evidence::factor::Factor;
use crate::evidence::gram::{Border, Grams};

/// Part of a column that must be left beside the others: below it there is nothing that they do not do.
const LEFT: f64 = 1e-7;

/// A linearised model under weights, factored.
pub(crate) struct Screen<'g> {
    grams: &'g Grams,
    /// Mean of 1/S for every output and band.
    weights: &'g [f64],
    runs: Vec<RunFactor>,
    shared: Factor,
    /// The residual's products with the shared columns, what belongs to runs eliminated, whitened.
    residual: Vec<f64>,
}

/// A run's own columns under weights.
struct RunFactor {
    factor: Factor,
    /// Their products with the residual and with each shared column, whitened.
    columns: Vec<Vec<f64>>,
}

/// A column beside all others.
#[derive(Debug, Clone)]
pub(crate) struct Beside {
    /// Its product with the residual, and its square, both beside what the others do.
    pub(crate) cross: f64,
    pub(crate) square: f64,
    /// Part of its square that is left there.
    pub(crate) left: f64,
    /// Whitened products with all own columns, run by run, then the shared ones.
    pub(crate) along: Vec<f64>,
}

impl<'g> Screen<'g> {
    /// None where the columns are not finite.
    pub(crate) fn new(grams: &'g Grams, weights: &'g [f64], precision: &[f64]) -> Option<Self> {
        let q = grams.shared();
        let size = q + 1;
        let (mut runs, mut schur, mut matrix) = (Vec::new(), vec![0.0; size * size], Vec::new());
        for run in grams.runs() {
            run.weighted(weights, &mut matrix);
            let mut factor = Factor::default();
            if run.own > 0 && !factor.renew(&matrix, run.own, run.width) {
                return None;
            }
            let column = |j: usize| -> Vec<f64> {
                let mut b: Vec<f64> = (0..run.own).map(|i| matrix[i * run.width + run.own + j]).collect();
                if run.own > 0 {
                    factor.whiten(&mut b);
                }
                b
            };
            let columns: Vec<Vec<f64>> = (0..size).map(column).collect();
            for i in 0..size {
                for j in 0..size {
                    let entry = matrix[(run.own + i) * run.width + run.own + j];
                    schur[i * size + j] += entry - inner(&columns[i], &columns[j]);
                }
            }
            runs.push(RunFactor { factor, columns });
        }
        let mut within: Vec<f64> = (1..size).flat_map(|i| schur[i * size + 1..(i + 1) * size].to_vec()).collect();
        precision.iter().enumerate().for_each(|(j, p)| within[j * q + j] += p);
        let mut shared = Factor::default();
        let mut residual: Vec<f64> = (1..size).map(|i| schur[i * size]).collect();
        if q > 0 {
            if !shared.renew(&within, q, q) {
                return None;
            }
            shared.whiten(&mut residual);
        }
        Some(Self { grams, weights, runs, shared, residual })
    }

    /// A column beside the others; none where they do all that it does.
    pub(crate) fn beside(&self, border: &Border) -> Option<Beside> {
        let q = self.grams.shared();
        let (mut along, mut rest) = (Vec::new(), vec![0.0; q + 1]);
        let (mut square, mut whole) = (0.0, 0.0);
        let mut sums = Vec::new();
        for ((run, own), products) in self.grams.runs().iter().zip(&self.runs).zip(&border.runs) {
            let width = run.width + 1;
            sums.clear();
            sums.resize(width, 0.0);
            for (weight, row) in self.weights.iter().zip(products.chunks_exact(width)) {
                sums.iter_mut().zip(row).for_each(|(sum, v)| *sum += weight * v);
            }
            let mut mine = sums[..run.own].to_vec();
            if run.own > 0 {
                own.factor.whiten(&mut mine);
            }
            for ((rest, sum), column) in rest.iter_mut().zip(&sums[run.own..run.width]).zip(&own.columns) {
                *rest += sum - inner(column, &mine);
            }
            square += sums[run.width] - inner(&mine, &mine);
            whole += sums[run.width];
            along.extend(mine);
        }
        let mut shared = rest.split_off(1);
        if q > 0 {
            self.shared.whiten(&mut shared);
        }
        let cross = rest[0] - inner(&shared, &self.residual);
        square -= inner(&shared, &shared);
        along.extend(shared);
        let left = square / whole;
        (left > LEFT && square.is_finite() && cross.is_finite()).then_some(Beside { cross, square, left, along })
    }
}

fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::evidence::bands::Bands;
    use crate::evidence::gram::segments;
    use fdm_numeric::random::Stream;
    use nalgebra::{DMatrix, DVector};

    /// Two runs with one own column each, two shared ones and one more: what is left of that is what least squares leaves.
    #[test]
    fn a_column_is_what_least_squares_leave_of_it() {
        let (bins, bands) = (60, Bands::new(60));
        let frequency: Vec<f64> = (0..bins).map(|k| k as f64).collect();
        let cut = segments(&bands, 0, &frequency, 0);
        let mut stream = Stream::seeded(3);
        let mut drawn = || -> Vec<f64> { (0..bins).map(|_| stream.normal()).collect() };
        // own, residual, two shared columns, of each run
        let columns: Vec<Vec<Vec<f64>>> = (0..2).map(|_| (0..4).map(|_| drawn()).collect()).collect();
        let more: Vec<Vec<f64>> = (0..2).map(|_| drawn()).collect();
        let mut grams = Grams::new(1, bands.count(), 2);
        columns.iter().for_each(|own| grams.add(1, &cut, own));
        let weights: Vec<f64> = (0..bands.count()).map(|b| 1.0 + 0.1 * b as f64).collect();
        let border = grams.border([&cut[..], &cut[..]].into_iter(), &columns, &more);
        let found = Screen::new(&grams, &weights, &[0.0, 0.0]).unwrap().beside(&border).unwrap();
        // the same by a whole design: own columns apart
        let weight = |k: usize| weights[bands.of(k as f64)].sqrt();
        let whole = |of: &dyn Fn(usize) -> Vec<f64>| {
            DVector::from_iterator(
                2 * bins,
                (0..2).flat_map(|r| of(r).into_iter().enumerate().map(|(k, v)| v * weight(k)).collect::<Vec<_>>()),
            )
        };
        let own = |run: usize| whole(&|r| if r == run { columns[r][0].clone() } else { vec![0.0; bins] });
        let design = DMatrix::from_columns(&[
            own(0),
            own(1),
            whole(&|r| columns[r][2].clone()),
            whole(&|r| columns[r][3].clone()),
        ]);
        let residual = whole(&|r| columns[r][1].clone());
        let column = whole(&|r| more[r].clone());
        let solve = |b: &DVector<f64>| b - &design * design.clone().svd(true, true).solve(b, 1e-12).unwrap();
        let (left, beside) = (solve(&residual), solve(&column));
        assert!((found.cross - beside.dot(&left)).abs() < 1e-8 * column.norm() * residual.norm(), "{}", found.cross);
        assert!((found.square / beside.norm_squared() - 1.0).abs() < 1e-8 && found.left < 1.0);
    }
}
