//! Linear models by exact discretisation: from node to node by one matrix, whatever the step's method has inside.
//!
//! For models whose rates are affine in states and inputs, with coefficients of parameters alone, and runs of few different sampling
//! intervals. Whether a model is linear is not decided by numbers: `fdm_grammar::schedule::Affine` has proven it.
//!
//! A state and its derivatives by the parameters of its subsystem are one row of lanes; the state drives its derivatives
//! through the derivatives of F. Subsystems that do not influence each other are separate, so that their rows are short.

mod equations;
mod feed;
mod map;
mod subsystem;
mod transition;

use super::blocks::{Gathering, RowLayout, Sink};
use super::drive::DriveTable;
use super::error::Divergence;
use super::observation::Observation;
use super::trajectory::Trajectory;
use crate::dynamics::Layout;
use equations::{Equations, Part, partition};
use fdm_grammar::graph::Signal;
use fdm_numeric::lanes::{Aligned, Simd, VECTOR, WithSimd, copy_vectors, dispatch};
use subsystem::{Subsystem, steps_of_a_block};

pub(super) use transition::Intervals;
pub(super) use transition::Method;

/// Subsystems up to this size are worth their full matrices whatever the steps are.
const FEW_STATES: usize = 24;
/// Most numbers in the derivatives of a subsystem's matrix: every run has a dozen of these, and more leave the near cache.
const MOST_NUMBERS: usize = 200_000;
/// Products of matrices that the coefficients of one length of a step take (see `transition.rs`), with some halvings.
const PRODUCTS: f64 = 30.0;
/// Beyond so many numbers coefficients come from a farther cache with every step, which takes so many times as long.
const NEAR: f64 = 1e5;
const FAR: f64 = 3.0;

/// Whether a model can be discretised exactly, with matrices that are not too large to be kept.
pub(super) fn possible(layout: &Layout) -> bool {
    is_recursion(layout) && partition(layout, observed(layout)).iter().all(is_kept)
}

/// Whether it is one worth it whatever the steps are: the matrices of a step are full within a subsystem.
pub(super) fn suits(layout: &Layout) -> bool {
    if !is_recursion(layout) {
        return false;
    }
    let parts = partition(layout, observed(layout));
    let full: usize = parts.iter().map(|part| part.states.len().pow(2)).sum();
    parts.iter().all(|part| part.states.len() <= FEW_STATES && is_kept(part))
        && full <= 8 * (layout.patterns.rates_by_state.len() + layout.states)
}

fn is_recursion(layout: &Layout) -> bool {
    let delays_states = layout.delayed.iter().any(|s| matches!(s, Signal::State(_)));
    layout.affine.rates && layout.states > 0 && !delays_states
}

fn is_kept(part: &Part) -> bool {
    part.states.len().pow(2) * (part.params.len() + VECTOR) <= MOST_NUMBERS
}

/// Operations of a step of the exact discretisation with its sensitivities, in a run of so many of them; its coefficients are among them.
pub(super) fn work(layout: &Layout, steps: usize) -> f64 {
    let of = |part: &Part| {
        let (n, lanes) = (part.states.len() as f64, (part.params.len() + 1).next_multiple_of(VECTOR) as f64);
        let (numbers, products) = ((n + part.drive.len() as f64) * n * lanes, 4.0 * n.powi(3) * lanes * PRODUCTS);
        let far = if numbers > NEAR { FAR } else { 1.0 };
        2.0 * (n * n * lanes + far * numbers) + products / steps.max(1) as f64
    };
    partition(layout, observed(layout)).iter().map(of).sum()
}

/// How many subsystems there are.
pub(super) fn subsystems(layout: &Layout) -> usize {
    partition(layout, observed(layout)).len()
}

/// Whether every output is affine as well.
fn observed(layout: &Layout) -> bool {
    layout.affine.outputs.iter().all(|affine| *affine)
}

