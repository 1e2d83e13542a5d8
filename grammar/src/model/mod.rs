//! A checked model: names, roles, units, values, bounds, equations as graph roots.
//!
//! **In** from `check`. **Out** [`Model`], in which no unresolved name can exist. **Never** text or spans of
//! expressions: mistakes have been told by now. **Start** at [`Model`].

pub mod reading;
mod substitution;
#[cfg(test)]
mod tests;
mod ties;

pub use crate::syntax::Membership;
pub use substitution::{Entry, Unshown};
pub use ties::Tie;

use crate::graph::{Graph, Leaf, Names, Node, Signal};
use crate::op::{Build, ExprId, Op};
use crate::requirement::Requirements;
use crate::unit::Unit;
use std::collections::BTreeMap;
use std::sync::Arc;

/// What is common to everything that has a name.
#[derive(Debug, Clone)]
pub struct Quantity {
    /// The name as declared.
    pub name: String,
    /// The doc string, empty when there is none.
    pub doc: String,
    /// The unit, when one was declared.
    pub unit: Option<Unit>,
}

/// A recorded signal that drives the model.
#[derive(Debug, Clone)]
pub struct Input {
    /// Name, doc, unit.
    pub quantity: Quantity,
    /// Declared with `known`: a value that each run brings, the same in all samples; expressions hold it as a parameter
    /// ([`Origin::FirstSample`]).
    pub known: bool,
    /// Of a value that runs bring: the group that it stands for.
    pub membership: Option<Membership>,
    /// How it goes between samples: it keeps its value until the next one (`held`, zero-order hold), or goes in straight lines (`linear`). Of others that is
    /// said with their records.
    pub held: Option<bool>,
    /// Made from `measured(.)` or by [`Model::substituted`]: a hidden input, filled from the record of this output. `None`
    /// for a declared input.
    pub measured: Option<u32>,
    /// Made by [`Model::carried`]: a hidden input, computed from what the inputs in front of it recorded.
    pub computed: Option<Computed>,
    /// Made from `der(u)`: a hidden input, the derivative of an input in front of it.
    pub slope: Option<Slope>,
}

impl Input {
    /// An input of which nothing else is said.
    pub fn new(quantity: Quantity) -> Self {
        Self { quantity, known: false, membership: None, held: None, measured: None, computed: None, slope: None }
    }

    /// Whether it was declared, so that a record has a column of it; hidden inputs follow from other columns.
    pub fn is_declared(&self) -> bool {
        self.measured.is_none() && self.computed.is_none() && self.slope.is_none()
    }
}

/// The derivative of an input, as its record is interpolated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slope {
    /// The input, by index.
    pub of: u32,
    /// Whether outputs show it: its value at a sample is then the mean of the slopes on both sides, and linear between samples. Otherwise
    /// it drives rates: each slope holds from its sample to the next, so that its integral is the input itself, and is zero outside
    /// the record.
    pub shown: bool,
}

/// What a hidden input is computed from: an expression in a graph of its own, so that neither derivatives nor delays of the
/// model know of it. Its leaves are time, inputs that stand in front of it, delayed inputs whose delays are known,
/// and parameters, which are taken at the values that the model gives them.
#[derive(Debug, Clone)]
pub struct Computed {
    /// Holds the expression.
    pub graph: Graph,
    /// Which it is.
    pub expr: ExprId,
}

/// A state with its equation.
#[derive(Debug, Clone)]
pub struct State {
    /// Name, doc, unit.
    pub quantity: Quantity,
    /// `der(state)`, an expression of everything.
    pub rate: ExprId,
    /// Value at the beginning of a run, an expression of parameters.
    pub initial: ExprId,
    /// Intensity of the white noise that enters the equation (`noise der(x) = q;`), an expression of parameters: the standard
    /// deviation of what it adds to the state in one unit of time.
    pub noise: Option<ExprId>,
    /// How far it may go (`limit x in [a, b];`).
    pub limits: Option<Limits>,
    /// The events that give it a new value (`when x > limit { v = -0.5*v; }`), in the order of the text.
    pub resets: Vec<Reset>,
}

