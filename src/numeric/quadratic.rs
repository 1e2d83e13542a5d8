//! The cost near one point as a quadratic of the step, in unknowns scaled to unit columns of the Jacobian; and its inverse.
//!
//! What Gauss-Newton leaves out of the second derivative of the cost, learnt from how the gradient changes.
//!
//! Where residuals are large and the response is curved, Gauss-Newton converges linearly, however near it is. The
//! missing part S of the Hessian is then updated from step to step (Dennis, Gay and Welsch 1981), and the steps
//! with it converge faster than linearly.

use crate::dense::cholesky::norm;
use crate::dense::{Cholesky, multiply_to_symmetric, panels};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::sync::OnceLock;

/// Singular values below this share of the largest count as zero: what they belong to is not determined.
pub const RANK: f64 = 1e-9;

/// Eigenvalues of products below this share of the largest count as zero: their rounding allows no less.
const RANK_OF_PRODUCTS: f64 = 1e-12;

/// Condition of the Jacobian below which a factor of products has lost at most half of its digits.
const WELL: f64 = 1e4;

/// Minus `rhs's + s'hessian s / 2` is the change of the cost that a scaled step s promises.
#[derive(Debug, Clone, Default)]
pub struct Quadratic {
    /// Number of unknowns P.
    size: usize,
    /// Norm of each whitened column of the Jacobian; 0 for an unknown without influence here.
    pub scale: Vec<f64>,
    /// J'J of scaled, whitened columns, P by P.
    hessian: Vec<f64>,
    /// J'v of scaled, whitened columns (P).
    pub rhs: Vec<f64>,
    /// The triangle of [J v] with scaled columns, (P + 1) by `width`; empty when only products are known.
    triangle: Vec<f64>,
    width: usize,
    /// The scaled part of the second derivative that J'J misses, P by P; empty when it counts as zero.
    curvature: Vec<f64>,
    /// The chosen unknowns whose products were inverted last (empty: none), and their factor; the undamped step asks for
    /// the same.
    factored: Vec<usize>,
    factor: Cholesky,
    /// The decomposition that was asked for first since the triangle was ended: every damping asks for the same.
    decomposition: OnceLock<Decomposition>,
    /// Products of chosen unknowns.
    chosen: Vec<f64>,
}

/// U, singular values (falling) and V' of chosen columns of the triangle.
#[derive(Debug, Clone)]
struct Decomposition {
    chosen: Vec<usize>,
    u: DMatrix<f64>,
    values: Vec<f64>,
    v: DMatrix<f64>,
}

/// The inverse of the scaled information matrix on chosen unknowns.
#[derive(Debug, Clone, Default)]
pub struct Inverse {
    /// The chosen unknowns, which rise.
    pub chosen: Vec<usize>,
    /// The (pseudo-)inverse, chosen by chosen.
    pub values: Vec<f64>,
    /// Condition number of the scaled Jacobian (an estimate when it comes from products).
    pub condition: f64,
    /// Orthonormal basis of what is not determined, as combinations of the chosen unknowns.
    pub null: Vec<Vec<f64>>,
    /// What is determined, each direction over its singular value (rank by chosen): the products of its columns are [`Self::values`]. Empty where products
    /// were inverted.
    pub along: Vec<f64>,
}

impl Inverse {
    /// Covariance of two unknowns in their units, by the `scale` of all unknowns; 0 of one that was not chosen.
    pub fn covariance(&self, scale: &[f64], (i, j): (usize, usize)) -> f64 {
        match (self.chosen.binary_search(&i), self.chosen.binary_search(&j)) {
            (Ok(a), Ok(b)) => self.values[a * self.chosen.len() + b] / (scale[i] * scale[j]),
            _ => 0.0,
        }
    }

