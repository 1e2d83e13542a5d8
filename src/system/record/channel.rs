//! The channels that a model asks for, and where each is read from.

use fdm_grammar::graph::Leaf;
use fdm_grammar::model::{Membership, Origin, Param, Slope};
use fdm_grammar::{Model, Unit};
use std::fmt;

/// What a channel is to a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// The time of the samples.
    Time,
    /// Drives the model.
    Input,
    /// Is compared with the model.
    Output,
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Time => "time",
            Self::Input => "input",
            Self::Output => "output",
        })
    }
}

/// A signal of a model that a record holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Its name in the model.
    pub name: String,
    /// Its unit in the model; `None` takes the numbers of the file as they are.
    pub unit: Option<Unit>,
    /// Of an input: whether it is a value that the run brings, the same in all samples.
    pub known: bool,
    /// Of a value that runs bring: the group that it stands for.
    pub membership: Option<Membership>,
    /// Of an input: whether it is held between samples, where the model's text says so.
    pub held: Option<bool>,
    /// Of an output: the period of an angle.
    pub wrap: Option<f64>,
}

impl Channel {
    /// A channel that may change from sample to sample.
    pub fn new(name: impl Into<String>, unit: Option<Unit>) -> Self {
        Self { name: name.into(), unit, known: false, membership: None, held: None, wrap: None }
    }
}

/// All that a model wants from a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Channels {
    /// Unit of the model's time.
    pub time: Unit,
    /// Whether time matters; otherwise the file needs no time column, and the run's time counts samples where there is none that rises.
    pub timed: bool,
    /// The least number of samples that are of use.
    pub samples: usize,
    /// Inputs in the model's order.
    pub inputs: Vec<Channel>,
    /// Outputs in the model's order.
    pub outputs: Vec<Channel>,
    /// The outputs (by index) whose records drive the model, in the order of its hidden inputs.
    pub driving: Vec<usize>,
    /// The derivatives of inputs and records that drive the model or are shown, in the order of its hidden inputs.
    pub slopes: Vec<Slope>,
    /// The number of states of a model that can begin at any sample: none of their initial values is stated, and nothing depends on the time since the beginning.
    pub begins_anywhere: Option<usize>,
}

/// The states (by index) whose initial values the model states: as numbers, by parameters that all runs share, or by values that a run brings. Free ones,
/// and those taken from the first sample of an input, are none.
pub fn stated(model: &Model) -> Vec<usize> {
    let found = |p: &Param| match p.origin {
        Origin::FirstSample(input) => model.inputs.get(input as usize).is_none_or(|i| !i.known),
        Origin::FreeInitial(_) | Origin::Declared => p.per_run && !p.fixed,
    };
    let depends = model.graph.depends(|leaf| matches!(leaf, Leaf::Param(k) if found(&model.params[k as usize])));
    (0..model.states.len()).filter(|k| !depends[model.states[*k].initial.index()]).collect()
}

/// Whether rates, outputs or events know the time.
pub(super) fn uses_time(model: &Model) -> bool {
    let time = model.graph.depends(|leaf| matches!(leaf, Leaf::Time));
    let outputs = model.outputs.iter().map(|o| o.expr);
    let states = model.states.iter().flat_map(|s| {
        let events = s.resets.iter().flat_map(|r| [r.guard, r.value]);
        [s.rate].into_iter().chain(events)
    });
    outputs.chain(states).any(|e| time[e.index()])
}

/// The channels of a model: time is wanted by states, delays, derivatives and explicit time.
pub fn channels(model: &Model) -> Channels {
    let channel = |q: &fdm_grammar::model::Quantity| Channel::new(q.name.clone(), q.unit.clone());
    let dynamic = !model.states.is_empty();
    let slopes: Vec<Slope> = model.inputs.iter().filter_map(|i| i.slope).collect();
    Channels {
        time: model.time.clone(),
        timed: dynamic || model.uses_time() || !slopes.is_empty(),
        samples: if dynamic || !slopes.is_empty() { 2 } else { 1 },
        inputs: model
            .inputs
            .iter()
            .filter(|i| i.is_declared())
            .map(|i| Channel { known: i.known, membership: i.membership.clone(), held: i.held, ..channel(&i.quantity) })
            .collect(),
        outputs: model.outputs.iter().map(|o| Channel { wrap: o.wrap, ..channel(&o.quantity) }).collect(),
        driving: model.inputs.iter().filter_map(|i| i.measured).map(|o| o as usize).collect(),
        slopes,
        begins_anywhere: (dynamic && stated(model).is_empty() && !uses_time(model)).then_some(model.states.len()),
    }
}

impl Channels {
    /// Inputs, then outputs.
    pub(crate) fn all(&self) -> impl Iterator<Item = (Role, &Channel)> {
        let inputs = self.inputs.iter().map(|c| (Role::Input, c));
        inputs.chain(self.outputs.iter().map(|c| (Role::Output, c)))
    }

    /// Whether the record of the output of this name drives the model.
    pub(crate) fn drives(&self, output: &str) -> bool {
        self.driving.iter().any(|k| self.outputs[*k].name == output)
    }

    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.all().map(|(_, c)| c.name.as_str())
    }

    /// Whether an option's name means the time: `t` or `time`, unless the model has a channel of that name.
    pub(crate) fn means_time(&self, name: &str) -> bool {
        matches!(name, "t" | "time") && !self.all().any(|(_, c)| c.name == name)
    }
}

/// What is asked of the column of an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Demand {
    /// It must be there and hold a value.
    Needed,
    /// It may be missing or empty, but not be there under a name that looks misspelt.
    IfMeasured,
    /// It may be missing or empty.
    Free,
    /// It is not read.
    LeftOut,
}

/// A column that a channel is read from, and how its numbers become the model's: `scale*value + offset`, or the logarithm of that.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Source {
    /// Index of the column.
    pub(crate) column: usize,
    /// Unit of the column, when it has one.
    pub(crate) unit: Option<String>,
    /// Factor.
    pub(crate) scale: f64,
    /// Added behind the factor.
    pub(crate) offset: f64,
    /// Whether the channel is the natural logarithm of all this.
    pub(crate) logarithm: bool,
    /// Whether its cells are dates or clock times, which are read as seconds.
    pub(crate) clock: bool,
}

impl Source {
    /// A number of the file in the model's unit; the same bits where nothing is to be converted. NaN for the logarithm of what is
    /// not above zero.
    pub(crate) fn convert(&self, value: f64) -> f64 {
        let plain = if self.scale == 1.0 && self.offset == 0.0 { value } else { value * self.scale + self.offset };
        match self.logarithm {
            false => plain,
            true if plain > 0.0 => fdm_grammar::math::log(plain),
            true => f64::NAN,
        }
    }
}

/// Where everything is read from.
#[derive(Debug, Default)]
pub(crate) struct Plan {
    /// The time column; `None` when samples are counted.
    pub(crate) time: Option<Source>,
    /// Whether rows are selected by time, or the model needs it: then every cell of the time column must hold a time.
    pub(crate) strict: bool,
    /// Inputs in the model's order.
    pub(crate) inputs: Vec<Source>,
    /// Outputs in the model's order; `None` where the file has no such column and needs none, or it is left out.
    pub(crate) outputs: Vec<Option<Source>>,
}