/// Observes outputs that are not affine, from the whole matrix of sensitivities.
struct General {
    observation: Observation,
    /// States by the lanes of the model.
    s: Aligned,
    lanes: usize,
    /// Lane of the model of each lane of a parameter, for each subsystem.
    lane_of: Vec<Vec<usize>>,
    rows: Vec<f64>,
}

/// Plans and memory for one choice of columns.
pub(super) struct Discrete {
    columns: Vec<usize>,
    method: Method,
    /// Most steps that are worked off together.
    block: usize,
    equations: Equations,
    subsystems: Vec<Subsystem>,
    general: Option<General>,
    gathering: Gathering,
    /// Rows of outputs that are not states.
    rows: Aligned,
    /// States at the beginning of a block, to find a divergence in it.
    before: Vec<Vec<f64>>,
}

impl Discrete {
    /// # Panics
    /// As [`Observation::new`].
    pub(super) fn new(trajectory: &Trajectory<'_>, columns: &[usize], method: Method, intervals: &Intervals) -> Self {
        let layout = trajectory.dynamics.layout();
        for k in columns {
            assert!(layout.stage.lane[*k].is_some(), "parameter {k} is fixed in the model: it has no derivatives");
        }
        let (held, linear) = (&trajectory.run.held, observed(layout));
        let block = steps_of_a_block(layout.states * (columns.len() + 1).next_multiple_of(VECTOR));
        let kinds = (intervals.lengths.len(), trajectory.grid.per_interval().unwrap_or(1), block);
        let parts = partition(layout, linear).into_iter();
        let subsystems: Vec<_> =
            parts.map(|part| Subsystem::new(layout, part, columns, held, kinds, &trajectory.drive)).collect();
        let general = (!linear).then(|| General {
            observation: Observation::new(layout, columns),
            s: Aligned::new(layout.states * layout.stage.lanes),
            lanes: layout.stage.lanes,
            lane_of: subsystems.iter().map(|s| lanes_of(layout, s)).collect(),
            rows: vec![0.0; layout.outputs * columns.len().next_multiple_of(VECTOR)],
        });
        let rows = if linear {
            RowLayout::new((0..layout.outputs).map(|o| columns_of(&subsystems, o)))
        } else {
            RowLayout::full(layout.outputs, columns.len())
        };
        let longest = subsystems.iter().map(|s| s.part.outputs.len() * s.width).max().unwrap_or(0);
        Self {
            columns: columns.to_vec(),
            method,
            block,
            equations: Equations::new(layout),
            before: subsystems.iter().map(|s| s.states().to_vec()).collect(),
            subsystems,
            general,
            gathering: Gathering::new(rows),
            rows: Aligned::new((block + 1) * longest),
        }
    }

    pub(super) fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// Runs through all samples; the trajectory has begun.
    pub(super) fn run(
        &mut self,
        trajectory: &mut Trajectory<'_>,
        intervals: &Intervals,
        sink: &mut Sink<'_>,
    ) -> Result<(), Divergence> {
        self.gathering.begin();
        self.equations.read(trajectory.dynamics, &trajectory.known, &mut trajectory.work);
        let result = dispatch(March { recursion: self, trajectory, intervals, sink });
        self.gathering.flush(sink);
        result
    }

    /// The first step of a block after which a state is not finite.
    #[cold]
    fn divergence(
        &mut self,
        trajectory: &Trajectory<'_>,
        intervals: &Intervals,
        steps: std::ops::Range<usize>,
    ) -> Divergence {
        self.subsystems.iter_mut().zip(&self.before).for_each(|(s, before)| s.restore(before));
        for k in steps.clone() {
            for subsystem in &mut self.subsystems {
                dispatch(Single { subsystem, trajectory, intervals, k });
            }
            if let Some(state) = self.first_not_finite() {
                let (t, h) = trajectory.grid.step(k);
                let sample = k / trajectory.grid.per_interval().unwrap_or(1);
                return Divergence { time: t + h, state, sample, event: None };
            }
        }
        let (t, h) = trajectory.grid.step(steps.end - 1);
        Divergence {
            time: t + h,
            state: None,
            sample: (steps.end - 1) / trajectory.grid.per_interval().unwrap_or(1),
            event: None,
        }
    }

