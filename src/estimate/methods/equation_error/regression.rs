//! Equations that share parameters, as one regression whose rows are weighted by the residual of their equation; its standard errors for coloured residuals,
//! `D [sum_ij x_i Rvv(i-j) x_j'] D`, D = (X'X)^-1 (Morelli and Klein, "Accuracy of aerodynamic model parameters estimated from flight test data", 1997).

use super::error::RegressionError;
use super::options::{Detrend, Domain, RegressionOptions};
use super::principal_components::{Chosen, Component, Decomposition, System, choose};
use super::regressors::Rows;
use crate::residuals::autocovariance::Lagged;
use nalgebra::{DMatrix, DVector};

/// A parameter of a regression, or behind those of the model the bias of an equation: shared, or that of one run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Unknown {
    pub(super) param: u32,
    pub(super) run: Option<usize>,
}

/// One equation in one run.
#[derive(Debug, Clone)]
pub(super) struct Block {
    /// Position among the equations.
    pub(super) equation: usize,
    /// Position among the runs.
    pub(super) run: usize,
    pub(super) rows: Rows,
    /// What each column belongs to.
    pub(super) unknowns: Vec<Unknown>,
}

/// Equations that share parameters.
pub(super) struct Group<'a> {
    pub(super) blocks: Vec<&'a Block>,
    /// Parameters with a column other than zero, rising.
    pub(super) unknowns: Vec<Unknown>,
    /// Parameters whose columns vanish in these data.
    pub(super) unseen: Vec<Unknown>,
    /// How messages and tables call the equations.
    pub(super) name: String,
}

/// What a group gives.
pub(super) struct Solved {
    pub(super) components: Vec<Component>,
    pub(super) chosen: usize,
    pub(super) reason: Chosen,
    pub(super) coloured: Option<Vec<f64>>,
    /// Residual of each block, not weighted.
    pub(super) residuals: Vec<Vec<f64>>,
    pub(super) significance: Vec<f64>,
    pub(super) rows: usize,
}

/// Rounds in which the weights follow the residuals.
const ROUNDS: usize = 4;

/// Residuals below this part of the rate are rounding.
const EXACT: f64 = 1e-12;

impl<'a> Group<'a> {
    /// Collects the parameters of some blocks.
    pub(super) fn new(blocks: Vec<&'a Block>, name: String) -> Self {
        let mut unknowns: Vec<Unknown> = blocks.iter().flat_map(|b| b.unknowns.iter().copied()).collect();
        unknowns.sort();
        unknowns.dedup();
        let seen = |u: &Unknown| {
            let own = |b: &&Block| b.unknowns.iter().position(|k| k == u).map(|k| largest(&b.rows.columns[k]));
            blocks.iter().filter_map(own).fold(0.0, f64::max) > 0.0
        };
        let (unknowns, unseen) = unknowns.into_iter().partition(seen);
        Self { blocks, unknowns, unseen, name }
    }

    /// Solves the group with all its principal components.
    pub(super) fn solve(&self, names: &[String], options: &RegressionOptions) -> Result<Solved, RegressionError> {
        let (rows, p) = (self.blocks.iter().map(|b| b.rows.left.len()).sum::<usize>(), self.unknowns.len());
        let taken = match options.domain {
            Domain::Time => self.blocks.len() * options.detrend.taken(),
            Domain::Frequency(_) => 0,
        };
        if rows == 0 {
            return Err(RegressionError::NoRows { equations: self.name.clone() });
        }
        if rows <= p + taken {
            return Err(RegressionError::TooFewRows { equations: self.name.clone(), rows, parameters: p });
        }
        let not_finite = || RegressionError::NotFinite { equations: self.name.clone() };
        let mut weights = self.first_weights();
        let equations = weights.iter().flatten().count();
        let mut found = self.decomposed(&weights, taken, options).ok_or_else(not_finite)?;
        for _ in 0..if equations > 1 { ROUNDS } else { 0 } {
            let solution = found.component(found.rank());
            self.reweigh(&mut weights, &self.residuals(&solution.values));
            found = self.decomposed(&weights, taken, options).ok_or_else(not_finite)?;
        }
        let (count, reason) = choose(&found, names, options.components);
        let components: Vec<Component> = (1..=found.rank()).map(|k| found.component(k)).collect();
        let values = &components[count - 1].values;
        let residuals = self.residuals(values);
        let coloured = (options.domain == Domain::Time).then(|| {
            let weighted: Vec<Vec<f64>> = self
                .blocks
                .iter()
                .zip(&residuals)
                .map(|(b, r)| r.iter().map(|v| v * weight(&weights, b)).collect())
                .collect();
            let stretches: Vec<Stretch<'_>> = self
                .blocks
                .iter()
                .zip(&weighted)
                .map(|(b, residual)| Stretch { columns: self.matrix(&[b], &weights), residual })
                .collect();
            let correction = rows as f64 / (rows - count - taken) as f64;
            coloured_errors(&stretches, &found.inverse(count), correction)
        });
        let significance = self.significance(values, &weights);
        Ok(Solved { chosen: count, reason, coloured, residuals, significance, rows, components })
    }

