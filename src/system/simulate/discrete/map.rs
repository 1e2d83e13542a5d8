//! The one loop that everything spends its time in: rows of lanes from rows of lanes,
//! `out = sum over j of T_j s_j + sum over m of K_m f_m` ([`LinearMap`]).
//!
//! Without sensitivities the lanes hold the states (`response.rs`).

use fdm_numeric::lanes::{Aligned, Simd};

/// A linear map of the states and their sensitivities, with what drives it.
///
/// A row holds the derivatives by the parameters and then the value itself. The values of the states, which have a lane of
/// their own, drive the derivatives like inputs: the coefficients' derivatives times the states.
pub(super) struct LinearMap {
    pub(super) rows: usize,
    pub(super) states: usize,
    /// Numbers of the feed.
    pub(super) terms: usize,
    /// Lanes of a row, whole vectors.
    pub(super) width: usize,
    /// The lane of the values.
    pub(super) lane: usize,
    /// Coefficients of the feed and then of the states' values, each rows by width.
    pub(super) forcing: Aligned,
    /// Coefficients of the states' rows, states by rows.
    pub(super) flow: Vec<f64>,
}

impl LinearMap {
    pub(super) fn new(rows: usize, states: usize, terms: usize, (width, lane): (usize, usize)) -> Self {
        let forcing = Aligned::new((terms + states) * rows * width);
        Self { rows, states, terms, width, lane, forcing, flow: vec![0.0; states * rows] }
    }

    /// Coefficients of one number of the feed in one row.
    pub(super) fn forcing_of(&mut self, term: usize, row: usize) -> &mut [f64] {
        &mut self.forcing[(term * self.rows + row) * self.width..][..self.width]
    }

    /// The coefficient of one number of the feed in one row, in the lane of the values.
    pub(super) fn value_of(&self, term: usize, row: usize) -> f64 {
        self.forcing[(term * self.rows + row) * self.width + self.lane]
    }

    /// Applies a map of states to states again and again: `rows` begins with the states before the first of `count` steps and
    /// takes those after each, `apart` numbers from step to step. `feed` has one row of `terms` numbers for every step.
    #[inline(always)]
    pub(super) fn march<S: Simd>(&self, simd: S, rows: &mut [f64], apart: usize, feed: &[f64], count: usize) {
        let tallest = if S::F64_LANES >= 8 { 8 } else { 4 };
        // single lanes never make up a row of one or two: the kernels are not even compiled for them
        if const { S::F64_LANES > 1 } && self.rows <= tallest {
            match self.width / S::F64_LANES {
                1 => return self.march_of::<S, 1>(simd, rows, apart, feed, count),
                2 => return self.march_of::<S, 2>(simd, rows, apart, feed, count),
                _ => {}
            }
        }
        let size = self.rows * self.width;
        for k in 0..count {
            let (before, after) = rows[k * apart..].split_at_mut(apart);
            self.apply(simd, &before[..size], &feed[k * self.terms..], &mut after[..size]);
        }
    }

    #[inline(always)]
    fn march_of<S: Simd, const C: usize>(&self, simd: S, rows: &mut [f64], apart: usize, feed: &[f64], count: usize) {
        match self.rows {
            0 => {}
            1 => self.march_in_registers::<S, 1, C>(simd, rows, apart, feed, count),
            2 => self.march_in_registers::<S, 2, C>(simd, rows, apart, feed, count),
            3 => self.march_in_registers::<S, 3, C>(simd, rows, apart, feed, count),
            4 => self.march_in_registers::<S, 4, C>(simd, rows, apart, feed, count),
            5 => self.march_in_registers::<S, 5, C>(simd, rows, apart, feed, count),
            6 => self.march_in_registers::<S, 6, C>(simd, rows, apart, feed, count),
            7 => self.march_in_registers::<S, 7, C>(simd, rows, apart, feed, count),
            _ => self.march_in_registers::<S, 8, C>(simd, rows, apart, feed, count),
        }
    }

    /// R states in C vectors each: the sums of a step stay in registers. The same operations in the same order as `apply`.
    #[inline(always)]
    fn march_in_registers<S: Simd, const R: usize, const C: usize>(
        &self,
        simd: S,
        rows: &mut [f64],
        apart: usize,
        feed: &[f64],
        count: usize,
    ) {
        let (size, terms, coefficients) = (R * C * S::F64_LANES, self.terms, self.coefficients::<S, R, C>());
        for k in 0..count {
            let (before, after) = rows[k * apart..].split_at_mut(apart);
            let sum = coefficients.sums(simd, R, &before[..size], &feed[k * terms..][..terms]);
            put(sum, S::as_mut_simd_f64s(&mut after[..size]).0);
        }
    }

