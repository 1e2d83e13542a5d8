//! A run that is being integrated: its grid, what drives it, the states at the last nodes and the past that delays see.
//!
//! Every integrator advances this, and every observation reads it.
//!
//! Outputs and their sensitivities at a sample: `y_theta = h_theta + h_x S + h_delay S_delay`.
//!
//! Every integrator observes by this: it gives the states at the sample and their sensitivities in lanes.

use super::cuts::{Cuts, Stops};
use super::delayed::History;
use super::drive::DriveTable;
use super::error::Divergence;
use super::events::{Events, Follower, StatesAlone, Stretch};
use super::steps::Grid;
use crate::dynamics::{Dynamics, Layout, Point, Step, Workspace};
use crate::record::Run;
use fdm_grammar::graph::Signal;
use fdm_numeric::lanes::{VECTOR, accumulate, copy_vectors, gather};

/// A step as an implicit method sees it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Interval<'a> {
    /// Time at the beginning.
    pub(super) t: f64,
    /// Length.
    pub(super) h: f64,
    /// States at the beginning (n).
    pub(super) x: &'a [f64],
    /// Drive at the stages (3 by drive), and slopes of the delayed inputs there (3 by delayed signals).
    pub(super) drive: &'a [f64],
    pub(super) slopes: &'a [f64],
    /// What `prepare` computed.
    pub(super) known: &'a [f64],
}

/// One run with its parameters.
pub(super) struct Trajectory<'a> {
    pub(super) dynamics: &'a dyn Dynamics,
    pub(super) run: &'a Run,
    pub(super) grid: Grid,
    pub(super) drive: DriveTable,
    pub(super) known: Vec<f64>,
    pub(super) work: Workspace,
    /// All parameters, with first samples of the run's inputs filled in.
    theta: Vec<f64>,
    /// The past of states that are seen delayed.
    pub(super) history: Option<History>,
    /// Three nodes' states in turn.
    pub(super) nodes: [Vec<f64>; 3],
    /// Limited states at the ends of the last steps.
    pub(super) stops: Stops,
    /// Of a model whose steps are cut at limits or kinks.
    pub(super) cuts: Option<Box<Cuts>>,
    /// Of a model that has events.
    pub(super) events: Option<Box<Events>>,
}

impl<'a> Trajectory<'a> {
    /// `kinks`: whether explicit steps are cut there, too.
    pub(super) fn new(
        dynamics: &'a dyn Dynamics,
        run: &'a Run,
        (grid, drive): (Grid, DriveTable),
        kinks: bool,
    ) -> Self {
        let layout = dynamics.layout();
        Self {
            dynamics,
            run,
            grid,
            drive,
            known: vec![0.0; layout.known],
            work: Workspace::new(dynamics),
            theta: Vec::with_capacity(layout.params),
            history: History::new(layout),
            nodes: std::array::from_fn(|_| vec![0.0; layout.states]),
            stops: Stops::new(layout),
            cuts: Cuts::new(layout, kinks),
            events: Events::new(layout),
        }
    }

    /// At the beginning of a run, whose states stand at node 0.
    pub(super) fn begin_events(&mut self) {
        let Self { dynamics, grid, drive, known, nodes, work, events: Some(events), .. } = self else { return };
        if grid.steps() > 0 {
            let (t, h) = grid.step(0);
            events.begin(&Stretch { dynamics: *dynamics, t, h, drive: drive.stages(0), known }, &nodes[0], work);
        }
    }

    /// Samples behind the first of a model without states: nothing to integrate, only outputs.
    pub(super) fn stateless(
        &mut self,
        mut emit: impl FnMut(&mut Self, usize) -> Result<(), Divergence>,
    ) -> Result<(), Divergence> {
        if self.dynamics.layout().states > 0 {
            return Ok(());
        }
        (1..self.run.len()).try_for_each(|sample| emit(self, sample))
    }

    /// Parameters to everything that depends on them alone; first samples are those of this run, whatever theta says.
    pub(super) fn prepare(&mut self, theta: &[f64]) {
        self.theta.clear();
        self.theta.extend_from_slice(theta);
        for (param, input) in &self.dynamics.layout().first {
            self.theta[*param as usize] = self.run.inputs.get(*input as usize).copied().unwrap_or(f64::NAN);
        }
        self.dynamics.prepare(&self.theta, &mut self.known, &mut self.work);
    }

