//! Combinations of the outputs of short runs whose noises are independent, and what they say of the parameters under a belief about their colour.

use super::coloured_rows::ColouredRows;
use super::forgetful::{Clock, Forgetful};
use super::restricted::Normal;
use crate::estimate::iteration::products::accumulate;
use nalgebra::{Cholesky, DMatrix, DVector};

/// A run among those that are short or uneven.
pub(super) struct Member<'r> {
    pub(super) rows: &'r ColouredRows,
    /// The place of each of its columns among the chosen unknowns (n).
    pub(super) places: Vec<Option<usize>>,
}

/// Combinations of the outputs whose noises are independent, of deviation 1 where the noise is what the covariance says.
pub(super) struct Combinations {
    /// `L^-1` (q by q).
    seen: DMatrix<f64>,
    /// `L' R^-1` (q by q).
    acting: DMatrix<f64>,
}

/// What one combination says in one run.
pub(super) struct Part {
    member: usize,
    /// `L^-1 S` and `L^-1 e`.
    seen: Rows,
    /// `L' R^-1 S`.
    acting: Rows,
}

/// Rows at the samples at which a combination is compared.
struct Rows {
    /// By clock: time, and number.
    moments: [Vec<f64>; 2],
    /// Sensitivities, and the residual behind them (a row for each sample).
    values: Vec<f64>,
    wide: usize,
}

impl Part {
    /// Samples at which the combination is compared.
    pub(super) fn samples(&self) -> usize {
        self.seen.moments[0].len()
    }
}

impl Combinations {
    /// `inverse_noise` is that of the fit, `covariance` that of the noise (q by q).
    pub(super) fn new(inverse_noise: &[f64], covariance: &DMatrix<f64>) -> Self {
        let q = covariance.nrows();
        // an output that nothing is compared of has no noise
        let deviations = DMatrix::from_diagonal(&covariance.diagonal().map(|v| v.max(f64::MIN_POSITIVE).sqrt()));
        let factor = Cholesky::new(covariance.clone()).map_or(deviations, |c| c.l());
        let seen = factor.clone().try_inverse().unwrap_or_else(|| DMatrix::identity(q, q));
        Self { seen, acting: factor.transpose() * DMatrix::from_row_slice(q, q, inverse_noise) }
    }

    /// The k-th combination in all members.
    pub(super) fn parts(&self, members: &[Member<'_>], k: usize) -> Vec<Part> {
        let of = |(member, m): (usize, &Member<'_>)| {
            let compared = |o: usize, i: usize| !m.rows.residuals[o][i].is_nan();
            let weights = |matrix: &DMatrix<f64>| matrix.row(k).iter().copied().collect::<Vec<f64>>();
            let (seen, acting) = (weights(&self.seen), weights(&self.acting));
            let any = |i: &usize| (0..acting.len()).any(|o| acting[o] != 0.0 && compared(o, *i));
            Part {
                member,
                seen: Rows::new(m.rows, &seen, (0..m.rows.length).filter(|i| compared(k, *i)).collect()),
                acting: Rows::new(m.rows, &acting, (0..m.rows.length).filter(any).collect()),
            }
        };
        members.iter().enumerate().map(of).collect()
    }
}

impl Rows {
    /// The outputs with these weights at these samples.
    fn new(rows: &ColouredRows, weights: &[f64], samples: Vec<usize>) -> Self {
        let (width, wide) = (rows.width, rows.width + 8);
        let mut values = vec![0.0; samples.len() * wide];
        for (i, row) in samples.iter().zip(values.chunks_exact_mut(wide)) {
            for (o, weight) in weights.iter().enumerate() {
                let residual = rows.residuals[o][*i];
                if *weight != 0.0 && !residual.is_nan() {
                    let from = &rows.rows[o][i * width..][..width];
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
    fn squares(&self, belief: &Forgetful, through: impl FnOnce(&[f64], &mut [f64], usize)) -> Vec<f64> {
        let mut values = self.values.clone();
        through(&self.moments[usize::from(belief.clock == Clock::Count)], &mut values, self.wide);
        let mut sums = vec![0.0; self.wide * self.wide];
        accumulate(&values, self.wide, values.len() / self.wide, self.wide, self.wide, &mut sums);
        sums
    }
}

/// Normal equations of one combination under one belief, and `S' R^-1 L C L' R^-1 S`.
pub(super) fn normal(parts: &[Part], members: &[Member<'_>], belief: &Forgetful, n: usize) -> (Normal, DMatrix<f64>) {
    let mut normal = Normal { matrix: DMatrix::zeros(n, n), vector: DVector::zeros(n), square: 0.0, logarithm: 0.0 };
    let mut middle = DMatrix::zeros(n, n);
    for part in parts {
        let wide = part.seen.wide;
        let columns = members[part.member].places.iter().enumerate();
        let places: Vec<(usize, usize)> = columns.filter_map(|(c, p)| p.map(|p| (c, p))).collect();
        let white = part.seen.squares(belief, |moments, rows, wide| {
            normal.logarithm += belief.whiten(moments, rows, wide);
        });
        let through = part.acting.squares(belief, |moments, rows, wide| belief.transpose(moments, rows, wide));
        for (c, a) in &places {
            for (d, b) in &places {
                let upper = c.min(d) * wide + c.max(d);
                normal.matrix[(*a, *b)] += white[upper];
                middle[(*a, *b)] += through[upper];
            }
            normal.vector[*a] += white[c * wide + wide - 8];
        }
        normal.square += white[(wide - 8) * wide + wide - 8];
    }
    (normal, middle)
}