    /// The first state, if any, that is not finite; none of them (but `Some`) when a sensitivity is not.
    fn first_not_finite(&self) -> Option<Option<usize>> {
        let values = |s: &Subsystem| {
            let states = s.part.states.iter().enumerate();
            states.filter(|(i, _)| !s.value(s.present(), *i).is_finite()).map(|(_, state)| *state).min()
        };
        if let Some(state) = self.subsystems.iter().filter_map(values).min() {
            return Some(Some(state));
        }
        None
    }
}

/// The columns that a linear output can depend on.
fn columns_of(subsystems: &[Subsystem], output: usize) -> Vec<u32> {
    let has = |s: &&Subsystem| s.part.outputs.contains(&output) || s.part.shown.iter().any(|(o, _)| *o == output);
    subsystems.iter().find(has).map_or_else(Vec::new, |s| s.columns.iter().map(|(c, _)| *c).collect())
}

fn lanes_of(layout: &Layout, subsystem: &Subsystem) -> Vec<usize> {
    subsystem.columns.iter().filter_map(|(_, k)| layout.stage.lane[*k]).map(|lane| lane as usize).collect()
}

/// One step of one subsystem.
struct Single<'m, 'a> {
    subsystem: &'m mut Subsystem,
    trajectory: &'m Trajectory<'a>,
    intervals: &'m Intervals,
    k: usize,
}

impl WithSimd for Single<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.subsystem.advance(simd, &self.trajectory.drive, self.intervals, self.k..self.k + 1);
    }
}

/// Some steps of the response alone, as long as an interval: the chains of the subsystems, each of which waits for itself,
/// advance together.
#[inline(always)]
fn respond<S: Simd>(
    simd: S,
    subsystems: &mut [Subsystem],
    trajectory: &Trajectory<'_>,
    intervals: &Intervals,
    steps: std::ops::Range<usize>,
) {
    // no closure: it would not have the processor's features that the loop is compiled for
    for subsystem in subsystems.iter_mut() {
        subsystem.begin(simd, &trajectory.drive, intervals, steps.clone());
    }
    for (k, step) in steps.enumerate() {
        let kind = intervals.of_step(step);
        for subsystem in subsystems.iter_mut() {
            subsystem.respond(simd, kind, k);
        }
    }
}

/// Where outputs and rows of some samples are written.
struct Place<'p> {
    layout: &'p RowLayout,
    y: &'p mut [f64],
    rows: &'p mut [f64],
    /// Rows of outputs that are not states.
    spare: &'p mut [f64],
    /// Whether there are no sensitivities to write.
    bare: bool,
}

