//! Standard manoeuvres: the model as it answers to them from its trim, and the records that drive it.
//!
//! The model is rewritten: it starts at its trim (where the text has none at its initial values, free ones at zero), inputs are counted from the trim,
//! and its outputs are what is asked for. A zigzag puts its input over when the signal passes a level: then the input is a sum of one step at several
//! delays, which are parameters, so that the simulator's own derivatives by delays say what a later moment does.
//!
//! What is asked of a response over time. Between samples a response is the cubic through four neighbours; every answer is a function of the samples,
//! and its derivatives are those of that function.

use super::measured::{Measured, RequirementError};
use fdm_grammar::graph::{Graph, Leaf, Reference, Signal};
use fdm_grammar::model::{Model as Definition, Origin, Output, Param, Quantity};
use fdm_grammar::op::{Build, ExprId, Op};
use fdm_grammar::requirement::{Drive, Form, Observed, OfCourse, Target};
use fdm_numeric::lanes::VECTOR;
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Simulator, StepOptions, Steps, UNSOUND, choose_steps};

/// Samples of a manoeuvre.
const SAMPLES: usize = 2000;
/// Length of a jump of an input, as a part of the manoeuvre: between samples inputs are linear.
const JUMP: f64 = 1e-6;

/// The input of a zigzag.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Zigzag {
    pub(super) signal: Observed,
    pub(super) input: u32,
    pub(super) size: f64,
    pub(super) level: f64,
}

/// What drives a manoeuvre.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Driven {
    Standard(Vec<Drive>),
    Zigzag(Zigzag),
}

/// A manoeuvre that is to be flown.
pub(super) struct Flown {
    pub(super) duration: f64,
    pub(super) driven: Driven,
    /// So many overshoots of a zigzag are asked for.
    pub(super) overshoots: u32,
    /// What is looked at.
    pub(super) targets: Vec<Target>,
}

/// A manoeuvre that is ready to be flown at any parameters.
pub(super) struct Manoeuvre {
    pub(super) duration: f64,
    /// What is looked at, in the order of the outputs of `model`.
    pub(super) targets: Vec<Target>,
    model: Model,
    run: Run,
    steps: Steps,
    /// Parameters of the model itself (p); moments of a zigzag and values of the trim stand behind them.
    params: usize,
    /// Moments of a zigzag: one for each overshoot that is asked for.
    moments: usize,
    /// Signals at the trim whose values are parameters behind those of the zigzag.
    solved: usize,
}

/// A manoeuvre at work.
pub(super) struct Flight<'p> {
    manoeuvre: &'p Manoeuvre,
    simulator: Simulator<'p>,
    y: Vec<f64>,
    rows: Vec<f64>,
    theta: Vec<f64>,
    zigzag: Option<Zigzags>,
}

/// What came of a zigzag at one vector of parameters: requirements on its first and its second overshoot need the same flights.
struct Zigzags {
    theta: Vec<f64>,
    columns: Vec<usize>,
    overshoots: Vec<Measured>,
}

/// The trim at one vector of parameters: values that were solved from the equations, and their derivatives (values by p).
#[derive(Debug, Clone, Default)]
pub(super) struct Solved {
    pub(super) signals: Vec<Signal>,
    pub(super) values: Vec<f64>,
    pub(super) slopes: Vec<f64>,
}

impl Manoeuvre {
    /// Prepares a manoeuvre of a model at its estimates theta (p).
    pub(super) fn new(
        model: &Model,
        (theta, solved): (&[f64], &Solved),
        Flown { duration, driven, overshoots, targets }: Flown,
    ) -> Result<Self, RequirementError> {
        let definition = model.definition();
        if let Some(input) = definition.inputs.iter().find(|i| i.measured.is_some() || i.computed.is_some()) {
            return Err(RequirementError::Records { name: input.quantity.name.clone() });
        }
        let moments = if let Driven::Zigzag(_) = &driven { overshoots as usize } else { 0 };
        let response = response(definition, &driven, &solved.signals, moments, &targets);
        let model = model.altered(response);
        let run = record(&model, theta, duration, &driven)?;
        let mut manoeuvre = Self {
            duration,
            targets,
            model,
            run,
            steps: Steps::from(1),
            params: theta.len(),
            moments,
            solved: solved.signals.len(),
        };
        let all = manoeuvre.all(theta, &vec![f64::INFINITY; moments], solved);
        let once = StepOptions { once: true, ..StepOptions::default() };
        let found = choose_steps(manoeuvre.model.dynamics(), &manoeuvre.run, &all, &once);
        let found = found.map_err(|e| RequirementError::Simulation { reason: e.to_string() })?;
        if found.error.is_finite() && found.error > UNSOUND {
            return Err(RequirementError::Simulation {
                reason: format!("the response is integrated to {:.0e} of its range only", found.error),
            });
        }
        manoeuvre.steps = found.steps;
        Ok(manoeuvre)
    }

