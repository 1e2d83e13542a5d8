//! The restricted likelihood of the noise of several outputs (Patterson and Thompson 1971): that of what is left of the residuals when the parameters are free,
//! so that what fitting takes off is not taken for quiet. Correlated outputs are decorrelated first, `L^-1 e` with the Cholesky factor L of their covariance.

use super::information::{Arrow, Blocks, Parts};
use super::noise_candidates::Clock;
use super::noise_candidates::NoiseModel;
use super::sensitivity_rows::SensitivityRows;
use crate::iteration::products::accumulate;
use nalgebra::{Cholesky, DMatrix, DVector};

/// A run among those that are short or uneven.
pub(super) struct ShortRun<'r> {
    pub(super) rows: &'r SensitivityRows,
    /// The place of each of its columns among the chosen unknowns (n).
    pub(super) places: Vec<Option<usize>>,
}

impl ShortRun<'_> {
    /// Adds `factor` times the score `S' R^-1 e` to that of the chosen unknowns (n); `inverse_noise` is that of the fit (q by q).
    pub(super) fn add_score(&self, factor: f64, inverse_noise: &[f64], score: &mut DVector<f64>) {
        let weighted = self.rows.weighted(inverse_noise);
        for (o, residuals) in self.rows.residuals.iter().enumerate() {
            let rows = weighted.of_output(o).chunks_exact(self.rows.width.max(1));
            for (row, residual) in rows.zip(residuals).filter(|(_, e)| !e.is_nan()) {
                let placed = row.iter().zip(&self.places).filter_map(|(s, place)| Some((s, (*place)?)));
                placed.for_each(|(s, place)| score[place] += factor * s * residual);
            }
        }
    }
}

/// Combinations of the outputs whose noises are independent, of deviation 1 where the noise is what the covariance says.
pub(super) struct Decorrelation {
    /// `L^-1` (q by q).
    seen: DMatrix<f64>,
    /// `L' R^-1` (q by q).
    acting: DMatrix<f64>,
}

/// One decorrelated output in one run.
pub(super) struct Decorrelated {
    run: usize,
    /// `L^-1 S` and `L^-1 e`.
    seen: DecorrelatedRows,
    /// `L' R^-1 S`.
    acting: DecorrelatedRows,
}

/// Rows at the samples at which a decorrelated output is compared.
struct DecorrelatedRows {
    /// By clock: time, and number.
    moments: [Vec<f64>; 2],
    /// Sensitivities, and the residual behind them (a row for each sample).
    values: Vec<f64>,
    wide: usize,
}

impl Decorrelated {
    /// Samples at which the decorrelated output is compared.
    pub(super) fn samples(&self) -> usize {
        self.seen.moments[0].len()
    }
}

impl Decorrelation {
    /// `inverse_noise` is that of the fit, `covariance` that of the noise (q by q).
    pub(super) fn new(inverse_noise: &[f64], covariance: &DMatrix<f64>) -> Self {
        let q = covariance.nrows();
        // an output that nothing is compared of has no noise
        let deviations = DMatrix::from_diagonal(&covariance.diagonal().map(|v| v.max(f64::MIN_POSITIVE).sqrt()));
        let factor = Cholesky::new(covariance.clone()).map_or(deviations, |c| c.l());
        let seen = factor.clone().try_inverse().unwrap_or_else(|| DMatrix::identity(q, q));
        Self { seen, acting: factor.transpose() * DMatrix::from_row_slice(q, q, inverse_noise) }
    }

