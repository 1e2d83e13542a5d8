//! One Runge-Kutta step of the sensitivities: `S' = f_x S + f_theta`, all parameters in lanes.
//!
//! Lanes never mix: the result has the same bits whatever the width of the machine's registers, because every one of them is computed by the
//! same fused multiply-adds. Few states stay in registers. Of many states some columns are worked off at a time, and the four stages follow
//! each other from row to row: a stage is at a row as soon as those rows have been through the stage before that it depends on. What is
//! between two stages is then a few rows, which stay in the innermost cache however many states there are. And of f_x, f_theta and S only
//! what can be other than zero is touched. Zeros that are left out change no bit: they are added to sums that begin with zero.
//!
//! Sensitivities of one run by the classical Runge-Kutta method: `S' = f_x S + f_theta`, all parameters in lanes.
//!
//! The four stages' partials are known before (they do not depend on S), so a step is linear in S (`tangent.rs`).
//!
//! The state chain is bound by latency, the sensitivities by throughput; running the states one step ahead lets the
//! processor overlap both, and gives the forcing terms, written one by one, time to reach the cache before they are read
//! as vectors.

use super::blocks::{Gathering, RowLayout, Sink};
use super::error::Divergence;
use super::event_steps;
use super::trajectory::{Observation, Scatter, scatter};
use super::trajectory::{Trajectory, finite, two_nodes};
use crate::dynamics::{Dynamics, Layout, Step};
use fdm_grammar::Pattern;
use fdm_grammar::graph::Signal;
use fdm_numeric::lanes::{Aligned, Simd, VECTOR, WithSimd, copy_vectors, dispatch};
use std::collections::BTreeSet;
use std::ops::Range;

/// Vectors of [`VECTOR`] lanes that are worked off together: their sums stay in registers, and the more they are the fewer instructions
/// are spent on finding entries. Fewer where many rows lie between two stages.
const VECTORS: usize = 8;
const VECTORS_OF_MANY: usize = 4;

/// Where the four stages' partials stand, and what of S they can reach.
#[derive(Debug, Clone)]
pub(super) struct TangentPlan {
    states: usize,
    /// First lane of f_theta in a stage's row, lanes of each row of f_theta and S, length of a stage's row.
    forcing: usize,
    lanes: usize,
    width: usize,
    /// Whether f_x is written as full rows; else columns are worked off tile by tile.
    dense: bool,
    tiles: Vec<Tile>,
    /// The rows and entries of all shapes, one after the other.
    rows: Vec<TileRow>,
    entries: Vec<Entry>,
    /// For each tile and each of its rows the vectors in which f_theta can be other than zero, a bit each.
    forced: Vec<u32>,
}

/// Neighbouring columns of S.
#[derive(Debug, Clone)]
struct Tile {
    /// First of its vectors of [`VECTOR`] lanes, and their number.
    first: usize,
    vectors: usize,
    /// Its rows that can be other than zero, in the order in which they are worked off; tiles with the same rows share them.
    rows: Range<usize>,
    /// Rows by which a stage stays behind the one before.
    lag: usize,
    /// Rows of the memory between the stages, which is used in turn.
    ring: usize,
    /// The first of its rows in `forced`.
    forced: usize,
}

/// A row of S in a tile.
#[derive(Debug, Clone, PartialEq)]
struct TileRow {
    state: u32,
    /// Its place in the memory between the stages.
    slot: u32,
    /// Its entries of f_x whose columns can be other than zero.
    entries: Range<u32>,
}

/// An entry of f_x: where it stands in a stage's row, and where the row of S that it takes stands between the stages.
#[derive(Debug, Clone, PartialEq)]
struct Entry {
    at: u32,
    slot: u32,
}

impl TangentPlan {
    /// For these columns of S (parameters); others that share no vector with them are left as they are.
    pub(super) fn new(layout: &Layout, columns: &[usize]) -> Self {
        let stage = &layout.stage;
        let mut plan = Self {
            states: layout.states,
            forcing: stage.forcing,
            lanes: stage.lanes,
            width: stage.width,
            dense: stage.dense,
            tiles: Vec::new(),
            rows: Vec::new(),
            entries: Vec::new(),
            forced: Vec::new(),
        };
        if !plan.dense {
            plan.cut(layout, columns);
        }
        plan
    }