    /// The parameters of the rewritten model: moments that are not reached lie behind the end.
    fn all(&self, theta: &[f64], moments: &[f64], solved: &Solved) -> Vec<f64> {
        let late = 2.0 * self.duration;
        let moments = moments.iter().map(|t| if t.is_finite() { *t } else { late });
        theta.iter().copied().chain(moments).chain(solved.values.iter().copied()).collect()
    }

    /// The place of a signal among the outputs.
    pub(super) fn place(&self, target: Target) -> usize {
        self.targets.iter().position(|t| *t == target).unwrap_or_default()
    }
}

impl<'p> Flight<'p> {
    pub(super) fn new(manoeuvre: &'p Manoeuvre) -> Result<Self, RequirementError> {
        let simulator = Simulator::new(manoeuvre.model.dynamics(), &manoeuvre.run, manoeuvre.steps.clone());
        let simulator = simulator.map_err(|e| RequirementError::Simulation { reason: e.to_string() })?;
        let count = manoeuvre.run.len() * manoeuvre.targets.len();
        let y = vec![f64::NAN; count];
        Ok(Self { manoeuvre, simulator, y, rows: Vec::new(), theta: Vec::new(), zigzag: None })
    }

    /// Flies the manoeuvre at theta (p) with derivatives by the columns of the rewritten model, or without any; false where the response diverges.
    fn fly(&mut self, columns: &[usize]) -> bool {
        self.y.fill(f64::NAN);
        if columns.is_empty() {
            return self.simulator.simulate(&self.theta, &mut self.y).is_ok();
        }
        let stride = columns.len().next_multiple_of(VECTOR);
        self.rows.clear();
        self.rows.resize(self.y.len() * stride, 0.0);
        self.simulator.sensitivities(&self.theta, columns, &mut self.y, &mut self.rows).is_ok()
    }

    /// Times, values and derivatives (N by columns) of an output, with a sign. A sample of the jump at the beginning is none of the response.
    fn signal(&self, output: usize, negative: bool, columns: usize) -> (Vec<f64>, Vec<f64>) {
        let q = self.manoeuvre.targets.len();
        let sign = if negative { -1.0 } else { 1.0 };
        let n = self.manoeuvre.run.len();
        let y = (0..n).map(|k| sign * self.y[k * q + output]).collect();
        let stride = columns.next_multiple_of(VECTOR);
        let row = |k: usize| &self.rows[(k * q + output) * stride..][..columns];
        let slopes =
            if columns == 0 { Vec::new() } else { (0..n).flat_map(|k| row(k).iter().map(|d| sign * d)).collect() };
        (y, slopes)
    }

    /// Flies a manoeuvre of standard inputs; `visit` gets its signals. `columns` are parameters of the model (indices into theta), none for
    /// values alone. Derivatives are by all parameters that were asked for.
    pub(super) fn standard<R>(
        &mut self,
        (theta, solved): (&[f64], &Solved),
        columns: &[usize],
        visit: impl FnOnce(&dyn Fn(Observed) -> Samples) -> R,
    ) -> Option<R> {
        let manoeuvre = self.manoeuvre;
        self.theta = manoeuvre.all(theta, &[], solved);
        let all = self.columns(columns, 0);
        if !self.fly(&all) {
            return None;
        }
        let flight = &*self;
        Some(visit(&|observed: Observed| flight.samples(observed, columns, solved, all.len())))
    }

    /// Columns of the rewritten model: parameters, moments, values of the trim.
    fn columns(&self, columns: &[usize], moments: usize) -> Vec<usize> {
        if columns.is_empty() {
            return Vec::new();
        }
        let p = self.manoeuvre.params;
        let behind = self.theta.len() - self.manoeuvre.solved;
        columns.iter().copied().chain(p..p + moments).chain(behind..self.theta.len()).collect()
    }