    /// The k-th decorrelated output in all runs.
    pub(super) fn outputs(&self, runs: &[ShortRun<'_>], k: usize) -> Vec<Decorrelated> {
        let of = |(run, m): (usize, &ShortRun<'_>)| {
            let compared = |o: usize, i: usize| !m.rows.residuals[o][i].is_nan();
            let weights = |matrix: &DMatrix<f64>| matrix.row(k).iter().copied().collect::<Vec<f64>>();
            let (seen, acting) = (weights(&self.seen), weights(&self.acting));
            let any = |i: &usize| (0..acting.len()).any(|o| acting[o] != 0.0 && compared(o, *i));
            Decorrelated {
                run,
                seen: DecorrelatedRows::new(m.rows, &seen, (0..m.rows.length).filter(|i| compared(k, *i)).collect()),
                acting: DecorrelatedRows::new(m.rows, &acting, (0..m.rows.length).filter(any).collect()),
            }
        };
        runs.iter().enumerate().map(of).collect()
    }
}

impl DecorrelatedRows {
    /// The outputs with these weights at these samples.
    fn new(rows: &SensitivityRows, weights: &[f64], samples: Vec<usize>) -> Self {
        let (width, wide) = (rows.width, rows.width + 8);
        let mut values = vec![0.0; samples.len() * wide];
        for (i, row) in samples.iter().zip(values.chunks_exact_mut(wide)) {
            for (o, weight) in weights.iter().enumerate() {
                let residual = rows.residuals[o][*i];
                if *weight != 0.0 && !residual.is_nan() {
                    let from = &rows.of_output(o)[i * width..][..width];
                    row.iter_mut().zip(from).for_each(|(to, from)| *to += weight * from);
                    row[width] += weight * residual;
                }
            }
        }
        let time = samples.iter().map(|i| rows.moments[*i]).collect();
        let count = samples.iter().map(|i| *i as f64).collect();
        Self { moments: [time, count], values, wide }
    }

