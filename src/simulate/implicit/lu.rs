//! LU factors of the stage equations' matrix, by rows, with partial pivoting inside the rows' envelopes.
//!
//! Rows are eliminated by whole rows, as wide registers like it, and only as far as their last entry reaches; a multiplier that
//! is zero costs one comparison. A chain of reactions or a line of cells therefore costs what its band costs, without a sparse
//! code. Right-hand sides are rows of lanes: all parameters in one pass.

use crate::simulate::vectors::Aligned;

/// A square matrix that becomes its factors.
pub(super) struct Lu {
    size: usize,
    stride: usize,
    rows: Aligned,
    /// The row that stands at each place.
    order: Vec<usize>,
    /// One behind the last entry of each row.
    reach: Vec<usize>,
    /// A right-hand side in its new order.
    permuted: Vec<f64>,
}

impl Lu {
    pub(super) fn new(size: usize) -> Self {
        let stride = size.next_multiple_of(crate::simulate::vectors::VECTOR);
        Self {
            size,
            stride,
            rows: Aligned::new(size * stride),
            order: (0..size).collect(),
            reach: vec![0; size],
            permuted: vec![0.0; size],
        }
    }

    /// An empty matrix again.
    #[inline(always)]
    pub(super) fn clear(&mut self) {
        self.rows.fill(0.0);
        self.reach.fill(0);
        self.order.iter_mut().enumerate().for_each(|(k, o)| *o = k);
    }

    /// Adds to an entry.
    #[inline(always)]
    pub(super) fn add(&mut self, row: usize, column: usize, value: f64) {
        self.rows[row * self.stride + column] += value;
        self.reach[row] = self.reach[row].max(column + 1);
    }

    /// Factorises what was added; `false` when the matrix is singular or not finite.
    #[inline(always)]
    pub(super) fn factorise(&mut self) -> bool {
        let (n, stride) = (self.size, self.stride);
        for k in 0..n {
            let mut best = k;
            for r in k + 1..n {
                if self.entry(r, k).abs() > self.entry(best, k).abs() {
                    best = r;
                }
            }
            let pivot = self.entry(best, k);
            if pivot == 0.0 || !pivot.is_finite() {
                return false;
            }
            self.order.swap(k, best);
            let upper = self.order[k];
            let reach = self.reach[upper];
            for r in k + 1..n {
                let lower = self.order[r];
                let entry = self.rows[lower * stride + k];
                if entry == 0.0 {
                    continue;
                }
                let multiplier = entry / pivot;
                self.rows[lower * stride + k] = multiplier;
                self.reach[lower] = self.reach[lower].max(reach);
                let (from, to) = two_rows(&mut self.rows, upper * stride, lower * stride, stride);
                add_row(-multiplier, &from[k + 1..reach], &mut to[k + 1..reach]);
            }
        }
        true
    }

    /// Solves for one right-hand side in place.
    #[inline(always)]
    pub(super) fn solve(&mut self, b: &mut [f64]) {
        let (n, stride) = (self.size, self.stride);
        for k in 0..n {
            let row = &self.rows[self.order[k] * stride..][..n];
            let mut sum = b[self.order[k]];
            for (l, x) in row[..k].iter().zip(&self.permuted) {
                sum = (-l).mul_add(*x, sum);
            }
            self.permuted[k] = sum;
        }
        for k in (0..n).rev() {
            let row = &self.rows[self.order[k] * stride..][..n];
            let mut sum = self.permuted[k];
            for (u, x) in row.iter().zip(&self.permuted).take(self.reach[self.order[k]]).skip(k + 1) {
                sum = (-u).mul_add(*x, sum);
            }
            self.permuted[k] = sum / row[k];
        }
        b.copy_from_slice(&self.permuted);
    }

