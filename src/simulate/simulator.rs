//! One run of a model: outputs, and outputs with sensitivities, by steps that are chosen before.

use super::block::{Block, Sink};
use super::drive::DriveTable;
use super::grid::Grid;
use super::implicit::{Collocation, ImplicitSensitivity, Interval};
use super::recursion::{self, Intervals, Method, Recursion};
use super::retarded::{History, Retarded, RetardedSensitivity};
use super::scheme::Scheme;
use super::sensitivity::Sensitivity;
use super::steps::Steps;
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
    #[error("{steps} steps are more than {MOST_STEPS} in a run of {samples} samples")]
    TooManySteps {
        /// Steps of the run.
        steps: usize,
        /// Samples of the run.
        samples: usize,
    },
    /// Delayed states would have to be interpolated with the sensitivities of the collocation polynomial.
    #[error(
        "the implicit method does not know delayed states yet: integrate this model by Runge-Kutta (`--integrator runge-kutta`)"
    )]
    DelayedStates,
    /// The equations of an implicit step would not fit into memory.
    #[error("{states} states are more than the {MOST_IMPLICIT} of the implicit method: use `--integrator runge-kutta`")]
    TooManyStates {
        /// States of the model.
        states: usize,
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

/// Most states of the implicit method: its matrix has nine times their square entries.
pub(super) const MOST_IMPLICIT: usize = 1000;

/// Simulates one run again and again with other parameters; allocates once.
pub struct Simulator<'a> {
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
    integrator: Integrator,
}

/// What advances the states and their sensitivities, with its memory.
enum Integrator {
    RungeKutta(Option<Sensitivity>),
    Retarded(Box<Retarded>, Option<RetardedSensitivity>),
    Radau(Box<Collocation>, Option<ImplicitSensitivity>),
    Recursion(Box<LinearIntegrator>),
}

/// A linear model's steps, with their memory.
struct LinearIntegrator {
    method: Method,
    intervals: Intervals,
    /// Without columns, and with those that were last asked for.
    response: Option<Recursion>,
    sensitivity: Option<Recursion>,
}

impl Integrator {
    /// A linear model's Runge-Kutta steps are a recursion as well, with other coefficients.
    fn new(layout: &Layout, grid: &Grid, scheme: Scheme, history: Option<&History>) -> Self {
        if let Some(history) = history {
            return Self::Retarded(Box::new(Retarded::new(layout, history)), None);
        }
        let method = match scheme {
            Scheme::Radau if layout.states > 0 => return Self::Radau(Box::new(Collocation::new(layout)), None),
            Scheme::Recursion { .. } => Method::Exact,
            Scheme::RungeKutta | Scheme::Radau => Method::RungeKutta,
        };
        let intervals = grid.per_interval().filter(|_| recursion::suits(layout)).and_then(|_| Intervals::of(grid));
        match intervals {
            Some(intervals) => {
                Self::Recursion(Box::new(LinearIntegrator { method, intervals, response: None, sensitivity: None }))
            }
            None => Self::RungeKutta(None),
        }
    }
}

impl LinearIntegrator {
    /// All samples by recursion.
    fn run(&mut self, simulator: &mut Simulator<'_>, columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        let Self { method, intervals, response, sensitivity } = self;
        let memory = if columns.is_empty() { response } else { sensitivity };
        memory.take_if(|r| r.columns() != columns);
        memory
            .get_or_insert_with(|| Recursion::new(simulator, columns, *method, intervals))
            .run(simulator, intervals, sink)
    }
}

impl Default for Integrator {
    fn default() -> Self {
        Self::RungeKutta(None)
    }
}