/// What an event makes of a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reset {
    /// The event, by its place in the text.
    pub event: u32,
    /// Passes zero upwards when its condition becomes true: an expression of everything.
    pub guard: ExprId,
    /// The state's value behind it: an expression of what stands just before it.
    pub value: ExprId,
}

/// States that get new values together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Event {
    /// As in [`Reset`].
    pub guard: ExprId,
    /// The states (by index) and their values.
    pub resets: Vec<(u32, ExprId)>,
}

impl State {
    /// Of the events that set it: guards and values.
    pub(crate) fn of_events(&self) -> impl Iterator<Item = ExprId> + '_ {
        self.resets.iter().flat_map(|r| [r.guard, r.value])
    }

    /// All its expressions but the rate.
    pub(crate) fn beside_rate(&self) -> impl Iterator<Item = ExprId> + '_ {
        let limits = self.limits.map(|l| [l.lower, l.upper]);
        [self.initial].into_iter().chain(self.noise).chain(limits.into_iter().flatten()).chain(self.of_events())
    }

    /// All its expressions but the rate, to be changed.
    pub(crate) fn beside_rate_mut(&mut self) -> impl Iterator<Item = &mut ExprId> {
        let limits = self.limits.as_mut().map(|l| [&mut l.lower, &mut l.upper]);
        let resets = self.resets.iter_mut().flat_map(|r| [&mut r.guard, &mut r.value]);
        [&mut self.initial].into_iter().chain(&mut self.noise).chain(limits.into_iter().flatten()).chain(resets)
    }

    /// All its expressions.
    pub(crate) fn expressions(&self) -> impl Iterator<Item = ExprId> + '_ {
        [self.rate].into_iter().chain(self.beside_rate())
    }

    /// All its expressions, to be changed.
    pub(crate) fn expressions_mut(&mut self) -> impl Iterator<Item = &mut ExprId> {
        let limits = self.limits.as_mut().map(|l| [&mut l.lower, &mut l.upper]);
        let resets = self.resets.iter_mut().flat_map(|r| [&mut r.guard, &mut r.value]);
        let known = [&mut self.rate, &mut self.initial].into_iter().chain(&mut self.noise);
        known.chain(limits.into_iter().flatten()).chain(resets)
    }
}

/// Where a state stops: a simulation holds it there while its rate pushes outwards. Expressions of parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Least value.
    pub lower: ExprId,
    /// Greatest value.
    pub upper: ExprId,
}

/// Where the first value of a parameter comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// Declared with `param`.
    Declared,
    /// Made from `state x = free`: the initial value of that state, first guessed from the data.
    FreeInitial(u32),
    /// Made from `initial(.)` or `known`: the first sample of that input in every run, filled in by whoever simulates one.
    FirstSample(u32),
}

/// What was known about a parameter before these data: a normal distribution (the field's a-priori weighting).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Mean, in the parameter's unit.
    pub mean: f64,
    /// Standard deviation, above 0.
    pub deviation: f64,
}

/// A number that the model leaves open.
#[derive(Debug, Clone)]
pub struct Param {
    /// Name (`x(0)` for the free initial value of x), doc, unit.
    pub quantity: Quantity,
    /// Declared with `param`, or made from a free initial state.
    pub origin: Origin,
    /// Start value of an estimation.
    pub value: f64,
    /// Least admissible value, `-inf` when not given.
    pub lower: f64,
    /// Greatest admissible value, `inf` when not given.
    pub upper: f64,
    /// Known: not estimated and not differentiated by.
    pub fixed: bool,
    /// Has a value of its own in every run.
    pub per_run: bool,
    /// Has a value of its own in every group of runs; the name of the grouping.
    pub group: Option<String>,
    /// Positive, and searched by its logarithm (`log`).
    pub logarithmic: bool,
    /// What was known before; the copies of every run have it each.
    pub prior: Option<Prior>,
}

impl Param {
    /// Estimated, shared by all runs, without bounds, and 0 at the start.
    pub fn open(quantity: Quantity, origin: Origin) -> Self {
        Self {
            quantity,
            origin,
            value: 0.0,
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
            fixed: false,
            per_run: false,
            group: None,
            logarithmic: false,
            prior: None,
        }
    }