    /// Cuts the columns into tiles of neighbouring vectors that are asked for.
    fn cut(&mut self, layout: &Layout, columns: &[usize]) {
        let Reach { forced, reached } = Reach::new(layout);
        let across = self.lanes / VECTOR;
        let mut asked = vec![false; across];
        columns.iter().filter_map(|c| layout.stage.lane[*c]).for_each(|l| asked[l as usize / VECTOR] = true);
        // states of the tiles so far, in the order of their rows
        let mut shapes: Vec<(Vec<u32>, Tile)> = Vec::new();
        let mut first = 0;
        while first < across {
            let run = asked[first..].iter().take_while(|asked| **asked).count();
            if run == 0 {
                first += 1;
                continue;
            }
            let any = |table: &[bool], i: u32, vectors: usize| {
                table[i as usize * across + first..][..vectors].iter().any(|other_than_zero| *other_than_zero)
            };
            let states_of = |vectors: usize| -> Vec<u32> {
                (0..layout.states as u32).filter(|i| any(&reached, *i, vectors)).collect()
            };
            let mut vectors = run.min(VECTORS);
            let mut states = states_of(vectors);
            let mut tile = self.shape(layout, &mut states, &mut shapes);
            // rows between the stages from which they are many: five arrays of them leave the innermost cache
            if tile.ring > 16 && VECTORS_OF_MANY < vectors {
                vectors = VECTORS_OF_MANY;
                states = states_of(vectors);
                tile = self.shape(layout, &mut states, &mut shapes);
            }
            self.tiles.push(Tile { first, vectors, forced: self.forced.len(), ..tile });
            let own = |i: &u32| -> u32 {
                let row = &forced[*i as usize * across + first..][..vectors];
                row.iter().enumerate().map(|(v, forced)| u32::from(*forced) << v).sum()
            };
            self.forced.extend(states.iter().map(own));
            first += vectors;
        }
    }

    /// The rows of tiles in which the rows of these states (rising) can be other than zero; the states are put in the order of the rows.
    fn shape(&mut self, layout: &Layout, states: &mut Vec<u32>, shapes: &mut Vec<(Vec<u32>, Tile)>) -> Tile {
        let f_x = &layout.patterns.rates_by_state;
        let ordered = order(f_x, states);
        if let Some((_, tile)) = shapes.iter().find(|(own, _)| *own == ordered) {
            *states = ordered;
            return tile.clone();
        }
        let mut place = vec![None; layout.states];
        ordered.iter().enumerate().for_each(|(r, state)| place[*state as usize] = Some(r));
        let (lag, back) = reaches(f_x, &ordered, &place);
        // until the last stage that reads it is behind it, a row keeps its slot
        let ring = ((3 * lag).max(lag + back) + 1).min(ordered.len().max(1));
        let (lag, start) = (lag.min(ordered.len()), self.rows.len());
        for (r, state) in ordered.iter().enumerate() {
            let begin = self.entries.len() as u32;
            let entries = f_x.row(*state as usize).filter_map(|(k, j)| Some((k, place[j]?)));
            let at = |(k, row): (usize, usize)| Entry { at: layout.stage.by_state[k], slot: (row % ring) as u32 };
            self.entries.extend(entries.map(at));
            let entries = begin..self.entries.len() as u32;
            self.rows.push(TileRow { state: *state, slot: (r % ring) as u32, entries });
        }
        let tile = Tile { first: 0, vectors: 0, rows: start..self.rows.len(), lag, ring, forced: 0 };
        shapes.push((ordered.clone(), tile.clone()));
        *states = ordered;
        tile
    }

    /// Length of the scratch that [`TangentPlan::step`] needs: of the rows between the stages S at the beginning, three stage tangents and
    /// the sum of the slopes.
    pub(super) fn scratch(&self) -> usize {
        self.tiles.iter().map(|t| 5 * t.ring * t.vectors * VECTOR).max().unwrap_or(0)
    }

    /// [`Self::step`] by itself, for whoever has no loop that is dispatched.
    pub(super) fn advance(&self, h: f64, partials: &[f64], s: &mut [f64], scratch: &mut [f64]) {
        dispatch(Single { plan: self, h, partials, s, scratch });
    }

    /// Advances S (n by lanes) by one step of length h; `partials` are the four rows of `step_with_partials`.
    #[inline(always)]
    pub(super) fn step<S: Simd>(&self, simd: S, h: f64, partials: &[f64], s: &mut [f64], scratch: &mut [f64]) {
        match (self.dense, self.states) {
            (true, 1) => simd.vectorize(Dense::<1> { plan: self, h, partials, s }),
            (true, 2) => simd.vectorize(Dense::<2> { plan: self, h, partials, s }),
            (true, 3) => simd.vectorize(Dense::<3> { plan: self, h, partials, s }),
            (true, 4) => simd.vectorize(Dense::<4> { plan: self, h, partials, s }),
            (true, 5) => simd.vectorize(Dense::<5> { plan: self, h, partials, s }),
            (true, 6) => simd.vectorize(Dense::<6> { plan: self, h, partials, s }),
            _ => simd.vectorize(Sparse { plan: self, h, partials, s, scratch }),
        }
    }
}

