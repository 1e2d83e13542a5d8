//! Sums of products of rows, several rows at a time, so that what is read once serves all of them. Each sum grows by one product
//! after the other, in the order of a textbook; where factors are zero, as in matrices of parts that have nothing to do with each
//! other, nothing is added. The products of `nalgebra` are no use here: their sums have an order and a rounding of their own on every
//! processor, and a factor and its inverse are to be the same everywhere.
//!
//! Householder reduction of tall matrices to a triangle, a block of rows at a time: rank is decided on J, never on J'J.

use crate::lanes::widest;
use rayon::prelude::*;

/// Columns that are worked on while they are in the nearest cache.
const TILE: usize = 256;
/// Rows of a product that are found together.
const ROWS: usize = 16;
/// Order from which threads are worth starting.
pub(super) const THREADED: usize = 256;

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

/// Order from which the widest registers are worth choosing.
pub(super) const WIDE: usize = 64;

/// Reduces `block` (rows by width, row-major) into the upper triangle `triangle` (order by width), so that
/// triangle' triangle grows by block' block. The block is overwritten. Only the first `order` columns are meant;
/// lanes beyond them must be zero.
pub fn reduce(triangle: &mut [f64], order: usize, block: &mut [f64], width: usize, work: &mut Vec<f64>) {
    if order < WIDE {
        reflect(triangle, order, block, width, work);
    } else {
        widest(
            #[inline(always)]
            || reflect(triangle, order, block, width, work),
        );
    }
}

#[inline(always)]
fn reflect(triangle: &mut [f64], order: usize, block: &mut [f64], width: usize, work: &mut Vec<f64>) {
    let rows = block.len() / width;
    work.clear();
    work.resize(rows + width, 0.0);
    let (reflector, products) = work.split_at_mut(rows);
    for j in 0..order {
        let mut square = 0.0;
        for (b, v) in reflector.iter_mut().enumerate() {
            *v = block[b * width + j];
            square += *v * *v;
        }
        // squares of columns below this are zero: on the way to the smallest numbers a reflection loses its digits
        // and overflows
        if square < 1e-280 {
            continue;
        }
        let row = &mut triangle[j * width..(j + 1) * width];
        let alpha = row[j];
        let norm = (alpha * alpha + square).sqrt();
        let head = if alpha > 0.0 { alpha + norm } else { alpha - norm };
        let tau = 2.0 / (head * head + square);
        let products = &mut products[j..];
        for (p, t) in products.iter_mut().zip(&row[j..]) {
            *p = head * t;
        }
        for (b, v) in reflector.iter().enumerate() {
            for (p, x) in products.iter_mut().zip(&block[b * width + j..(b + 1) * width]) {
                *p += v * x;
            }
        }
        for (t, p) in row[j..].iter_mut().zip(&*products) {
            *t -= tau * head * p;
        }
        for (b, v) in reflector.iter().enumerate() {
            let factor = tau * v;
            for (x, p) in block[b * width + j..(b + 1) * width].iter_mut().zip(&*products) {
                *x -= factor * p;
            }
        }
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

#[cfg(test)]
mod triangle_tests {
    use super::*;

    #[test]
    fn columns_on_the_way_to_zero_count_as_zero() {
        for tiny in [1e-150, 1e-158, 1e-162, 5e-324] {
            let (mut triangle, mut work) = (vec![0.0; 2 * 8], Vec::new());
            for _ in 0..3 {
                let mut block: Vec<f64> =
                    (0..4).flat_map(|k| [1.0, tiny * f64::from(k), 0., 0., 0., 0., 0., 0.]).collect();
                reduce(&mut triangle, 2, &mut block, 8, &mut work);
            }
            assert!(triangle.iter().all(|v| v.is_finite()), "{tiny}: {triangle:?}");
            assert!((triangle[0].abs() - 12f64.sqrt()).abs() < 1e-14);
        }
    }

    #[test]
    fn products_are_kept_and_small_singular_values_survive() {
        // two columns that differ by 1e-10: J'J in double precision cannot tell them apart, the triangle can
        let rows: Vec<[f64; 3]> = (0..40)
            .map(|k| {
                let t = k as f64 / 40.0;
                [1.0 + t, 1.0 + t + 1e-10 * t * t, t.sin()]
            })
            .collect();
        let width = 8;
        let (mut triangle, mut work) = (vec![0.0; 3 * width], Vec::new());
        for part in rows.chunks(7) {
            let mut block = vec![0.0; part.len() * width];
            part.iter().enumerate().for_each(|(b, r)| block[b * width..b * width + 3].copy_from_slice(r));
            reduce(&mut triangle, 3, &mut block, width, &mut work);
        }
        for i in 0..3 {
            for j in 0..3 {
                let want: f64 = rows.iter().map(|r| r[i] * r[j]).sum();
                let got: f64 = (0..=i.min(j)).map(|k| triangle[k * width + i] * triangle[k * width + j]).sum();
                assert!((want - got).abs() < 1e-12 * want.abs(), "{i} {j}: {want} {got}");
            }
        }
        // the part of the second column that is orthogonal to the first
        let (a, d): (f64, f64) = rows.iter().fold((0.0, 0.0), |s, r| (s.0 + r[0] * r[0], s.1 + r[0] * (r[1] - r[0])));
        let want = rows.iter().map(|r| (r[1] - r[0] - d / a * r[0]).powi(2)).sum::<f64>().sqrt();
        assert!((triangle[width + 1].abs() / want - 1.0).abs() < 1e-4, "{} {want}", triangle[width + 1]);
    }
}
