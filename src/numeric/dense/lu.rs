//! LU factors of a square matrix, by rows, with partial pivoting inside the rows' envelopes.
//!
//! Rows are eliminated by whole rows, as wide registers like it, and only as far as their last entry reaches; a multiplier that
//! is zero costs one comparison. A chain of reactions or a line of cells therefore costs what its band costs, without a sparse
//! code. Right-hand sides may be rows of lanes: all parameters in one pass.
//!
//! One algorithm, three kinds of arithmetic ([`Arithmetic`]): results are kept to the bit, and how a product is rounded before it is
//! subtracted shows in them.
//!
//! GaussJordan with complete pivoting of a matrix that may be of any rank, with right sides.

use crate::lanes::{Aligned, VECTOR, accumulate};
use num_complex::Complex64;
use std::ops::Div;

/// How the entries of a matrix are eliminated.
pub trait Arithmetic {
    /// An entry.
    type Entry: Copy + Default + PartialEq + Div<Output = Self::Entry>;

    /// By which pivots are compared.
    fn size(entry: Self::Entry) -> f64;

    /// Whether a pivot further down is preferred to the best one so far.
    fn is_better(size: f64, best: f64) -> bool {
        size > best
    }

    /// `to -= factor from`.
    fn subtract(factor: Self::Entry, from: &[Self::Entry], to: &mut [Self::Entry]);

    /// `b` less the product of a part of a row with what is known of the solution.
    fn remainder(b: Self::Entry, row: &[Self::Entry], known: &[Self::Entry]) -> Self::Entry;

    /// Divides lanes by a pivot.
    #[inline(always)]
    fn divide(lanes: &mut [Self::Entry], pivot: Self::Entry) {
        lanes.iter_mut().for_each(|v| *v = *v / pivot);
    }
}

/// Fused multiply-adds: inside a task of [`crate::lanes::dispatch`], where they are one instruction.
#[derive(Debug, Clone, Copy)]
pub struct Fused;

/// Products rounded before they are subtracted.
#[derive(Debug, Clone, Copy)]
pub struct Rounded;

/// Complex entries, products rounded; the last of equal pivots is taken.
#[derive(Debug, Clone, Copy)]
pub struct Complex;

impl Arithmetic for Fused {
    type Entry = f64;

    #[inline(always)]
    fn size(entry: f64) -> f64 {
        entry.abs()
    }

    #[inline(always)]
    fn subtract(factor: f64, from: &[f64], to: &mut [f64]) {
        to.iter_mut().zip(from).for_each(|(t, f)| *t = (-factor).mul_add(*f, *t));
    }

    #[inline(always)]
    fn remainder(b: f64, row: &[f64], known: &[f64]) -> f64 {
        row.iter().zip(known).fold(b, |rest, (a, x)| (-a).mul_add(*x, rest))
    }

    #[inline(always)]
    fn divide(lanes: &mut [f64], pivot: f64) {
        let over = 1.0 / pivot;
        lanes.iter_mut().for_each(|v| *v *= over);
    }
}

impl Arithmetic for Rounded {
    type Entry = f64;

    #[inline(always)]
    fn size(entry: f64) -> f64 {
        entry.abs()
    }

    #[inline(always)]
    fn subtract(factor: f64, from: &[f64], to: &mut [f64]) {
        to.iter_mut().zip(from).for_each(|(t, f)| *t -= factor * f);
    }

    #[inline(always)]
    fn remainder(b: f64, row: &[f64], known: &[f64]) -> f64 {
        b - row.iter().zip(known).map(|(a, x)| a * x).sum::<f64>()
    }
}

impl Arithmetic for Complex {
    type Entry = Complex64;

    #[inline(always)]
    fn size(entry: Complex64) -> f64 {
        entry.re.abs().max(entry.im.abs())
    }

    #[inline(always)]
    fn is_better(size: f64, best: f64) -> bool {
        size >= best
    }

    #[inline(always)]
    fn subtract(factor: Complex64, from: &[Complex64], to: &mut [Complex64]) {
        to.iter_mut().zip(from).for_each(|(t, f)| *t -= factor * f);
    }