/// An order of states in which those that depend on each other are near: their own, or that of Cuthill and McKee (1969), whichever lets the
/// stages follow each other more closely.
fn order(f_x: &Pattern, states: &[u32]) -> Vec<u32> {
    let n = states.len();
    let mut place = vec![None; f_x.rows.len()];
    states.iter().enumerate().for_each(|(r, state)| place[*state as usize] = Some(r));
    let mut beside: Vec<BTreeSet<usize>> = vec![BTreeSet::new(); n];
    for (r, state) in states.iter().enumerate() {
        for c in f_x.row(*state as usize).filter_map(|(_, j)| place[j]).filter(|c| *c != r) {
            beside[r].insert(c);
            beside[c].insert(r);
        }
    }
    let mut by_degree: Vec<usize> = (0..n).collect();
    by_degree.sort_by_key(|r| beside[*r].len());
    let (mut met, mut found) = (vec![false; n], Vec::with_capacity(n));
    for root in &by_degree {
        let mut next = found.len();
        if !std::mem::replace(&mut met[*root], true) {
            found.push(*root);
        }
        while next < found.len() {
            let mut others: Vec<usize> = beside[found[next]].iter().copied().filter(|c| !met[*c]).collect();
            others.sort_by_key(|c| beside[*c].len());
            others.iter().for_each(|c| met[*c] = true);
            found.extend(others);
            next += 1;
        }
    }
    let near: Vec<u32> = found.iter().map(|r| states[*r]).collect();
    let width = |order: &[u32]| {
        let mut place = vec![None; f_x.rows.len()];
        order.iter().enumerate().for_each(|(r, state)| place[*state as usize] = Some(r));
        reaches(f_x, order, &place)
    };
    if width(&near) < width(states) { near } else { states.to_vec() }
}

/// How many rows ahead of itself a row depends on at most, and how many behind.
fn reaches(f_x: &Pattern, order: &[u32], place: &[Option<usize>]) -> (usize, usize) {
    let mut reach = (0, 0);
    for (r, state) in order.iter().enumerate() {
        for c in f_x.row(*state as usize).filter_map(|(_, j)| place[j]) {
            reach = (reach.0.max(c.saturating_sub(r)), reach.1.max(r.saturating_sub(c)));
        }
    }
    reach
}

/// What can be other than zero, by state and vector of lanes (n by vectors each).
struct Reach {
    /// f_theta, with what delays add to it.
    forced: Vec<bool>,
    /// S at any time.
    reached: Vec<bool>,
}

impl Reach {
    fn new(layout: &Layout) -> Self {
        let (p, stage, n) = (&layout.patterns, &layout.stage, layout.states);
        let across = stage.lanes / VECTOR;
        let place = |i: usize, j: usize| stage.lane[j].map(|lane| i * across + lane as usize / VECTOR);
        let mut forced = vec![false; n * across];
        p.rates_by_param.entries().filter_map(|(_, i, j)| place(i, j)).for_each(|at| forced[at] = true);
        for (_, i, d) in p.rates_by_delayed.entries() {
            match layout.delayed[d] {
                // the past of a state has lanes of its own
                Signal::State(_) => forced[i * across..][..across].fill(true),
                _ => p.tau_by_param.row(d).filter_map(|(_, j)| place(i, j)).for_each(|at| forced[at] = true),
            }
        }
        let mut reached = forced.clone();
        p.initial_by_param.entries().filter_map(|(_, i, j)| place(i, j)).for_each(|at| reached[at] = true);
        let limits = p.limits_by_param.entries().filter_map(|(_, row, j)| place(layout.limited[row / 2] as usize, j));
        limits.for_each(|at| reached[at] = true);
        // an event hands the derivative of its instant on to every state
        let mut grown = layout.events.is_empty();
        if !grown {
            reached.fill(true);
        }
        while grown {
            grown = false;
            for (_, i, j) in p.rates_by_state.entries().filter(|(_, i, j)| i != j) {
                for v in 0..across {
                    if reached[j * across + v] && !reached[i * across + v] {
                        reached[i * across + v] = true;
                        grown = true;
                    }
                }
            }
        }
        Self { forced, reached }
    }
}

/// A step by itself.
struct Single<'a> {
    plan: &'a TangentPlan,
    h: f64,
    partials: &'a [f64],
    s: &'a mut [f64],
    scratch: &'a mut [f64],
}

impl WithSimd for Single<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.plan.step(simd, self.h, self.partials, self.s, self.scratch);
    }
}

/// A step of many states: a function of its own too, for it has several callers.
struct Sparse<'a> {
    plan: &'a TangentPlan,
    h: f64,
    partials: &'a [f64],
    s: &'a mut [f64],
    scratch: &'a mut [f64],
}

