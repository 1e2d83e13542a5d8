//! A unit at work: what FMI's functions do, without their C ([`Instance`]).
//!
//! Its whole state, the past that delays see among it, is one value ([`Moving`]) that is copied, restored and written as bytes.

use super::delays::{Now, Open, Past, Seen};
use super::solver::{Pace, Solver};
use super::variables::{Kind, Variable, Variables};
use fdm_grammar::graph::Signal;
use fdm_grammar::model::Param;
use fdm_system::Model;
use fdm_system::dynamics::{Layout, Point, Workspace};
use fdm_system::simulate::rests;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Why a call came to nothing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refused {
    /// There is no variable with this value reference.
    #[error("there is no variable with the value reference {0}")]
    NoVariable(u32),
    /// A variable that the unit computes.
    #[error("`{0}` is computed by the unit and cannot be set")]
    Computed(String),
    /// A parameter of the beginning, set later.
    #[error("`{0}` counts at the beginning only: set it before the initialization ends")]
    Begun(String),
    /// A derivative that is none.
    #[error(
        "there is no derivative of `{of}` by `{by}`: it is of state derivatives and outputs, by states, inputs and parameters"
    )]
    NoDerivative {
        /// What should change.
        of: String,
        /// What is changed.
        by: String,
    },
    /// As many numbers are expected as there are variables.
    #[error("{found} numbers where {expected} are expected")]
    Count {
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// A value that is not finite was given.
    #[error("`{name}` is set to {value}")]
    NotFinite {
        /// The variable.
        name: String,
        /// What was given.
        value: f64,
    },
    /// A response left the finite numbers.
    #[error("`{name}` is not finite at time {time}")]
    Diverged {
        /// The variable.
        name: String,
        /// When.
        time: f64,
    },
    /// No step is short enough.
    #[error(
        "no step is short enough for the tolerance {tolerance} at time {time}; the model may be discontinuous there, or diverge"
    )]
    NoStep {
        /// When.
        time: f64,
        /// What was asked for.
        tolerance: f64,
    },
    /// A step that takes too long.
    #[error("a communication step takes more than {0} integration steps; take a shorter one, or a larger tolerance")]
    TooManySteps(usize),
    /// A delay that looks ahead.
    #[error("the delay of `{name}` is {tau}: a unit cannot look ahead")]
    Ahead {
        /// The signal.
        name: String,
        /// The delay.
        tau: f64,
    },
    /// A delay of a state that co-simulation cannot step over.
    #[error(
        "the delay of the state `{0}` is 0: co-simulation needs a longer one; write the state itself, or use model exchange"
    )]
    NoDelay(String),
    /// A delay that grew past what was kept.
    #[error("the delay of `{name}` grew to {tau} while the simulation ran: so much of the past was not kept")]
    Forgotten {
        /// The signal.
        name: String,
        /// The delay.
        tau: f64,
    },
    /// A step that does not begin where the last one ended.
    #[error("a step begins at {begins}, and the unit is at {at}")]
    OtherTime {
        /// Where the step begins.
        begins: f64,
        /// Where the unit is.
        at: f64,
    },
    /// A state that belongs to another unit, or is damaged.
    #[error("this is not a state of this unit")]
    NoState,
}

/// What is expected of an instance next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Mode {
    /// States follow from the parameters until the initialization ends.
    Beginning,
    Event,
    Running,
}

/// Everything in an instance that changes.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Moving {
    pub(super) mode: Mode,
    pub(super) start: f64,
    pub(super) time: f64,
    pub(super) tolerance: f64,
    /// Parameters (p), inputs (m) with their slopes in the next step, states (n).
    pub(super) theta: Vec<f64>,
    pub(super) inputs: Vec<f64>,
    pub(super) slopes: Vec<f64>,
    pub(super) x: Vec<f64>,
    /// Of each limited state whether it rests at its lower (1) or upper (2) limit, in model exchange.
    held: Vec<u8>,
    /// Since when a piece of the past is not finished (model exchange): time, inputs, states, rates.
    node: (f64, Vec<f64>, Vec<f64>, Vec<f64>),
    pub(super) past: Past,
    pub(super) pace: Pace,
    /// Inputs and slopes as the last step left them.
    left: (Vec<f64>, Vec<f64>),
}

