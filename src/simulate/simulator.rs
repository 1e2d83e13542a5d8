//! One run of a model: outputs, and outputs with sensitivities, by fixed-step Runge-Kutta.

use super::block::{Block, Sink};
use super::drive::DriveTable;
use super::grid::Grid;
use super::recursion::{self, Intervals, Method, Recursion};
use super::retarded::{History, Retarded, RetardedSensitivity};
use super::scheme::Scheme;
use super::sensitivity::Sensitivity;
use super::vectors::VECTOR;
use crate::dynamics::{Dynamics, Layout, Point, Step, Workspace};
use crate::record::Run;
use fdm_grammar::graph::Signal;

/// The simulation left the finite numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Divergence {
    /// Time since the run began at which the first value was not finite.
    pub time: f64,
    /// The state that was not finite; `None` when it was an output, a delay or a sensitivity.
    pub state: Option<usize>,
    /// The last sample before that time.
    pub sample: usize,
}

/// Most steps of a run; every step keeps its time and its drive.
const MOST_STEPS: usize = 20_000_000;

/// Why a run cannot be simulated with exact sensitivities.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Unsuited {
    /// The run was made for another model, or lacks the records that drive this one.
    #[error(
        "the run has {found} inputs where the model has {expected}, those that are measured outputs included \
         (`Run::with_measured` completes them)"
    )]
    OtherInputs {
        /// Inputs of the run.
        found: usize,
        /// Inputs of the model, hidden ones included.
        expected: usize,
    },
    /// An output that shows a held input directly moves in jumps with its delay: its derivative is zero or infinite.
    #[error(
        "an output shows an input directly that is held between samples and delayed by an estimated delay: it moves in \
         jumps with that delay, so that nothing can be estimated from it; take input {input} as linear between samples, or fix the delay"
    )]
    HeldAndDelayed {
        /// Index of the input.
        input: usize,
    },
    /// The steps would not fit into memory.
    #[error("{per_interval} steps between samples are more than {MOST_STEPS} in a run of {samples} samples")]
    TooManySteps {
        /// Steps between samples.
        per_interval: usize,
        /// Samples of the run.
        samples: usize,
    },
    /// The past that a delay reaches back to would not fit into memory.
    #[error(
        "a state delayed by {longest} reaches back over {nodes} steps, too many to keep with their sensitivities; shorten the delay, \
         or thin out the record"
    )]
    LongMemory {
        /// The longest delay of a state, in the model's time unit.
        longest: f64,
        /// Steps that it covers.
        nodes: usize,
    },
    /// Too many states are delayed by less than a step: the equations of a step that sees itself would be too large.
    #[error(
        "{states} states are delayed, some by less than a step, and have to be found at once; {} at most: take more steps between \
         samples, or bound the delays from below",
        Retarded::MOST_AT_ONCE
    )]
    ShortDelays {
        /// States that would have to be found at once.
        states: usize,
    },
}

/// Simulates one run again and again with other parameters; allocates once.
pub struct Simulator<'a> {
    pub(super) dynamics: &'a dyn Dynamics,
    pub(super) run: &'a Run,
    pub(super) grid: Grid,
    pub(super) drive: DriveTable,
    pub(super) known: Vec<f64>,
    pub(super) work: Workspace,
    /// The past of states that are seen delayed, and the steps of such a model.
    pub(super) history: Option<History>,
    retarded: Option<Retarded>,
    /// Three nodes' states in turn.
    pub(super) nodes: [Vec<f64>; 3],
    integrator: Integrator,
}

/// What advances the states and their sensitivities, with its memory.
enum Integrator {
    RungeKutta(Option<Sensitivity>),
    /// Runge-Kutta steps that see delayed states.
    Retarded(Option<RetardedSensitivity>),
    Recursion {
        method: Method,
        intervals: Intervals,
        /// Without columns, and with those that were last asked for.
        response: Option<Box<Recursion>>,
        sensitivity: Option<Box<Recursion>>,
    },
}

impl Integrator {
    /// A linear model's Runge-Kutta steps are a recursion as well, with other coefficients.
    fn new(layout: &Layout, grid: &Grid, scheme: Scheme, delays_states: bool) -> Self {
        if delays_states {
            return Self::Retarded(None);
        }
        let method = match scheme {
            Scheme::RungeKutta => Method::RungeKutta,
            Scheme::Recursion { .. } => Method::Exact,
        };
        match Intervals::of(grid).filter(|_| recursion::suits(layout)) {
            Some(intervals) => Self::Recursion { method, intervals, response: None, sensitivity: None },
            None => Self::RungeKutta(None),
        }
    }
}

impl<'a> Simulator<'a> {
    /// Prepares a run for the classical Runge-Kutta method; `per_interval` steps between samples.
    ///
    /// # Errors
    /// As [`Simulator::with_scheme`].
    pub fn new(dynamics: &'a dyn Dynamics, run: &'a Run, per_interval: usize) -> Result<Self, Unsuited> {
        Self::with_scheme(dynamics, run, Scheme::RungeKutta, per_interval)
    }