impl Place<'_> {
    /// One of the samples.
    fn only(&mut self, at: usize) -> Place<'_> {
        let (q, length) = (self.layout.outputs.len(), self.layout.length);
        let (y, rows) = (&mut self.y[at * q..][..q], &mut self.rows[at * length..][..length]);
        Place { layout: self.layout, y, rows, spare: self.spare, bare: self.bare }
    }

    /// Outputs that are states, at `count` samples whose states stand in the slots from `slot` on.
    #[inline(always)]
    fn show(&mut self, subsystem: &Subsystem, count: usize, slot: usize) {
        if self.bare {
            let (q, size, slots) = (self.layout.outputs.len(), subsystem.size(), subsystem.slots_from(slot));
            for (output, state) in &subsystem.part.shown {
                let values = slots[*state..].iter().step_by(size.max(1)).take(count);
                self.y[*output..].iter_mut().step_by(q.max(1)).zip(values).for_each(|(y, x)| *y = *x);
            }
            return;
        }
        match subsystem.width / VECTOR {
            1 => self.show_rows::<1>(subsystem, count, slot),
            2 => self.show_rows::<2>(subsystem, count, slot),
            3 => self.show_rows::<3>(subsystem, count, slot),
            _ => self.show_rows::<0>(subsystem, count, slot),
        }
    }

    /// The same where a row is so many vectors; any number when it is 0.
    #[inline(always)]
    fn show_rows<const VECTORS: usize>(&mut self, subsystem: &Subsystem, count: usize, slot: usize) {
        let (q, length) = (self.layout.outputs.len(), self.layout.length / VECTOR);
        let across = if VECTORS > 0 { VECTORS } else { subsystem.width / VECTOR };
        let size = subsystem.part.states.len() * across;
        let (lane, slots) = (subsystem.lane.min(across * VECTOR - 1), subsystem.slots_from(slot).as_chunks().0);
        let rows: &mut [[f64; VECTOR]] = self.rows.as_chunks_mut().0;
        for (output, state) in &subsystem.part.shown {
            let start = self.layout.outputs[*output].start / VECTOR;
            for k in 0..count {
                let (from, to) = (k * size + state * across, k * length + start);
                let from = &slots[from..from + across];
                rows[to..to + across].copy_from_slice(from);
                self.y[k * q + output] = from[lane / VECTOR][lane % VECTOR];
            }
        }
    }

    /// Other linear outputs, at some samples; the first of them stands at `at`.
    #[inline(always)]
    fn observe<S: Simd>(
        &mut self,
        simd: S,
        subsystem: &mut Subsystem,
        drive: &DriveTable,
        samples: std::ops::Range<usize>,
        slot: usize,
    ) {
        let outputs = subsystem.part.outputs.len();
        if outputs == 0 {
            return;
        }
        let (q, length, count) = (self.layout.outputs.len(), self.layout.length, samples.len());
        subsystem.observe(simd, drive, (samples, slot), self.spare);
        if self.bare {
            let lanes = subsystem.output_lanes();
            for at in 0..count {
                let values = &self.spare[at * lanes..][..outputs];
                for (output, value) in subsystem.part.outputs.iter().zip(values) {
                    self.y[at * q + output] = *value;
                }
            }
            return;
        }
        let (lane, width) = (subsystem.lane, subsystem.width);
        for at in 0..count {
            let rows = self.spare[at * outputs * width..].chunks_exact(width);
            for (output, row) in subsystem.part.outputs.iter().zip(rows) {
                self.y[at * q + output] = row[lane];
                let start = self.layout.outputs[*output].start;
                copy_vectors(row, &mut self.rows[at * length + start..][..width]);
            }
        }
    }
}

/// The loop over the samples, compiled for the machine's widest registers.
struct March<'m, 'a> {
    recursion: &'m mut Discrete,
    trajectory: &'m mut Trajectory<'a>,
    intervals: &'m Intervals,
    sink: &'m mut Sink<'m>,
}

impl WithSimd for March<'_, '_> {
    type Output = Result<(), Divergence>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { recursion, trajectory, intervals, sink } = self;
        let layout = trajectory.dynamics.layout();
        for subsystem in &mut recursion.subsystems {
            let how = (recursion.method, &intervals.lengths[..]);
            subsystem.prepare(layout, &recursion.equations, (&trajectory.known, &trajectory.drive), how);
        }
        let (samples, per) = (trajectory.run.len(), trajectory.grid.per_interval().unwrap_or(1));
        let mut first = 0;
        while first < samples {
            let most = if recursion.general.is_some() { 1 } else { (samples - first).min(recursion.block) };
            let count = recursion.advance(simd, trajectory, intervals, (first, most));
            let steps = first.saturating_sub(1) * per..(first + count - 1) * per;
            if recursion.first_not_finite().is_some() {
                let found = recursion.divergence(trajectory, intervals, steps);
                let finite = (found.sample + 1).saturating_sub(first).min(count);
                recursion.observe(trajectory, first, finite)?;
                recursion.gathering.filled(finite, sink);
                return Err(found);
            }
            recursion.observe(trajectory, first, count)?;
            recursion.gathering.filled(count, sink);
            first += count;
        }
        Ok(())
    }
}