impl Moving {
    /// Of all that is as long as the model is large.
    fn lengths(&self) -> [usize; 11] {
        let (node, left) = (&self.node, &self.left);
        let of_node = [node.1.len(), node.2.len(), node.3.len()];
        let [a, b, c] = of_node;
        let own = [self.theta.len(), self.inputs.len(), self.slopes.len(), self.x.len(), self.held.len()];
        let [d, e, f, g, h] = own;
        [a, b, c, d, e, f, g, h, left.0.len(), left.1.len(), self.pace.sizes.len()]
    }
}

/// What an event changed.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Events {
    /// States have other values.
    pub states_changed: bool,
    /// When the next event is, that is known before.
    pub next: Option<f64>,
}

/// A unit at work.
pub struct Instance {
    pub(super) model: Arc<Model>,
    pub(super) variables: Arc<Variables>,
    pub(super) moving: Moving,
    /// What `prepare` computed of the parameters; whether it is to be computed anew.
    pub(super) known: Vec<f64>,
    stale: bool,
    pub(super) drive: Vec<f64>,
    pub(super) work: Workspace,
    rates: Vec<f64>,
    /// Zeros: a piece of the past whose middle is not known is a cubic (n).
    straight: Vec<f64>,
    raw: Vec<f64>,
    outputs: Vec<f64>,
    /// Whether rates and outputs are those of now.
    fresh: (bool, bool),
    pub(super) solver: Option<Solver>,
    /// Values that a reset goes back to.
    values: Vec<f64>,
}

/// Relative error of a step where nobody says otherwise.
pub(super) const TOLERANCE: f64 = 1e-9;

impl Instance {
    /// A unit of a model with the values that its parameters have. Derivatives by all parameters are made, by those that are `fixed`
    /// in the text too.
    pub fn new(model: &Model) -> Self {
        let freed = model.definition().params.iter().map(|p| Param { fixed: false, ..p.clone() }).collect();
        let model = Arc::new(model.with_params(freed));
        let variables = Arc::new(Variables::of(&model));
        let layout = model.layout();
        let values = model.definition().start();
        let moving = Moving {
            mode: Mode::Beginning,
            start: 0.0,
            time: 0.0,
            tolerance: TOLERANCE,
            theta: values.clone(),
            inputs: vec![0.0; layout.inputs],
            slopes: vec![0.0; layout.inputs],
            x: vec![0.0; layout.states],
            held: vec![0; layout.limited.len()],
            node: (0.0, vec![0.0; layout.inputs], vec![0.0; layout.states], vec![0.0; layout.states]),
            past: Past::new(layout),
            pace: Pace::new(layout.states),
            left: (vec![0.0; layout.inputs], vec![0.0; layout.inputs]),
        };
        Self {
            known: vec![0.0; layout.known],
            stale: true,
            drive: vec![0.0; layout.drive()],
            work: Workspace::new(model.dynamics()),
            rates: vec![0.0; layout.states],
            straight: vec![0.0; layout.states],
            raw: vec![0.0; layout.states],
            outputs: vec![0.0; layout.outputs],
            fresh: (false, false),
            solver: None,
            values,
            variables,
            moving,
            model,
        }
    }

    /// The variables.
    pub fn variables(&self) -> &Variables {
        &self.variables
    }

    /// Number of states n.
    pub fn states(&self) -> usize {
        self.layout().states
    }

    /// Number of event indicators.
    pub fn indicators(&self) -> usize {
        2 * self.layout().limited.len()
    }

    /// The time now.
    pub fn time(&self) -> f64 {
        self.moving.time
    }

    pub(super) fn layout(&self) -> &Layout {
        self.model.layout()
    }

    /// Back to the beginning, with the values of the unit.
    pub fn reset(&mut self) {
        let fresh = Self::new(&self.model);
        self.moving = Moving { theta: self.values.clone(), ..fresh.moving };
        self.changed(true);
    }

    /// Where the run begins, and the relative error of a step in co-simulation.
    pub fn set_up(&mut self, start: f64, tolerance: Option<f64>) {
        (self.moving.start, self.moving.time) = (start, start);
        if let Some(tolerance) = tolerance.filter(|t| *t > 0.0) {
            self.moving.tolerance = tolerance.clamp(1e-13, 0.1);
        }
        self.changed(true);
    }

