//! Linear models by exact discretisation: from node to node by one matrix, whatever the step's method has inside.
//!
//! For models whose rates are affine in states and inputs, with coefficients of parameters alone, and runs of few different sampling
//! intervals. Whether a model is linear is not decided by numbers: `fdm_grammar::schedule::Affine` has proven it.
//!
//! The values of the states are a recursion of their own. The derivatives of a state by the parameters of its subsystem are one row of
//! lanes; the values drive them through the derivatives of F. Subsystems that do not influence each other are separate, so that their
//! rows are short.

mod equations;
mod feed;
mod map;
mod response;
mod subsystem;
#[cfg(test)]
mod tests;
mod transition;

use super::blocks::{Gathering, OutputRow, RowLayout, Sink};
use super::error::Divergence;
use super::observation::Observation;
use super::trajectory::Trajectory;
use crate::dynamics::Layout;
use equations::{Equations, Part, partition};
use fdm_grammar::graph::Signal;
use fdm_numeric::lanes::{Aligned, Simd, VECTOR, WithSimd, copy_vectors, dispatch};
use feed::Readings;
use response::Values;
use std::ops::Range;
use subsystem::{Counts, Subsystem, steps_of_a_block};

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
    /// Whether the states' rows go to the places that are handed over as soon as they are computed.
    in_place: bool,
    /// Rows that stand a second time in another output's place: from, to, width.
    twins: Vec<(usize, usize, usize)>,
    values: Values,
    /// What drives a block of steps, where it must be gathered.
    feed: Vec<f64>,
    output_feed: Vec<f64>,
    /// Values of the states at the beginning of a block, to find a divergence in it.
    before: Vec<f64>,
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
        let in_place = linear && per == 1;
        let steps = steps_of_a_block(layout.states * (columns.len() + 1).next_multiple_of(VECTOR));
        // steps between samples are taken a block at a time
        let kept = if columns.is_empty() || in_place { 0 } else { per.min(steps) };
        let counts = Counts { kinds: intervals.lengths.len(), per, kept };
        let parts = partition(layout, linear).into_iter();
        let mut subsystems: Vec<_> =
            parts.map(|part| Subsystem::new(layout, part, columns, held, counts, &trajectory.drive)).collect();
        let general = (!linear).then(|| General {
            observation: Observation::new(layout, columns),
            s: Aligned::new(layout.states * layout.stage.lanes),
            lanes: layout.stage.lanes,
            lane_of: subsystems.iter().map(|s| lanes_of(layout, s)).collect(),
            rows: vec![0.0; layout.outputs * columns.len().next_multiple_of(VECTOR)],
        });
        let (gathering, twins) = if linear {
            let (rows, twins) = arrange(&mut subsystems, layout.outputs);
            (Gathering::continued(rows), twins)
        } else {
            (Gathering::new(RowLayout::full(layout.outputs, columns.len())), Vec::new())
        };
        let block = if in_place { gathering.capacity() } else { steps };
        let values = values_of(&mut subsystems, counts.kinds, block, if linear { layout.outputs } else { 0 });
        Self {
            columns: columns.to_vec(),
            method,
            block,
            equations: Equations::new(layout),
            before: values.states().to_vec(),
            feed: vec![0.0; block * values.steps.gathered()],
            output_feed: vec![0.0; (block + 1) * values.samples.gathered()],
            subsystems,
            general,
            gathering,
            in_place,
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
        self.values.restore(&self.before);
        for k in steps.clone() {
            let feed = self.values.steps.of_steps(&trajectory.drive, k..k + 1, &mut self.feed);
            self.values.advance(feed, (intervals, k..k + 1), &mut []);
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
        let present = self.values.states();
        if present.iter().all(|x| x.is_finite()) {
            return None;
        }
        let values = |s: &Subsystem| {
            let states = s.part.states.iter().zip(&present[s.lane..]);
            states.filter(|(_, value)| !value.is_finite()).map(|(state, _)| *state).min()
        };
        if let Some(state) = self.subsystems.iter().filter_map(values).min() {
            return Some(Some(state));
        }
        None
    }
}

