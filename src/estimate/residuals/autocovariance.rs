//! Sums of lagged products: the autocovariances of a series with gaps, and of one series with another.

/// Products of a series with itself, lag by lag, over the pairs that are present.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Lagged {
    /// Sum of `v(i) v(i+k)` for k = 0, 1, ...
    pub(crate) sums: Vec<f64>,
    /// Pairs in each sum.
    pub(crate) pairs: Vec<usize>,
}

impl Lagged {
    /// No pair yet, for lags 0 to `most`.
    pub(crate) fn none(most: usize) -> Self {
        Self { sums: vec![0.0; most + 1], pairs: vec![0; most + 1] }
    }

    /// Adds a series; NaN where there is no value.
    pub(crate) fn add(&mut self, series: &[f64]) {
        let present: Vec<bool> = series.iter().map(|v| !v.is_nan()).collect();
        let filled: Vec<f64> = series.iter().map(|v| if v.is_nan() { 0.0 } else { *v }).collect();
        let whole = present.iter().all(|p| *p);
        add_lagged_products(&filled, &filled, 1, &mut self.sums);
        for k in 0..self.sums.len().min(series.len()) {
            self.pairs[k] += match whole {
                true => series.len() - k,
                false => present.iter().zip(&present[k..]).filter(|(a, b)| **a && **b).count(),
            };
        }
    }

    /// The sums of one series.
    pub(crate) fn of(series: &[f64], most: usize) -> Self {
        let mut lagged = Self::none(most.min(series.len().saturating_sub(1)));
        lagged.add(series);
        lagged
    }

    /// Mean products for lags 0, 1, ...; zero where there is no pair.
    pub(crate) fn means(&self) -> impl Iterator<Item = f64> {
        self.sums.iter().zip(&self.pairs).map(|(sum, pairs)| sum / (*pairs).max(1) as f64)
    }

    /// Autocorrelations for lags 1, 2, ...: sums relative to that of lag 0.
    pub(crate) fn correlations(&self) -> impl Iterator<Item = f64> {
        self.sums[1..].iter().map(|s| s / self.sums[0])
    }
}

/// The values without their mean; NaN stays.
pub(crate) fn centred(mut series: Vec<f64>) -> Vec<f64> {
    let (sum, count) = total(&series);
    let mean = sum / count.max(1) as f64;
    series.iter_mut().for_each(|v| *v -= mean);
    series
}

use fdm_numeric::lanes::{Aligned, Simd, WithSimd, dispatch};

/// The sum of the values that are there, and how many there are.
pub(crate) fn total(series: &[f64]) -> (f64, usize) {
    let (whole, rest) = series.as_chunks::<8>();
    let (mut sums, mut missing) = ([0.0; 8], [0; 8]);
    let mut add = |l: usize, v: f64| {
        sums[l] += if v.is_nan() { 0.0 } else { v };
        missing[l] += usize::from(v.is_nan());
    };
    whole.iter().for_each(|eight| (0..8).for_each(|l| add(l, eight[l])));
    rest.iter().enumerate().for_each(|(l, v)| add(l, *v));
    (together(sums), series.len() - missing.iter().sum::<usize>())
}

/// The sum of the products of two series.
pub(crate) fn inner(a: &[f64], b: &[f64]) -> f64 {
    let mut sum = [0.0];
    add_lagged_products(a, b, 1, &mut sum);
    sum[0]
}

/// Lags that are summed side by side.
const LAGS: usize = 4;
/// Numbers of a series that stay in the nearest cache while all lags are taken.
const BLOCK: usize = 512;
/// Lags of rows that are summed side by side, whole vectors apart: a vector that has been read serves several rows and
/// several lags.
const LAGS_OF_ROWS: usize = 8;
/// Rows that serve each other.
const TILE: usize = 4;
/// Rows of which the columns of vectors stay in the nearest cache.
const ROWS: usize = 128;

/// Adds to `sums[k]` the sum over i of `early[i] late[i + k step]`, as far as both reach. The order of the sums depends on the
/// lengths alone, not on the processor.
pub(crate) fn add_lagged_products(early: &[f64], late: &[f64], step: usize, sums: &mut [f64]) {
    dispatch(Lags { early, late, step, sums });
}

struct Lags<'a> {
    early: &'a [f64],
    late: &'a [f64],
    step: usize,
    sums: &'a mut [f64],
}

impl WithSimd for Lags<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let step = self.step;
        if step.is_multiple_of(8) && self.early.len().is_multiple_of(step) && self.late.len().is_multiple_of(8) {
            return self.of_rows(simd);
        }
        for (block, early) in self.early.chunks(BLOCK).enumerate() {
            for (group, sums) in self.sums.chunks_mut(LAGS).enumerate() {
                let first = block * BLOCK + group * LAGS * step;
                let late = self.late.get(first..).unwrap_or_default();
                if sums.len() == LAGS && late.len() >= (LAGS - 1) * step + early.len() {
                    several::<S, LAGS>(simd, early, late, step, sums);
                    continue;
                }
                for (l, sum) in sums.iter_mut().enumerate() {
                    let late = late.get(l * step..).unwrap_or_default();
                    let early = &early[..early.len().min(late.len())];
                    several::<S, 1>(simd, early, late, 0, std::slice::from_mut(sum));
                }
            }
        }
    }
}