    /// Whether it is the first sample of an input: neither estimated nor given, and no user declared it.
    pub fn is_recorded(&self) -> bool {
        matches!(self.origin, Origin::FirstSample(_))
    }

    /// Whether both bounds have one sign and the one is 100 times further from zero than the other, or more: its logarithm says
    /// more of its size than its value.
    pub fn spans_decades(&self) -> bool {
        const WIDE: f64 = 100.0;
        let Self { lower, upper, .. } = *self;
        lower > 0.0 && upper.is_finite() && upper >= WIDE * lower
            || upper < 0.0 && lower.is_finite() && lower <= WIDE * upper
    }
}

/// A parameter that is defined by others (`param b = 2*a`) or tied to them (`tie b = 2*a`): reported, not estimated.
#[derive(Debug, Clone)]
pub struct Derived {
    /// Name, doc, unit.
    pub quantity: Quantity,
    /// Its definition, an expression of parameters.
    pub expr: ExprId,
    /// Declared with a value of its own, which it has while its tie is off.
    pub tied: bool,
}

/// What the model says a recorded channel should be.
#[derive(Debug, Clone)]
pub struct Output {
    /// Name, doc, unit.
    pub quantity: Quantity,
    /// An expression of everything.
    pub expr: ExprId,
    /// Standard deviation of the measurement noise, when it is known (`noise y = 0.02;`).
    pub noise: Option<f64>,
    /// Standard deviation of the measurement noise as an expression of everything, when it is not one number (`noise y
    /// = 0.02 + 0.1*abs(y);`).
    pub noise_model: Option<ExprId>,
    /// The period of an angle: values that differ by a multiple of it are the same.
    pub wrap: Option<f64>,
}

impl Output {
    /// An output of whose noise nothing is known.
    pub fn new(quantity: Quantity, expr: ExprId) -> Self {
        Self { quantity, expr, noise: None, noise_model: None, wrap: None }
    }

    /// Its expression and that of its noise.
    pub fn expressions(&self) -> impl Iterator<Item = ExprId> + use<> {
        [self.expr].into_iter().chain(self.noise_model)
    }

    /// Its expression and that of its noise, to be changed.
    pub fn expressions_mut(&mut self) -> impl Iterator<Item = &mut ExprId> {
        [&mut self.expr].into_iter().chain(&mut self.noise_model)
    }
}

/// A function through nodes, as the model declares it; its values stand in the model's expressions.
#[derive(Debug, Clone)]
pub struct Table {
    /// Name, doc, unit of its values.
    pub quantity: Quantity,
    /// The word behind `=`: `linear`, `cubic` or `pchip`.
    pub method: String,
    /// One to three.
    pub arguments: Vec<TableArgument>,
    /// Values at all crossings of the axes, those of the last argument next to each other.
    pub nodes: Vec<TableNode>,
    /// What it is called with.
    pub calls: TableCalls,
    /// `smooth CL by order 2;`: which differences of neighbouring nodes are small.
    pub smooth: Option<u32>,
}

/// An argument of a table.
#[derive(Debug, Clone)]
pub struct TableArgument {
    /// Its name.
    pub name: String,
    /// Its unit, when one was declared.
    pub unit: Option<Unit>,
    /// Where the nodes are, increasing (2 or more).
    pub axis: Vec<f64>,
}

/// What a table is at a node.
#[derive(Debug, Clone, PartialEq)]
pub enum TableNode {
    /// A number.
    Number(f64),
    /// The param of this name.
    Param(String),
    /// An expression of params.
    Expression,
}

/// The arguments of every call of a table, in a graph of their own, so that neither derivatives nor substitutions know of them.
#[derive(Debug, Clone, Default)]
pub struct TableCalls {
    /// Holds the expressions.
    pub graph: Graph,
    /// By call and argument.
    pub arguments: Vec<Vec<ExprId>>,
}

impl Table {
    /// Numbers of nodes along the arguments.
    pub fn lengths(&self) -> Vec<usize> {
        self.arguments.iter().map(|a| a.axis.len()).collect()
    }