impl WithSimd for Sparse<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { plan, h, partials, s, scratch } = self;
        Tangent { simd, plan, h, partials }.sparse(s, scratch);
    }
}

/// A step of few states: a function of its own, or all of them together would need a frame that no stack has room for.
struct Dense<'a, const N: usize> {
    plan: &'a TangentPlan,
    h: f64,
    partials: &'a [f64],
    s: &'a mut [f64],
}

impl<const N: usize> WithSimd for Dense<'_, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { plan, h, partials, s } = self;
        Tangent { simd, plan, h, partials }.dense::<N>(s);
    }
}

#[derive(Clone, Copy)]
struct Tangent<'a, S> {
    simd: S,
    plan: &'a TangentPlan,
    h: f64,
    partials: &'a [f64],
}

impl<S: Simd> Tangent<'_, S> {
    /// Few states: everything unrolled, stage tangents in registers.
    #[inline(always)]
    fn dense<const N: usize>(self, s: &mut [f64]) {
        let s = S::as_mut_simd_f64s(s).0;
        let width = self.plan.lanes / S::F64_LANES;
        // single lanes never make up a row of one or two
        if const { S::F64_LANES > 1 } {
            match width {
                1 => return self.dense_tile::<N, 1, 1>(0, 1, s),
                2 => return self.dense_tile::<N, 2, 2>(0, 2, s),
                _ => {}
            }
        }
        let mut tile = 0;
        while tile + 2 <= width {
            self.dense_tile::<N, 2, 0>(tile, width, s);
            tile += 2;
        }
        if tile < width {
            self.dense_tile::<N, 1, 0>(tile, width, s);
        }
    }

    /// L vectors of every row, which has `width` (W of them; any number when that is 0).
    #[inline(always)]
    fn dense_tile<const N: usize, const L: usize, const W: usize>(self, tile: usize, width: usize, s: &mut [S::f64s]) {
        let simd = self.simd;
        let width = if W > 0 { W } else { width };
        let s = &mut s[..N * width];
        let splat = |a: f64| simd.splat_f64s(a);
        let (half, sixth, third, whole) =
            (splat(0.5 * self.h), splat(self.h / 6.0), splat(self.h / 3.0), splat(self.h));
        let mut start = [[half; L]; N];
        for (i, row) in start.iter_mut().enumerate() {
            *row = load(s, i * width + tile, half);
        }
        let k = self.dense_slopes::<N, L, W>(0, tile, width, &start);
        let (x, sum) = (rows(simd, half, &k, &start), rows(simd, sixth, &k, &start));
        let k = self.dense_slopes::<N, L, W>(1, tile, width, &x);
        let (x, sum) = (rows(simd, half, &k, &start), rows(simd, third, &k, &sum));
        let k = self.dense_slopes::<N, L, W>(2, tile, width, &x);
        let (x, sum) = (rows(simd, whole, &k, &start), rows(simd, third, &k, &sum));
        let k = self.dense_slopes::<N, L, W>(3, tile, width, &x);
        for (i, row) in rows(simd, sixth, &k, &sum).into_iter().enumerate() {
            store(s, i * width + tile, row);
        }
    }

    /// `f_x S + f_theta` at a stage.
    #[inline(always)]
    fn dense_slopes<const N: usize, const L: usize, const W: usize>(
        self,
        stage: usize,
        tile: usize,
        width: usize,
        x: &[[S::f64s; L]; N],
    ) -> [[S::f64s; L]; N] {
        let row = &self.partials[stage * self.plan.width..][..self.plan.width];
        let f_x = &row[N..N + N * N];
        let width = if W > 0 { W } else { width };
        let forcing = &S::as_simd_f64s(&row[self.plan.forcing..]).0[..N * width];
        let zero = self.simd.splat_f64s(0.0);
        let mut slopes = [[zero; L]; N];
        for (i, slope) in slopes.iter_mut().enumerate() {
            *slope = load(forcing, i * width + tile, zero);
            for j in 0..N {
                *slope = axpy(self.simd, self.simd.splat_f64s(f_x[i * N + j]), x[j], *slope);
            }
        }
        slopes
    }

    /// Many states: tile by tile, what is between the stages in memory.
    #[inline(always)]
    fn sparse(self, s: &mut [f64], scratch: &mut [f64]) {
        let parts = VECTOR / S::F64_LANES;
        for tile in &self.plan.tiles {
            let (mut first, end) = (tile.first * parts, (tile.first + tile.vectors) * parts);
            while first < end {
                first += match end - first {
                    1 => self.tile::<1>(tile, first, s, scratch),
                    2 => self.tile::<2>(tile, first, s, scratch),
                    3 => self.tile::<3>(tile, first, s, scratch),
                    4..8 => self.tile::<4>(tile, first, s, scratch),
                    _ => self.tile::<8>(tile, first, s, scratch),
                };
            }
        }
    }

    /// Advances the L vectors from `first` on of a tile's rows; columns of S do not depend on each other.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "four stages look at four rows")]
    fn tile<const L: usize>(self, tile: &Tile, first: usize, s: &mut [f64], scratch: &mut [f64]) -> usize {
        let (simd, plan, width) = (self.simd, self.plan, self.plan.lanes / S::F64_LANES);
        let rows = &plan.rows[tile.rows.clone()];
        let forced = &plan.forced[tile.forced..][..rows.len()];
        let (n, lag) = (rows.len(), tile.lag);
        let behind = first / (VECTOR / S::F64_LANES) - tile.first;
        let s = S::as_mut_simd_f64s(s).0;
        let scratch = S::as_mut_simd_f64s(scratch).0.as_chunks_mut::<L>().0;
        let (start, rest) = scratch.split_at_mut(tile.ring);
        let (one, rest) = rest.split_at_mut(tile.ring);
        let (two, rest) = rest.split_at_mut(tile.ring);
        let (three, rest) = rest.split_at_mut(tile.ring);
        let sum = &mut rest[..tile.ring];
        let splat = |a: f64| simd.splat_f64s(a);
        let (half, sixth, third, whole) =
            (splat(0.5 * self.h), splat(self.h / 6.0), splat(self.h / 3.0), splat(self.h));
        for row in &rows[..lag] {
            start[row.slot as usize] = load(s, row.state as usize * width + first, half);
        }
        for at in 0..n + 3 * lag {
            if at + lag < n {
                let row = &rows[at + lag];
                start[row.slot as usize] = load(s, row.state as usize * width + first, half);
            }
            if at < n {
                let (row, slot) = (&rows[at], rows[at].slot as usize);
                let k = self.slope::<L>(0, row, forced[at] >> behind, first, start);
                one[slot] = axpy(simd, half, k, start[slot]);
                sum[slot] = axpy(simd, sixth, k, start[slot]);
            }
            if at >= lag && at - lag < n {
                let (row, slot) = (&rows[at - lag], rows[at - lag].slot as usize);
                let k = self.slope::<L>(1, row, forced[at - lag] >> behind, first, one);
                two[slot] = axpy(simd, half, k, start[slot]);
                sum[slot] = axpy(simd, third, k, sum[slot]);
            }
            if at >= 2 * lag && at - 2 * lag < n {
                let (row, slot) = (&rows[at - 2 * lag], rows[at - 2 * lag].slot as usize);
                let k = self.slope::<L>(2, row, forced[at - 2 * lag] >> behind, first, two);
                three[slot] = axpy(simd, whole, k, start[slot]);
                sum[slot] = axpy(simd, third, k, sum[slot]);
            }
            if at >= 3 * lag {
                let (row, slot) = (&rows[at - 3 * lag], rows[at - 3 * lag].slot as usize);
                let k = self.slope::<L>(3, row, forced[at - 3 * lag] >> behind, first, three);
                store(s, row.state as usize * width + first, axpy(simd, sixth, k, sum[slot]));
            }
        }
        L
    }

    /// A row of `f_x S + f_theta` at a stage, L vectors of it.
    #[inline(always)]
    fn slope<const L: usize>(
        self,
        stage: usize,
        row: &TileRow,
        forced: u32,
        first: usize,
        x: &[[S::f64s; L]],
    ) -> [S::f64s; L] {
        let partials = &self.partials[stage * self.plan.width..][..self.plan.width];
        let zero = self.simd.splat_f64s(0.0);
        let mut k = [zero; L];
        if forced != 0 {
            let width = self.plan.lanes / S::F64_LANES;
            let forcing = &S::as_simd_f64s(&partials[self.plan.forcing..]).0[row.state as usize * width + first..][..L];
            // a row of f_theta is longer than what of it is not zero: the rest is not fetched
            for l in 0..L {
                if forced >> (l / (VECTOR / S::F64_LANES)) & 1 != 0 {
                    k[l] = forcing[l];
                }
            }
        }
        for entry in &self.plan.entries[row.entries.start as usize..row.entries.end as usize] {
            k = axpy(self.simd, self.simd.splat_f64s(partials[entry.at as usize]), x[entry.slot as usize], k);
        }
        k
    }
}