    /// Solves for a row of `lanes` right-hand sides per equation. What was given as row k of `b` is overwritten; row k of the
    /// solution is where [`Lu::row`] says.
    #[inline(always)]
    pub(super) fn solve_lanes(&self, b: &mut [f64], lanes: usize) {
        let (n, stride) = (self.size, self.stride);
        for k in 0..n {
            let at = self.order[k];
            let row = &self.rows[at * stride..][..n];
            for (j, l) in row[..k].iter().enumerate() {
                if *l != 0.0 {
                    let (from, to) = two_rows(b, self.order[j] * lanes, at * lanes, lanes);
                    add_row(-l, from, to);
                }
            }
        }
        for k in (0..n).rev() {
            let at = self.order[k];
            let row = &self.rows[at * stride..][..n];
            for (j, u) in row.iter().enumerate().take(self.reach[at]).skip(k + 1) {
                if *u != 0.0 {
                    let (from, to) = two_rows(b, self.order[j] * lanes, at * lanes, lanes);
                    add_row(-u, from, to);
                }
            }
            let over = 1.0 / row[k];
            b[at * lanes..][..lanes].iter_mut().for_each(|b| *b *= over);
        }
    }

    /// Which row of the right-hand sides holds unknown k of the solution.
    #[inline(always)]
    pub(super) fn row(&self, k: usize) -> usize {
        self.order[k]
    }

    #[inline(always)]
    fn entry(&self, place: usize, column: usize) -> f64 {
        self.rows[self.order[place] * self.stride + column]
    }
}

/// The row that begins at `from` to read, and the one that begins at `to` to write.
#[inline(always)]
fn two_rows(rows: &mut [f64], from: usize, to: usize, len: usize) -> (&[f64], &mut [f64]) {
    if from < to {
        let (a, b) = rows.split_at_mut(to);
        (&a[from..from + len], &mut b[..len])
    } else {
        let (a, b) = rows.split_at_mut(from);
        (&b[..len], &mut a[to..to + len])
    }
}

/// `to += a from`, of any length.
#[inline(always)]
fn add_row(a: f64, from: &[f64], to: &mut [f64]) {
    for (t, f) in to.iter_mut().zip(from) {
        *t = a.mul_add(*f, *t);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A banded matrix of random numbers whose diagonal is small, so that it cannot be solved without pivoting.
    fn matrix(n: usize, band: usize) -> Vec<f64> {
        let mut state = 88_172_645_463_325_252_u64;
        let mut random = move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let mut a = vec![0.0; n * n];
        for i in 0..n {
            for j in i.saturating_sub(band)..(i + band + 1).min(n) {
                a[i * n + j] = random() * if i == j { 1e-3 } else { 1.0 };
            }
        }
        a
    }

    #[test]
    fn solutions_satisfy_their_equations() {
        for (n, band) in [(1, 0), (3, 3), (9, 9), (40, 3), (33, 33)] {
            let (a, lanes) = (matrix(n, band), 8);
            let mut lu = Lu::new(n);
            lu.clear();
            for i in 0..n {
                (0..n).filter(|j| a[i * n + j] != 0.0).for_each(|j| lu.add(i, j, a[i * n + j]));
            }
            assert!(lu.factorise());
            let right: Vec<f64> = (0..n * lanes).map(|k| (k as f64 * 0.7).sin()).collect();
            let (mut many, mut one) = (right.clone(), (0..n).map(|i| right[i * lanes]).collect::<Vec<_>>());
            lu.solve_lanes(&mut many, lanes);
            lu.solve(&mut one);
            for lane in 0..lanes {
                for i in 0..n {
                    let sum: f64 = (0..n).map(|j| a[i * n + j] * many[lu.row(j) * lanes + lane]).sum();
                    assert!((sum - right[i * lanes + lane]).abs() < 1e-9, "{n}: {sum}");
                }
            }
            let same = (0..n).all(|i| (one[i] - many[lu.row(i) * lanes]).abs() <= 1e-9 * one[i].abs().max(1.0));
            assert!(same, "{n}");
        }
    }

    #[test]
    fn singular_matrices_are_told() {
        let mut lu = Lu::new(2);
        lu.clear();
        (0..2).for_each(|i| (0..2).for_each(|j| lu.add(i, j, 1.0)));
        assert!(!lu.factorise());
        lu.clear();
        (0..2).for_each(|i| lu.add(i, i, f64::NAN));
        assert!(!lu.factorise());
    }
}