    /// Roots of the diagonal, and the inverse of the information scaled by them on the unknowns inside their bounds.
    pub fn of_products(information: &[f64], inside: &[bool]) -> (Vec<f64>, Self) {
        let size = inside.len();
        let scale: Vec<f64> = (0..size).map(|j| information[j * size + j].max(0.0).sqrt()).collect();
        let chosen: Vec<usize> = (0..size).filter(|j| inside[*j] && scale[*j] > 0.0).collect();
        let n = chosen.len();
        if n == 0 {
            return (scale, Self { chosen, condition: f64::INFINITY, ..Self::default() });
        }
        let entry = |a: usize, b: usize| {
            let (i, j) = (chosen[a], chosen[b]);
            information[i * size + j] / (scale[i] * scale[j])
        };
        if let Some(inverse) = Self::of_definite(&chosen, entry) {
            return (scale, inverse);
        }
        let eigen = DMatrix::from_fn(n, n, entry).symmetric_eigen();
        let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
        let (mut values, mut null, mut least) = (vec![0.0; n * n], Vec::new(), largest);
        for (k, value) in eigen.eigenvalues.iter().enumerate() {
            let vector = eigen.eigenvectors.column(k);
            if *value <= RANK_OF_PRODUCTS * largest {
                null.push(vector.iter().copied().collect());
                continue;
            }
            least = least.min(*value);
            for (at, v) in values.iter_mut().enumerate() {
                *v += vector[at / n] * vector[at % n] / value;
            }
        }
        let condition = if least > 0.0 { (largest / least).sqrt() } else { f64::INFINITY };
        (scale, Self { chosen, values, condition, null, along: Vec::new() })
    }

    /// By a factor, where many unknowns are all determined well: nothing is left to be decided by eigenvalues.
    fn of_definite(chosen: &[usize], entry: impl Fn(usize, usize) -> f64) -> Option<Self> {
        let n = chosen.len();
        // unknowns from which eigenvalues are too slow where a factor does
        if n < 64 {
            return None;
        }
        let matrix: Vec<f64> = (0..n * n).map(|k| entry(k / n, k % n)).collect();
        let (mut values, size) = (Vec::new(), norm(&matrix, n));
        Cholesky::new(matrix, n)?.invert(&mut values);
        let condition = (size * norm(&values, n)).sqrt();
        (condition < WELL).then(|| Self { chosen: chosen.to_vec(), values, condition, ..Self::default() })
    }
}

impl Quadratic {
    /// Begins to gather what belongs to `size` unknowns; [`Self::end`] ends it.
    pub fn begin(&mut self, size: usize) {
        self.size = size;
        self.width = self.size + 1;
        self.hessian.clear();
        self.hessian.resize(self.size * self.size, 0.0);
        self.rhs.clear();
        self.rhs.resize(self.size, 0.0);
        self.triangle.clear();
        self.curvature.clear();
        self.factored.clear();
        self.decomposition.take();
    }

    /// J'J (P by P, its upper triangle) and J'v (P), to be added to between [`Self::begin`] and [`Self::end`].
    pub fn products(&mut self) -> (&mut [f64], &mut [f64]) {
        (&mut self.hessian, &mut self.rhs)
    }

    /// Adds whitened rows [J v] of [`Self::width`] numbers, which are overwritten; products must not be added beside them.
    pub fn add_rows(&mut self, rows: &mut [f64], work: &mut Vec<f64>) {
        self.triangle.resize((self.size + 1) * self.width, 0.0);
        panels::reduce(&mut self.triangle, self.size + 1, rows, self.width, work);
    }

    /// Adds one row [J v] of which only these entries (unknowns that rise) are other than zero: a prior.
    pub fn add_row_of(
        &mut self,
        entries: impl Iterator<Item = (usize, f64)> + Clone,
        residual: f64,
        rows: &mut Vec<f64>,
        work: &mut Vec<f64>,
    ) {
        if self.triangle.is_empty() {
            for (k, (unknown, entry)) in entries.clone().enumerate() {
                for (other, factor) in entries.clone().skip(k) {
                    self.hessian[unknown * self.size + other] += entry * factor;
                }
                self.rhs[unknown] += entry * residual;
            }
        } else {
            rows.clear();
            rows.resize(self.width, 0.0);
            entries.for_each(|(unknown, entry)| rows[unknown] = entry);
            rows[self.size] = residual;
            panels::reduce(&mut self.triangle, self.size + 1, rows, self.width, work);
        }
    }