    /// A signal with its derivatives by the parameters, those through the trim among them, and by the moments behind them.
    fn samples(&self, observed: Observed, columns: &[usize], solved: &Solved, all: usize) -> Samples {
        let output = self.manoeuvre.place(observed.target);
        let (y, rows) = self.signal(output, observed.negative, all);
        let (own, trims) = (columns.len(), if all == 0 { 0 } else { self.manoeuvre.solved });
        let moments = all.saturating_sub(own + trims);
        let p = self.manoeuvre.params;
        let mut slopes = Vec::with_capacity(y.len() * (own + moments));
        for row in rows.chunks(all.max(1)).take(if all == 0 { 0 } else { y.len() }) {
            let through = |k: usize| (0..trims).map(|z| row[own + moments + z] * solved.slopes[z * p + k]).sum::<f64>();
            slopes.extend(columns.iter().enumerate().map(|(c, k)| row[c] + through(*k)));
            slopes.extend_from_slice(&row[own..own + moments]);
        }
        Samples { time: self.manoeuvre.run.time.clone(), y, slopes, columns: if all == 0 { 0 } else { own + moments } }
    }

    /// The overshoot of this number, from 1, of a zigzag.
    pub(super) fn zigzag(
        &mut self,
        zigzag: &Zigzag,
        number: u32,
        at: (&[f64], &Solved),
        columns: &[usize],
    ) -> Measured {
        let known = self.zigzag.take().filter(|z| z.theta == at.0 && z.columns == columns);
        let found = known.unwrap_or_else(|| Zigzags {
            theta: at.0.to_vec(),
            columns: columns.to_vec(),
            overshoots: self.overshoots(zigzag, at, columns),
        });
        let all = &self.zigzag.insert(found).overshoots;
        // those behind one that is missing are missing for the same reason
        let own = all.get(number as usize - 1).or(all.last()).cloned();
        own.unwrap_or_else(|| Measured::missing("the response diverges"))
    }

    /// All overshoots of a zigzag that are asked for, up to the first that is missing.
    fn overshoots(&mut self, zigzag: &Zigzag, (theta, solved): (&[f64], &Solved), columns: &[usize]) -> Vec<Measured> {
        let manoeuvre = self.manoeuvre;
        let own = columns.len();
        let (mut moments, mut overshoots) = (Vec::<Moment>::new(), Vec::new());
        loop {
            let done = moments.len();
            let mut times = vec![f64::INFINITY; manoeuvre.moments];
            times.iter_mut().zip(&moments).for_each(|(t, m)| *t = m.t);
            self.theta = manoeuvre.all(theta, &times, solved);
            let all = self.columns(columns, done);
            let flown = self.fly(&all);
            let mut samples = self.samples(zigzag.signal, columns, solved, all.len());
            samples.follow(&moments, own);
            let course = samples.course();
            if !flown || !course.is_finite() {
                overshoots.push(Measured::missing("the response diverges"));
                return overshoots;
            }
            // put over at +level first, then at -level, and so on
            let sign = if done.is_multiple_of(2) { 1.0 } else { -1.0 };
            let from = moments.last().map_or(0, |m: &Moment| course.time.partition_point(|t| *t <= m.t));
            if done > 0 {
                let peak = course.greatest(from.saturating_sub(1), -sign);
                let value = -sign * peak.value - zigzag.level;
                overshoots.push(Measured::of(value, peak.gradient.iter().map(|d| -sign * d).collect()));
            }
            if done == manoeuvre.moments {
                return overshoots;
            }
            // behind the last moment the signal still goes on: it must come back first
            match course.passes_towards(from, sign * zigzag.level, sign) {
                Some(moment) => moments.push(moment),
                None => {
                    overshoots.push(Measured::missing(format!("the signal does not pass {}", sign * zigzag.level)));
                    return overshoots;
                }
            }
        }
    }
}

/// A signal of a flight.
pub(super) struct Samples {
    time: Vec<f64>,
    y: Vec<f64>,
    slopes: Vec<f64>,
    columns: usize,
}

