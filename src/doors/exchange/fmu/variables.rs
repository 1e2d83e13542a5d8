//! The variables of a unit, in the order of their value references ([`Variables`]).

use fdm_grammar::Unit;
use fdm_grammar::graph::Signal;
use fdm_grammar::model::{Origin, Quantity};
use fdm_system::Model;
use std::collections::BTreeSet;

/// What a variable is; numbers are places in the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Time.
    Time,
    /// A parameter.
    Parameter(usize),
    /// A value that every run brings (`known T0 per run;`): an input of the model that does not move.
    Known(usize),
    /// An input.
    Input(usize),
    /// A state.
    State(usize),
    /// The derivative of a state.
    Rate(usize),
    /// An output.
    Output(usize),
    /// A parameter that follows from others.
    Derived(usize),
    /// How far a state with limits is from its lower and its upper one: two for each of [`Layout::limited`].
    ///
    /// [`Layout::limited`]: fdm_grammar::Layout::limited
    Indicator(usize),
}

/// A variable.
#[derive(Debug, Clone, PartialEq)]
pub struct Variable {
    /// Its name, unique.
    pub name: String,
    /// What the model says of it; may be empty.
    pub doc: String,
    /// Its unit, where it has one.
    pub unit: Option<Unit>,
    /// What it is.
    pub kind: Kind,
    /// Value at the start, of what is given from outside.
    pub start: Option<f64>,
    /// Admissible values; infinite where there is no bound.
    pub bounds: (f64, f64),
    /// Whether it is a parameter of the beginning only, such as an initial value.
    pub initial: bool,
}

/// All variables of a model; a value reference is a place in this list.
#[derive(Debug, Clone, PartialEq)]
pub struct Variables {
    /// In the order time, parameters, values of runs, inputs, states, derivatives, outputs, derived parameters, indicators.
    pub list: Vec<Variable>,
}

impl Variables {
    /// Of a model.
    pub fn of(model: &Model) -> Self {
        let definition = model.definition();
        let time = Quantity { name: "time".into(), doc: String::new(), unit: Some(definition.time.clone()) };
        let mut named = Named::default();
        named.add(&time, None, Kind::Time);
        for (k, param) in definition.params.iter().enumerate().filter(|(_, p)| !p.is_recorded()) {
            let variable = named.add(&param.quantity, Some(param.value), Kind::Parameter(k));
            variable.bounds = (param.lower, param.upper);
            variable.initial = matches!(param.origin, Origin::FreeInitial(_));
        }
        for (k, input) in definition.inputs.iter().enumerate().filter(|(_, i)| i.known) {
            named.add(&input.quantity, Some(0.0), Kind::Known(k)).initial = true;
        }
        for (k, input) in definition.inputs.iter().enumerate().filter(|(_, i)| !i.known) {
            named.add(&input.quantity, Some(0.0), Kind::Input(k));
        }
        for (k, state) in definition.states.iter().enumerate() {
            named.add(&state.quantity, None, Kind::State(k));
        }
        for (k, state) in definition.states.iter().enumerate() {
            let unit = state.quantity.unit.as_ref().and_then(|unit| unit.quotient(&definition.time));
            let name = format!("der({})", state.quantity.name);
            named.add(&Quantity { name, doc: String::new(), unit }, None, Kind::Rate(k));
        }
        for (k, output) in definition.outputs.iter().enumerate() {
            named.add(&output.quantity, None, Kind::Output(k));
        }
        for (k, derived) in definition.derived.iter().enumerate() {
            named.add(&derived.quantity, None, Kind::Derived(k));
        }
        for (k, state) in model.layout().limited.iter().enumerate() {
            let quantity = &definition.states[*state as usize].quantity;
            for (side, word) in ["lower", "upper"].into_iter().enumerate() {
                let name = format!("{word}_limit({})", quantity.name);
                let doc = String::from("distance from the limit; the rate outwards while the state rests there");
                named.add(&Quantity { name, doc, unit: None }, None, Kind::Indicator(2 * k + side));
            }
        }
        Self { list: named.list }
    }

    /// The value reference of a variable.
    pub fn of_kind(&self, kind: Kind) -> Option<u32> {
        self.list.iter().position(|v| v.kind == kind).map(|k| k as u32)
    }

    /// The variable with this value reference.
    pub fn get(&self, reference: u32) -> Option<&Variable> {
        self.list.get(reference as usize)
    }

    /// Value references of the signals that a delayed signal may be.
    pub(super) fn of_signal(&self, signal: Signal) -> Option<u32> {
        match signal {
            Signal::State(k) => self.of_kind(Kind::State(k as usize)),
            Signal::Input(k) => self.of_kind(Kind::Input(k as usize)),
        }
    }
}

/// Variables with names that differ.
#[derive(Default)]
struct Named {
    list: Vec<Variable>,
    taken: BTreeSet<String>,
}

impl Named {
    fn add(&mut self, quantity: &Quantity, start: Option<f64>, kind: Kind) -> &mut Variable {
        let mut name = quantity.name.clone();
        // an input and what `measured` made of an output may be called alike
        while !self.taken.insert(name.clone()) {
            name.push('_');
        }
        let (doc, unit) = (quantity.doc.clone(), quantity.unit.clone());
        let bounds = (f64::NEG_INFINITY, f64::INFINITY);
        self.list.push(Variable { name, doc, unit, kind, start, bounds, initial: false });
        let last = self.list.len() - 1;
        &mut self.list[last]
    }
}