    /// Applies a map to the states of `count` samples, with one row of the feed for each; the rows that it gives stand behind theirs. From
    /// sample to sample it is `apart` numbers.
    #[inline(always)]
    pub(super) fn sweep<S: Simd>(&self, simd: S, rows: &mut [f64], apart: usize, feed: &[f64], count: usize) {
        if const { S::F64_LANES > 1 } {
            match (self.rows, self.width / S::F64_LANES) {
                (1, 1) => return self.sweep_in_registers::<S, 1, 1>(simd, rows, apart, feed, count),
                (1, 2) => return self.sweep_in_registers::<S, 1, 2>(simd, rows, apart, feed, count),
                (2, 1) => return self.sweep_in_registers::<S, 2, 1>(simd, rows, apart, feed, count),
                (2, 2) => return self.sweep_in_registers::<S, 2, 2>(simd, rows, apart, feed, count),
                _ => {}
            }
        }
        let (size, own) = (self.states * self.width, self.rows * self.width);
        for k in 0..count {
            let (states, out) = rows[k * apart..][..size + own].split_at_mut(size);
            self.apply(simd, states, &feed[k * self.terms..], out);
        }
    }

    #[inline(always)]
    fn sweep_in_registers<S: Simd, const R: usize, const C: usize>(
        &self,
        simd: S,
        rows: &mut [f64],
        apart: usize,
        feed: &[f64],
        count: usize,
    ) {
        let (width, terms, states) = (C * S::F64_LANES, self.terms, self.states);
        let (size, coefficients) = (states * width, self.coefficients::<S, R, C>());
        for k in 0..count {
            let (before, out) = rows[k * apart..][..size + R * width].split_at_mut(size);
            let sum = coefficients.sums(simd, states, before, &feed[k * terms..][..terms]);
            put(sum, S::as_mut_simd_f64s(out).0);
        }
    }

    /// The coefficients as rows of vectors, found once for many steps.
    #[inline(always)]
    fn coefficients<S: Simd, const R: usize, const C: usize>(&self) -> Coefficients<'_, S, R, C> {
        let forcing = S::as_simd_f64s(&self.forcing).0.as_chunks::<C>().0.as_chunks::<R>().0;
        let (by_feed, by_state) = forcing.split_at(self.terms);
        let lane = self.lane.min(C * S::F64_LANES - 1);
        Coefficients { by_feed, by_state, flow: self.flow.as_chunks().0, lane }
    }

    /// Applies the map to states (rows of lanes) and feed.
    #[inline(always)]
    pub(super) fn apply<S: Simd>(&self, simd: S, s: &[f64], feed: &[f64], out: &mut [f64]) {
        let across = self.width / S::F64_LANES;
        let tallest = if S::F64_LANES >= 8 { 8 } else { 4 };
        let mut row = 0;
        while row < self.rows {
            let rows = (self.rows - row).min(tallest);
            let mut vector = 0;
            while vector < across {
                let wide = (across - vector).min(2);
                match wide {
                    1 => self.tiles::<S, 1>(simd, (row, rows), vector, s, feed, out),
                    _ => self.tiles::<S, 2>(simd, (row, rows), vector, s, feed, out),
                }
                vector += wide;
            }
            row += rows;
        }
    }

    #[inline(always)]
    fn tiles<S: Simd, const C: usize>(
        &self,
        simd: S,
        (row, rows): (usize, usize),
        vector: usize,
        s: &[f64],
        feed: &[f64],
        out: &mut [f64],
    ) {
        match rows {
            1 => self.tile::<S, 1, C>(simd, row, vector, s, feed, out),
            2 => self.tile::<S, 2, C>(simd, row, vector, s, feed, out),
            3 => self.tile::<S, 3, C>(simd, row, vector, s, feed, out),
            4 => self.tile::<S, 4, C>(simd, row, vector, s, feed, out),
            5 => self.tile::<S, 5, C>(simd, row, vector, s, feed, out),
            6 => self.tile::<S, 6, C>(simd, row, vector, s, feed, out),
            7 => self.tile::<S, 7, C>(simd, row, vector, s, feed, out),
            _ => self.tile::<S, 8, C>(simd, row, vector, s, feed, out),
        }
    }

    /// R rows, C vectors of them, held in registers. What does not depend on the step before comes first.
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const C: usize>(
        &self,
        simd: S,
        row: usize,
        vector: usize,
        s: &[f64],
        feed: &[f64],
        out: &mut [f64],
    ) {
        let (width, across) = (self.width, self.width / S::F64_LANES);
        let mut sum = [[simd.splat_f64s(0.0); C]; R];
        let s = &s[..self.states * width];
        let vectors = S::as_simd_f64s(s).0;
        let forcing = S::as_simd_f64s(&self.forcing).0;
        let (by_feed, by_state) = forcing.split_at(self.terms * self.rows * across);
        let block = self.rows * across;
        let first = row * across + vector;
        for m in 0..self.terms {
            add::<S, R, C>(simd, feed[m], &by_feed[m * block + first..], across, &mut sum);
        }
        for j in 0..self.states {
            add::<S, R, C>(simd, s[j * width + self.lane], &by_state[j * block + first..], across, &mut sum);
        }
        for j in 0..self.states {
            let (x, factors) = (&vectors[j * across + vector..][..C], &self.flow[j * self.rows + row..][..R]);
            for r in 0..R {
                let factor = simd.splat_f64s(factors[r]);
                for c in 0..C {
                    sum[r][c] = simd.mul_add_f64s(factor, x[c], sum[r][c]);
                }
            }
        }
        let out = S::as_mut_simd_f64s(out).0;
        for r in 0..R {
            for c in 0..C {
                out[(row + r) * across + vector + c] = sum[r][c];
            }
        }
    }
}