impl Samples {
    pub(super) fn course(&self) -> Course<'_> {
        Course { time: &self.time, y: &self.y, slopes: &self.slopes, columns: self.columns }
    }

    /// Moments that move with the parameters: their columns go into those of the parameters.
    fn follow(&mut self, moments: &[Moment], own: usize) {
        if self.columns == 0 || moments.is_empty() {
            return;
        }
        let mut slopes = Vec::with_capacity(self.y.len() * own);
        for row in self.slopes.chunks(self.columns) {
            let through = |c: usize| row[own..].iter().zip(moments).map(|(d, m)| d * m.slopes[c]).sum::<f64>();
            slopes.extend((0..own).map(|c| row[c] + through(c)));
        }
        (self.slopes, self.columns) = (slopes, own);
    }
}

/// The model that answers.
fn response(old: &Definition, driven: &Driven, solved: &[Signal], moments: usize, targets: &[Target]) -> Definition {
    let mut graph = Graph::default();
    let first = old.params.len();
    let named: Vec<ExprId> = old.trim.iter().map(|(_, e)| *e).collect();
    let named = old.graph.rebuild(&named, &mut graph, Graph::reference);
    let mut base: Vec<(Signal, ExprId)> = old.trim.iter().map(|(s, _)| *s).zip(named).collect();
    for (k, signal) in solved.iter().enumerate() {
        let leaf = graph.leaf(Leaf::Param((first + moments + k) as u32));
        base.push((*signal, leaf));
    }
    let at = |signal: Signal| base.iter().find(|(s, _)| *s == signal).map(|(_, e)| *e);
    let mut roots: Vec<ExprId> = old.states.iter().map(|s| s.rate).collect();
    roots.extend(old.states.iter().map(|s| s.initial));
    roots.extend(
        targets
            .iter()
            .filter_map(|t| if let Target::Output(k) = t { Some(old.outputs[*k as usize].expr) } else { None }),
    );
    let roots = old.graph.rebuild(&roots, &mut graph, |graph, reference| {
        let (input, tau) = match reference {
            Reference::Now(Leaf::Input(k)) => (k, None),
            Reference::Earlier(Signal::Input(k), tau) => (k, Some(tau)),
            other => return graph.reference(other),
        };
        let driven = match driven {
            Driven::Zigzag(z) if z.input == input => put_over(graph, input, tau, z.size, first, moments),
            _ => graph.reference(reference),
        };
        match at(Signal::Input(input)) {
            Some(trim) => graph.apply(Op::Add, &[trim, driven]),
            None => driven,
        }
    });
    let n = old.states.len();
    let mut states = old.states.clone();
    let zero = graph.number(0.0);
    for (k, state) in states.iter_mut().enumerate() {
        let free = old.params.iter().any(|p| p.origin == Origin::FreeInitial(k as u32));
        state.rate = roots[k];
        state.initial = at(Signal::State(k as u32)).unwrap_or(if free { zero } else { roots[n + k] });
        state.noise = None;
    }
    let mut expressions = roots[2 * n..].iter();
    let outputs = targets.iter().map(|target| match target {
        Target::State(k) => {
            let leaf = graph.leaf(Leaf::State(*k));
            Output::new(old.states[*k as usize].quantity.clone(), leaf)
        }
        Target::Output(k) => {
            Output::new(old.outputs[*k as usize].quantity.clone(), expressions.next().copied().unwrap_or(zero))
        }
    });
    let outputs: Vec<Output> = outputs.collect();
    let param = |name: String| Param::open(Quantity { name, doc: String::new(), unit: None }, Origin::Declared);
    let mut params = old.params.clone();
    params.extend((0..moments).map(|k| param(format!("moment {}", k + 1))));
    params.extend((0..solved.len()).map(|k| param(format!("trim {}", k + 1))));
    Definition {
        states,
        outputs,
        params,
        derived: Vec::new(),
        ties: Vec::new(),
        trim: Vec::new(),
        tables: Vec::new(),
        requirements: None,
        graph,
        ..old.clone()
    }
}

/// `size (u(t) - 2 u(t - T1) + 2 u(t - T2) - ...)` of a unit step u.
fn put_over(graph: &mut Graph, input: u32, tau: Option<ExprId>, size: f64, first: usize, moments: usize) -> ExprId {
    let signal = Signal::Input(input);
    let mut sum = match tau {
        Some(tau) => graph.delay(signal, tau),
        None => graph.leaf(Leaf::Input(input)),
    };
    for k in 0..moments {
        let moment = graph.leaf(Leaf::Param((first + k) as u32));
        let late = tau.map_or(moment, |tau| graph.apply(Op::Add, &[tau, moment]));
        let step = graph.delay(signal, late);
        let two = graph.number(if k % 2 == 0 { -2.0 } else { 2.0 });
        let step = graph.apply(Op::Mul, &[two, step]);
        sum = graph.apply(Op::Add, &[sum, step]);
    }
    let size = graph.number(size);
    graph.apply(Op::Mul, &[size, sum])
}