    /// Prepares a run; `per_interval` steps between samples.
    ///
    /// # Errors
    /// [`Unsuited`] when sensitivities would be silently zero, or the steps do not fit into memory.
    pub fn with_scheme(
        dynamics: &'a dyn Dynamics,
        run: &'a Run,
        scheme: Scheme,
        per_interval: usize,
    ) -> Result<Self, Unsuited> {
        let layout = dynamics.layout();
        if run.held.len() != layout.inputs || run.inputs.len() != run.len() * layout.inputs {
            return Err(Unsuited::OtherInputs { found: run.held.len(), expected: layout.inputs });
        }
        if layout.states > 0 && per_interval.saturating_mul(run.len()) > MOST_STEPS {
            return Err(Unsuited::TooManySteps { per_interval, samples: run.len() });
        }
        for (d, signal) in layout.delayed.iter().enumerate() {
            if let Signal::Input(input) = *signal
                && run.held[input as usize]
                && layout.patterns.outputs_by_delayed.columns.contains(&(d as u32))
                && layout.patterns.tau_by_param.row(d).next().is_some()
            {
                return Err(Unsuited::HeldAndDelayed { input: input as usize });
            }
        }
        let grid = Grid::new(&run.time, if layout.states == 0 { 0 } else { per_interval.max(1) });
        let history = History::new(layout);
        let integrator = Integrator::new(layout, &grid, scheme, history.is_some());
        Ok(Self {
            dynamics,
            run,
            drive: DriveTable::new(layout, run, &grid),
            grid,
            known: vec![0.0; layout.known],
            work: Workspace::new(dynamics),
            retarded: history.as_ref().map(|history| Retarded::new(layout, history)),
            history,
            nodes: std::array::from_fn(|_| vec![0.0; layout.states]),
            integrator,
        })
    }

    /// The run that is simulated.
    pub fn run(&self) -> &Run {
        self.run
    }

    /// The steps in use.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Number of samples N.
    pub fn samples(&self) -> usize {
        self.run.len()
    }

    /// Number of outputs q.
    pub fn outputs(&self) -> usize {
        self.dynamics.layout().outputs
    }

