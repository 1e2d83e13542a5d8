//! One run of a model: outputs, and outputs with sensitivities, by steps that are chosen before.
//!
//! Single steps of a model, of any length and anywhere, whose drive at the stages is known ([`SingleStep`]).

use super::blocks::{Block, Sink};
use super::cuts::take_back;
use super::delayed::{DelayedSensitivity, DelayedStates, History};
use super::discrete;
use super::discrete::{Discrete, Intervals, Method};
use super::drive::DriveTable;
use super::error::{Divergence, MOST_AT_ONCE, MOST_IMPLICIT, MOST_STEPS, Unsuited};
use super::steps::{Grid, NODES, Scheme, Steps};
use super::stiff::{Collocation, StiffSensitivity};
use super::tangent::Sensitivity;
use super::trajectory::{Interval, Trajectory, node};
use crate::dynamics::{Dynamics, Layout, Point, Step, Workspace};
use crate::record::Run;
use fdm_grammar::graph::Signal;
use fdm_numeric::lanes::VECTOR;

/// Simulates one run again and again with other parameters; allocates once.
pub struct Simulator<'a> {
    trajectory: Trajectory<'a>,
    integrator: Integrator,
}

/// What advances the states and their sensitivities, with its memory.
enum Integrator {
    RungeKutta(Option<Sensitivity>),
    Delayed(Box<DelayedStates>, Option<DelayedSensitivity>),
    Stiff(Box<Collocation>, Option<StiffSensitivity>),
    Discrete(Box<LinearIntegrator>),
}

/// A linear model's steps, with their memory.
struct LinearIntegrator {
    method: Method,
    intervals: Intervals,
    /// Without columns, and with those that were last asked for.
    response: Option<Discrete>,
    sensitivity: Option<Discrete>,
}

impl Integrator {
    /// A small linear model's Runge-Kutta steps are a recursion from node to node as well, with other coefficients.
    fn new(layout: &Layout, grid: &Grid, scheme: Scheme, history: Option<&History>) -> Self {
        if let Some(history) = history {
            return Self::Delayed(Box::new(DelayedStates::new(layout, history)), None);
        }
        let (method, suited) = match scheme {
            Scheme::Radau if layout.states > 0 => return Self::Stiff(Box::new(Collocation::new(layout)), None),
            Scheme::ExactDiscretisation { .. } => (Method::Exact, discrete::possible(layout)),
            Scheme::RungeKutta | Scheme::Radau => (Method::RungeKutta, discrete::suits(layout)),
        };
        let intervals = grid.per_interval().filter(|_| suited).and_then(|_| Intervals::of(grid));
        match intervals {
            Some(intervals) => {
                Self::Discrete(Box::new(LinearIntegrator { method, intervals, response: None, sensitivity: None }))
            }
            None => Self::RungeKutta(None),
        }
    }
}

impl Integrator {
    /// All samples, step by step; those of a linear model go another way.
    fn march<'a>(
        &mut self,
        trajectory: &mut Trajectory<'a>,
        visit: impl FnMut(&mut Trajectory<'a>, usize, usize) -> Result<(), Divergence>,
    ) -> Result<(), Divergence> {
        match self {
            Self::RungeKutta(_) | Self::Discrete(_) => march(trajectory, visit, Trajectory::advance),
            Self::Delayed(delayed, _) => march(trajectory, visit, |t, k| delayed.advance(t, k)),
            Self::Stiff(collocation, _) => march(trajectory, visit, |t, k| collocation.advance(t, k)),
        }
    }
}

impl LinearIntegrator {
    /// All samples.
    fn run(
        &mut self,
        trajectory: &mut Trajectory<'_>,
        columns: &[usize],
        sink: &mut Sink<'_>,
    ) -> Result<(), Divergence> {
        let Self { method, intervals, response, sensitivity } = self;
        let memory = if columns.is_empty() { response } else { sensitivity };
        memory.take_if(|r| r.columns() != columns);
        memory
            .get_or_insert_with(|| Discrete::new(trajectory, columns, *method, intervals))
            .run(trajectory, intervals, sink)
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
        dynamics.ready().map_err(Unsuited::ForeignCode)?;
        let total = steps.total(run.len());
        if layout.states > 0 && total > MOST_STEPS {
            return Err(Unsuited::TooManySteps { steps: total, samples: run.len() });
        }
        let delays_states = layout.delayed.iter().any(|s| matches!(s, Signal::State(_)));
        let implicit = layout.states > 0 && steps.scheme() == Scheme::Radau;
        if implicit && delays_states {
            return Err(Unsuited::DelayedStates);
        }
        if implicit && !layout.events.is_empty() {
            return Err(Unsuited::Events);
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
        let integrator = Integrator::new(layout, &grid, steps.scheme(), History::new(layout).as_ref());
        let discrete = matches!(integrator, Integrator::Discrete(_));
        let drive = DriveTable::new(layout, run, &grid, &steps, discrete);
        Ok(Self { trajectory: Trajectory::new(dynamics, run, (grid, drive), steps.are_cut()), integrator })
    }

    /// The run that is simulated.
    pub fn run(&self) -> &Run {
        self.trajectory.run
    }

    /// The steps in use.
    pub fn grid(&self) -> &Grid {
        &self.trajectory.grid
    }

    /// Number of samples N.
    pub fn samples(&self) -> usize {
        self.trajectory.run.len()
    }

    /// Number of outputs q.
    pub fn outputs(&self) -> usize {
        self.trajectory.dynamics.layout().outputs
    }

    /// Outputs at the samples (N by q) for parameters theta (p).
    ///
    /// # Errors
    /// [`Divergence`] at the first value that is not finite; rows before it are filled.
    pub fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        self.begin(theta, 0)?;
        let Self { trajectory, integrator } = self;
        let q = trajectory.dynamics.layout().outputs;
        match integrator {
            Integrator::Discrete(linear) => {
                let mut sink = |block: Block<'_>| y[block.first * q..][..block.y.len()].copy_from_slice(block.y);
                linear.run(trajectory, &[], &mut sink)
            }
            other => other.march(trajectory, |t, sample, k| t.observe(sample, k, &mut y[sample * q..])),
        }?;
        trajectory.run.turn(&trajectory.dynamics.layout().wraps, 0, y);
        Ok(())
    }