/// The coefficients of a map of R rows of C vectors: of the feed, of the states' values, of the states' rows.
struct Coefficients<'m, S: Simd, const R: usize, const C: usize> {
    by_feed: &'m [[[S::f64s; C]; R]],
    by_state: &'m [[[S::f64s; C]; R]],
    flow: &'m [[f64; R]],
    lane: usize,
}

impl<S: Simd, const R: usize, const C: usize> Coefficients<'_, S, R, C> {
    /// All rows.
    #[inline(always)]
    fn sums(&self, simd: S, states: usize, before: &[f64], feed: &[f64]) -> [[S::f64s; C]; R] {
        let width = C * S::F64_LANES;
        let (before, x) = (&before[..states * width], S::as_simd_f64s(before).0.as_chunks::<C>().0);
        let (by_feed, by_state) = (&self.by_feed[..feed.len()], &self.by_state[..states]);
        let (flow, x) = (&self.flow[..states], &x[..states]);
        let mut sum = [[simd.splat_f64s(0.0); C]; R];
        for m in 0..feed.len() {
            axpy(simd, feed[m], &by_feed[m], &mut sum);
        }
        for j in 0..states {
            axpy(simd, before[j * width + self.lane], &by_state[j], &mut sum);
        }
        for j in 0..states {
            for r in 0..R {
                let factor = simd.splat_f64s(flow[j][r]);
                for c in 0..C {
                    sum[r][c] = simd.mul_add_f64s(factor, x[j][c], sum[r][c]);
                }
            }
        }
        sum
    }
}

/// `sum += f k`.
#[inline(always)]
fn axpy<S: Simd, const R: usize, const C: usize>(simd: S, f: f64, k: &[[S::f64s; C]; R], sum: &mut [[S::f64s; C]; R]) {
    let f = simd.splat_f64s(f);
    for r in 0..R {
        for c in 0..C {
            sum[r][c] = simd.mul_add_f64s(f, k[r][c], sum[r][c]);
        }
    }
}

/// Writes rows one after the other.
#[inline(always)]
fn put<V: Copy, const R: usize, const C: usize>(sum: [[V; C]; R], out: &mut [V]) {
    let out = &mut out[..R * C];
    for r in 0..R {
        for c in 0..C {
            out[r * C + c] = sum[r][c];
        }
    }
}

/// `sum += f k`, R rows of which the first C vectors are meant.
#[inline(always)]
fn add<S: Simd, const R: usize, const C: usize>(
    simd: S,
    f: f64,
    k: &[S::f64s],
    across: usize,
    sum: &mut [[S::f64s; C]; R],
) {
    let f = simd.splat_f64s(f);
    let k = &k[..(R - 1) * across + C];
    for r in 0..R {
        for c in 0..C {
            sum[r][c] = simd.mul_add_f64s(f, k[r * across + c], sum[r][c]);
        }
    }
}