    /// One weight for each equation: one over the size of its left side.
    fn first_weights(&self) -> Vec<Option<f64>> {
        let mut weights = vec![None; self.blocks.iter().map(|b| b.equation + 1).max().unwrap_or(0)];
        let sizes = self.sizes(|b, _| &b.rows.left, weights.len());
        for (weight, size) in weights.iter_mut().zip(sizes) {
            *weight = size.map(|size| if size > 0.0 { 1.0 / size } else { 1.0 });
        }
        weights
    }

    fn reweigh(&self, weights: &mut [Option<f64>], residuals: &[Vec<f64>]) {
        let left = self.sizes(|b, _| &b.rows.measured, weights.len());
        let sizes = self.sizes(|_, k| &residuals[k], weights.len());
        for ((weight, size), left) in weights.iter_mut().zip(sizes).zip(left) {
            *weight = size.zip(left).map(|(size, left)| 1.0 / size.max(EXACT * left).max(f64::MIN_POSITIVE));
        }
    }

    /// Root mean square of something about each equation.
    fn sizes<'s>(&'s self, of: impl Fn(&'s Block, usize) -> &'s Vec<f64>, equations: usize) -> Vec<Option<f64>> {
        let mut sums = vec![(0.0, 0); equations];
        for (k, block) in self.blocks.iter().enumerate() {
            let values = of(block, k);
            let (sum, count) = &mut sums[block.equation];
            *sum += values.iter().map(|v| v * v).sum::<f64>();
            *count += values.len();
        }
        sums.into_iter().map(|(sum, count): (f64, usize)| (count > 0).then(|| (sum / count as f64).sqrt())).collect()
    }

    fn decomposed(&self, weights: &[Option<f64>], taken: usize, options: &RegressionOptions) -> Option<Decomposition> {
        let columns = self.matrix(&self.blocks, weights);
        let left = self.blocks.iter().flat_map(|b| b.rows.left.iter().map(|v| v * weight(weights, b)));
        let left = DVector::from_iterator(columns.nrows(), left);
        let time = options.domain == Domain::Time;
        let independent = self.blocks.iter().map(|b| b.rows.independent).fold(1.0, f64::min);
        let constant = time && (options.detrend != Detrend::None || self.has_constant());
        let total = self.blocks.iter().map(|b| spread(&b.rows.left, time) * weight(weights, b).powi(2)).sum();
        let repeated = 1.0 / independent;
        Decomposition::new(&System { columns: &columns, left: &left, total, taken, repeated, constant })
    }

    fn has_constant(&self) -> bool {
        let constant = |c: &Vec<f64>| c.first().is_some_and(|v| *v != 0.0 && c.iter().all(|w| w == v));
        self.blocks.iter().any(|b| b.rows.columns.iter().any(constant))
    }

    /// Weighted rows of some blocks by all parameters.
    fn matrix(&self, blocks: &[&Block], weights: &[Option<f64>]) -> DMatrix<f64> {
        let rows = blocks.iter().map(|b| b.rows.left.len()).sum();
        let mut matrix = DMatrix::zeros(rows, self.unknowns.len());
        let mut first = 0;
        for block in blocks {
            let weight = weight(weights, block);
            for (unknown, column) in block.unknowns.iter().zip(&block.rows.columns) {
                let Ok(j) = self.unknowns.binary_search(unknown) else { continue };
                column.iter().enumerate().for_each(|(i, v)| matrix[(first + i, j)] = v * weight);
            }
            first += block.rows.left.len();
        }
        matrix
    }

    fn residuals(&self, values: &[f64]) -> Vec<Vec<f64>> {
        let one = |block: &&Block| {
            let mut residual = block.rows.left.clone();
            for (unknown, column) in block.unknowns.iter().zip(&block.rows.columns) {
                let Ok(j) = self.unknowns.binary_search(unknown) else { continue };
                residual.iter_mut().zip(column).for_each(|(r, x)| *r -= values[j] * x);
            }
            residual
        };
        self.blocks.iter().map(one).collect()
    }