/// L vectors; `any` only fills the array before it is written. Plain loops: closures of the standard library's array
/// functions would be compiled without the wide registers.
#[inline(always)]
fn load<V: Copy, const L: usize>(from: &[V], at: usize, any: V) -> [V; L] {
    let mut v = [any; L];
    v.copy_from_slice(&from[at..at + L]);
    v
}

#[inline(always)]
fn store<V: Copy, const L: usize>(to: &mut [V], at: usize, v: [V; L]) {
    to[at..at + L].copy_from_slice(&v);
}

/// `a x + y`
#[inline(always)]
fn axpy<S: Simd, const L: usize>(simd: S, a: S::f64s, x: [S::f64s; L], y: [S::f64s; L]) -> [S::f64s; L] {
    let mut sum = y;
    for l in 0..L {
        sum[l] = simd.mul_add_f64s(a, x[l], y[l]);
    }
    sum
}

/// `a x + y`, row by row.
#[inline(always)]
fn rows<S: Simd, const N: usize, const L: usize>(
    simd: S,
    a: S::f64s,
    x: &[[S::f64s; L]; N],
    y: &[[S::f64s; L]; N],
) -> [[S::f64s; L]; N] {
    let mut sum = *y;
    for i in 0..N {
        sum[i] = axpy(simd, a, x[i], y[i]);
    }
    sum
}

