//! A run that is being integrated: its grid, what drives it, the states at the last nodes and the past that delays see.
//!
//! Every integrator advances this, and every observation reads it.

use super::cuts::Cuts;
use super::delayed::History;
use super::drive::DriveTable;
use super::error::Divergence;
use super::events::{Events, Follower, StatesAlone, Stretch};
use super::steps::Grid;
use super::stops::Stops;
use crate::dynamics::{Dynamics, Point, Step, Workspace};
use crate::record::Run;
use fdm_grammar::graph::Signal;

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
