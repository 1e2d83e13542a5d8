//! Small matrices with their derivatives by the parameters of a subsystem, in lanes.

use crate::simulate::vectors::{Aligned, VECTOR, accumulate};

/// A matrix and its exact derivatives.
pub(super) struct Jet {
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// Lanes of each entry's derivatives, whole vectors.
    pub(super) lanes: usize,
    /// Rows by columns.
    pub(super) value: Vec<f64>,
    /// Rows by columns by lanes.
    pub(super) slope: Aligned,
}

impl Jet {
    pub(super) fn zero(rows: usize, columns: usize, lanes: usize) -> Self {
        let size = rows * columns;
        Self { rows, columns, lanes, value: vec![0.0; size], slope: Aligned::new(size * lanes) }
    }

    /// Derivatives of an entry.
    #[inline(always)]
    pub(super) fn slope_of(&self, i: usize, j: usize) -> &[f64] {
        &self.slope[(i * self.columns + j) * self.lanes..][..self.lanes]
    }

    /// Becomes zero.
    pub(super) fn clear(&mut self) {
        self.value.fill(0.0);
        self.slope.fill(0.0);
    }

    /// Becomes `factor` times another.
    #[inline(always)]
    pub(super) fn scale_of(&mut self, factor: f64, other: &Self) {
        self.clear();
        self.add(factor, other);
    }

    /// Adds `factor` times another.
    #[inline(always)]
    pub(super) fn add(&mut self, factor: f64, other: &Self) {
        self.value.iter_mut().zip(&other.value).for_each(|(s, o)| *s += factor * o);
        accumulate(factor, &other.slope, &mut self.slope);
    }

    /// Adds a multiple of the unit matrix.
    pub(super) fn add_unit(&mut self, factor: f64) {
        (0..self.rows).for_each(|i| self.value[i * self.columns + i] += factor);
    }

    /// Becomes the product `a b`, derivatives by the product rule.
    #[inline(always)]
    pub(super) fn product_of(&mut self, a: &Self, b: &Self) {
        let (inner, lanes) = (a.columns, self.lanes);
        for i in 0..self.rows {
            for j in 0..self.columns {
                let mut sum = 0.0;
                for k in 0..inner {
                    sum += a.value[i * inner + k] * b.value[k * b.columns + j];
                }
                self.value[i * self.columns + j] = sum;
                let to = &mut self.slope[(i * self.columns + j) * lanes..][..lanes];
                for (v, to) in to.as_chunks_mut::<VECTOR>().0.iter_mut().enumerate() {
                    let mut total = [0.0; VECTOR];
                    for k in 0..inner {
                        let (x, y) = (a.value[i * inner + k], b.value[k * b.columns + j]);
                        let Some(dx) = a.slope[(i * inner + k) * lanes + v * VECTOR..].first_chunk::<VECTOR>() else {
                            return;
                        };
                        let Some(dy) = b.slope[(k * b.columns + j) * lanes + v * VECTOR..].first_chunk::<VECTOR>()
                        else {
                            return;
                        };
                        for l in 0..VECTOR {
                            total[l] = y.mul_add(dx[l], total[l]);
                            total[l] = x.mul_add(dy[l], total[l]);
                        }
                    }
                    *to = total;
                }
            }
        }
    }

    /// Largest sum of magnitudes in a column.
    pub(super) fn norm(&self) -> f64 {
        let column = |j: usize| (0..self.rows).map(|i| self.value[i * self.columns + j].abs()).sum::<f64>();
        (0..self.columns).map(column).fold(0.0, f64::max)
    }
}