    /// Outputs at the samples (N by q) for parameters theta (p).
    ///
    /// # Errors
    /// [`Divergence`] at the first value that is not finite; rows before it are filled.
    pub fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        if let Integrator::Recursion { .. } = self.integrator {
            let q = self.outputs();
            let mut sink = |block: Block<'_>| y[block.first * q..][..block.y.len()].copy_from_slice(block.y);
            return self.recur(theta, &[], &mut sink);
        }
        self.begin(theta, 0)?;
        if let Some(retarded) = &mut self.retarded {
            retarded.begin(&self.known[self.dynamics.layout().tau.clone()], &self.grid);
        }
        let steps = self.grid.steps();
        if let Some(history) = &mut self.history {
            history.node(self.run.time[0], &self.nodes[0], &[]);
        }
        for k in 0..=steps {
            if let Some(sample) = self.grid.sample_at(k) {
                self.observe(sample, k, &mut y[sample * self.outputs()..])?;
            }
            if k < steps {
                self.advance(k)?;
            }
        }
        self.stateless(|simulator, sample| {
            let q = simulator.outputs();
            simulator.observe(sample, 0, &mut y[sample * q..])
        })
    }

    /// Outputs and their derivatives by the parameters `columns` (indices into theta), a block of samples at a time to
    /// `sink`.
    ///
    /// # Panics
    /// When a column is fixed in the model: it has no derivatives, and a silent zero would be wrong.
    ///
    /// # Errors
    /// [`Divergence`] at the first value that is not finite; blocks before it may have been handed over.
    pub fn stream(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        match &mut self.integrator {
            Integrator::RungeKutta(memory) => {
                let mut sensitivity = match memory.take() {
                    Some(s) if s.columns() == columns => s,
                    _ => Sensitivity::new(self.dynamics, columns),
                };
                let result = self.begin(theta, sensitivity.lanes()).and_then(|()| sensitivity.run(self, sink));
                self.integrator = Integrator::RungeKutta(Some(sensitivity));
                result
            }
            Integrator::Retarded(memory) => {
                let Some(mut retarded) = self.retarded.take() else { return Ok(()) };
                let mut sensitivity = match memory.take() {
                    Some(s) if s.columns() == columns => s,
                    _ => RetardedSensitivity::new(self.dynamics, columns, &retarded),
                };
                let result = self.begin(theta, sensitivity.lanes()).and_then(|()| {
                    retarded.begin(&self.known[self.dynamics.layout().tau.clone()], &self.grid);
                    sensitivity.run(&mut retarded, self, sink)
                });
                self.retarded = Some(retarded);
                self.integrator = Integrator::Retarded(Some(sensitivity));
                result
            }
            Integrator::Recursion { .. } => self.recur(theta, columns, sink),
        }
    }

    /// All samples by recursion.
    fn recur(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        self.begin(theta, 0)?;
        let integrator = std::mem::replace(&mut self.integrator, Integrator::RungeKutta(None));
        let Integrator::Recursion { method, intervals, mut response, mut sensitivity } = integrator else {
            return Ok(());
        };
        let memory = if columns.is_empty() { &mut response } else { &mut sensitivity };
        let mut recursion = match memory.take() {
            Some(recursion) if recursion.columns() == columns => recursion,
            _ => Box::new(Recursion::new(self, columns, method, &intervals)),
        };
        let result = recursion.run(self, &intervals, sink);
        *memory = Some(recursion);
        self.integrator = Integrator::Recursion { method, intervals, response, sensitivity };
        result
    }

    /// Everything that [`Simulator::stream`] gives, in one piece: outputs (N by q), and derivatives in `jacobian`, N q rows
    /// of `stride` lanes, where stride is the number of columns rounded up to a multiple of 8; lanes behind the columns
    /// are zero.
    ///
    /// # Panics
    /// As [`Simulator::stream`].
    ///
    /// # Errors
    /// As [`Simulator::stream`].
    pub fn sensitivities(
        &mut self,
        theta: &[f64],
        columns: &[usize],
        y: &mut [f64],
        jacobian: &mut [f64],
    ) -> Result<(), Divergence> {
        let stride = columns.len().next_multiple_of(VECTOR);
        self.stream(theta, columns, &mut |block| block.copy_to(y, jacobian, stride))
    }

    /// Whether the delays of states at theta can be followed on these steps.
    ///
    /// # Errors
    /// [`Unsuited::LongMemory`], [`Unsuited::ShortDelays`].
    pub fn suits(&mut self, theta: &[f64]) -> Result<(), Unsuited> {
        let layout = self.dynamics.layout();
        self.dynamics.prepare(theta, &mut self.known, &mut self.work);
        let lanes = layout.stage.lanes;
        let Self { history: Some(history), retarded: Some(retarded), known, grid, .. } = self else { return Ok(()) };
        let longest = longest_state_delay(layout, known);
        let numbers = history.numbers(lanes, longest, grid);
        if numbers > History::MOST {
            return Err(Unsuited::LongMemory { longest, nodes: numbers / history.numbers_per_node(lanes) });
        }
        match retarded.states_at_once(&known[layout.tau.clone()], grid) {
            states if states > Retarded::MOST_AT_ONCE => Err(Unsuited::ShortDelays { states }),
            _ => Ok(()),
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

    /// Parameters to everything that depends on them alone, delays and initial values among it.
    fn begin(&mut self, theta: &[f64], stride: usize) -> Result<(), Divergence> {
        let layout = self.dynamics.layout();
        self.dynamics.prepare(theta, &mut self.known, &mut self.work);
        let start = |state| Divergence { time: 0.0, state, sample: 0 };
        let x0 = &self.known[layout.initial.clone()];
        if let Some(state) = x0.iter().position(|x| !x.is_finite()) {
            return Err(start(Some(state)));
        }
        self.nodes[0].copy_from_slice(x0);
        let tau = &self.known[layout.tau.clone()];
        if tau.iter().any(|t| !t.is_finite() || *t < 0.0) {
            return Err(start(None));
        }
        self.drive.delay(tau, self.run, &self.grid);
        if let Some(history) = &mut self.history {
            let longest = longest_state_delay(layout, &self.known);
            let too_many = |r: &Retarded| r.states_at_once(tau, &self.grid) > Retarded::MOST_AT_ONCE;
            if history.numbers(stride, longest, &self.grid) > History::MOST
                || self.retarded.as_ref().is_some_and(too_many)
            {
                return Err(start(None));
            }
            history.begin(stride, longest, &self.grid);
        }
        Ok(())
    }

    /// One step without sensitivities.
    fn advance(&mut self, k: usize) -> Result<(), Divergence> {
        if let Some(mut retarded) = self.retarded.take() {
            let result = retarded.advance(self, k);
            self.retarded = Some(retarded);
            return result;
        }
        let (t, h) = self.grid.step(k);
        let (x, next) = two_nodes(&mut self.nodes, k);
        let step = Step { t, h, x, drive: self.drive.stages(k), known: &self.known };
        self.dynamics.step(step, next, &mut self.work);
        finite(&self.grid, k, next)
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
        if y.iter().all(|y| y.is_finite()) { Ok(()) } else { Err(Divergence { time: t, state: None, sample }) }
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
    Divergence { time: t + h, state, sample: k / grid.per_interval().max(1) }
}

/// The longest delay of a state.
fn longest_state_delay(layout: &Layout, known: &[f64]) -> f64 {
    let delays = layout.delayed.iter().zip(&known[layout.tau.clone()]);
    delays.filter(|(s, _)| matches!(s, Signal::State(_))).map(|(_, tau)| *tau).fold(0.0, f64::max)
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
