//! Sums of products of rows, several rows at a time, so that what is read once serves all of them. Each sum grows by one product
//! after the other, in the order of a textbook; where factors are zero, as in matrices of parts that have nothing to do with each
//! other, nothing is added. The products of `nalgebra` are no use here: their sums have an order and a rounding of their own on every
//! processor, and a factor and its inverse are to be the same everywhere.

use crate::lanes::widest;
use rayon::prelude::*;

/// Columns that are worked on while they are in the nearest cache.
const TILE: usize = 256;
/// Rows of a product that are found together.
const ROWS: usize = 16;
/// Order from which threads are worth starting.
const THREADED: usize = 256;

/// What is added up: `factor(r, k)` times the row `from(k)`, for k from 0 to `count`.
pub(super) struct Terms<A, F> {
    pub(super) factor: A,
    pub(super) from: F,
    pub(super) count: usize,
}

impl<'f, A: Fn(usize, usize) -> f64, F: Fn(usize) -> &'f [f64]> Terms<A, F> {
    /// Adds the terms to rows of `width` numbers, from the column `first` on.
    #[inline(always)]
    pub(super) fn add_to(&self, to: &mut [f64], width: usize, first: usize) {
        let count = to.len() / width;
        let (rows_of_four, terms_of_four) = (count - count % 4, self.count - self.count % 4);
        for first in (first..width).step_by(TILE) {
            let tile = first..(first + TILE).min(width);
            for k in (0..terms_of_four).step_by(4) {
                let from = [0, 1, 2, 3].map(|l| &(self.from)(k + l)[tile.clone()]);
                let factors = |r: usize| [0, 1, 2, 3].map(|l| (self.factor)(r, k + l));
                let (fours, rest) = to.split_at_mut(rows_of_four * width);
                for (four, rows) in fours.chunks_exact_mut(4 * width).enumerate() {
                    let (p, rows) = rows.split_at_mut(width);
                    let (q, rows) = rows.split_at_mut(width);
                    let (r, s) = rows.split_at_mut(width);
                    let to = [p, q, r, s].map(|row| &mut row[tile.clone()]);
                    add_sixteen(to, from, [0, 1, 2, 3].map(|r| factors(4 * four + r)));
                }
                for (r, row) in rest.chunks_exact_mut(width).enumerate() {
                    add_four(&mut row[tile.clone()], from, factors(rows_of_four + r));
                }
            }
            for k in terms_of_four..self.count {
                let from = &(self.from)(k)[tile.clone()];
                for (r, row) in to.chunks_exact_mut(width).enumerate() {
                    add((self.factor)(r, k), from, &mut row[tile.clone()]);
                }
            }
        }
    }
}

/// `to += factor from`.
#[inline(always)]
pub(super) fn add(factor: f64, from: &[f64], to: &mut [f64]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += factor * from);
}

#[inline(always)]
fn add_four(to: &mut [f64], from: [&[f64]; 4], factors: [f64; 4]) {
    let n = to.len();
    let [a, b, c, d] = from.map(|row| &row[..n]);
    if factors == [0.0; 4] {
        return;
    }
    for t in 0..n {
        to[t] = (((to[t] + factors[0] * a[t]) + factors[1] * b[t]) + factors[2] * c[t]) + factors[3] * d[t];
    }
}

#[inline(always)]
fn add_sixteen(to: [&mut [f64]; 4], from: [&[f64]; 4], factors: [[f64; 4]; 4]) {
    if factors == [[0.0; 4]; 4] {
        return;
    }
    let [p, q, r, s] = to;
    let n = p.len();
    let (q, r, s) = (&mut q[..n], &mut r[..n], &mut s[..n]);
    let [a, b, c, d] = from.map(|row| &row[..n]);
    for t in 0..n {
        let (a, b, c, d) = (a[t], b[t], c[t], d[t]);
        let sum = |to: f64, f: &[f64; 4]| (((to + f[0] * a) + f[1] * b) + f[2] * c) + f[3] * d;
        p[t] = sum(p[t], &factors[0]);
        q[t] = sum(q[t], &factors[1]);
        r[t] = sum(r[t], &factors[2]);
        s[t] = sum(s[t], &factors[3]);
    }
}

/// The product of two matrices (n by n, row-major).
pub fn multiply(a: &[f64], b: &[f64], n: usize) -> Vec<f64> {
    product(a, b, n, false)
}

/// The product where it is known to be symmetric: its upper triangle is found, the lower one copied.
pub fn multiply_to_symmetric(a: &[f64], b: &[f64], n: usize) -> Vec<f64> {
    let mut product = product(a, b, n, true);
    for i in 0..n {
        for j in 0..i {
            product[i * n + j] = product[j * n + i];
        }
    }
    product
}

fn product(a: &[f64], b: &[f64], n: usize, upper: bool) -> Vec<f64> {
    let mut c = vec![0.0; n * n];
    add_product((a, n), (b, n), upper, &mut c);
    c
}

/// Adds the product of `a` (any rows of `inner` numbers) and `b` (inner by `columns`) to `to` (rows by columns).
pub fn multiply_add(a: &[f64], inner: usize, b: &[f64], columns: usize, to: &mut [f64]) {
    add_product((a, inner), (b, columns), false, to);
}

fn add_product((a, inner): (&[f64], usize), (b, n): (&[f64], usize), upper: bool, c: &mut [f64]) {
    let rows = |(block, to): (usize, &mut [f64])| {
        let first = block * ROWS;
        let terms = Terms {
            factor: |r: usize, k: usize| a[(first + r) * inner + k],
            from: |k: usize| &b[k * n..(k + 1) * n],
            count: inner,
        };
        widest(
            #[inline(always)]
            || terms.add_to(to, n, if upper { first } else { 0 }),
        );
    };
    if n < THREADED {
        c.chunks_mut((ROWS * n).max(1)).enumerate().for_each(rows);
    } else {
        c.par_chunks_mut(ROWS * n).enumerate().for_each(rows);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_a_textbook() {
        for n in [1, 3, 4, 17, 35, 261] {
            let entry = |k: usize| ((k * 37 + k * k % 11) % 19) as f64 * 0.1 - 0.8;
            let a: Vec<f64> = (0..n * n).map(entry).collect();
            let b: Vec<f64> = (0..n * n).map(|k| entry(k + 5)).collect();
            let sum = |i: usize, j: usize| (0..n).fold(0.0, |sum, k| sum + a[i * n + k] * b[k * n + j]);
            let c = multiply(&a, &b, n);
            let upper = multiply_to_symmetric(&a, &b, n);
            for k in 0..n * n {
                let (i, j) = (k / n, k % n);
                assert_eq!(c[k].to_bits(), sum(i, j).to_bits(), "{n}: {i} {j}");
                assert_eq!(upper[k].to_bits(), sum(i.min(j), i.max(j)).to_bits(), "{n}: {i} {j}");
            }
        }
    }
}