/// Rows of a sample: for each subsystem those of its states and of its other outputs. An output that shows a state has that state's row
/// for its own; whoever shows it too has another.
fn arrange(subsystems: &mut [Subsystem], outputs: usize) -> (RowLayout, Vec<(usize, usize, usize)>) {
    let mut layout =
        RowLayout { outputs: vec![OutputRow { start: 0, width: 0, columns: Vec::new() }; outputs], length: 0 };
    let mut twins = Vec::new();
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

/// The values of all states, and of so many outputs.
fn values_of(subsystems: &mut [Subsystem], kinds: usize, block: usize, outputs: usize) -> Values {
    let steps = Readings::of(subsystems.iter().flat_map(|s| &s.terms), false);
    let samples = Readings::of(subsystems.iter().flat_map(|s| &s.output_terms), true);
    let mut values = Values::new(steps, samples);
    let (mut shown, mut others) = (vec![0; outputs], Vec::new());
    for subsystem in subsystems {
        subsystem.take_place(&mut values);
        subsystem.part.shown.iter().for_each(|(output, state)| shown[*output] = (subsystem.lane + state) as u32);
        let lanes = subsystem.part.outputs.iter().zip(subsystem.output_lane..);
        others.extend(lanes.map(|(output, lane)| (*output as u32, lane as u32)));
    }
    values.set_up(kinds, block, shown, others);
    values
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
        recursion.values.begin();
        for subsystem in &mut recursion.subsystems {
            let how = (recursion.method, &intervals.lengths[..]);
            let given = (&trajectory.known[..], &trajectory.drive);
            subsystem.prepare(layout, &recursion.equations, given, how, &mut recursion.values);
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
        let Self { block, subsystems, general, gathering, values, feed: room, output_feed, before, in_place, .. } =
            self;
        let drive = &trajectory.drive;
        let (layout, y, rows, count) = gathering.several(most);
        let (outputs, length) = (layout.outputs.len(), layout.length);
        before.copy_from_slice(values.states());
        // no closures: they would not have the processor's features that the loops are compiled for
        if *in_place {
            // the first sample has no step before it
            let (steps, after) = (first.saturating_sub(1)..first + count - 1, usize::from(first > 0));
            if first == 0 {
                values.show(&mut y[..outputs]);
            }
            let feed = values.steps.of_steps(drive, steps.clone(), room);
            values.advance(feed, (intervals, steps.clone()), &mut y[(1 - after) * outputs..]);
            let observed = values.samples.of_samples(drive, first..first + count, output_feed);
            values.observe(observed, after, y);
            for subsystem in subsystems.iter().filter(|s| !s.columns.is_empty()) {
                let rows = &mut rows[subsystem.start..];
                if first == 0 {
                    copy_vectors(subsystem.rows(), &mut rows[length..][..subsystem.size()]);
                }
                subsystem.march(
                    simd,
                    (feed, values),
                    (intervals, steps.clone()),
                    (&mut rows[(1 - after) * length..], length),
                );
                subsystem.observe(simd, (observed, values, after), (&mut rows[length..], length), count);
            }
            self.copy_twins(count);
            return count;
        }
        for at in 0..count {
            let sample = first + at;
            let (mut from, end) = (sample.saturating_sub(1) * per, sample * per);
            while from < end {
                let to = end.min(from + *block);
                let feed = values.steps.of_steps(drive, from..to, room);
                values.advance(feed, (intervals, from..to), &mut []);
                for subsystem in subsystems.iter_mut().filter(|s| !s.columns.is_empty()) {
                    subsystem.march_here(simd, (feed, values), (intervals, from..to));
                }
                from = to;
            }
            if general.is_some() {
                continue;
            }
            let (y, present) = (&mut y[at * outputs..][..outputs], values.present());
            let observed = values.samples.of_samples(drive, sample..sample + 1, output_feed);
            values.show(y);
            values.observe(observed, present, y);
            for subsystem in subsystems.iter().filter(|s| !s.columns.is_empty()) {
                let rows = &mut rows[(at + 1) * length + subsystem.start..];
                copy_vectors(subsystem.rows(), &mut rows[..subsystem.size()]);
                subsystem.observe(simd, (observed, values, present), (rows, length), 1);
            }
        }
        self.copy_twins(count);
        count
    }

    /// Writes rows a second time that two outputs have in common.
    fn copy_twins(&mut self, count: usize) {
        let Self { gathering, twins, .. } = self;
        if twins.is_empty() {
            return;
        }
        let (layout, _, rows, _) = gathering.several(count);
        for row in rows.chunks_exact_mut(layout.length).skip(1) {
            twins.iter().for_each(|(from, to, width)| row.copy_within(*from..from + width, *to));
        }
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
        for (subsystem, lane_of) in subsystems.iter().zip(&general.lane_of) {
            for (state, value) in subsystem.part.states.iter().zip(&values.states()[subsystem.lane..]) {
                trajectory.nodes[0][*state] = *value;
            }
            let rows = subsystem.rows().chunks_exact(subsystem.width);
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