    /// Multiplies the columns of J so far by `slopes` (P): unknowns of which these are functions take their place.
    pub fn stretch(&mut self, slopes: &[f64]) {
        for (row, slope) in self.hessian.chunks_mut(self.size).zip(slopes) {
            row.iter_mut().zip(slopes).for_each(|(value, other)| *value *= slope * other);
        }
        self.rhs.iter_mut().zip(slopes).for_each(|(value, slope)| *value *= slope);
        for row in self.triangle.chunks_mut(self.width) {
            row.iter_mut().zip(slopes).for_each(|(value, slope)| *value *= slope);
        }
    }

    /// Length of a row [J v].
    pub fn width(&self) -> usize {
        self.width
    }

    /// Ends what was begun: scales the columns.
    pub fn end(&mut self) {
        if !self.triangle.is_empty() {
            self.multiply_triangle();
        }
        self.rescale();
    }

    /// From an information matrix (P by P) and minus the gradient of the cost (P).
    pub fn set(&mut self, information: &[f64], descent: &[f64]) {
        self.begin(descent.len());
        self.hessian.copy_from_slice(information);
        self.rhs.copy_from_slice(descent);
        self.end();
    }

    fn multiply_triangle(&mut self) {
        for k in 0..self.size {
            let row = &self.triangle[k * self.width..(k + 1) * self.width];
            for i in k..self.size {
                for j in i..self.size {
                    self.hessian[i * self.size + j] += row[i] * row[j];
                }
                self.rhs[i] += row[i] * row[self.size];
            }
        }
    }

    /// Divides by the norms of the columns and completes the lower triangle.
    fn rescale(&mut self) {
        let n = self.size;
        self.decomposition.take();
        self.scale.clear();
        self.scale.extend((0..n).map(|j| self.hessian[j * n + j].max(0.0).sqrt()));
        let inverse = |s: f64| if s > 0.0 { 1.0 / s } else { 0.0 };
        for i in 0..n {
            let row = inverse(self.scale[i]);
            self.rhs[i] *= row;
            for j in i..n {
                let value = self.hessian[i * n + j] * row * inverse(self.scale[j]);
                self.hessian[i * n + j] = value;
                self.hessian[j * n + i] = value;
            }
        }
        for row in self.triangle.chunks_mut(self.width) {
            row.iter_mut().zip(&self.scale).for_each(|(v, s)| *v *= inverse(*s));
        }
    }

    /// Whether it was gathered from triangles.
    pub fn is_precise(&self) -> bool {
        !self.triangle.is_empty()
    }