    /// The place of a node along each argument, from 0.
    pub fn place(&self, node: usize) -> Vec<usize> {
        let mut rest = node;
        let mut place: Vec<usize> = Vec::with_capacity(self.arguments.len());
        for argument in self.arguments.iter().rev() {
            place.push(rest % argument.axis.len());
            rest /= argument.axis.len();
        }
        place.reverse();
        place
    }
}

/// A checked model.
#[derive(Debug, Clone)]
pub struct Model {
    /// Its name.
    pub name: String,
    /// Its doc string, empty when there is none.
    pub doc: String,
    /// Unit of `t` and of the time in `der`.
    pub time: Unit,
    /// Inputs in the order of declaration, then the hidden ones (see `Input::measured`).
    pub inputs: Vec<Input>,
    /// States in the order of declaration.
    pub states: Vec<State>,
    /// Parameters in the order of declaration; free initial values stand where their state is declared.
    pub params: Vec<Param>,
    /// Derived parameters.
    pub derived: Vec<Derived>,
    /// Ties that are open: their params are estimated by themselves. None refers to a later one.
    pub ties: Vec<Tie>,
    /// Outputs in the order of declaration.
    pub outputs: Vec<Output>,
    /// Where the model is linearised: values of states and inputs, expressions of parameters, from `trim`; what is not
    /// named is found from the equations.
    pub trim: Vec<(Signal, ExprId)>,
    /// Tables in the order of declaration.
    pub tables: Vec<Table>,
    /// What the model is used for; none where nothing is required.
    pub requirements: Option<Arc<Requirements>>,
    /// All expressions.
    pub graph: Graph,
}

impl Model {
    /// Index of a parameter by name.
    pub fn param(&self, name: &str) -> Option<usize> {
        self.params.iter().position(|p| p.quantity.name == name)
    }