    #[inline(always)]
    fn remainder(b: Complex64, row: &[Complex64], known: &[Complex64]) -> Complex64 {
        b - row.iter().zip(known).map(|(a, x)| a * x).sum::<Complex64>()
    }
}

/// A square matrix that becomes its factors.
#[derive(Debug, Clone)]
pub struct Lu<A: Arithmetic> {
    size: usize,
    stride: usize,
    rows: Aligned<A::Entry>,
    /// The row that stands at each place.
    order: Vec<usize>,
    /// One behind the last entry of each row.
    reach: Vec<usize>,
    /// A right-hand side in its new order.
    permuted: Vec<A::Entry>,
}

impl<A: Arithmetic> Default for Lu<A> {
    fn default() -> Self {
        Self::new(0)
    }
}

impl<A: Arithmetic> Lu<A> {
    /// A matrix of zeros (size by size).
    pub fn new(size: usize) -> Self {
        let stride = size.next_multiple_of(VECTOR);
        Self {
            size,
            stride,
            rows: Aligned::new(size * stride),
            order: (0..size).collect(),
            reach: vec![0; size],
            permuted: vec![A::Entry::default(); size],
        }
    }

    /// Rows and columns.
    pub fn size(&self) -> usize {
        self.size
    }

    /// A matrix of zeros again.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.rows.fill(A::Entry::default());
        self.reach.fill(0);
        self.order.iter_mut().enumerate().for_each(|(k, o)| *o = k);
    }

    /// An entry, to be written.
    #[inline(always)]
    pub fn entry_mut(&mut self, row: usize, column: usize) -> &mut A::Entry {
        self.reach[row] = self.reach[row].max(column + 1);
        &mut self.rows[row * self.stride + column]
    }

    /// Factorises what was written. `false` when a pivot is not larger than `negligible`, or is no finite number: there is no
    /// solution then.
    #[inline(always)]
    pub fn factorise(&mut self, negligible: f64) -> bool {
        let (n, stride) = (self.size, self.stride);
        for k in 0..n {
            let (mut best, mut size) = (k, A::size(self.entry(k, k)));
            for r in k + 1..n {
                let other = A::size(self.entry(r, k));
                if A::is_better(other, size) {
                    (best, size) = (r, other);
                }
            }
            let pivot = self.entry(best, k);
            if !(size > negligible && size.is_finite()) {
                return false;
            }
            self.order.swap(k, best);
            let upper = self.order[k];
            let reach = self.reach[upper];
            for r in k + 1..n {
                let lower = self.order[r];
                let entry = self.rows[lower * stride + k];
                if entry == A::Entry::default() {
                    continue;
                }
                let multiplier = entry / pivot;
                self.rows[lower * stride + k] = multiplier;
                self.reach[lower] = self.reach[lower].max(reach);
                let (from, to) = two_rows(&mut self.rows, upper * stride, lower * stride, stride);
                A::subtract(multiplier, &from[k + 1..reach], &mut to[k + 1..reach]);
            }
        }
        true
    }

    /// Solves for one right-hand side in place.
    #[inline(always)]
    pub fn solve(&mut self, b: &mut [A::Entry]) {
        let (n, stride) = (self.size, self.stride);
        for k in 0..n {
            let row = &self.rows[self.order[k] * stride..][..n];
            self.permuted[k] = A::remainder(b[self.order[k]], &row[..k], &self.permuted[..k]);
        }
        for k in (0..n).rev() {
            let (row, reach) = (&self.rows[self.order[k] * stride..][..n], self.reach[self.order[k]]);
            let rest = A::remainder(self.permuted[k], &row[k + 1..reach], &self.permuted[k + 1..reach]);
            self.permuted[k] = rest / row[k];
        }
        b.copy_from_slice(&self.permuted);
    }

    /// Which row of right-hand sides in lanes holds unknown k of the solution.
    #[inline(always)]
    pub fn row(&self, k: usize) -> usize {
        self.order[k]
    }

    #[inline(always)]
    fn entry(&self, place: usize, column: usize) -> A::Entry {
        self.rows[self.order[place] * self.stride + column]
    }
}

