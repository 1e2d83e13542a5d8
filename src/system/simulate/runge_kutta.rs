//! Sensitivities of one run by the classical Runge-Kutta method: `S' = f_x S + f_theta`, all parameters in lanes.
//!
//! The four stages' partials are known before (they do not depend on S), so a step is linear in S. Lanes never mix: the result has the
//! same bits whatever the width of the machine's registers, because every one of them is computed by the same fused multiply-adds.
//!
//! The state chain is bound by latency, the sensitivities by throughput; running the states one step ahead lets the
//! processor overlap both, and gives the forcing terms, written one by one, time to reach the cache before they are read
//! as vectors.

use super::blocks::{Gathering, RowLayout, Sink};
use super::error::Divergence;
use super::observation::{Observation, Scatter, scatter};
use super::trajectory::{Trajectory, finite, two_nodes};
use crate::dynamics::{Dynamics, Layout, Step};
use fdm_numeric::lanes::{Aligned, Simd, VECTOR, WithSimd, copy_vectors, dispatch};

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
        let (n, stage, plan) = (layout.states, &layout.stage, TangentPlan::new(layout));
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
        stops.hold(k, dynamics.layout(), known, next);
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

/// Where the four stages' partials stand, and the structure of f_x.
#[derive(Debug, Clone)]
pub(super) struct TangentPlan {
    states: usize,
    /// Entries of each row of f_x, and their columns, for models whose f_x is not written as full rows.
    rows: Vec<u32>,
    columns: Vec<u32>,
    dense: bool,
    /// First lane of f_theta in a stage's row, lanes of each row of f_theta and S, length of a stage's row.
    forcing: usize,
    lanes: usize,
    width: usize,
}

impl TangentPlan {
    pub(super) fn new(layout: &Layout) -> Self {
        let (f_x, stage) = (&layout.patterns.rates_by_state, &layout.stage);
        let (rows, columns) = (f_x.rows.clone(), f_x.columns.clone());
        let (forcing, lanes, width) = (stage.forcing, stage.lanes, stage.width);
        Self { states: layout.states, rows, columns, dense: stage.dense, forcing, lanes, width }
    }

    /// Length of the scratch that [`TangentPlan::step`] needs: two stage tangents and the sum of the slopes.
    pub(super) fn scratch(&self) -> usize {
        3 * self.states * self.lanes
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

/// A step of many states: a function of its own too, for it has three callers.
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

    /// Many states: structural nonzeros of f_x only, stage tangents in memory.
    #[inline(always)]
    fn sparse(self, s: &mut [f64], scratch: &mut [f64]) {
        let width = self.plan.lanes / S::F64_LANES;
        let mut tile = 0;
        while tile < width {
            tile += match width - tile {
                1 => self.sparse_tile::<1>(tile, width, s, scratch),
                2 => self.sparse_tile::<2>(tile, width, s, scratch),
                3 => self.sparse_tile::<3>(tile, width, s, scratch),
                _ => self.sparse_tile::<4>(tile, width, s, scratch),
            };
        }
    }

    /// Advances the L vectors from `tile` on of every row; columns of S do not depend on each other.
    #[inline(always)]
    fn sparse_tile<const L: usize>(self, tile: usize, width: usize, s: &mut [f64], scratch: &mut [f64]) -> usize {
        let (simd, states) = (self.simd, self.plan.states);
        let block = states * width;
        let s = S::as_mut_simd_f64s(s).0;
        let (first, rest) = S::as_mut_simd_f64s(scratch).0.split_at_mut(block);
        let (second, sum) = rest.split_at_mut(block);
        let splat = |a: f64| simd.splat_f64s(a);
        let (half, sixth, third, whole) =
            (splat(0.5 * self.h), splat(self.h / 6.0), splat(self.h / 3.0), splat(self.h));
        for i in 0..states {
            let at = i * width + tile;
            let k = self.sparse_slope::<L>(0, i, tile, width, s);
            let x: [S::f64s; L] = load(s, at, half);
            store(first, at, axpy(simd, half, k, x));
            store(sum, at, axpy(simd, sixth, k, x));
        }
        for i in 0..states {
            let at = i * width + tile;
            let k = self.sparse_slope::<L>(1, i, tile, width, first);
            store(second, at, axpy(simd, half, k, load(s, at, half)));
            store(sum, at, axpy(simd, third, k, load(sum, at, half)));
        }
        for i in 0..states {
            let at = i * width + tile;
            let k = self.sparse_slope::<L>(2, i, tile, width, second);
            store(first, at, axpy(simd, whole, k, load(s, at, half)));
            store(sum, at, axpy(simd, third, k, load(sum, at, half)));
        }
        for i in 0..states {
            let at = i * width + tile;
            let k = self.sparse_slope::<L>(3, i, tile, width, first);
            store(s, at, axpy(simd, sixth, k, load(sum, at, half)));
        }
        L
    }

    /// Row i of `f_x S + f_theta` at a stage, L vectors of it.
    #[inline(always)]
    fn sparse_slope<const L: usize>(
        self,
        stage: usize,
        i: usize,
        tile: usize,
        width: usize,
        x: &[S::f64s],
    ) -> [S::f64s; L] {
        let row = &self.partials[stage * self.plan.width..][..self.plan.width];
        let zero = self.simd.splat_f64s(0.0);
        let mut k: [S::f64s; L] = load(S::as_simd_f64s(&row[self.plan.forcing..]).0, i * width + tile, zero);
        let range = self.plan.rows[i] as usize..self.plan.rows[i + 1] as usize;
        let entries = &row[self.plan.states + range.start..self.plan.states + range.end];
        for (a, j) in entries.iter().zip(&self.plan.columns[range]) {
            k = axpy(self.simd, self.simd.splat_f64s(*a), load(x, *j as usize * width + tile, zero), k);
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