    /// `|theta_j| int |X_j| / int |xdot|` of every parameter.
    fn significance(&self, values: &[f64], weights: &[Option<f64>]) -> Vec<f64> {
        let size = |v: &[f64]| v.iter().map(|v| v.abs()).sum::<f64>();
        let one = |(unknown, value): (&Unknown, &f64)| {
            let (mut part, mut whole) = (0.0, 0.0);
            for block in &self.blocks {
                let Some(k) = block.unknowns.iter().position(|u| u == unknown) else { continue };
                part += size(&block.rows.columns[k]) * weight(weights, block);
                whole += size(&block.rows.measured) * weight(weights, block);
            }
            value.abs() * part / whole
        };
        self.unknowns.iter().zip(values).map(one).collect()
    }
}

fn weight(weights: &[Option<f64>], block: &Block) -> f64 {
    weights[block.equation].unwrap_or(1.0)
}

fn largest(values: &[f64]) -> f64 {
    values.iter().map(|v| v.abs()).fold(0.0, f64::max)
}

/// Sum of squares, about the mean in the time domain.
pub(super) fn spread(values: &[f64], time: bool) -> f64 {
    let mean = if time { values.iter().sum::<f64>() / values.len().max(1) as f64 } else { 0.0 };
    values.iter().map(|v| (v - mean).powi(2)).sum()
}

/// Longest lag of the residuals' autocovariance, in parts of the record, and at all.
const PART: usize = 5;
const MOST_LAG: usize = 2000;

/// Rows of one equation in one run: neighbours in time.
pub(super) struct Stretch<'a> {
    /// Rows by parameters, weighted.
    pub(super) columns: DMatrix<f64>,
    /// Residuals, weighted.
    pub(super) residual: &'a [f64],
}

/// Standard errors (p) from `inverse`, (X'X)^-1. Autocovariances are tapered linearly up to the longest lag, so that no variance is negative.
pub(super) fn coloured_errors(stretches: &[Stretch<'_>], inverse: &DMatrix<f64>, correction: f64) -> Vec<f64> {
    let p = inverse.nrows();
    let mut middle = DMatrix::zeros(p, p);
    for stretch in stretches {
        let n = stretch.residual.len();
        let most = (n / PART).clamp(1, MOST_LAG);
        let lagged = Lagged::of(stretch.residual, most);
        let covariance: Vec<f64> = lagged
            .sums
            .iter()
            .enumerate()
            .map(|(k, sum)| sum / n as f64 * (1.0 - k as f64 / (most + 1) as f64))
            .collect();
        middle += quadratic_form(&stretch.columns, &covariance);
    }
    let variance = inverse * middle * inverse * correction;
    (0..p).map(|j| variance[(j, j)].max(0.0).sqrt()).collect()
}

/// `sum_ij x_i r(i - j) x_j'`.
fn quadratic_form(columns: &DMatrix<f64>, covariance: &[f64]) -> DMatrix<f64> {
    let (n, p) = columns.shape();
    let mut filtered = DMatrix::zeros(n, p);
    for j in 0..p {
        let (source, mut to) = (columns.column(j), filtered.column_mut(j));
        let source = source.as_slice();
        for (k, r) in covariance.iter().enumerate().take(n) {
            for i in 0..n - k {
                to[i] += r * source[i + k];
                if k > 0 {
                    to[i + k] += r * source[i];
                }
            }
        }
    }
    columns.transpose() * filtered
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_residuals_change_nothing_and_slow_ones_weigh_more() {
        let mut normal = fdm_numeric::random::Normal(11);
        let n = 2000;
        let columns = DMatrix::from_fn(n, 1, |i, _| (0.01 * i as f64).sin() + 2.0);
        let inverse = DMatrix::from_element(1, 1, 1.0 / columns.norm_squared());
        let white: Vec<f64> = (0..n).map(|_| normal.next()).collect();
        let mut slow = vec![0.0; n];
        for i in 1..n {
            slow[i] = 0.9 * slow[i - 1] + (1.0f64 - 0.81).sqrt() * normal.next();
        }
        let error = |residual: &[f64]| {
            coloured_errors(&[Stretch { columns: columns.clone(), residual }], &inverse, 1.0)[0]
                / inverse[(0, 0)].sqrt()
        };
        // an AR(1) process of unit variance has sqrt((1 + 0.9)/(1 - 0.9)) = 4.36 times the error of a mean
        let (a, b) = (error(&white), error(&slow));
        assert!((a - 1.0).abs() < 0.35 && (b / 4.36 - 1.0).abs() < 0.35, "{a} {b}");
    }
}