    /// The initialization ends: the states have their initial values.
    ///
    /// # Errors
    /// [`Refused::Diverged`] for an initial value that is not finite, [`Refused::Ahead`].
    pub fn begin(&mut self) -> Result<(), Refused> {
        self.prepare();
        let time = self.moving.time;
        if let Some(k) = self.moving.x.iter().position(|x| !x.is_finite()) {
            return Err(Refused::Diverged { name: self.name(Kind::State(k)), time });
        }
        let layout = self.model.layout();
        for (d, tau) in self.known[layout.tau.clone()].iter().enumerate() {
            if tau.is_nan() || *tau < 0.0 {
                return Err(Refused::Ahead { name: self.delayed_name(d), tau: *tau });
            }
        }
        self.moving.mode = Mode::Event;
        let Moving { past, inputs, x, left, slopes, .. } = &mut self.moving;
        past.begin(time, inputs, x);
        left.0.clone_from(inputs);
        left.1.clone_from(slopes);
        self.changed(false);
        self.set_node()
    }

    /// Parameters to what depends on them alone.
    pub(super) fn prepare(&mut self) {
        if !self.stale {
            return;
        }
        let dynamics = self.model.dynamics();
        let layout = dynamics.layout();
        let Moving { theta, inputs, mode, x, .. } = &mut self.moving;
        if *mode == Mode::Beginning {
            layout.first.iter().for_each(|(param, input)| theta[*param as usize] = inputs[*input as usize]);
        }
        dynamics.prepare(theta, &mut self.known, &mut self.work);
        if *mode == Mode::Beginning {
            x.copy_from_slice(&self.known[layout.initial.clone()]);
        }
        self.stale = false;
        self.fresh = (false, false);
    }

    /// Something was set; `parameters` where it was one, or the states follow from it.
    fn changed(&mut self, parameters: bool) {
        self.stale |= parameters;
        self.fresh = (false, false);
    }