    /// Whether all numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.hessian.iter().chain(&self.rhs).chain(&self.scale).all(|v| v.is_finite())
    }

    /// J'J times a vector, both in the units of the parameters.
    pub fn times(&self, vector: &[f64]) -> Vec<f64> {
        let scaled: Vec<f64> = vector.iter().zip(&self.scale).map(|(v, s)| v * s).collect();
        let row = |row: &[f64]| row.iter().zip(&scaled).map(|(h, v)| h * v).sum::<f64>();
        self.hessian.chunks(self.size.max(1)).zip(&self.scale).map(|(h, s)| row(h) * s).collect()
    }

    /// J'J times a vector, both scaled.
    pub fn times_scaled(&self, vector: &[f64]) -> Vec<f64> {
        let row = |row: &[f64]| row.iter().zip(vector).map(|(h, v)| h * v).sum::<f64>();
        self.hessian.chunks(self.size.max(1)).map(row).collect()
    }

    /// Minus the derivative of the damped quadratic at a step: where the cost falls.
    pub fn slope(&self, damping: f64, step: &[f64]) -> Vec<f64> {
        let taken = self.times_scaled(step);
        let bent = self.bends(damping);
        let row = |j: usize| self.curvature[j * self.size..(j + 1) * self.size].iter();
        let turned = |j: usize| if bent { row(j).zip(step).map(|(c, s)| c * s).sum() } else { 0.0 };
        (0..self.size).map(|j| self.rhs[j] - taken[j] - turned(j) - damping * step[j]).collect()
    }

    /// The quadratic of the other unknowns when `following` ones always go to their best values: what their columns span is
    /// taken out of all others. Needs the triangle.
    pub fn without(&self, following: &[usize]) -> Self {
        let Decomposition { u, values, .. } = &*self.decompose(following);
        let least = RANK * values.first().copied().unwrap_or(0.0);
        let rank = values.iter().take_while(|s| **s > least).count();
        let mut rows = self.triangle[..self.triangle.len().min(self.size * self.width)].to_vec();
        // twice is enough for columns that the others explain almost wholly
        for k in [0..rank, 0..rank].into_iter().flatten() {
            for j in 0..self.width {
                let along: f64 = (0..self.size).map(|i| u[(i, k)] * rows[i * self.width + j]).sum();
                (0..self.size).for_each(|i| rows[i * self.width + j] -= along * u[(i, k)]);
            }
        }
        for row in rows.chunks_mut(self.width) {
            following.iter().for_each(|j| row[*j] = 0.0);
        }
        let (size, width) = (self.size, self.width);
        let mut rest = Self { size, width, ..Self::default() };
        rest.triangle.resize((size + 1) * width, 0.0);
        panels::reduce(&mut rest.triangle, size + 1, &mut rows, width, &mut Vec::new());
        rest.hessian.resize(size * size, 0.0);
        rest.rhs.resize(size, 0.0);
        rest.multiply_triangle();
        rest.rescale();
        rest.scale.iter_mut().zip(&self.scale).for_each(|(rest, all)| *rest *= all);
        rest
    }

    /// Adds what J'J misses of the second derivative, in the units of the parameters; undamped steps see it.
    pub fn curve(&mut self, matrix: &[f64]) {
        let n = self.size;
        let inverse = |s: f64| if s > 0.0 { 1.0 / s } else { 0.0 };
        self.curvature.clear();
        self.curvature.extend(
            matrix.iter().enumerate().map(|(k, v)| v * inverse(self.scale[k / n]) * inverse(self.scale[k % n])),
        );
    }

    /// Half of s'S s for a scaled step.
    fn bent(&self, step: &[f64]) -> f64 {
        let moved = |row: &[f64]| row.iter().zip(step).map(|(h, s)| h * s).sum::<f64>();
        self.curvature.chunks(self.size.max(1)).zip(step).map(|(row, s)| 0.5 * s * moved(row)).sum()
    }

    /// How much the cost falls by a scaled step, if the model were quadratic.
    pub fn reduction(&self, step: &[f64]) -> f64 {
        let moved = |row: &[f64]| row.iter().zip(step).map(|(h, s)| h * s).sum::<f64>();
        if self.triangle.is_empty() {
            let rows = self.hessian.chunks(self.size.max(1)).zip(&self.rhs).zip(step);
            return rows.map(|((row, r), s)| s * (r - 0.5 * moved(row))).sum::<f64>() - self.bent(step);
        }
        let rows = self.triangle.chunks(self.width).take(self.size);
        let straight: f64 = rows.map(|row| (moved(row), row[self.size])).map(|(m, t)| m * (t - 0.5 * m)).sum();
        straight - self.bent(step)
    }

    /// How far the quadratic falls by a step of one unknown alone.
    pub fn reduction_along(&self, unknown: usize, step: f64) -> f64 {
        let at = unknown * self.size + unknown;
        let curvature = self.hessian[at] + self.curvature.get(at).copied().unwrap_or(0.0);
        step * (self.rhs[unknown] - 0.5 * curvature * step)
    }

    /// (H + damping)^-1 `rhs` on the chosen unknowns, both scaled; the others stay 0. None when H is too coarse.
    pub fn apply_inverse(&self, chosen: &[usize], damping: f64, rhs: &[f64]) -> Option<Vec<f64>> {
        let (mut matrix, n) = (self.chosen_products(chosen), chosen.len());
        (0..n).for_each(|k| matrix[k * n + k] += damping);
        let mut solution: Vec<f64> = chosen.iter().map(|j| rhs[*j]).collect();
        Cholesky::new(matrix, n)?.solve(&mut solution);
        let mut all = vec![0.0; self.size];
        chosen.iter().zip(&solution).for_each(|(j, s)| all[*j] = *s);
        Some(all)
    }

    /// Solves for the chosen unknowns while the others keep their part of `step`; unknowns that are not determined
    /// move as little as they can. False when products alone do not suffice.
    pub fn solve(&self, chosen: &[usize], damping: f64, step: &mut [f64]) -> bool {
        for j in chosen {
            step[*j] = 0.0;
        }
        let solution = if self.triangle.is_empty() {
            self.solve_products(chosen, damping, step)
        } else {
            self.solve_triangle(chosen, damping, step)
        };
        let Some(solution) = solution else { return false };
        for (j, s) in chosen.iter().zip(&solution) {
            step[*j] = *s;
        }
        true
    }

    fn solve_products(&self, chosen: &[usize], damping: f64, step: &[f64]) -> Option<Vec<f64>> {
        let bent = self.bends(damping);
        let taken = |row: &[f64]| row.iter().zip(step).map(|(h, s)| h * s).sum::<f64>();
        let row = |j: usize| j * self.size..(j + 1) * self.size;
        let rest = |j: &usize| self.rhs[*j] - taken(&self.hessian[row(*j)]);
        let mut solution: Vec<f64> = chosen.iter().map(rest).collect();
        if bent {
            let turned = chosen.iter().map(|j| taken(&self.curvature[row(*j)]));
            solution.iter_mut().zip(turned).for_each(|(s, t)| *s -= t);
        }
        if !bent && damping == 0.0 && !chosen.is_empty() && self.factored == chosen {
            self.factor.solve(&mut solution);
        } else {
            self.factored(chosen, damping, bent)?.solve(&mut solution);
        }
        Some(solution)
    }

    /// The factor of the products of chosen unknowns, damped or bent.
    fn factored(&self, chosen: &[usize], damping: f64, bent: bool) -> Option<Cholesky> {
        let (mut matrix, n) = (self.chosen_products(chosen), chosen.len());
        (0..n).for_each(|k| matrix[k * n + k] += damping);
        if bent {
            let curvature = |k: usize| self.curvature[chosen[k / n] * self.size + chosen[k % n]];
            matrix.iter_mut().enumerate().for_each(|(k, v)| *v += curvature(k));
        }
        Cholesky::new(matrix, n)
    }

    /// Whether the missing part of the second derivative counts: damped steps do without.
    fn bends(&self, damping: f64) -> bool {
        damping == 0.0 && !self.curvature.is_empty()
    }

    fn solve_triangle(&self, chosen: &[usize], damping: f64, step: &[f64]) -> Option<Vec<f64>> {
        let row = |i: usize| &self.triangle[i * self.width..(i + 1) * self.width];
        let taken = |i: usize| row(i).iter().zip(step).map(|(t, s)| t * s).sum::<f64>();
        let rest: Vec<f64> = (0..self.size).map(|i| row(i)[self.size] - taken(i)).collect();
        let Decomposition { u, values, v, .. } = &*self.decompose(chosen);
        let least = RANK * values.first().copied().unwrap_or(0.0);
        let rank = values.iter().take_while(|s| **s > least).count();
        let along = |k: usize| (0..self.size).map(|i| u[(i, k)] * rest[i]).sum::<f64>();
        let mut lengths: Vec<f64> = (0..rank).map(along).collect();
        if self.bends(damping) {
            self.straighten(chosen, &values[..rank], v, step, &mut lengths)?;
        }
        let mut solution = vec![0.0; chosen.len()];
        for (k, s) in values[..rank].iter().enumerate() {
            let length = lengths[k] * s / (s * s + damping);
            solution.iter_mut().enumerate().for_each(|(j, x)| *x += length * v[(k, j)]);
        }
        Some(solution)
    }

    /// Solves (I + A'S A) x = `lengths` + A'(S step), A = V / singular values: the curved problem in coordinates in which
    /// J'J is the identity, so that its condition does no harm.
    fn straighten(
        &self,
        chosen: &[usize],
        values: &[f64],
        v: &DMatrix<f64>,
        step: &[f64],
        lengths: &mut [f64],
    ) -> Option<()> {
        let (n, rank) = (chosen.len(), values.len());
        let curved = |i: usize, j: usize| self.curvature[chosen[i] * self.size + chosen[j]];
        let mut moved = vec![0.0; n * rank];
        for (k, m) in moved.iter_mut().enumerate() {
            *m = (0..n).map(|j| curved(k / rank, j) * v[(k % rank, j)] / values[k % rank]).sum();
        }
        let mut factor = vec![0.0; rank * rank];
        for (k, f) in factor.iter_mut().enumerate() {
            let (a, b) = (k / rank, k % rank);
            let part: f64 = (0..n).map(|i| v[(a, i)] / values[a] * moved[i * rank + b]).sum();
            *f = part + if a == b { 1.0 } else { 0.0 };
        }
        for (a, length) in lengths.iter_mut().enumerate() {
            for (i, j) in chosen.iter().enumerate() {
                let row = &self.curvature[j * self.size..(j + 1) * self.size];
                let turned: f64 = row.iter().zip(step).map(|(c, s)| c * s).sum();
                *length -= v[(a, i)] / values[a] * turned;
            }
        }
        Cholesky::new(factor, rank)?.solve(lengths);
        Some(())
    }

    fn decompose(&self, chosen: &[usize]) -> Cow<'_, Decomposition> {
        let decompose = || {
            let columns = DMatrix::from_fn(self.size, chosen.len(), |i, j| self.triangle[i * self.width + chosen[j]]);
            let svd = columns.svd(true, true);
            let blank = || DMatrix::zeros(0, 0);
            let (u, v) = (svd.u.unwrap_or_else(blank), svd.v_t.unwrap_or_else(blank));
            Decomposition { chosen: chosen.to_vec(), u, values: svd.singular_values.iter().copied().collect(), v }
        };
        let known = self.decomposition.get_or_init(decompose);
        if known.chosen == chosen { Cow::Borrowed(known) } else { Cow::Owned(decompose()) }
    }

    fn chosen_products(&self, chosen: &[usize]) -> Vec<f64> {
        let mut products = Vec::with_capacity(chosen.len() * chosen.len());
        self.put_products(chosen, &mut products);
        products
    }

    fn put_products(&self, chosen: &[usize], products: &mut Vec<f64>) {
        products.clear();
        for i in chosen {
            let row = &self.hessian[i * self.size..][..self.size];
            products.extend(chosen.iter().map(|j| row[*j]));
        }
    }

    /// The inverse of the information on the chosen unknowns, in the memory of one that is not needed any more; none when
    /// products do not suffice for it.
    pub fn invert(&mut self, chosen: Vec<usize>, spent: Inverse) -> Option<Inverse> {
        let n = chosen.len();
        if n == 0 {
            return Some(Inverse { condition: 1.0, ..Inverse::default() });
        }
        if self.triangle.is_empty() {
            return self.invert_products(chosen, spent.values);
        }
        let decomposition = self.decompose(&chosen);
        let Decomposition { values: singular, v, .. } = &*decomposition;
        let largest = singular.first().copied().unwrap_or(0.0);
        let (mut condition, mut null, mut rank) = (0.0, Vec::new(), 0);
        // the directions that are determined, each over its singular value
        let (mut along, mut across) = (vec![0.0; n * n], vec![0.0; n * n]);
        for (k, s) in singular.iter().enumerate() {
            let direction = v.row(k);
            condition = largest / s;
            if *s <= RANK * largest {
                null.push(direction.iter().copied().collect());
                continue;
            }
            for (j, entry) in direction.iter().enumerate() {
                (along[rank * n + j], across[j * n + rank]) = (entry / s, entry / s);
            }
            rank += 1;
        }
        let values = multiply_to_symmetric(&across, &along, n);
        along.truncate(rank * n);
        Some(Inverse { chosen, values, condition, null, along })
    }

    fn invert_products(&mut self, chosen: Vec<usize>, mut values: Vec<f64>) -> Option<Inverse> {
        let (n, mut matrix) = (chosen.len(), std::mem::take(&mut self.chosen));
        self.put_products(&chosen, &mut matrix);
        self.factored.clear();
        let (size, definite) = (norm(&matrix, n), self.factor.renew(&matrix, n));
        self.chosen = matrix;
        if !definite {
            return None;
        }
        self.factored.extend_from_slice(&chosen);
        self.factor.invert(&mut values);
        let condition = (size * norm(&values, n)).sqrt();
        Some(Inverse { chosen, values, condition, ..Inverse::default() })
    }
}