impl<A: Arithmetic<Entry = f64>> Lu<A> {
    /// Solves for a row of `lanes` right-hand sides per equation (whole vectors), with fused multiply-adds. What was given as row k of
    /// `b` is overwritten; row k of the solution is where [`Lu::row`] says.
    #[inline(always)]
    pub fn solve_lanes(&self, b: &mut [f64], lanes: usize) {
        let (n, stride) = (self.size, self.stride);
        for k in 0..n {
            let at = self.order[k];
            let row = &self.rows[at * stride..][..n];
            for (j, l) in row[..k].iter().enumerate() {
                if *l != 0.0 {
                    let (from, to) = two_rows(b, self.order[j] * lanes, at * lanes, lanes);
                    accumulate(-l, from, to);
                }
            }
        }
        for k in (0..n).rev() {
            let at = self.order[k];
            let row = &self.rows[at * stride..][..n];
            for (j, u) in row.iter().enumerate().take(self.reach[at]).skip(k + 1) {
                if *u != 0.0 {
                    let (from, to) = two_rows(b, self.order[j] * lanes, at * lanes, lanes);
                    accumulate(-u, from, to);
                }
            }
            A::divide(&mut b[at * lanes..][..lanes], row[k]);
        }
    }
}

impl Lu<Complex> {
    /// Solves `w A = c` in place.
    pub fn solve_left(&mut self, w: &mut [Complex64]) {
        let n = self.size;
        self.permuted.copy_from_slice(w);
        for k in 0..n {
            let sum: Complex64 = (0..k).map(|i| self.permuted[i] * self.entry(i, k)).sum();
            self.permuted[k] = (self.permuted[k] - sum) / self.entry(k, k);
        }
        for k in (0..n).rev() {
            let sum: Complex64 = (k + 1..n).map(|i| self.permuted[i] * self.entry(i, k)).sum();
            self.permuted[k] -= sum;
        }
        self.order.iter().zip(&self.permuted).for_each(|(row, value)| w[*row] = *value);
    }
}

/// The row that begins at `from` to read, and the one that begins at `to` to write.
#[inline(always)]
fn two_rows<T>(rows: &mut [T], from: usize, to: usize, len: usize) -> (&[T], &mut [T]) {
    if from < to {
        let (a, b) = rows.split_at_mut(to);
        (&a[from..from + len], &mut b[..len])
    } else {
        let (a, b) = rows.split_at_mut(from);
        (&b[..len], &mut a[to..to + len])
    }
}

/// A matrix with right sides, row by row: which columns can be solved for, and their solution with the other unknowns at zero.
#[derive(Debug, Clone, Default)]
pub struct GaussJordan {
    /// Rows by (unknowns + right sides).
    entries: Vec<f64>,
    rows: usize,
    unknowns: usize,
    sides: usize,
    /// (row, column) of the pivots, in the order of elimination.
    pivots: Vec<(usize, usize)>,
    taken: Vec<bool>,
    scales: Vec<f64>,
}

impl GaussJordan {
    /// A pivot below this part of the largest entry that its row had is rounding.
    const SINGULAR: f64 = 1e-11;

    /// Makes a matrix of zeros.
    pub fn clear(&mut self, rows: usize, unknowns: usize, sides: usize) {
        (self.rows, self.unknowns, self.sides) = (rows, unknowns, sides);
        self.entries.clear();
        self.entries.resize(rows * (unknowns + sides), 0.0);
    }

    /// An entry of the matrix.
    pub fn set(&mut self, row: usize, column: usize, value: f64) {
        self.entries[row * (self.unknowns + self.sides) + column] = value;
    }

    /// An entry of a right side.
    pub fn set_side(&mut self, row: usize, side: usize, value: f64) {
        self.set(row, self.unknowns + side, value);
    }