    /// What is not finished of the past.
    pub(super) fn open(moving: &Moving) -> Now<'_> {
        let (from, inputs, states, rates) = &moving.node;
        let to = moving.time;
        Now {
            inputs: Open { from: *from, to, first: inputs, last: &moving.inputs },
            states: Open { from: *from, to, first: states, last: &moving.x },
            rates,
        }
    }

    /// Inputs and delayed signals now.
    pub(super) fn fill_drive(&mut self) -> Result<(), Refused> {
        let m = self.model.layout().inputs;
        self.drive[..m].copy_from_slice(&self.moving.inputs);
        for d in 0..self.model.layout().delayed.len() {
            self.drive[m + d] = self.delayed(d)?.value;
        }
        Ok(())
    }

    /// A delayed signal now, with its derivatives.
    pub(super) fn delayed(&self, d: usize) -> Result<Seen, Refused> {
        let layout = self.model.layout();
        let (tau, signal) = (self.known[layout.tau.start + d], layout.delayed[d]);
        let vanishing = matches!(signal, Signal::Input(k) if layout.vanishing.contains(&k));
        let now = Self::open(&self.moving);
        if self.moving.mode == Mode::Beginning {
            // nothing has passed: the signal's own first value
            let value = match signal {
                Signal::Input(k) => self.moving.inputs[k as usize],
                Signal::State(k) => self.moving.x[k as usize],
            };
            let gone = vanishing && tau > 0.0;
            let [value, now] = if gone { [0.0; 2] } else { [value, 1.0] };
            return Ok(Seen { value, slope: 0.0, now });
        }
        let seen = self.moving.past.seen(signal, vanishing, self.moving.time - tau, &now);
        seen.ok_or_else(|| Refused::Forgotten { name: self.delayed_name(d), tau })
    }

    /// The signal behind a delayed one.
    pub(super) fn delayed_name(&self, d: usize) -> String {
        let signal = self.variables.of_signal(self.layout().delayed[d]);
        signal.and_then(|s| self.variables.get(s)).map(|v| v.name.clone()).unwrap_or_default()
    }

    pub(super) fn name(&self, kind: Kind) -> String {
        let found = self.variables.of_kind(kind).and_then(|k| self.variables.get(k));
        found.map(|v| v.name.clone()).unwrap_or_default()
    }

    /// Rates of the states, of those that rest at a limit too.
    fn raw_rates(&mut self) -> Result<(), Refused> {
        self.prepare();
        if !self.fresh.0 {
            self.fill_drive()?;
            let Moving { time, start, x, .. } = &self.moving;
            let at = Point { t: time - start, x, drive: &self.drive, known: &self.known };
            self.model.dynamics().rates(at, &mut self.raw, &mut self.work);
            self.rates.copy_from_slice(&self.raw);
            for (held, state) in self.moving.held.iter().zip(&self.model.layout().limited) {
                if *held != 0 {
                    self.rates[*state as usize] = 0.0;
                }
            }
            self.fresh.0 = true;
        }
        Ok(())
    }

    /// Derivatives of the states (n).
    ///
    /// # Errors
    /// [`Refused::Forgotten`].
    pub fn rates(&mut self) -> Result<&[f64], Refused> {
        self.raw_rates()?;
        Ok(&self.rates)
    }

    /// Outputs (q).
    ///
    /// # Errors
    /// As [`Self::rates`].
    pub fn outputs(&mut self) -> Result<&[f64], Refused> {
        self.prepare();
        if !self.fresh.1 {
            self.fill_drive()?;
            let Moving { time, start, x, .. } = &self.moving;
            let at = Point { t: time - start, x, drive: &self.drive, known: &self.known };
            self.model.dynamics().outputs(at, &mut self.outputs, &mut self.work);
            self.fresh.1 = true;
        }
        Ok(&self.outputs)
    }

    /// An event indicator: how far a state is from its limit; the rate outwards while it rests there. It changes its sign where the state
    /// reaches the limit, and where it leaves it.
    fn indicator(&mut self, k: usize) -> Result<f64, Refused> {
        self.raw_rates()?;
        let layout = self.model.layout();
        let (state, side) = (layout.limited[k / 2] as usize, k % 2);
        let (x, limit, raw) = (self.moving.x[state], self.known[layout.limits.start + k], self.raw[state]);
        Ok(match (side, self.moving.held[k / 2]) {
            (0, 1) => raw,
            (1, 2) => -raw,
            (0, _) => x - limit,
            _ => limit - x,
        })
    }

    /// Which indicator shows a rate instead of a distance.
    pub(super) fn rests_at(&self, k: usize) -> bool {
        self.moving.held[k / 2] == 1 + (k % 2) as u8
    }

    /// Whether a state (by index) rests at a limit.
    pub(super) fn is_held(&self, state: usize) -> bool {
        let place = self.layout().limited.iter().position(|s| *s as usize == state);
        place.is_some_and(|k| self.moving.held[k] != 0)
    }

    /// All event indicators, in their order.
    ///
    /// # Errors
    /// As [`Self::rates`].
    pub fn all_indicators(&mut self, out: &mut [f64]) -> Result<(), Refused> {
        expect(out.len(), self.indicators())?;
        (0..out.len()).try_for_each(|k| self.indicator(k).map(|value| out[k] = value))
    }

    fn variable(&self, reference: u32) -> Result<&Variable, Refused> {
        self.variables.get(reference).ok_or(Refused::NoVariable(reference))
    }

    /// The value of a variable.
    ///
    /// # Errors
    /// [`Refused::NoVariable`], and as [`Self::rates`].
    pub fn get(&mut self, reference: u32) -> Result<f64, Refused> {
        self.prepare();
        Ok(match self.variable(reference)?.kind {
            Kind::Time => self.moving.time,
            Kind::Parameter(k) => self.moving.theta[k],
            Kind::Known(k) | Kind::Input(k) => self.moving.inputs[k],
            Kind::State(k) => self.moving.x[k],
            Kind::Rate(k) => self.rates()?[k],
            Kind::Output(k) => self.outputs()?[k],
            Kind::Derived(k) => self.known[self.model.layout().derived.start + k],
            Kind::Indicator(k) => self.indicator(k)?,
        })
    }

    /// Sets an input, a parameter, or, when the run has begun, a state.
    ///
    /// # Errors
    /// [`Refused::NoVariable`], [`Refused::Computed`], [`Refused::Begun`], [`Refused::NotFinite`].
    pub fn set(&mut self, reference: u32, value: f64) -> Result<(), Refused> {
        let variables = self.variables.clone();
        let variable = variables.get(reference).ok_or(Refused::NoVariable(reference))?;
        let (kind, name) = (variable.kind, || variable.name.clone());
        let beginning = self.moving.mode == Mode::Beginning;
        if !value.is_finite() {
            return Err(Refused::NotFinite { name: name(), value });
        }
        if variable.initial && !beginning {
            return Err(Refused::Begun(name()));
        }
        match kind {
            Kind::Parameter(k) => self.moving.theta[k] = value,
            Kind::Known(k) | Kind::Input(k) => self.moving.inputs[k] = value,
            Kind::State(k) if !beginning => self.moving.x[k] = value,
            _ => return Err(Refused::Computed(name())),
        }
        self.changed(beginning || matches!(kind, Kind::Parameter(_)));
        Ok(())
    }

    /// How fast an input moves in the next step of a co-simulation.
    ///
    /// # Errors
    /// [`Refused::NoVariable`], [`Refused::Computed`] for what is no input.
    pub fn set_slope(&mut self, reference: u32, slope: f64) -> Result<(), Refused> {
        let variable = self.variable(reference)?;
        match variable.kind {
            Kind::Input(_) if !slope.is_finite() => {
                Err(Refused::NotFinite { name: variable.name.clone(), value: slope })
            }
            Kind::Input(k) => {
                self.moving.slopes[k] = slope;
                Ok(())
            }
            _ => Err(Refused::Computed(variable.name.clone())),
        }
    }

    /// Moves the time (model exchange).
    pub fn set_time(&mut self, time: f64) {
        self.moving.time = time;
        self.changed(false);
    }

    /// The states (n).
    pub fn state_values(&mut self) -> &[f64] {
        self.prepare();
        &self.moving.x
    }

    /// Sets the states (n).
    ///
    /// # Errors
    /// [`Refused::Count`].
    pub fn set_states(&mut self, x: &[f64]) -> Result<(), Refused> {
        expect(x.len(), self.states())?;
        self.moving.x.copy_from_slice(x);
        self.changed(false);
        Ok(())
    }

    /// An integration step of model exchange is finished: what was passed becomes past.
    ///
    /// # Errors
    /// As [`Self::rates`].
    pub fn completed_step(&mut self) -> Result<(), Refused> {
        if self.moving.past.is_empty() || self.moving.time <= self.moving.node.0 {
            return Ok(());
        }
        self.raw_rates()?;
        let mut past = std::mem::take(&mut self.moving.past);
        let open = Self::open(&self.moving);
        past.inputs(open.inputs);
        past.states(open.states, [open.rates, &self.rates], [&self.straight; 2]);
        self.moving.past = past;
        self.forget();
        self.set_node()
    }

    /// Leaves out what no delay reaches.
    pub(super) fn forget(&mut self) {
        let longest = self.known[self.model.layout().tau.clone()].iter().copied().fold(0.0, f64::max);
        // steps end where delayed kinks are seen: pieces begin just where the longest delay reaches, but for rounding
        let slack = 1e-6 * longest + 64.0 * f64::EPSILON * self.moving.time.abs();
        let before = self.moving.time - longest - slack;
        self.moving.past.forget(before);
    }

    /// A piece of the past begins here.
    fn set_node(&mut self) -> Result<(), Refused> {
        if self.moving.past.is_empty() {
            return Ok(());
        }
        // the delayed signals of now are those of the end of the piece before
        let Moving { node, time, inputs, x, .. } = &mut self.moving;
        node.0 = *time;
        node.1.copy_from_slice(inputs);
        node.2.copy_from_slice(x);
        self.fresh = (false, false);
        self.raw_rates()?;
        self.moving.node.3.copy_from_slice(&self.rates);
        self.fresh = (false, false);
        Ok(())
    }

    /// An event begins.
    ///
    /// # Errors
    /// As [`Self::rates`].
    pub fn enter_event(&mut self) -> Result<(), Refused> {
        self.completed_step()?;
        self.moving.mode = Mode::Event;
        Ok(())
    }

    /// What an event changes: states come to rest at their limits, or leave them.
    ///
    /// # Errors
    /// As [`Self::rates`].
    pub fn update(&mut self) -> Result<Events, Refused> {
        let mut events = Events::default();
        self.raw_rates()?;
        let Moving { node, inputs, x, .. } = &self.moving;
        // where something jumps or bends it will be seen late; an event that only sees that has none of its own
        let mut bent = node.1 != *inputs || node.2 != *x;
        let layout = self.model.layout();
        for (k, state) in layout.limited.iter().map(|s| *s as usize).enumerate() {
            let [lower, upper] = [0, 1].map(|side| self.known[layout.limits.start + 2 * k + side]);
            let x = self.moving.x[state];
            let resting = rests(layout, &self.known, state, x, self.raw[state]);
            let held = if resting { 1 + u8::from(x >= upper) } else { 0 };
            bent |= held != self.moving.held[k];
            self.moving.held[k] = held;
            let inside = if x < lower {
                lower
            } else if x > upper {
                upper
            } else {
                x
            };
            if inside != x {
                self.moving.x[state] = inside;
                events.states_changed = true;
            }
        }
        self.fresh = (false, false);
        if bent {
            let time = self.moving.time;
            self.moving.past.kink(time);
        }
        events.next = self.moving.past.next_kink(self.moving.time, &self.known[layout.tau.clone()]);
        Ok(events)
    }

    /// An event is over: time runs again.
    ///
    /// # Errors
    /// As [`Self::rates`].
    pub fn enter_continuous(&mut self) -> Result<(), Refused> {
        self.moving.mode = Mode::Running;
        self.set_node()
    }

    /// A step of a co-simulation.
    ///
    /// # Errors
    /// What goes wrong on the way; the instance is then at the time to which all went well.
    pub fn step(&mut self, begins: f64, length: f64) -> Result<(), Refused> {
        let at = self.moving.time;
        let near = 1e-9 * (at.abs() + length.abs()).max(f64::MIN_POSITIVE);
        if (begins - at).abs() > near || length.is_nan() || length < 0.0 {
            return Err(Refused::OtherTime { begins, at });
        }
        self.prepare();
        self.moving.mode = Mode::Running;
        let Moving { past, inputs, slopes, left, .. } = &mut self.moving;
        if left.0 != *inputs || left.1 != *slopes {
            past.kink(at);
        }
        let mut solver = match self.solver.take() {
            Some(solver) => solver,
            None => Solver::new(self.model.dynamics()),
        };
        let done = solver.cross(self, length);
        self.solver = Some(solver);
        done?;
        let Moving { inputs, slopes, left, .. } = &mut self.moving;
        left.0.copy_from_slice(inputs);
        left.1.copy_from_slice(slopes);
        slopes.fill(0.0);
        self.changed(false);
        self.set_node()
    }

    /// The whole state of the instance.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot(self.moving.clone())
    }

    /// Goes back to a state.
    ///
    /// # Errors
    /// [`Refused::NoState`] for one of another unit.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), Refused> {
        if snapshot.0.lengths() != self.moving.lengths() || !snapshot.0.past.fits(&self.moving.past) {
            return Err(Refused::NoState);
        }
        let a = &snapshot.0;
        self.moving.clone_from(a);
        self.stale = true;
        self.fresh = (false, false);
        if self.moving.mode != Mode::Beginning {
            self.prepare();
        }
        Ok(())
    }
}

/// The whole state of an instance, past and pace included.
#[derive(Debug, Clone)]
pub struct Snapshot(Moving);

impl Snapshot {
    /// The state as bytes, equal ones for equal states.
    ///
    /// # Errors
    /// [`Refused::NoState`] where they cannot be made.
    pub fn bytes(&self) -> Result<Vec<u8>, Refused> {
        postcard::to_stdvec(&self.0).map_err(|_| Refused::NoState)
    }

    /// From bytes.
    ///
    /// # Errors
    /// [`Refused::NoState`] for bytes that are none.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Refused> {
        postcard::from_bytes(bytes).map(Self).map_err(|_| Refused::NoState)
    }
}

pub(super) fn expect(found: usize, expected: usize) -> Result<(), Refused> {
    if found == expected { Ok(()) } else { Err(Refused::Count { found, expected }) }
}

impl std::fmt::Debug for Instance {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Instance").field("model", &self.model).field("time", &self.moving.time).finish_non_exhaustive()
    }
}