/// Adds `entry * -slope * tau_theta` to a lane: a delay's part in the forcing.
#[derive(Debug, Clone, Copy)]
pub(super) struct DelayTerm {
    /// Slot of the entry of f_delay.
    entry: u32,
    /// Which delayed signal.
    delayed: u32,
    /// Position of tau_theta in `known`.
    tau: u32,
    /// Slot of the lane.
    to: u32,
    /// Whether the model writes this lane too; otherwise it must be cleared before.
    written: bool,
}

/// Plans and memory for one choice of columns.
pub(super) struct Sensitivity {
    columns: Vec<usize>,
    pub(super) lanes: usize,
    width: usize,
    pub(super) plan: TangentPlan,
    initial: Vec<Scatter>,
    pub(super) rates_by_delay: Vec<DelayTerm>,
    observation: Observation,
    gathering: Gathering,
    /// Rows of one sample without the free lane, when that is not merely padding.
    bare: Vec<f64>,
    pub(super) s: Aligned,
    pub(super) scratch: Aligned,
    partials: [Aligned; 2],
}

impl Sensitivity {
    /// # Panics
    /// As [`Observation::new`].
    pub(super) fn new(dynamics: &dyn Dynamics, columns: &[usize]) -> Self {
        let layout = dynamics.layout();
        let (n, stage, plan) = (layout.states, &layout.stage, TangentPlan::new(layout, columns));
        let observation = Observation::new(layout, columns);
        let rows = RowLayout::full(layout.outputs, columns.len());
        let bare = if rows.length == layout.outputs * observation.stride { 0 } else { observation.stride };
        Self {
            columns: columns.to_vec(),
            lanes: stage.lanes,
            width: stage.width,
            initial: scatter(layout, &layout.patterns.initial_by_param, layout.initial_by_param.start),
            rates_by_delay: delay_terms(layout),
            observation,
            gathering: Gathering::new(rows),
            bare: vec![0.0; layout.outputs * bare],
            s: Aligned::new(n * stage.lanes),
            scratch: Aligned::new(plan.scratch()),
            plan,
            partials: [Aligned::new(4 * stage.width), Aligned::new(4 * stage.width)],
        }
    }

    pub(super) fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// Back to the initial values.
    pub(super) fn begin(&mut self, known: &[f64]) {
        self.gathering.begin();
        self.s.fill(0.0);
        for c in &self.initial {
            self.s[c.to as usize] = known[c.from as usize];
        }
    }

    /// Hands over the samples that are still gathered.
    pub(super) fn flush(&mut self, sink: &mut Sink<'_>) {
        self.gathering.flush(sink);
    }

    /// A whole run for which the trajectory is prepared.
    pub(super) fn run(&mut self, trajectory: &mut Trajectory<'_>, sink: &mut Sink<'_>) -> Result<(), Divergence> {
        self.begin(&trajectory.known);
        if trajectory.events.is_some() || trajectory.cuts.is_some() {
            return event_steps::run(self, trajectory, sink);
        }
        dispatch(March { sensitivity: self, trajectory, sink })
    }

    /// Outputs and their sensitivities at the sample of node k.
    #[inline(always)]
    pub(super) fn observe(
        &mut self,
        trajectory: &mut Trajectory<'_>,
        sample: usize,
        k: usize,
        sink: &mut Sink<'_>,
    ) -> Result<(), Divergence> {
        let (y, rows) = self.gathering.next();
        if self.bare.is_empty() {
            self.observation.observe(trajectory, (sample, k), &self.s, y, rows)?;
        } else {
            self.observation.observe(trajectory, (sample, k), &self.s, y, &mut self.bare)?;
            let stride = self.observation.stride;
            for (row, bare) in rows.chunks_exact_mut(stride + VECTOR).zip(self.bare.chunks_exact(stride.max(1))) {
                copy_vectors(bare, row);
            }
        }
        self.gathering.filled(1, sink);
        Ok(())
    }