/// The record of a manoeuvre: inputs off their trim, and values that runs bring.
fn record(model: &Model, theta: &[f64], duration: f64, driven: &Driven) -> Result<Run, RequirementError> {
    let jump = JUMP * duration;
    let mut edges = vec![0.0];
    let drives: Vec<Drive> = match driven {
        Driven::Standard(drives) => drives.clone(),
        Driven::Zigzag(z) => vec![Drive { input: z.input, form: Form::Step(1.0) }],
    };
    for drive in &drives {
        match drive.form {
            Form::Hold(_) | Form::Step(_) => {}
            Form::Pulse(_, length) => edges.push(length),
            Form::Doublet(_, length) => edges.extend([length, 2.0 * length]),
        }
    }
    let even = (0..=SAMPLES).map(|k| duration * k as f64 / SAMPLES as f64);
    let edges = edges.into_iter().filter(|t| *t + jump < duration).flat_map(|t| [t, t + jump]);
    let mut time: Vec<f64> = even.chain(edges).collect();
    time.sort_by(f64::total_cmp);
    // neighbours that rounding alone holds apart are one
    time.dedup_by(|b, a| *b - *a < 0.5 * jump);
    let mut inputs: Vec<Vec<f64>> = vec![vec![0.0; time.len()]; model.definition().inputs.len()];
    for drive in &drives {
        for (value, t) in inputs[drive.input as usize].iter_mut().zip(&time) {
            *value += of_form(drive.form, *t, jump);
        }
    }
    let mut builder = model.run("manoeuvre").times(time.clone()).without_outputs();
    for (k, input) in model.definition().inputs.iter().enumerate().filter(|(_, i)| i.is_declared()) {
        let name = &input.quantity.name;
        builder = match input.known {
            true => builder.known(name, theta[known(model.definition(), k)]),
            // every corner of the form is a sample
            false => builder.samples(name, std::mem::take(&mut inputs[k])).linear(name),
        };
    }
    builder.build().map_err(|e| RequirementError::Simulation { reason: e.to_string() })
}

/// The parameter that holds what runs bring in an input.
fn known(definition: &Definition, input: usize) -> usize {
    definition.params.iter().position(|p| p.origin == Origin::FirstSample(input as u32)).unwrap_or_default()
}

/// A form at a time; it jumps over the time `jump` behind each edge.
fn of_form(form: Form, t: f64, jump: f64) -> f64 {
    let step = |edge: f64| ((t - edge) / jump).clamp(0.0, 1.0);
    match form {
        Form::Hold(size) => size,
        Form::Step(size) => size * step(0.0),
        Form::Pulse(size, length) => size * (step(0.0) - step(length)),
        Form::Doublet(size, length) => size * (step(0.0) - 2.0 * step(length) + step(2.0 * length)),
    }
}

/// A signal at the samples, with its derivatives by some columns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Course<'a> {
    /// Times since the manoeuvre began (N), rising.
    pub(super) time: &'a [f64],
    /// Its values (N).
    pub(super) y: &'a [f64],
    /// Its derivatives, N rows; empty where they were not asked for.
    pub(super) slopes: &'a [f64],
    /// Length of a row.
    pub(super) columns: usize,
}

/// A time, with its derivatives.
#[derive(Debug, Clone)]
pub(super) struct Moment {
    pub(super) t: f64,
    pub(super) slopes: Vec<f64>,
}

/// Four neighbours and their weights in a value and in its derivative by time.
struct Weights {
    first: usize,
    value: [f64; 4],
    rate: [f64; 4],
}

