//! Linear models by exact discretisation: from node to node by one matrix, whatever the step's method has inside.
//!
//! For models whose rates are affine in states and inputs, with coefficients of parameters alone, and runs of few different sampling
//! intervals. Whether a model is linear is not decided by numbers: `fdm_grammar::schedule::Affine` has proven it.
//!
//! A state and its derivatives by the parameters of its subsystem are one row of lanes; the state drives its derivatives
//! through the derivatives of F. Subsystems that do not influence each other are separate, so that their rows are short.

mod equations;
mod map;
mod response;
mod subsystem;
#[cfg(test)]
mod tests;
mod transition;

use super::blocks::{Gathering, OutputRow, RowLayout, Sink};
use super::error::Divergence;
use super::trajectory::Observation;
use super::trajectory::Trajectory;
use crate::dynamics::Layout;
use equations::{Equations, Part, partition};
use fdm_grammar::graph::Signal;
use fdm_numeric::lanes::{Aligned, Simd, VECTOR, WithSimd, copy_vectors, dispatch};
use response::Values;
use std::ops::Range;
use subsystem::{Subsystem, steps_of_a_block};

pub(super) use transition::{Intervals, Method};

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
    // subsystems up to this size are worth their full matrices whatever the steps are
    parts.iter().all(|part| part.states.len() <= 24 && is_kept(part))
        && full <= 8 * (layout.patterns.rates_by_state.len() + layout.states)
}

fn is_recursion(layout: &Layout) -> bool {
    let delays_states = layout.delayed.iter().any(|s| matches!(s, Signal::State(_)));
    layout.affine.rates && layout.states > 0 && !delays_states
}

fn is_kept(part: &Part) -> bool {
    // most numbers in the derivatives of a subsystem's matrix: every run has a dozen of these, and more leave the
    // near cache
    part.states.len().pow(2) * (part.params.len() + VECTOR) <= 200_000
}