    /// States at the samples (N by n) for parameters theta (p); false where they are not known, because the model is linear
    /// and goes from sample to sample at once.
    ///
    /// # Errors
    /// [`Divergence`] as [`Simulator::simulate`].
    pub fn states(&mut self, theta: &[f64], x: &mut [f64]) -> Result<bool, Divergence> {
        self.begin(theta, 0)?;
        let Self { trajectory, integrator } = self;
        let n = trajectory.dynamics.layout().states;
        if matches!(integrator, Integrator::Discrete(_)) || n == 0 {
            return Ok(false);
        }
        let visit = |t: &mut Trajectory<'_>, sample: usize, k: usize| {
            x[sample * n..][..n].copy_from_slice(&t.nodes[node(k)]);
            Ok(())
        };
        integrator.march(trajectory, visit).map(|()| true)
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
        let (run, dynamics) = (self.trajectory.run, self.trajectory.dynamics);
        let wraps = &dynamics.layout().wraps;
        if wraps.is_empty() {
            return self.streamed(theta, columns, sink);
        }
        let mut turned = Vec::new();
        self.streamed(theta, columns, &mut |block| {
            turned.clear();
            turned.extend_from_slice(block.y);
            run.turn(wraps, block.first, &mut turned);
            sink(Block { y: &turned, ..block });
        })
    }

    fn streamed(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        self.begin(theta, self.trajectory.dynamics.layout().stage.lanes)?;
        let Self { trajectory, integrator } = self;
        let dynamics = trajectory.dynamics;
        match integrator {
            Integrator::RungeKutta(memory) => {
                memory.take_if(|s| s.columns() != columns);
                memory.get_or_insert_with(|| Sensitivity::new(dynamics, columns)).run(trajectory, sink)
            }
            Integrator::Delayed(delayed, memory) => {
                memory.take_if(|s| s.columns() != columns);
                let sensitivity = memory.get_or_insert_with(|| DelayedSensitivity::new(dynamics, columns, delayed));
                sensitivity.run(delayed, trajectory, sink)
            }
            Integrator::Stiff(collocation, memory) => {
                memory.take_if(|s| s.columns() != columns);
                let sensitivity = memory.get_or_insert_with(|| StiffSensitivity::new(dynamics, columns));
                sensitivity.run(collocation, trajectory, sink)
            }
            Integrator::Discrete(linear) => linear.run(trajectory, columns, sink),
        }
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
        let Self { trajectory, integrator } = self;
        trajectory.prepare(theta);
        let Trajectory { dynamics, history: Some(history), known, grid, .. } = trajectory else { return Ok(()) };
        let Integrator::Delayed(delayed, _) = integrator else { return Ok(()) };
        let layout = dynamics.layout();
        let lanes = layout.stage.lanes;
        let longest = longest_state_delay(layout, known);
        let numbers = history.numbers(lanes, longest, grid);
        if numbers > History::MOST {
            return Err(Unsuited::LongMemory { longest, nodes: numbers / history.numbers_per_node(lanes) });
        }
        match delayed.states_at_once(&known[layout.tau.clone()], grid) {
            states if states > MOST_AT_ONCE => Err(Unsuited::ShortDelays { states }),
            _ => Ok(()),
        }
    }

    /// Parameters to everything that depends on them alone, delays and initial values among it.
    fn begin(&mut self, theta: &[f64], stride: usize) -> Result<(), Divergence> {
        let Self { trajectory, integrator } = self;
        trajectory.prepare(theta);
        let Trajectory { dynamics, run, grid, drive, known, nodes, .. } = trajectory;
        let layout = dynamics.layout();
        let start = |state| Divergence { time: 0.0, state, sample: 0, event: None };
        let x0 = &known[layout.initial.clone()];
        if let Some(state) = x0.iter().position(|x| !x.is_finite()) {
            return Err(start(Some(state)));
        }
        nodes[0].copy_from_slice(x0);
        let tau = &known[layout.tau.clone()];
        // the future of a record is known, that of a state is not
        let ahead = |(tau, signal): (&f64, &Signal)| *tau < 0.0 && matches!(signal, Signal::State(_));
        if tau.iter().any(|t| !t.is_finite()) || tau.iter().zip(&layout.delayed).any(ahead) {
            return Err(start(None));
        }
        drive.delay(tau, run, grid, matches!(integrator, Integrator::Discrete(_)));
        trajectory.begin_events();
        let Trajectory { grid, known, history, .. } = trajectory;
        let tau = &known[layout.tau.clone()];
        if let Some(history) = history {
            let longest = longest_state_delay(layout, known);
            if history.numbers(stride, longest, grid) > History::MOST {
                return Err(start(None));
            }
            history.begin(stride, longest, grid);
        }
        match integrator {
            Integrator::RungeKutta(_) | Integrator::Discrete(_) => {}
            Integrator::Delayed(delayed, _) if delayed.states_at_once(tau, grid) > MOST_AT_ONCE => {
                return Err(start(None));
            }
            Integrator::Delayed(delayed, _) => delayed.begin(tau, grid),
            Integrator::Stiff(collocation, _) => collocation.begin(),
        }
        Ok(())
    }
}