impl Discrete {
    /// Advances every subsystem over the next samples, at most `most`, and writes their rows; gives how many these were.
    #[inline(always)]
    fn advance<S: Simd>(
        &mut self,
        simd: S,
        trajectory: &Trajectory<'_>,
        intervals: &Intervals,
        (first, most): (usize, usize),
    ) -> usize {
        let per = trajectory.grid.per_interval().unwrap_or(1);
        let Self { columns, block, subsystems, gathering, rows: spare, before, .. } = self;
        let (layout, y, rows, count) = gathering.several(most);
        let (bare, after) = (columns.is_empty(), usize::from(first > 0));
        let mut place = Place { layout, y, rows, spare, bare };
        subsystems.iter().zip(before).for_each(|(subsystem, before)| before.copy_from_slice(subsystem.states()));
        if per == 1 {
            let steps = first.saturating_sub(1)..first + count - 1;
            if bare {
                respond(simd, subsystems, trajectory, intervals, steps);
            } else {
                // no closure: it would not have the processor's features that the loop is compiled for
                for subsystem in subsystems.iter_mut() {
                    subsystem.advance(simd, &trajectory.drive, intervals, steps.clone());
                }
            }
            for subsystem in subsystems {
                place.show(subsystem, count, after);
                place.observe(simd, subsystem, &trajectory.drive, first..first + count, after);
            }
            return count;
        }
        for subsystem in subsystems {
            for at in 0..count {
                let sample = first + at;
                let (mut from, end) = (sample.saturating_sub(1) * per, sample * per);
                while from < end {
                    let to = end.min(from + *block);
                    subsystem.advance(simd, &trajectory.drive, intervals, from..to);
                    from = to;
                }
                let mut place = place.only(at);
                place.show(subsystem, 1, subsystem.present());
                place.observe(simd, subsystem, &trajectory.drive, sample..sample + 1, subsystem.present());
            }
        }
        count
    }

    /// Outputs of the samples whose rows have been written; general ones with their rows.
    fn observe(&mut self, trajectory: &mut Trajectory<'_>, first: usize, count: usize) -> Result<(), Divergence> {
        if count == 0 {
            return Ok(());
        }
        if self.general.is_some() {
            return self.observe_in_general(trajectory, first);
        }
        let (layout, y, ..) = self.gathering.several(count);
        if self.subsystems.iter().all(|s| s.part.outputs.is_empty()) {
            return Ok(());
        }
        match y.iter().position(|y| !y.is_finite()) {
            None => Ok(()),
            Some(cell) => {
                let sample = first + cell / layout.outputs.len();
                Err(Divergence { time: trajectory.run.time[sample], state: None, sample, event: None })
            }
        }
    }

    fn observe_in_general(&mut self, trajectory: &mut Trajectory<'_>, sample: usize) -> Result<(), Divergence> {
        let Self { subsystems, general: Some(general), gathering, .. } = self else { return Ok(()) };
        general.s.fill(0.0);
        for (subsystem, lane_of) in subsystems.iter().zip(&general.lane_of) {
            let present = subsystem.present();
            for (i, state) in subsystem.part.states.iter().enumerate() {
                trajectory.nodes[0][*state] = subsystem.value(present, i);
            }
            let rows = subsystem.states().chunks_exact(subsystem.width);
            for (state, row) in subsystem.part.states.iter().zip(rows).filter(|_| !lane_of.is_empty()) {
                for (lane, value) in lane_of.iter().zip(row) {
                    general.s[state * general.lanes + lane] = *value;
                }
            }
        }
        let (layout, y, rows, _) = gathering.several(1);
        if self.columns.is_empty() {
            return trajectory.observe(sample, 0, y);
        }
        general.observation.observe(trajectory, (sample, 0), &general.s, y, &mut general.rows)?;
        let stride = general.observation.stride;
        for (o, row) in layout.outputs.iter().enumerate() {
            let to = &mut rows[row.start..][..row.width];
            to.fill(0.0);
            to[..row.columns.len()].copy_from_slice(&general.rows[o * stride..][..row.columns.len()]);
        }
        Ok(())
    }
}