impl Lags<'_> {
    /// Rows of `step` numbers, column by column of vectors, all lags in eight sums side by side.
    #[inline(always)]
    fn of_rows<S: Simd>(self, simd: S) {
        let Self { early, late, step, sums } = self;
        let across = step / S::F64_LANES;
        let (early, late) = (S::as_simd_f64s(early).0, S::as_simd_f64s(late).0);
        let lags = sums.len().next_multiple_of(LAGS_OF_ROWS);
        let mut total = vec![[0.0; 8]; lags];
        let mut room = [(); 2].map(|()| Aligned::<f64>::new((ROWS + lags) * S::F64_LANES));
        let [near, far] = room.each_mut().map(|room| S::as_mut_simd_f64s(room).0);
        let rows = early.len() / across;
        for first in (0..rows).step_by(ROWS) {
            let count = ROWS.min(rows - first).next_multiple_of(TILE);
            let (early, late) = (&early[first * across..], late.get(first * across..).unwrap_or_default());
            for vector in 0..across {
                column(simd, early, across, vector, &mut near[..count]);
                column(simd, late, across, vector, &mut far[..count + lags]);
                tiles(simd, &near[..count], far, vector * S::F64_LANES % 8, &mut total);
            }
        }
        sums.iter_mut().zip(total).for_each(|(sum, own)| *sum += together(own));
    }
}

/// All lags of two columns; of the eight sums those from `part` on that a register holds.
#[inline(always)]
fn tiles<S: Simd>(simd: S, near: &[S::f64s], far: &[S::f64s], part: usize, total: &mut [[f64; 8]]) {
    for (group, total) in total.as_chunks_mut::<LAGS_OF_ROWS>().0.iter_mut().enumerate() {
        let far = &far[group * LAGS_OF_ROWS..];
        let mut sums = [simd.splat_f64s(0.0); LAGS_OF_ROWS];
        for (sum, total) in sums.iter_mut().zip(&*total) {
            *sum = S::as_simd_f64s(&total[part..]).0[0];
        }
        for (tile, near) in near.as_chunks::<TILE>().0.iter().enumerate() {
            let Some(far) = far[tile * TILE..].first_chunk::<{ TILE + LAGS_OF_ROWS - 1 }>() else { return };
            for r in 0..TILE {
                for l in 0..LAGS_OF_ROWS {
                    sums[l] = simd.mul_add_f64s(near[r], far[r + l], sums[l]);
                }
            }
        }
        for (sum, total) in sums.iter().zip(total) {
            S::as_mut_simd_f64s(&mut total[part..]).0[0] = *sum;
        }
    }
}

/// `L` lags, each over all of `early`, in eight sums side by side.
#[inline(always)]
fn several<S: Simd, const L: usize>(simd: S, early: &[f64], late: &[f64], step: usize, sums: &mut [f64]) {
    let mut total = [[0.0; 8]; L];
    let (whole, rest) = early.as_chunks::<8>();
    let mut late_of = [late; L];
    for (l, of) in late_of.iter_mut().enumerate() {
        *of = &late[l * step..][..early.len()];
    }
    // of the eight sums as many at a time as a register holds
    for part in (0..8).step_by(S::F64_LANES) {
        let mut sums = [simd.splat_f64s(0.0); L];
        for (i, a) in whole.iter().enumerate() {
            let a = S::as_simd_f64s(&a[part..]).0[0];
            for l in 0..L {
                let b = S::as_simd_f64s(&late_of[l][8 * i + part..]).0[0];
                sums[l] = simd.mul_add_f64s(a, b, sums[l]);
            }
        }
        for l in 0..L {
            S::as_mut_simd_f64s(&mut total[l][part..]).0[0] = sums[l];
        }
    }
    let done = 8 * whole.len();
    for (l, sum) in sums.iter_mut().enumerate().take(L) {
        for (k, a) in rest.iter().enumerate() {
            total[l][k] = a.mul_add(late_of[l][done + k], total[l][k]);
        }
        *sum += together(total[l]);
    }
}

/// The eight sums as one.
#[inline(always)]
fn together([a, b, c, d, e, f, g, h]: [f64; 8]) -> f64 {
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}

/// A column of vectors, a row each; zeros where there are no more.
#[inline(always)]
fn column<S: Simd>(simd: S, rows: &[S::f64s], across: usize, vector: usize, to: &mut [S::f64s]) {
    let mut rows = rows.chunks(across).map(|row| row.get(vector));
    to.fill_with(|| rows.next().flatten().copied().unwrap_or_else(|| simd.splat_f64s(0.0)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_across_a_gap_count_and_missing_values_do_not() {
        let lagged = Lagged::of(&[1.0, 2.0, f64::NAN, 3.0], 5);
        assert_eq!(lagged, Lagged { sums: vec![14.0, 2.0, 6.0, 3.0], pairs: vec![3, 1, 1, 1] });
        assert_eq!(centred(vec![1.0, f64::NAN, 3.0])[2], 1.0);
    }
}

#[cfg(test)]
mod product_tests {
    use super::*;

    #[test]
    fn sums_are_those_of_the_definition_for_every_length_and_step() {
        for (n, m, step, lags) in [
            (1300, 1300, 1, 61),
            (1312, 900, 16, 61),
            (1312, 904, 16, 61),
            (1312, 920, 16, 61),
            (48, 56, 24, 5),
            (24, 24, 24, 3),
            (7, 5, 3, 9),
            (0, 4, 1, 3),
            (40, 2000, 8, 12),
            (4104, 7000, 24, 20),
        ] {
            let series = |n: usize, f: f64| (0..n).map(|k| (k as f64 * f).sin()).collect::<Vec<_>>();
            let (early, late) = (series(n, 0.7), series(m, 1.1));
            let mut sums = vec![1.0; lags];
            add_lagged_products(&early, &late, step, &mut sums);
            for (k, sum) in sums.iter().enumerate() {
                let pairs = early.iter().zip(late.iter().skip(k * step));
                let want = 1.0 + pairs.map(|(a, b)| a * b).sum::<f64>();
                assert!((sum - want).abs() < 1e-10, "{n} {m} {step} lag {k}: {sum} {want}");
            }
        }
    }
}