impl<'a> Course<'a> {
    fn row(&self, k: usize) -> &'a [f64] {
        if self.columns == 0 { &[] } else { &self.slopes[k * self.columns..(k + 1) * self.columns] }
    }

    fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether all values are finite.
    pub(super) fn is_finite(&self) -> bool {
        self.y.iter().all(|v| v.is_finite())
    }

    /// Lagrange's weights of a time between samples k and k + 1.
    fn weights(&self, k: usize, t: f64) -> Weights {
        let count = self.len().min(4);
        let first = k.saturating_sub(1).min(self.len() - count);
        let nodes = &self.time[first..first + count];
        let mut weights = Weights { first, value: [0.0; 4], rate: [0.0; 4] };
        for i in 0..count {
            let (mut value, mut rate, mut below) = (1.0, 0.0, 1.0);
            for j in (0..count).filter(|j| *j != i) {
                rate = rate * (t - nodes[j]) + value;
                value *= t - nodes[j];
                below *= nodes[i] - nodes[j];
            }
            (weights.value[i], weights.rate[i]) = (value / below, rate / below);
        }
        weights
    }

    /// Value, rate and derivatives of the value at a time between samples k and k + 1.
    fn between(&self, k: usize, t: f64) -> (f64, f64, Vec<f64>) {
        let weights = self.weights(k, t);
        let (mut value, mut rate, mut slopes) = (0.0, 0.0, vec![0.0; self.columns]);
        for i in 0..self.len().min(4) {
            let at = weights.first + i;
            value += weights.value[i] * self.y[at];
            rate += weights.rate[i] * self.y[at];
            slopes.iter_mut().zip(self.row(at)).for_each(|(s, d)| *s += weights.value[i] * d);
        }
        (value, rate, slopes)
    }

    /// The sample in front of a time.
    fn before(&self, t: f64) -> usize {
        self.time.partition_point(|s| *s <= t).saturating_sub(1).min(self.len().saturating_sub(2))
    }

    /// The value at a moment: it moves with the moment, too.
    pub(super) fn at(&self, moment: &Moment) -> Measured {
        let (value, rate, mut slopes) = self.between(self.before(moment.t), moment.t);
        slopes.iter_mut().zip(&moment.slopes).for_each(|(s, d)| *s += rate * d);
        Measured::of(value, slopes)
    }

    /// The first moment from sample `from` on at which the signal passes a level that has derivatives of its own.
    pub(super) fn passes(&self, from: usize, level: f64, by: &[f64]) -> Option<Moment> {
        let side = |k: usize| (self.y[k] - level).partial_cmp(&0.0).filter(|o| o.is_ne());
        let begins = (from..self.len()).find_map(side)?;
        let k = (from + 1..self.len()).find(|k| side(*k) != Some(begins))? - 1;
        Some(self.crossing(k, level, by))
    }

    /// The first moment from sample `from` on at which the signal comes through a level with a rate of this sign.
    pub(super) fn passes_towards(&self, from: usize, level: f64, sign: f64) -> Option<Moment> {
        let off = |k: usize| sign * (self.y[k] - level);
        let k = (from..self.len().saturating_sub(1)).find(|k| off(*k) < 0.0 && off(*k + 1) >= 0.0)?;
        Some(self.crossing(k, level, &[]))
    }

    /// The moment between samples k and k + 1 at which the signal passes a level.
    fn crossing(&self, k: usize, level: f64, by: &[f64]) -> Moment {
        let (mut a, mut b) = (self.time[k], self.time[k + 1]);
        let above = self.y[k] > level;
        for _ in 0..200 {
            let t = 0.5 * (a + b);
            if t <= a || t >= b {
                break;
            }
            if (self.between(k, t).0 > level) == above { a = t } else { b = t }
        }
        let t = 0.5 * (a + b);
        let (_, rate, slopes) = self.between(k, t);
        let slopes = slopes.iter().enumerate().map(|(c, d)| (by.get(c).unwrap_or(&0.0) - d) / rate).collect();
        Moment { t, slopes }
    }

    /// The greatest value from sample `from` on: the vertex of the parabola through the greatest sample and its neighbours.
    pub(super) fn greatest(&self, from: usize, sign: f64) -> Measured {
        let better = |a: usize, b: usize| if sign * self.y[b] > sign * self.y[a] { b } else { a };
        let k = (from..self.len()).reduce(better).unwrap_or_default();
        let own = || Measured::of(self.y[k], self.row(k).to_vec());
        if k <= from || k + 1 >= self.len() {
            return own();
        }
        let t = [self.time[k - 1], self.time[k], self.time[k + 1]];
        let y = [self.y[k - 1], self.y[k], self.y[k + 1]];
        let (left, right) = ((y[1] - y[0]) / (t[1] - t[0]), (y[2] - y[1]) / (t[2] - t[1]));
        let bend = (right - left) / (t[2] - t[0]);
        let at = 0.5 * (t[0] + t[1]) - 0.5 * left / bend;
        if !(at > t[0] && at < t[2]) {
            return own();
        }
        let weight = |i: usize| {
            let others = (0..3).filter(|j| *j != i);
            others.map(|j| (at - t[j]) / (t[i] - t[j])).product::<f64>()
        };
        // at the vertex the value does not move with the time
        let (mut value, mut slopes) = (0.0, vec![0.0; self.columns]);
        for (i, y) in y.iter().enumerate() {
            value += weight(i) * y;
            slopes.iter_mut().zip(self.row(k - 1 + i)).for_each(|(s, d)| *s += weight(i) * d);
        }
        Measured::of(value, slopes)
    }

    /// The integral of the cubics between the samples: Gauss' rule of two points.
    fn integral(&self) -> Measured {
        let (mut value, mut slopes) = (0.0, vec![0.0; self.columns]);
        for k in 0..self.len() - 1 {
            let (a, b) = (self.time[k], self.time[k + 1]);
            let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
            for side in [-1.0, 1.0] {
                let (v, _, d) = self.between(k, middle + side * half / 3f64.sqrt());
                value += half * v;
                slopes.iter_mut().zip(&d).for_each(|(s, d)| *s += half * d);
            }
        }
        Measured::of(value, slopes)
    }

    /// What is asked; `other` is the signal that decides when, where one does.
    pub(super) fn of(&self, of: OfCourse, other: Option<&Course<'_>>) -> Measured {
        if !self.is_finite() || other.is_some_and(|o| !o.is_finite()) {
            return Measured::missing("the response diverges");
        }
        let last = self.len() - 1;
        let (start, end) = (self.y[0], self.y[last]);
        let change = end - start;
        let part = |share: f64| {
            let level = start + share * change;
            let by = self.row(0).iter().zip(self.row(last)).map(|(a, b)| a + share * (b - a)).collect::<Vec<f64>>();
            (level, by)
        };
        match of {
            OfCourse::At => Measured::of(end, self.row(last).to_vec()),
            OfCourse::Maximum => self.greatest(0, 1.0),
            OfCourse::Minimum => self.greatest(0, -1.0),
            OfCourse::Integral => self.integral(),
            OfCourse::When(level) => match self.passes(0, level, &[]) {
                Some(moment) => Measured::of(moment.t, moment.slopes),
                None => Measured::missing("the signal does not pass the level"),
            },
            OfCourse::Reached(_, level) => match other.and_then(|o| o.passes(0, level, &[])) {
                Some(moment) => self.at(&moment),
                None => Measured::missing("the signal does not pass the level"),
            },
            _ if change == 0.0 => Measured::missing("the response ends where it begins"),
            OfCourse::Overshoot => {
                let sign = change.signum();
                let peak = self.greatest(0, sign);
                let excess = sign * (peak.value - end);
                let size = change.abs();
                let slope = |(c, d): (usize, &f64)| {
                    let (a, b) = (self.row(0)[c], self.row(last)[c]);
                    sign * (d - b) / size - excess / (size * size) * sign * (b - a)
                };
                Measured::of(excess / size, peak.gradient.iter().enumerate().map(slope).collect())
            }
            OfCourse::RiseTime => {
                let [low, high] = [0.1, 0.9].map(|share| {
                    let (level, by) = part(share);
                    self.passes(0, level, &by)
                });
                match (low, high) {
                    (Some(low), Some(high)) => {
                        let slopes = high.slopes.iter().zip(&low.slopes).map(|(b, a)| b - a).collect();
                        Measured::of(high.t - low.t, slopes)
                    }
                    _ => Measured::missing("the response does not rise"),
                }
            }
            OfCourse::SettlingTime => {
                let off = |k: usize| (self.y[k] - end) / change.abs();
                match (0..last).rev().find(|k| off(*k).abs() > 0.05) {
                    Some(k) => {
                        let (level, by) = part(1.0 + 0.05 * off(k).signum() * change.signum());
                        let moment = self.crossing(k, level, &by);
                        Measured::of(moment.t, moment.slopes)
                    }
                    None => Measured::missing("the response is at its end all the time"),
                }
            }
        }
    }
}