    /// One step of the states; their partials go to the buffer of step k.
    #[inline(always)]
    fn advance(&mut self, trajectory: &mut Trajectory<'_>, k: usize) -> Result<(), Divergence> {
        let Trajectory { dynamics, grid, drive, known, nodes, work, stops, .. } = trajectory;
        let (t, h) = grid.step(k);
        let (x, next) = two_nodes(nodes, k);
        let partials = &mut self.partials[k % 2];
        dynamics.step_with_partials(Step { t, h, x, drive: drive.stages(k), known }, next, partials, work);
        stops.hold(k, *dynamics, known, next);
        finite(grid, k, next)?;
        if !self.rates_by_delay.is_empty() {
            let slopes = drive.stage_slopes(k);
            let delays = slopes.len() / 3;
            for (row, at) in partials.chunks_exact_mut(self.width).zip([0, 1, 1, 2]) {
                add_delays(&self.rates_by_delay, row, &slopes[at * delays..][..delays], known);
            }
        }
        Ok(())
    }
}

/// What estimated delays add to f_theta.
pub(super) fn delay_terms(layout: &Layout) -> Vec<DelayTerm> {
    let (p, stage) = (&layout.patterns, &layout.stage);
    let mut terms: Vec<DelayTerm> = Vec::new();
    for (k, i, d) in p.rates_by_delayed.entries() {
        for (entry, j) in p.tau_by_param.row(d) {
            let Some(to) = stage.by_param(i, j) else { continue };
            let by_model = p.rates_by_param.row(i).any(|(_, column)| column == j);
            terms.push(DelayTerm {
                entry: (stage.by_delayed + k) as u32,
                delayed: d as u32,
                tau: (layout.tau_by_param.start + entry) as u32,
                to: to as u32,
                written: by_model || terms.iter().any(|t| t.to == to as u32),
            });
        }
    }
    terms
}

pub(super) fn add_delays(terms: &[DelayTerm], row: &mut [f64], slopes: &[f64], known: &[f64]) {
    for d in terms {
        let part = row[d.entry as usize] * slopes[d.delayed as usize] * known[d.tau as usize];
        let lane = &mut row[d.to as usize];
        *lane = if d.written { *lane } else { 0.0 } - part;
    }
}

/// The loop over the steps, compiled for the machine's widest registers.
struct March<'m, 'a> {
    sensitivity: &'m mut Sensitivity,
    trajectory: &'m mut Trajectory<'a>,
    sink: &'m mut Sink<'m>,
}

impl WithSimd for March<'_, '_> {
    type Output = Result<(), Divergence>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { sensitivity, trajectory, sink } = self;
        let steps = trajectory.grid.steps();
        if steps > 0 {
            sensitivity.advance(trajectory, 0)?;
        }
        for k in 0..=steps {
            if let Some(sample) = trajectory.grid.sample_at(k) {
                sensitivity.observe(trajectory, sample, k, sink)?;
            }
            if k + 1 < steps {
                sensitivity.advance(trajectory, k + 1)?;
            }
            if k < steps {
                let Sensitivity { plan, partials, s, scratch, .. } = &mut *sensitivity;
                plan.step(simd, trajectory.grid.step(k).1, &partials[k % 2], s, scratch);
                trajectory.stops.follow(k, &trajectory.known, s);
            }
        }
        trajectory.stateless(|trajectory, sample| sensitivity.observe(trajectory, sample, 0, sink))?;
        sensitivity.flush(sink);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::model::Model;
    use fdm_numeric::lanes::Aligned;
    use std::fmt::Write;

    /// A chain of masses with a lag before it and a meter behind it, in which its parameters do not reach the lag. States of a mass are
    /// neighbours, or all positions stand before all speeds.
    fn chain(masses: usize, neighbours: bool) -> Model {
        let mut text = String::from("model chain { input u; param a = 2; state lag = free; der(lag) = a*(u - lag);\n");
        for i in (0..masses).filter(|_| !neighbours) {
            write!(text, "state x{i} = 0; ").unwrap();
        }
        for i in 0..masses {
            let before = if i > 0 { format!("x{}", i - 1) } else { "lag".into() };
            let link = |i: usize| if i < masses { format!("k{i}*(x{i} - x{})", i - 1) } else { "0".into() };
            let position = if neighbours { format!("state x{i} = 0;") } else { String::new() };
            writeln!(text, "{position} state v{i} = 0; param k{i} = 3, c{i} = 0.2; der(x{i}) = v{i};").unwrap();
            writeln!(text, "der(v{i}) = -k{i}*(x{i} - {before})^3 - c{i}*v{i} + {};", link(i + 1)).unwrap();
        }
        let last = masses - 1;
        write!(text, "state meter = 0; param b = 1; der(meter) = b*x{last} - meter; output y = meter; }}").unwrap();
        Model::from_text("chain.fdm", &text).unwrap()
    }