/// The loop over the steps, without sensitivities; visits every sample with its node.
#[inline(always)]
fn march<'a>(
    trajectory: &mut Trajectory<'a>,
    mut visit: impl FnMut(&mut Trajectory<'a>, usize, usize) -> Result<(), Divergence>,
    mut advance: impl FnMut(&mut Trajectory<'a>, usize) -> Result<(), Divergence>,
) -> Result<(), Divergence> {
    let steps = trajectory.grid.steps();
    if let Some(history) = &mut trajectory.history {
        history.node(trajectory.run.time[0], &trajectory.nodes[0], &[]);
    }
    for k in 0..=steps {
        if let Some(sample) = trajectory.grid.sample_at(k) {
            visit(trajectory, sample, k)?;
        }
        if k < steps {
            advance(trajectory, k)?;
        }
    }
    trajectory.stateless(|trajectory, sample| visit(trajectory, sample, 0))
}

/// The longest delay of a state.
fn longest_state_delay(layout: &Layout, known: &[f64]) -> f64 {
    let delays = layout.delayed.iter().zip(&known[layout.tau.clone()]);
    delays.filter(|(s, _)| matches!(s, Signal::State(_))).map(|(_, tau)| *tau).fold(0.0, f64::max)
}

/// Takes single steps of one model: explicit, or implicit where the scheme is [`Scheme::Radau`]. Allocates once.
pub struct SingleStep {
    pub(super) work: Workspace,
    /// The stage equations, when the method is implicit.
    pub(super) collocation: Option<Box<Collocation>>,
}

impl SingleStep {
    /// For one model.
    pub fn new(dynamics: &dyn Dynamics, scheme: Scheme) -> Self {
        let collocation = (scheme == Scheme::Radau).then(|| Box::new(Collocation::new(dynamics.layout())));
        Self { work: Workspace::new(dynamics), collocation }
    }

    /// Whether implicit steps suit a model of this size.
    pub fn may_be_implicit(layout: &Layout) -> bool {
        layout.states > 0 && layout.states <= MOST_IMPLICIT
    }

    /// The parts of a step at which its three rows of the drive stand.
    pub fn nodes(scheme: Scheme) -> [f64; 3] {
        if scheme == Scheme::Radau { NODES } else { [0.0, 0.5, 1.0] }
    }

    /// Rates at a point (n), in the memory of the steps.
    pub fn rates(&mut self, dynamics: &dyn Dynamics, at: Point<'_>, out: &mut [f64]) {
        dynamics.rates(at, out, &mut self.work);
    }

    /// Forgets the steps before, so that the next one depends on nothing but its arguments.
    pub fn begin(&mut self) {
        if let Some(collocation) = &mut self.collocation {
            collocation.begin();
        }
    }

    /// Takes a step, limited states taken back into their limits; the rows of its drive stand at [`Self::nodes`]. `false` when the end
    /// (n) is not finite or cannot be found.
    pub fn take(&mut self, dynamics: &dyn Dynamics, step: Step<'_>, next: &mut [f64]) -> bool {
        let Step { t, h, x, drive, known } = step;
        let solved = match &mut self.collocation {
            None => {
                dynamics.step(step, next, &mut self.work);
                true
            }
            Some(collocation) => {
                let interval = Interval { t, h, x, drive, slopes: &[], known };
                collocation.step(dynamics, interval, next, &mut self.work).is_ok()
            }
        };
        take_back(dynamics.layout(), known, next, |_, _| {});
        solved && next.iter().all(|x| x.is_finite())
    }
}