/// Operations of a step of the exact discretisation with its sensitivities, in a run of so many of them; its coefficients are among them.
pub(super) fn work(layout: &Layout, steps: usize) -> f64 {
    let of = |part: &Part| {
        let (n, lanes) = (part.states.len() as f64, (part.params.len() + 1).next_multiple_of(VECTOR) as f64);
        // products of matrices that the coefficients of one length of a step take (see `transition.rs`), with some
        // halvings
        let (numbers, products) = ((n + part.drive.len() as f64) * n * lanes, 4.0 * n.powi(3) * lanes * 30.0);
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
    /// Rows that stand a second time in another output's place: from, to, width.
    twins: Vec<(usize, usize, usize)>,
    /// The response, where no columns are asked for.
    values: Option<Values>,
    /// States at the beginning of a block, to find a divergence in it: of each subsystem, or the values alone.
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
        let per = trajectory.grid.per_interval().unwrap_or(1);
        let (parts, kinds) = (partition(layout, linear).into_iter(), (intervals.lengths.len(), per));
        let mut subsystems: Vec<_> =
            parts.map(|part| Subsystem::new(layout, part, columns, held, kinds, &trajectory.drive)).collect();
        let general = (!linear).then(|| General {
            observation: Observation::new(layout, columns),
            s: Aligned::new(layout.states * layout.stage.lanes),
            lanes: layout.stage.lanes,
            lane_of: subsystems.iter().map(|s| lanes_of(layout, s)).collect(),
            rows: vec![0.0; layout.outputs * columns.len().next_multiple_of(VECTOR)],
        });
        let (gathering, twins) = if linear && !columns.is_empty() {
            let (rows, twins) = arrange(&mut subsystems, layout.outputs);
            (Gathering::continued(rows), twins)
        } else {
            (Gathering::new(RowLayout::full(layout.outputs, columns.len())), Vec::new())
        };
        let in_place = linear && !columns.is_empty() && per == 1;
        let steps = steps_of_a_block(layout.states * (columns.len() + 1).next_multiple_of(VECTOR));
        // states that go to the rows that are handed over are kept elsewhere for one step alone
        let (block, kept) = if in_place { (gathering.capacity(), 1) } else { (steps, steps) };
        subsystems.iter_mut().for_each(|s| s.make_room(block, kept));
        let outputs = if linear { layout.outputs } else { 0 };
        let values = columns.is_empty().then(|| Values::new(&subsystems, outputs, kinds.0, block));
        Self {
            columns: columns.to_vec(),
            method,
            block,
            equations: Equations::new(layout),
            before: match &values {
                Some(values) => vec![values.states().to_vec()],
                None => subsystems.iter().map(|s| s.states().to_vec()).collect(),
            },
            subsystems,
            general,
            gathering,
            twins,
            values,
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
    fn divergence(&mut self, trajectory: &Trajectory<'_>, intervals: &Intervals, steps: Range<usize>) -> Divergence {
        match &mut self.values {
            Some(values) => values.restore(&self.before[0]),
            None => self.subsystems.iter_mut().zip(&self.before).for_each(|(s, before)| s.restore(before)),
        }
        for k in steps.clone() {
            dispatch(Single { recursion: self, trajectory, intervals, k });
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
        let first = |(k, s): (usize, &Subsystem)| {
            let finite = |i: usize| match &self.values {
                Some(values) => values.of_subsystem(k)[i].is_finite(),
                None => s.value(i).is_finite(),
            };
            let states = s.part.states.iter().enumerate();
            states.filter(|(i, _)| !finite(*i)).map(|(_, state)| *state).min()
        };
        if let Some(state) = self.subsystems.iter().enumerate().filter_map(first).min() {
            return Some(Some(state));
        }
        None
    }
}

/// Rows of a sample: for each subsystem those of its states and of its other outputs. An output that shows a state has that state's row
/// for its own; whoever shows it too has another.
fn arrange(subsystems: &mut [Subsystem], outputs: usize) -> (RowLayout, Vec<(usize, usize, usize)>) {
    let none = OutputRow { start: 0, width: 0, columns: Vec::new() };
    let (mut layout, mut twins) = (RowLayout { outputs: vec![none; outputs], length: 0 }, Vec::new());
    for subsystem in subsystems {
        subsystem.start = layout.length;
        let (part, width) = (&subsystem.part, subsystem.width);
        let columns: Vec<u32> = subsystem.columns.iter().map(|(c, _)| *c).collect();
        layout.length += (part.states.len() + part.outputs.len()) * width;
        let row = |start: usize| OutputRow { start, width, columns: columns.clone() };
        for (k, output) in part.outputs.iter().enumerate() {
            layout.outputs[*output] = row(subsystem.start + (part.states.len() + k) * width);
        }
        for (k, (output, state)) in part.shown.iter().enumerate() {
            let own = subsystem.start + state * width;
            let again = part.shown[..k].iter().any(|(_, shown)| shown == state);
            if again {
                twins.push((own, layout.length, width));
                layout.length += width;
            }
            layout.outputs[*output] = row(if again { layout.length - width } else { own });
        }
    }
    (layout, twins)
}

fn lanes_of(layout: &Layout, subsystem: &Subsystem) -> Vec<usize> {
    subsystem.columns.iter().filter_map(|(_, k)| layout.stage.lane[*k]).map(|lane| lane as usize).collect()
}

/// One step of all subsystems.
struct Single<'m, 'a> {
    recursion: &'m mut Discrete,
    trajectory: &'m Trajectory<'a>,
    intervals: &'m Intervals,
    k: usize,
}

impl WithSimd for Single<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { recursion: Discrete { values, subsystems, .. }, trajectory, intervals, k } = self;
        if let Some(values) = values {
            return values.advance(simd, &trajectory.drive, (intervals, k..k + 1), &mut []);
        }
        for subsystem in subsystems {
            subsystem.advance(simd, &trajectory.drive, (intervals, k..k + 1), None);
        }
    }
}

/// Outputs from the rows of their samples, and rows that two outputs have in common a second time.
fn spread(layout: &RowLayout, twins: &[(usize, usize, usize)], y: &mut [f64], rows: &mut [f64]) {
    for (y, rows) in y.chunks_exact_mut(layout.outputs.len().max(1)).zip(rows.chunks_exact_mut(layout.length)) {
        twins.iter().for_each(|(from, to, width)| rows.copy_within(*from..from + width, *to));
        y.iter_mut().zip(&layout.outputs).for_each(|(y, row)| *y = rows[row.start + row.columns.len()]);
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
        if let Some(values) = &mut recursion.values {
            values.begin(&recursion.subsystems);
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
        let Self { block, subsystems, general, gathering, twins, values, before, .. } = self;
        let (drive, linear) = (&trajectory.drive, general.is_none());
        let (layout, y, rows, count) = gathering.several(most);
        let (q, length) = (layout.outputs.len(), layout.length);
        // the first sample has no step before it
        let after = usize::from(first > 0);
        let (samples, steps) = (first..first + count, first.saturating_sub(1)..first + count - 1);
        // no closures for what uses vectors: they would not have the processor's features that the loops are compiled for
        if let Some(values) = values {
            before[0].copy_from_slice(values.states());
            let q = if linear { q } else { 0 };
            if per == 1 {
                if first == 0 && linear {
                    values.show(&mut y[..q]);
                }
                values.advance(simd, drive, (intervals, steps), &mut y[(1 - after) * q..][..(count - 1 + after) * q]);
                values.observe(simd, drive, samples, Some(after), y);
                return count;
            }
            for sample in samples {
                let (mut from, end) = (sample.saturating_sub(1) * per, sample * per);
                while from < end {
                    let to = end.min(from + *block);
                    values.advance(simd, drive, (intervals, from..to), &mut []);
                    from = to;
                }
                let y = &mut y[(sample - first) * q..][..q];
                values.show(y);
                values.observe(simd, drive, sample..sample + 1, None, y);
            }
            return count;
        }
        subsystems.iter().zip(before).for_each(|(subsystem, before)| before.copy_from_slice(subsystem.states()));
        if per == 1 && linear {
            for subsystem in subsystems {
                let place = (&mut rows[(1 - after) * length..], length);
                subsystem.advance(simd, drive, (intervals, steps.clone()), Some(place));
                subsystem.observe(simd, drive, samples.clone(), (&mut rows[length..], length));
            }
            spread(layout, twins, y, &mut rows[length..]);
            return count;
        }
        for subsystem in subsystems {
            for at in 0..count {
                let sample = first + at;
                let (mut from, end) = (sample.saturating_sub(1) * per, sample * per);
                while from < end {
                    let to = end.min(from + *block);
                    subsystem.advance(simd, drive, (intervals, from..to), None);
                    from = to;
                }
                if !linear {
                    continue;
                }
                let rows = &mut rows[(at + 1) * length..][..length];
                copy_vectors(subsystem.states(), &mut rows[subsystem.start..][..subsystem.size()]);
                subsystem.observe(simd, drive, sample..sample + 1, (rows, length));
            }
        }
        if linear {
            spread(layout, twins, y, &mut rows[length..]);
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
        let Self { subsystems, general: Some(general), gathering, values, .. } = self else { return Ok(()) };
        general.s.fill(0.0);
        for (k, (subsystem, lane_of)) in subsystems.iter().zip(&general.lane_of).enumerate() {
            for (i, state) in subsystem.part.states.iter().enumerate() {
                trajectory.nodes[0][*state] = match values {
                    Some(values) => values.of_subsystem(k)[i],
                    None => subsystem.value(i),
                };
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