    /// The step as it is written, all rows and columns of it.
    fn reference(layout: &Layout, h: f64, partials: &[f64], s: &mut [f64]) {
        let (stage, n, f_x) = (&layout.stage, layout.states, &layout.patterns.rates_by_state);
        let slopes = |k: usize, x: &[f64]| -> Vec<f64> {
            let row = &partials[k * stage.width..][..stage.width];
            let mut slopes = row[stage.forcing..][..n * stage.lanes].to_vec();
            for (entry, i, j) in f_x.entries() {
                for l in 0..stage.lanes {
                    let k = &mut slopes[i * stage.lanes + l];
                    *k = row[stage.by_state[entry] as usize].mul_add(x[j * stage.lanes + l], *k);
                }
            }
            slopes
        };
        let add =
            |a: f64, k: &[f64], x: &[f64]| -> Vec<f64> { k.iter().zip(x).map(|(k, x)| a.mul_add(*k, *x)).collect() };
        let k = slopes(0, s);
        let (x, sum) = (add(0.5 * h, &k, s), add(h / 6.0, &k, s));
        let k = slopes(1, &x);
        let (x, sum) = (add(0.5 * h, &k, s), add(h / 3.0, &k, &sum));
        let k = slopes(2, &x);
        let (x, sum) = (add(h, &k, s), add(h / 3.0, &k, &sum));
        let k = slopes(3, &x);
        s.copy_from_slice(&add(h / 6.0, &k, &sum));
    }

    #[test]
    fn tiles_give_the_bits_of_the_whole_step_and_leave_out_what_no_parameter_reaches() {
        for (masses, neighbours) in [(3, true), (9, true), (60, true), (3, false), (60, false)] {
            let model = chain(masses, neighbours);
            let layout = model.dynamics().layout();
            let (stage, all): (_, Vec<usize>) = (&layout.stage, (0..layout.params).collect());
            let (plan, few) = (TangentPlan::new(layout, &all), TangentPlan::new(layout, &all[..1]));
            let mut seed = 1.0_f64;
            let mut number = || {
                seed = (seed * 1234.567 + 0.123).fract();
                seed - 0.4
            };
            let mut s = Aligned::new(layout.states * stage.lanes);
            let initial = &layout.patterns.initial_by_param;
            initial.entries().for_each(|(_, i, j)| s[i * stage.lanes + stage.lane[j].unwrap() as usize] = number());
            let (mut whole, mut part) = (s.to_vec(), s.clone());
            let mut scratch = Aligned::new(plan.scratch().max(few.scratch()));
            let mut partials = Aligned::new(4 * stage.width);
            for _ in 0..4 {
                for row in partials.chunks_exact_mut(stage.width) {
                    stage.by_state.iter().for_each(|slot| row[*slot as usize] = number());
                    let forced = layout.patterns.rates_by_param.entries();
                    forced.filter_map(|(_, i, j)| stage.by_param(i, j)).for_each(|slot| row[slot] = number());
                }
                plan.advance(0.3, &partials, &mut s, &mut scratch);
                few.advance(0.3, &partials, &mut part, &mut scratch);
                reference(layout, 0.3, &partials, &mut whole);
            }
            assert!(s.iter().zip(&whole).all(|(a, b)| a.to_bits() == b.to_bits()), "{masses}");
            let lane = stage.lane[all[0]].unwrap() as usize;
            let column = |s: &[f64]| -> Vec<f64> { s.chunks_exact(stage.lanes).map(|row| row[lane]).collect() };
            assert_eq!(column(&part), column(&whole), "{masses}: the column that is asked for");
            // the lag is reached by its own parameters alone, and no tile of others has its row
            let p = &layout.patterns;
            let reaching = p.rates_by_param.entries().chain(p.initial_by_param.entries()).filter(|(_, i, _)| *i == 0);
            let lanes: Vec<usize> = reaching.filter_map(|(_, _, j)| Some(stage.lane[j]? as usize / VECTOR)).collect();
            for tile in &plan.tiles {
                let has_its_row = plan.rows[tile.rows.clone()].iter().any(|row| row.state == 0);
                let reaches = lanes.iter().any(|l| (tile.first..tile.first + tile.vectors).contains(l));
                assert_eq!(has_its_row, reaches, "{masses}: {tile:?}");
            }
            assert_eq!(few.tiles.iter().map(|t| t.vectors).sum::<usize>(), 1, "{masses}");
            assert!(plan.tiles.iter().all(|t| t.lag <= 3 && t.ring <= 12), "{masses}: {:?}", plan.tiles);
        }
    }
}