impl<'a> Simulator<'a> {
    /// Prepares a run; `steps` as [`super::choose_steps`] gives them, or a whole number of equal Runge-Kutta steps between samples.
    ///
    /// # Errors
    /// [`Unsuited`] when sensitivities would be silently zero, the steps do not fit into memory, or the method does not suit
    /// the model.
    pub fn new(dynamics: &'a dyn Dynamics, run: &'a Run, steps: impl Into<Steps>) -> Result<Self, Unsuited> {
        let (layout, steps) = (dynamics.layout(), steps.into());
        if run.held.len() != layout.inputs || run.inputs.len() != run.len() * layout.inputs {
            return Err(Unsuited::OtherInputs { found: run.held.len(), expected: layout.inputs });
        }
        let total = steps.total(run.len());
        if layout.states > 0 && total > MOST_STEPS {
            return Err(Unsuited::TooManySteps { steps: total, samples: run.len() });
        }
        let delays_states = layout.delayed.iter().any(|s| matches!(s, Signal::State(_)));
        let implicit = layout.states > 0 && steps.scheme() == Scheme::Radau;
        if implicit && delays_states {
            return Err(Unsuited::DelayedStates);
        }
        if implicit && layout.states > MOST_IMPLICIT {
            return Err(Unsuited::TooManyStates { states: layout.states });
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
        let grid = if layout.states == 0 { Grid::without_steps(&run.time) } else { Grid::new(&run.time, &steps) };
        let history = History::new(layout);
        let integrator = Integrator::new(layout, &grid, steps.scheme(), history.as_ref());
        let recursion = matches!(integrator, Integrator::Recursion(_));
        Ok(Self {
            dynamics,
            run,
            drive: DriveTable::new(layout, run, &grid, &steps, recursion),
            grid,
            known: vec![0.0; layout.known],
            work: Workspace::new(dynamics),
            theta: Vec::with_capacity(layout.params),
            integrator,
            history,
            nodes: std::array::from_fn(|_| vec![0.0; layout.states]),
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
        self.begin(theta, 0)?;
        let mut integrator = std::mem::take(&mut self.integrator);
        let result = match &mut integrator {
            Integrator::RungeKutta(_) => self.march(y, Self::advance),
            Integrator::Retarded(retarded, _) => self.march(y, |simulator, k| retarded.advance(simulator, k)),
            // compiled for the machine's widest registers, for the factors
            Integrator::Radau(collocation, _) => {
                pulp::Arch::new().dispatch(|| self.march(y, |simulator, k| collocation.advance(simulator, k)))
            }
            Integrator::Recursion(linear) => {
                let q = self.outputs();
                let mut sink = |block: Block<'_>| y[block.first * q..][..block.y.len()].copy_from_slice(block.y);
                linear.run(self, &[], &mut sink)
            }
        };
        self.integrator = integrator;
        result
    }

    /// The loop over the steps.
    #[inline(always)]
    fn march(
        &mut self,
        y: &mut [f64],
        mut advance: impl FnMut(&mut Self, usize) -> Result<(), Divergence>,
    ) -> Result<(), Divergence> {
        let steps = self.grid.steps();
        if let Some(history) = &mut self.history {
            history.node(self.run.time[0], &self.nodes[0], &[]);
        }
        for k in 0..=steps {
            if let Some(sample) = self.grid.sample_at(k) {
                self.observe(sample, k, &mut y[sample * self.outputs()..])?;
            }
            if k < steps {
                advance(self, k)?;
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
        self.begin(theta, self.dynamics.layout().stage.lanes)?;
        let (dynamics, mut integrator) = (self.dynamics, std::mem::take(&mut self.integrator));
        let result = match &mut integrator {
            Integrator::RungeKutta(memory) => {
                memory.take_if(|s| s.columns() != columns);
                memory.get_or_insert_with(|| Sensitivity::new(dynamics, columns)).run(self, sink)
            }
            Integrator::Retarded(retarded, memory) => {
                memory.take_if(|s| s.columns() != columns);
                let sensitivity = memory.get_or_insert_with(|| RetardedSensitivity::new(dynamics, columns, retarded));
                sensitivity.run(retarded, self, sink)
            }
            Integrator::Radau(collocation, memory) => {
                memory.take_if(|s| s.columns() != columns);
                let sensitivity = memory.get_or_insert_with(|| ImplicitSensitivity::new(dynamics, columns));
                sensitivity.run(collocation, self, sink)
            }
            Integrator::Recursion(linear) => linear.run(self, columns, sink),
        };
        self.integrator = integrator;
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
        self.prepare(theta);
        let lanes = layout.stage.lanes;
        let Self { history: Some(history), integrator: Integrator::Retarded(retarded, _), known, grid, .. } = self
        else {
            return Ok(());
        };
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

    /// Parameters to everything that depends on them alone; first samples are those of this run, whatever theta says.
    fn prepare(&mut self, theta: &[f64]) {
        self.theta.clear();
        self.theta.extend_from_slice(theta);
        for (param, input) in &self.dynamics.layout().first {
            self.theta[*param as usize] = self.run.inputs.get(*input as usize).copied().unwrap_or(f64::NAN);
        }
        self.dynamics.prepare(&self.theta, &mut self.known, &mut self.work);
    }

    /// Parameters to everything that depends on them alone, delays and initial values among it.
    fn begin(&mut self, theta: &[f64], stride: usize) -> Result<(), Divergence> {
        let layout = self.dynamics.layout();
        self.prepare(theta);
        let start = |state| Divergence { time: 0.0, state, sample: 0 };
        let x0 = &self.known[layout.initial.clone()];
        if let Some(state) = x0.iter().position(|x| !x.is_finite()) {
            return Err(start(Some(state)));
        }
        self.nodes[0].copy_from_slice(x0);
        let tau = &self.known[layout.tau.clone()];
        // the future of a record is known, that of a state is not
        let ahead = |(tau, signal): (&f64, &Signal)| *tau < 0.0 && matches!(signal, Signal::State(_));
        if tau.iter().any(|t| !t.is_finite()) || tau.iter().zip(&layout.delayed).any(ahead) {
            return Err(start(None));
        }
        let by_taps = matches!(self.integrator, Integrator::Recursion(_));
        self.drive.delay(tau, self.run, &self.grid, by_taps);
        if let Some(history) = &mut self.history {
            let longest = longest_state_delay(layout, &self.known);
            if history.numbers(stride, longest, &self.grid) > History::MOST {
                return Err(start(None));
            }
            history.begin(stride, longest, &self.grid);
        }
        match &mut self.integrator {
            Integrator::RungeKutta(_) | Integrator::Recursion(_) => {}
            Integrator::Retarded(retarded, _) if retarded.states_at_once(tau, &self.grid) > Retarded::MOST_AT_ONCE => {
                return Err(start(None));
            }
            Integrator::Retarded(retarded, _) => retarded.begin(tau, &self.grid),
            Integrator::Radau(collocation, _) => collocation.begin(),
        }
        Ok(())
    }

    /// One step without sensitivities.
    #[inline(always)]
    fn advance(&mut self, k: usize) -> Result<(), Divergence> {
        let (t, h) = self.grid.step(k);
        let (x, next) = two_nodes(&mut self.nodes, k);
        let step = Step { t, h, x, drive: self.drive.stages(k), known: &self.known };
        self.dynamics.step(step, next, &mut self.work);
        finite(&self.grid, k, next)
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
    Divergence { time: t + h, state, sample: grid.sample_before(k) }
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