    /// One step without sensitivities.
    #[inline(always)]
    pub(super) fn advance(&mut self, k: usize) -> Result<(), Divergence> {
        let (t, h) = self.grid.step(k);
        let (x, next) = two_nodes(&mut self.nodes, k);
        let step = Step { t, h, x, drive: self.drive.stages(k), known: &self.known };
        self.dynamics.step(step, next, &mut self.work);
        if self.cuts.is_some() {
            self.cut(k, &mut StatesAlone);
        }
        let next = two_nodes(&mut self.nodes, k).1;
        self.stops.hold(k, self.dynamics, &self.known, next);
        finite(&self.grid, k, next)?;
        if self.events.is_some() {
            return self.across(k, &mut StatesAlone);
        }
        Ok(())
    }

    /// Cuts step k, whose end as if there were nothing to cut it at stands at node k + 1.
    pub(super) fn cut(&mut self, k: usize, follower: &mut dyn Follower) {
        let Self { dynamics, grid, drive, known, nodes, work, cuts: Some(cuts), .. } = self else { return };
        let (t, h) = grid.step(k);
        let (x, next) = two_nodes(nodes, k);
        // what has diverged is told by who took the step
        if next.iter().all(|x| x.is_finite()) {
            cuts.across(&Stretch { dynamics: *dynamics, t, h, drive: drive.stages(k), known }, x, next, work, follower);
        }
    }

    /// The events of step k, whose end without them stands at node k + 1.
    pub(super) fn across(&mut self, k: usize, follower: &mut dyn Follower) -> Result<(), Divergence> {
        let Self { dynamics, grid, drive, known, nodes, work, events: Some(events), .. } = self else { return Ok(()) };
        let (t, h) = grid.step(k);
        let (x, next) = two_nodes(nodes, k);
        let stretch = Stretch { dynamics: *dynamics, t, h, drive: drive.stages(k), known };
        let sample = grid.sample_before(k);
        let fault = |(time, fault)| Divergence { time, state: None, sample, event: Some(fault) };
        events.across(&stretch, x, next, work, follower).map_err(fault)?;
        finite(grid, k, next)
    }

    /// Takes the limited states at the end of step k back, for methods that have just found them.
    #[inline(always)]
    pub(super) fn hold(&mut self, k: usize) {
        let next = two_nodes(&mut self.nodes, k).1;
        self.stops.hold(k, self.dynamics, &self.known, next);
    }

    /// Step k as the implicit method sees it, where its end goes, and memory.
    #[inline(always)]
    pub(super) fn interval(&mut self, k: usize) -> (Interval<'_>, &mut [f64], &mut Workspace) {
        let (t, h) = self.grid.step(k);
        let (x, next) = two_nodes(&mut self.nodes, k);
        let (drive, slopes) = (self.drive.stages(k), self.drive.stage_slopes(k));
        (Interval { t, h, x, drive, slopes, known: &self.known }, next, &mut self.work)
    }

    /// Outputs at a sample, delayed states filled in first.
    pub(super) fn observe(&mut self, sample: usize, k: usize, y: &mut [f64]) -> Result<(), Divergence> {
        let layout = self.dynamics.layout();
        let t = self.run.time[sample];
        let drive = self.drive.sample(sample);
        if let Some(history) = &self.history {
            for (d, signal) in layout.delayed.iter().enumerate() {
                if let Signal::State(state) = *signal {
                    let tau = self.known[layout.tau.start + d];
                    drive[layout.inputs + d] = history.at(t - tau, state as usize, &mut []).0;
                }
            }
        }
        let x = &self.nodes[node(k)];
        let y = &mut y[..layout.outputs];
        self.dynamics.outputs(Point { t, x, drive, known: &self.known }, y, &mut self.work);
        if y.iter().all(|y| y.is_finite()) {
            Ok(())
        } else {
            Err(Divergence { time: t, state: None, sample, event: None })
        }
    }
}

/// The states after step k are finite, or the run has diverged.
#[inline]
pub(super) fn finite(grid: &Grid, k: usize, x: &[f64]) -> Result<(), Divergence> {
    if x.iter().all(|x| x.is_finite()) {
        return Ok(());
    }
    Err(diverged(grid, k, x.iter().position(|x| !x.is_finite())))
}

/// Step k has left the finite numbers.
pub(super) fn diverged(grid: &Grid, k: usize, state: Option<usize>) -> Divergence {
    let (t, h) = grid.step(k);
    Divergence { time: t + h, state, sample: grid.sample_before(k), event: None }
}

/// Which of the three nodes in turn holds node k.
#[inline]
pub(super) fn node(k: usize) -> usize {
    k % 3
}

/// The states of node k to read, and those of node k + 1 to write.
#[inline]
pub(super) fn two_nodes(nodes: &mut [Vec<f64>; 3], k: usize) -> (&[f64], &mut [f64]) {
    let [a, b, c] = nodes;
    match node(k) {
        0 => (a, b),
        1 => (b, c),
        _ => (c, a),
    }
}