    /// Eliminates; afterwards [`GaussJordan::solution`] has values. Returns the rank.
    pub fn eliminate(&mut self) -> usize {
        let width = self.unknowns + self.sides;
        self.pivots.clear();
        self.taken.clear();
        self.taken.resize(self.rows, false);
        self.scales.clear();
        for row in self.entries.chunks_exact(width.max(1)).take(self.rows) {
            self.scales.push(row[..self.unknowns].iter().fold(0.0_f64, |a, b| a.max(b.abs())));
        }
        while let Some((row, column)) = self.pivot() {
            self.taken[row] = true;
            self.pivots.push((row, column));
            let pivot = self.entries[row * width + column];
            for other in (0..self.rows).filter(|r| *r != row) {
                let factor = self.entries[other * width + column] / pivot;
                if factor != 0.0 {
                    for k in 0..width {
                        self.entries[other * width + k] -= factor * self.entries[row * width + k];
                    }
                    self.entries[other * width + column] = 0.0;
                }
            }
        }
        self.pivots.len()
    }

    /// The largest entry, relative to its row, of what is left.
    fn pivot(&self) -> Option<(usize, usize)> {
        let width = self.unknowns + self.sides;
        let (mut best, mut place) = (Self::SINGULAR, None);
        for row in (0..self.rows).filter(|r| !self.taken[*r]) {
            for column in 0..self.unknowns {
                let size = (self.entries[row * width + column] / self.scales[row]).abs();
                if size > best && size.is_finite() {
                    (best, place) = (size, Some((row, column)));
                }
            }
        }
        place
    }

    /// The columns that were solved for, in the order of elimination.
    pub fn columns(&self) -> impl Iterator<Item = usize> + '_ {
        self.pivots.iter().map(|(_, column)| *column)
    }

    /// The rows that were solved, in the order of elimination.
    pub fn rows(&self) -> impl Iterator<Item = usize> + '_ {
        self.pivots.iter().map(|(row, _)| *row)
    }

    /// (unknown, value) of the solution with one right side; the unknowns that are not named are zero.
    pub fn solution(&self, side: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let width = self.unknowns + self.sides;
        self.pivots.iter().map(move |(row, column)| {
            let row = &self.entries[row * width..][..width];
            (*column, row[self.unknowns + side] / row[*column])
        })
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
            let mut lu = Lu::<Fused>::new(n);
            lu.clear();
            for i in 0..n {
                (0..n).filter(|j| a[i * n + j] != 0.0).for_each(|j| *lu.entry_mut(i, j) = a[i * n + j]);
            }
            assert!(lu.factorise(0.0));
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
        let mut lu = Lu::<Fused>::new(2);
        lu.clear();
        (0..2).for_each(|i| (0..2).for_each(|j| *lu.entry_mut(i, j) = 1.0));
        assert!(!lu.factorise(0.0));
        lu.clear();
        (0..2).for_each(|i| *lu.entry_mut(i, i) = f64::NAN);
        assert!(!lu.factorise(0.0));
    }
}

#[cfg(test)]
mod gauss_jordan_tests {
    use super::*;

    fn solve(rows: &[&[f64]], sides: &[f64]) -> (usize, Vec<(usize, f64)>) {
        let mut e = GaussJordan::default();
        e.clear(rows.len(), rows[0].len(), 1);
        for (i, row) in rows.iter().enumerate() {
            row.iter().enumerate().for_each(|(j, v)| e.set(i, j, *v));
            e.set_side(i, 0, sides[i]);
        }
        let rank = e.eliminate();
        let mut found: Vec<_> = e.solution(0).collect();
        found.sort_by_key(|(k, _)| *k);
        (rank, found)
    }

    #[test]
    fn full_rank_is_solved() {
        let (rank, found) = solve(&[&[0.0, 2.0], &[4.0, 1.0]], &[6.0, 11.0]);
        assert_eq!((rank, found), (2, vec![(0, 2.0), (1, 3.0)]));
    }

    #[test]
    fn what_the_rows_do_not_determine_stays_at_zero() {
        let (rank, found) = solve(&[&[1.0, 0.0, 5.0], &[2.0, 0.0, 10.0]], &[10.0, 20.0]);
        assert_eq!((rank, found), (1, vec![(2, 2.0)]), "the largest of the row, the empty column never");
        assert_eq!(solve(&[&[0.0, 0.0]], &[1.0]), (0, Vec::new()));
    }
}