/// The missing part of the Hessian and the point where it was learnt last; everything in the units of the parameters.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Secant {
    /// S, P by P; empty as long as Gauss-Newton is fast enough by itself.
    pub matrix: Vec<f64>,
    /// The last estimates and the gradient of the cost there; empty when there are none to compare with.
    values: Vec<f64>,
    gradient: Vec<f64>,
}

impl Secant {
    /// Whether steps take it into account.
    pub fn is_active(&self) -> bool {
        !self.matrix.is_empty()
    }

    /// Forgets what was learnt.
    pub fn clear(&mut self) {
        self.matrix.clear();
    }

    /// Compares the gradient at `values` with the last one; `learn` says whether S is to change (or to begin).
    pub fn visit(&mut self, values: &[f64], quadratic: &Quadratic, learn: bool) {
        let parts = quadratic.rhs.iter().zip(&quadratic.scale).map(|(r, s)| -r * s);
        if learn && self.values.len() == values.len() {
            let gradient: Vec<f64> = parts.clone().collect();
            let step: Vec<f64> = values.iter().zip(&self.values).map(|(a, b)| a - b).collect();
            let change: Vec<f64> = gradient.iter().zip(&self.gradient).map(|(a, b)| a - b).collect();
            self.matrix.resize(values.len() * values.len(), 0.0);
            self.update(&step, &change, &quadratic.times(&step));
        }
        self.gradient.clear();
        self.gradient.extend(parts);
        self.values.clear();
        self.values.extend_from_slice(values);
    }