    /// Inputs (by index) that are zero outside the record.
    pub fn vanishing(&self) -> impl Iterator<Item = u32> + '_ {
        let slope = |i: &Input| i.slope.is_some_and(|s| !s.shown);
        self.inputs.iter().enumerate().filter(move |(_, i)| slope(i)).map(|(k, _)| k as u32)
    }

    /// The states (by index) that have limits.
    pub fn limits(&self) -> impl Iterator<Item = (usize, Limits)> + '_ {
        self.states.iter().enumerate().filter_map(|(k, s)| Some((k, s.limits?)))
    }

    /// The events in the order of the text.
    pub fn events(&self) -> Vec<Event> {
        let mut events: BTreeMap<u32, Event> = BTreeMap::new();
        for (k, state) in self.states.iter().enumerate() {
            for reset in &state.resets {
                let event = events.entry(reset.event);
                let event = event.or_insert_with(|| Event { guard: reset.guard, resets: Vec::new() });
                event.resets.push((k as u32, reset.value));
            }
        }
        events.into_values().collect()
    }

    /// Whether an event can set a state.
    pub fn has_events(&self) -> bool {
        self.states.iter().any(|s| !s.resets.is_empty())
    }

    /// Start values of all parameters.
    pub fn start(&self) -> Vec<f64> {
        self.params.iter().map(|p| p.value).collect()
    }

    /// For each parameter whether it stands in noises (`noise der(x) = q;`, `noise y = s*abs(y);`) and nowhere else: it moves no response.
    pub fn only_in_noise(&self) -> Vec<bool> {
        self.only_in(
            self.states.iter().filter_map(|s| s.noise).chain(self.outputs.iter().filter_map(|o| o.noise_model)),
        )
    }

    /// For each parameter whether it stands in the noise of outputs (`noise y = s*abs(y);`) and nowhere else but in other noises.
    pub fn only_in_output_noise(&self) -> Vec<bool> {
        self.only_in(self.outputs.iter().filter_map(|o| o.noise_model))
    }

    /// For each parameter whether it stands in these noises and in no equation.
    fn only_in(&self, noises: impl Iterator<Item = ExprId>) -> Vec<bool> {
        let mentioned = |roots: Vec<ExprId>| {
            let mut mentioned = vec![false; self.params.len()];
            for e in self.graph.reachable(roots) {
                if let Node::Leaf(Leaf::Param(k)) = self.graph.node(e) {
                    mentioned[k as usize] = true;
                }
            }
            mentioned
        };
        let limits = |s: &State| s.limits.into_iter().flat_map(|l| [l.lower, l.upper]);
        let states = self.states.iter().flat_map(|s| [s.rate, s.initial].into_iter().chain(limits(s)));
        let states = states.chain(self.states.iter().flat_map(State::of_events));
        let others = self.outputs.iter().map(|o| o.expr).chain(self.trim.iter().map(|(_, e)| *e));
        let delays = self.graph.delayed().iter().map(|d| d.tau);
        let elsewhere = mentioned(states.chain(others).chain(delays).collect());
        let noise = mentioned(noises.collect());
        noise.iter().zip(elsewhere).map(|(noise, elsewhere)| *noise && !elsewhere).collect()
    }

    /// The model with one over the standard deviation of each noise that is an expression as outputs behind its own, in their order; none where there are
    /// none. An infinite deviation, of a sample that says nothing, is then 0.
    pub fn with_precisions(&self) -> Option<Self> {
        let noisy = self.outputs.iter().filter_map(|o| Some((&o.quantity.name, o.noise_model?)));
        let noisy: Vec<(&String, ExprId)> = noisy.collect();
        let mut model = (!noisy.is_empty()).then(|| self.clone())?;
        for (name, deviation) in noisy {
            let one = model.graph.number(1.0);
            let expr = model.graph.apply(Op::Div, &[one, deviation]);
            let name = format!("1/(noise of {name})");
            model.outputs.push(Output::new(Quantity { name, doc: String::new(), unit: None }, expr));
        }
        Some(model)
    }

    /// The model with the arguments of all calls of its tables as outputs behind its own: table by table, call by call. None where
    /// no table is called.
    pub fn with_table_arguments(&self) -> Option<Self> {
        if self.tables.iter().all(|t| t.calls.arguments.is_empty()) {
            return None;
        }
        let mut model = self.clone();
        for table in &self.tables {
            let all: Vec<ExprId> = table.calls.arguments.iter().flatten().copied().collect();
            let moved = table.calls.graph.rebuild(&all, &mut model.graph, Graph::reference);
            for (k, expr) in moved.into_iter().enumerate() {
                let argument = &table.arguments[k % table.arguments.len()];
                let name =
                    format!("{} of {}, call {}", argument.name, table.quantity.name, k / table.arguments.len() + 1);
                model.outputs.push(Output::new(Quantity { name, doc: String::new(), unit: None }, expr));
            }
        }
        Some(model)
    }

    /// Whether an expression (of rates, outputs or their noise) mentions explicit time.
    pub fn uses_time(&self) -> bool {
        let roots = self.states.iter().map(|s| s.rate).chain(self.outputs.iter().flat_map(Output::expressions));
        let roots = roots.chain(self.states.iter().flat_map(State::of_events));
        let time = self.graph.depends(|l| matches!(l, Leaf::Time | Leaf::Delayed(_)));
        let computed = self.inputs.iter().filter_map(|i| i.computed.as_ref());
        let mut beside =
            computed.map(|c| c.graph.depends(|l| matches!(l, Leaf::Time | Leaf::Delayed(_)))[c.expr.index()]);
        roots.into_iter().any(|r| time[r.index()]) || beside.any(|depends| depends)
    }
}

impl Names for Model {
    fn leaf(&self, leaf: Leaf) -> String {
        match leaf {
            Leaf::Time => "t".into(),
            Leaf::State(k) => self.states[k as usize].quantity.name.clone(),
            Leaf::Input(k) => self.inputs[k as usize].quantity.name.clone(),
            Leaf::Param(k) => self.params[k as usize].quantity.name.clone(),
            Leaf::Delayed(k) => {
                let d = self.graph.delayed()[k as usize];
                let signal = match d.signal {
                    Signal::State(i) => Leaf::State(i),
                    Signal::Input(i) => Leaf::Input(i),
                };
                format!("delay({}, {})", self.leaf(signal), crate::graph::show(&self.graph, d.tau, self))
            }
        }
    }
}