    /// Products of all columns (wide by wide, the upper triangle) after `through` has been through the rows.
    fn squares(&self, model: &NoiseModel, through: impl FnOnce(&[f64], &mut [f64], usize)) -> Vec<f64> {
        let mut values = self.values.clone();
        through(&self.moments[usize::from(model.clock() == Clock::Samples)], &mut values, self.wide);
        let mut sums = vec![0.0; self.wide * self.wide];
        accumulate(&values, self.wide, values.len() / self.wide, self.wide, self.wide, &mut sums);
        sums
    }
}

/// Normal equations of one decorrelated output under one noise model, and `S' R^-1 L C L' R^-1 S`.
pub(super) fn normal_equations(
    parts: &[Decorrelated],
    runs: &[ShortRun<'_>],
    model: &NoiseModel,
    blocks: &Blocks,
) -> (NormalEquations, DMatrix<f64>) {
    let n = blocks.len();
    let (mut matrix, mut vector, mut square, mut logarithm) = (DMatrix::zeros(n, n), DVector::zeros(n), 0.0, 0.0);
    let mut middle = DMatrix::zeros(n, n);
    for part in parts {
        let wide = part.seen.wide;
        let columns = runs[part.run].places.iter().enumerate();
        let places: Vec<(usize, usize)> = columns.filter_map(|(c, p)| p.map(|p| (c, p))).collect();
        let white = part.seen.squares(model, |moments, rows, wide| {
            logarithm += model.whiten(moments, rows, wide);
        });
        let through = part.acting.squares(model, |moments, rows, wide| model.transpose(moments, rows, wide));
        for (c, a) in &places {
            for (d, b) in &places {
                let upper = c.min(d) * wide + c.max(d);
                matrix[(*a, *b)] += white[upper];
                middle[(*a, *b)] += through[upper];
            }
            vector[*a] += white[c * wide + wide - 8];
        }
        square += white[(wide - 8) * wide + wide - 8];
    }
    let matrix = Arrow::of(blocks, &matrix);
    (NormalEquations { matrix, vector: blocks.parts(&vector), square, logarithm }, middle)
}

/// Degrees of freedom below which an output says nothing of its scale.
const LEAST_FREEDOM: f64 = 0.5;
/// Decorrelated of the information that is added so that what is not determined does no harm.
const RIDGE: f64 = 1e-12;

/// Normal equations of one output under one noise model.
#[derive(Debug, Clone)]
pub(super) struct NormalEquations {
    /// `J' C^-1 J`, p by p.
    pub(super) matrix: Arrow,
    /// `J' C^-1 e`, p.
    pub(super) vector: Parts,
    /// `e' C^-1 e`.
    pub(super) square: f64,
    /// Logarithm of the determinant of C.
    pub(super) logarithm: f64,
}

/// Normal equations of all outputs under all noise models.
pub(super) struct Restricted {
    /// For each output its samples.
    pub(super) samples: Vec<f64>,
    /// For each output its normal equations under each noise model.
    pub(super) normals: Vec<Vec<NormalEquations>>,
    /// What else determines the parameters: other runs, priors (p by p).
    pub(super) others: Arrow,
    /// Its score at the estimates (p).
    pub(super) pull: Parts,
}

/// What is likely under one noise model for each output.
pub(super) struct Likelihood {
    /// Logarithm of the restricted likelihood, but for a constant.
    pub(super) logarithm: f64,
    /// The scale of each output's noise, as a variance over the one of the fit.
    pub(super) scales: Vec<f64>,
    /// The degrees of freedom of each scale.
    pub(super) freedom: Vec<f64>,
}

impl Restricted {
    /// The likelihood where the noise of each output is the model of this number; none where the matrices are not finite.
    pub(super) fn likely(&self, models: &[usize]) -> Option<Likelihood> {
        let normals: Vec<&NormalEquations> = self.normals.iter().zip(models).map(|(n, b)| &n[*b]).collect();
        let mut scales = vec![1.0; normals.len()];
        let mut freedom = self.samples.clone();
        let mut logarithm = 0.0;
        // rounds in which the scales of the outputs find each other
        for _ in 0..8 {
            let (mut matrix, mut vector) = (self.others.clone(), self.pull.clone());
            for (n, scale) in normals.iter().zip(&scales) {
                matrix.add_over(*scale, &n.matrix);
                vector.add_over(*scale, &n.vector);
            }
            matrix.raise(RIDGE);
            let factor = matrix.factor()?;
            let (moved, inverse) = (factor.solve(&vector), factor.inverse());
            logarithm = factor.logarithm();
            logarithm += self.others.square(&moved) - 2.0 * moved.dot(&self.pull);
            for (k, n) in normals.iter().enumerate() {
                let left = n.square - 2.0 * moved.dot(&n.vector) + n.matrix.square(&moved);
                logarithm += n.logarithm + self.samples[k] * scales[k].ln() + left / scales[k];
                freedom[k] = (self.samples[k] - inverse.dot(&n.matrix) / scales[k]).max(LEAST_FREEDOM);
                scales[k] = (left / freedom[k]).clamp(scales[k] * 1e-3, scales[k] * 1e3).max(f64::MIN_POSITIVE);
            }
        }
        let likely = Likelihood { logarithm: -0.5 * logarithm, scales, freedom };
        likely.logarithm.is_finite().then_some(likely)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal equations of a matrix of sensitivities in white noise.
    fn normal(j: &DMatrix<f64>, e: &DVector<f64>) -> NormalEquations {
        let blocks = Blocks::one(j.ncols());
        let (matrix, vector) = (Arrow::of(&blocks, &(j.transpose() * j)), blocks.parts(&(j.transpose() * e)));
        NormalEquations { matrix, vector, square: e.dot(e), logarithm: 0.0 }
    }

    #[test]
    fn one_output_is_known_in_closed_form() {
        let j = DMatrix::from_fn(9, 2, |i, k| (i as f64 + 1.0).powi(k as i32));
        let e = DVector::from_fn(9, |i, _| (1.9 * i as f64).cos());
        let of = |scale: f64| {
            let (j, e) = (&j / scale.sqrt(), &e / scale.sqrt());
            NormalEquations { logarithm: 9.0 * scale.ln(), ..normal(&j, &e) }
        };
        let restricted = Restricted {
            samples: vec![9.0],
            normals: vec![vec![of(1.0), of(7.0)]],
            others: Arrow::of(&Blocks::one(2), &DMatrix::zeros(2, 2)),
            pull: Blocks::one(2).parts(&DVector::zeros(2)),
        };
        let left = (&e - &j * (j.transpose() * &j).try_inverse().expect("regular") * j.transpose() * &e).norm_squared();
        let [one, seven] = [0, 1].map(|b| restricted.likely(&[b]).expect("finite"));
        assert!((one.scales[0] / (left / 7.0) - 1.0).abs() < 1e-9 && (one.freedom[0] - 7.0).abs() < 1e-9);
        // in units seven times as large the scale is a seventh, and nothing else is said
        assert!((seven.scales[0] * 7.0 / one.scales[0] - 1.0).abs() < 1e-9);
        assert!((seven.logarithm - one.logarithm).abs() < 1e-8, "{} {}", seven.logarithm, one.logarithm);
    }

    #[test]
    fn two_outputs_find_their_scales() {
        let j = DMatrix::from_fn(400, 1, |i, _| (0.3 * i as f64).sin());
        // quiet and loud, and a parameter that both are wrong about by 0.3
        let noise =
            |seed: f64| DVector::from_fn(400, |i, _| 2.0_f64.sqrt() * (seed * (i * i) as f64).cos() + 0.3 * j[i]);
        let (quiet, loud) = (0.1 * noise(1.1), 3.0 * noise(2.3));
        let restricted = Restricted {
            samples: vec![400.0, 400.0],
            normals: vec![vec![normal(&j, &quiet)], vec![normal(&j, &loud)]],
            others: Arrow::of(&Blocks::one(1), &DMatrix::zeros(1, 1)),
            pull: Blocks::one(1).parts(&DVector::zeros(1)),
        };
        let likely = restricted.likely(&[0, 0]).expect("finite");
        assert!((likely.scales[0] / 0.01 - 1.0).abs() < 0.2 && (likely.scales[1] / 9.0 - 1.0).abs() < 0.2);
        assert!(likely.freedom[0] < 399.1 && likely.freedom[1] > 399.9, "{:?}", likely.freedom);
    }

    /// Three runs with two unknowns of their own each: what blocks give is what the whole matrix gives.
    #[test]
    fn unknowns_of_single_runs_are_eliminated() {
        let (n, shared) = (8, 2);
        let rows = |run: usize, seed: f64| -> (DMatrix<f64>, DVector<f64>) {
            let own = shared + 2 * run..shared + 2 * run + 2;
            let entry = |i: usize, k: usize| {
                if k < shared || own.contains(&k) { (seed * ((i + 1) * (k + 2)) as f64).sin() } else { 0.0 }
            };
            (DMatrix::from_fn(12, n, entry), DVector::from_fn(12, |i, _| (seed + (i * i) as f64).cos()))
        };
        let with = |blocks: &Blocks| -> Restricted {
            let output = |seed: f64| {
                let (mut matrix, mut vector, mut square) = (DMatrix::zeros(n, n), DVector::zeros(n), 0.0);
                for run in 0..3 {
                    let (j, e) = rows(run, seed + run as f64);
                    matrix += j.transpose() * &j;
                    vector += j.transpose() * &e;
                    square += e.dot(&e);
                }
                let (matrix, vector) = (Arrow::of(blocks, &matrix), blocks.parts(&vector));
                vec![NormalEquations { matrix, vector, square, logarithm: 0.3 * seed }]
            };
            let prior = DMatrix::from_fn(n, n, |i, k| if i == k { 0.5 + i as f64 } else { 0.0 });
            Restricted {
                samples: vec![36.0, 36.0],
                normals: vec![output(1.7), output(0.6)],
                others: Arrow::of(blocks, &prior),
                pull: blocks.parts(&DVector::from_fn(n, |i, _| 0.1 * i as f64)),
            }
        };
        let places = |run: usize| -> Vec<usize> { (0..shared).chain(shared + 2 * run..shared + 2 * run + 2).collect() };
        let blocks = Blocks::new(&[places(0), places(1), places(2)], &DMatrix::zeros(n, n));
        let (whole, apart) =
            (with(&Blocks::one(n)).likely(&[0, 0]).expect("finite"), with(&blocks).likely(&[0, 0]).expect("finite"));
        assert!((whole.logarithm - apart.logarithm).abs() < 1e-9 * whole.logarithm.abs());
        for k in 0..2 {
            assert!((whole.scales[k] / apart.scales[k] - 1.0).abs() < 1e-10, "{:?} {:?}", whole.scales, apart.scales);
            assert!((whole.freedom[k] / apart.freedom[k] - 1.0).abs() < 1e-10);
        }
        // what couples the unknowns of two runs makes them shared
        let coupled = DMatrix::from_fn(n, n, |i, k| if (i, k) == (2, 4) || (i, k) == (4, 2) { 1.0 } else { 0.0 });
        assert_eq!(Blocks::new(&[places(0), places(1), places(2)], &coupled), Blocks::one(n));
    }
}