    /// Makes S map `step` to what the `change` of the gradient has beyond `explained`, by the smallest symmetric
    /// update in a norm that suits the change (Dennis, Gay and Welsch 1981, equation 4.5); before that S shrinks to the size that was seen.
    fn update(&mut self, step: &[f64], change: &[f64], explained: &[f64]) {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let missing: Vec<f64> = change.iter().zip(explained).map(|(c, e)| c - e).collect();
        let along = dot(change, step);
        if along.is_nan() || along <= 0.0 {
            return self.clear();
        }
        let n = step.len();
        let known: Vec<f64> = self.matrix.chunks(n).map(|row| dot(row, step)).collect();
        let (size, seen) = (dot(step, &known).abs(), dot(step, &missing).abs());
        let shrink = if size > seen { seen / size } else { 1.0 };
        let rest: Vec<f64> = missing.iter().zip(&known).map(|(m, k)| m - shrink * k).collect();
        let twice = dot(&rest, step) / (along * along);
        for (i, row) in self.matrix.chunks_mut(n).enumerate() {
            for (j, s) in row.iter_mut().enumerate() {
                let sum = rest[i] * change[j] + change[i] * rest[j];
                *s = shrink * *s + sum / along - twice * change[i] * change[j];
            }
        }
        if self.matrix.iter().any(|v| !v.is_finite()) {
            self.clear();
        }
    }
}

#[cfg(test)]
mod secant_tests {
    use super::*;

    #[test]
    fn the_update_is_symmetric_and_explains_the_last_change() {
        let mut secant = Secant { matrix: vec![0.3, 0.1, 0.1, -0.2], ..Secant::default() };
        let (step, change, explained) = ([0.4, -0.7], [1.1, -0.9], [0.8, -1.3]);
        secant.update(&step, &change, &explained);
        let s = &secant.matrix;
        assert!((s[1] - s[2]).abs() < 1e-15);
        for i in 0..2 {
            let mapped = s[2 * i] * step[0] + s[2 * i + 1] * step[1];
            assert!((mapped - (change[i] - explained[i])).abs() < 1e-14, "{i}");
        }
        secant.update(&step, &[-1.1, 0.9], &explained);
        assert!(!secant.is_active(), "a gradient that falls along the step is no minimum's");
    }
}