/// Copies one number of a result to a lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scatter {
    pub(super) from: u32,
    pub(super) to: u32,
}

/// Adds `entry * row` of sensitivities to a row of outputs.
#[derive(Debug, Clone, Copy)]
struct OutputTerm {
    /// Position of the entry of h_x or h_delay in the result.
    entry: u32,
    /// First lane of the row that is read.
    from: u32,
    /// First lane of the row that is added to.
    to: u32,
}

/// Plans and memory for observing with one choice of columns.
pub(super) struct Observation {
    /// Lane of each column; empty when column k is lane k and no lane is left out.
    lane_of: Vec<u32>,
    lanes: usize,
    /// Numbers in a row of the Jacobian: columns, rounded up to whole vectors.
    pub(super) stride: usize,
    by_param: Vec<Scatter>,
    by_state: Vec<OutputTerm>,
    by_delayed: Vec<OutputTerm>,
    /// (position of tau_theta in known, delayed signal, lane)
    tau: Vec<(usize, usize, usize)>,
    /// For each output the state that it is, when every output is a state.
    observed: Option<Vec<u32>>,
    /// Result of `outputs_and_partials`, sensitivities of delayed signals, and rows of outputs in lanes.
    output: Vec<f64>,
    delayed: Vec<f64>,
    rows: Vec<f64>,
}

impl Observation {
    /// # Panics
    /// When a column is a parameter that is fixed in the model: its sensitivity would be a silent zero.
    pub(super) fn new(layout: &Layout, columns: &[usize]) -> Self {
        let (p, stage) = (&layout.patterns, &layout.stage);
        let lane = |param: usize| stage.lane[param].map(|l| l as usize);
        let lane_of: Vec<u32> = columns
            .iter()
            .map(|c| {
                stage.lane[*c].unwrap_or_else(|| panic!("parameter {c} is fixed in the model: it has no derivatives"))
            })
            .collect();
        let all = lane_of.iter().enumerate().all(|(k, l)| k == *l as usize);
        let all = all && columns.len() == stage.lane.iter().flatten().count();
        let terms = |pattern: &fdm_grammar::Pattern, first: usize| -> Vec<OutputTerm> {
            let row = |i: usize| (i * stage.lanes) as u32;
            pattern
                .entries()
                .map(|(k, i, j)| OutputTerm { entry: (first + k) as u32, from: row(j), to: row(i) })
                .collect()
        };
        let at = |(k, d, j)| Some((layout.tau_by_param.start + k, d, lane(j)?));
        let by_param = layout.outputs + p.outputs_by_state.len() + p.outputs_by_delayed.len();
        Self {
            lane_of: if all { Vec::new() } else { lane_of },
            lanes: stage.lanes,
            stride: columns.len().next_multiple_of(VECTOR),
            by_param: scatter(layout, &p.outputs_by_param, by_param),
            by_state: terms(&p.outputs_by_state, layout.outputs),
            by_delayed: terms(&p.outputs_by_delayed, layout.outputs + p.outputs_by_state.len()),
            tau: p.tau_by_param.entries().filter_map(at).collect(),
            observed: layout.observed.iter().copied().collect(),
            output: vec![0.0; layout.output_slots()],
            delayed: vec![0.0; layout.delayed.len() * stage.lanes],
            rows: vec![0.0; if all { 0 } else { layout.outputs * stage.lanes }],
        }
    }

    /// Outputs (q) and their sensitivities (q rows of `stride`) at the sample that is node k, whose states have the
    /// sensitivities `s` (n rows of lanes).
    #[inline(always)]
    pub(super) fn observe(
        &mut self,
        trajectory: &mut Trajectory<'_>,
        (sample, k): (usize, usize),
        s: &[f64],
        y: &mut [f64],
        rows: &mut [f64],
    ) -> Result<(), Divergence> {
        if let Some(observed) = &self.observed {
            let x = &trajectory.nodes[node(k)];
            for (state, y) in observed.iter().zip(y) {
                *y = x[*state as usize];
            }
            match (self.lane_of.is_empty(), self.stride / VECTOR) {
                (true, 1) => copy_rows::<1>(observed, s, rows),
                (true, 2) => copy_rows::<2>(observed, s, rows),
                (true, 3) => copy_rows::<3>(observed, s, rows),
                (true, 4) => copy_rows::<4>(observed, s, rows),
                _ => self.choose_rows(observed, s, rows),
            }
            return Ok(());
        }
        if self.lane_of.is_empty() {
            return self.outputs(trajectory, (sample, k), s, y, rows);
        }
        let mut in_lanes = std::mem::take(&mut self.rows);
        let result = self.outputs(trajectory, (sample, k), s, y, &mut in_lanes);
        for (row, lanes) in rows.chunks_exact_mut(self.stride.max(1)).zip(in_lanes.chunks_exact(self.lanes.max(1))) {
            gather(&self.lane_of, lanes, row);
        }
        self.rows = in_lanes;
        result
    }

    /// The rows of states, of which each lane is a column or only some are.
    #[inline(always)]
    fn choose_rows(&self, observed: &[u32], s: &[f64], rows: &mut [f64]) {
        for (state, row) in observed.iter().zip(rows.chunks_exact_mut(self.stride.max(1))) {
            let lanes = &s[*state as usize * self.lanes..][..self.lanes];
            if self.lane_of.is_empty() { copy_vectors(lanes, row) } else { gather(&self.lane_of, lanes, row) }
        }
    }

    /// The general case: `h_theta + h_x S + h_delay S_delay`, q rows of lanes.
    #[inline(always)]
    fn outputs(
        &mut self,
        trajectory: &mut Trajectory<'_>,
        (sample, k): (usize, usize),
        s: &[f64],
        y: &mut [f64],
        rows: &mut [f64],
    ) -> Result<(), Divergence> {
        let dynamics = trajectory.dynamics;
        let layout = dynamics.layout();
        let (q, lanes, t) = (layout.outputs, self.lanes, trajectory.run.time[sample]);
        if !layout.delayed.is_empty() {
            self.delay_signals(
                layout,
                trajectory.history.as_ref(),
                sample,
                t,
                &trajectory.known,
                &mut trajectory.drive,
            );
        }
        let x = &trajectory.nodes[node(k)];
        let at = Point { t, x, drive: trajectory.drive.sample(sample), known: &trajectory.known };
        dynamics.outputs_and_partials(at, &mut self.output, &mut trajectory.work);
        y.copy_from_slice(&self.output[..q]);
        rows.fill(0.0);
        for c in &self.by_param {
            rows[c.to as usize] = self.output[c.from as usize];
        }
        for (terms, from) in [(&self.by_state, s), (&self.by_delayed, &self.delayed[..])] {
            for term in terms {
                let (from, to) = (&from[term.from as usize..][..lanes], &mut rows[term.to as usize..][..lanes]);
                accumulate(self.output[term.entry as usize], from, to);
            }
        }
        if y.iter().all(|y| y.is_finite()) {
            Ok(())
        } else {
            Err(Divergence { time: t, state: None, sample, event: None })
        }
    }

    /// Delayed signals at a sample with their sensitivities: the signal's own, and -slope times tau_theta.
    #[inline(always)]
    fn delay_signals(
        &mut self,
        layout: &Layout,
        history: Option<&History>,
        sample: usize,
        t: f64,
        known: &[f64],
        drive: &mut DriveTable,
    ) {
        self.delayed.fill(0.0);
        for (d, signal) in layout.delayed.iter().enumerate() {
            let lanes = &mut self.delayed[d * self.lanes..][..self.lanes];
            let slope = match (*signal, history) {
                (Signal::State(state), Some(history)) => {
                    let (value, slope) = history.at(t - known[layout.tau.start + d], state as usize, lanes);
                    drive.sample(sample)[layout.inputs + d] = value;
                    slope
                }
                _ => drive.sample_slopes(sample)[d],
            };
            for (at, _, lane) in self.tau.iter().filter(|(_, delayed, _)| *delayed == d) {
                lanes[*lane] -= slope * known[*at];
            }
        }
    }
}

/// The rows of states, V vectors each.
#[inline(always)]
fn copy_rows<const V: usize>(observed: &[u32], s: &[f64], rows: &mut [f64]) {
    let (from, to) = (s.as_chunks::<VECTOR>().0.as_chunks::<V>().0, rows.as_chunks_mut::<VECTOR>().0);
    for (state, row) in observed.iter().zip(to.as_chunks_mut::<V>().0) {
        *row = from[*state as usize];
    }
}

/// The entries of a pattern of derivatives by parameters that have a lane; results start at `first`.
pub(super) fn scatter(layout: &Layout, pattern: &fdm_grammar::Pattern, first: usize) -> Vec<Scatter> {
    let stage = &layout.stage;
    let to = |row: usize, column: usize| stage.lane[column].map(|l| (row * stage.lanes) as u32 + l);
    let entries = pattern.entries();
    entries.filter_map(|(k, i, j)| to(i, j).map(|to| Scatter { from: (first + k) as u32, to })).collect()
}
