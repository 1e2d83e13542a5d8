//! Measured records in the place of states: Goodman's substitution. Where the equations are driven by what was measured
//! instead of by what was simulated, the response depends on most parameters linearly, and a correction converges from
//! starts from which it fails otherwise.
//!
//! Unknown forces: a model driven by more than what was recorded, at chosen places.

use super::reading::{Reading, Unsettled, reading, unsettled};
use super::{Input, Model, Origin, Output, Param, Quantity, State};
use crate::graph::{Graph, Leaf, Reference, Signal};
use crate::op::{Build, ExprId, Op};

/// States that cannot be replaced by a record, by name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unshown {
    /// The states that no output shows.
    pub states: Vec<String>,
    /// Outputs that would show some of them if less were to be estimated.
    pub unsettled: Vec<Unsettled>,
}

impl std::fmt::Display for Unshown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names: Vec<String> = self.states.iter().map(|s| format!("`{s}`")).collect();
        let plural = if names.len() == 1 { "" } else { "s" };
        write!(
            f,
            "no output shows the state{plural} {}: a record replaces a state where an output is the state itself, or a \
             multiple of it plus a constant",
            names.join(", ")
        )?;
        self.unsettled.iter().try_for_each(|unsettled| write!(f, "; {unsettled}"))
    }
}

impl std::error::Error for Unshown {}

impl Model {
    /// The model with measured records in the place of the chosen states (by index) on the right sides of all
    /// equations, delayed ones too. The record is that of the output which is the state itself, or `a*state + b` with
    /// `a` and `b` of constants and fixed parameters; then `(record - b)/a` is used. Outputs and initial values
    /// keep the simulated states. The records are hidden inputs (`Input::measured`) behind the others.
    ///
    /// # Errors
    /// [`Unshown`] with all chosen states that no output shows so.
    ///
    /// # Panics
    /// When an index is not that of a state.
    pub fn substituted(&self, states: &[usize]) -> Result<Model, Unshown> {
        let mut old = self.graph.clone();
        let mut model = Model { graph: Graph::default(), ..self.clone() };
        let mut readings: Vec<Option<Reading>> = vec![None; self.states.len()];
        for state in states {
            readings[*state] = reading(self, &mut old, *state as u32);
        }
        let missing = |state: &usize| readings[*state].is_none();
        let unshown: Vec<&usize> = states.iter().filter(|s| missing(s)).collect();
        if !unshown.is_empty() {
            let states = unshown.iter().map(|s| self.states[**s].quantity.name.clone()).collect();
            let unsettled = unshown.iter().filter_map(|s| unsettled(self, &mut old, **s as u32)).collect();
            return Err(Unshown { states, unsettled });
        }
        let records: Vec<Option<Record>> =
            readings.iter().map(|r| r.map(|r| Record::new(r, &mut model, &old))).collect();
        let mut graph = std::mem::take(&mut model.graph);
        let rates: Vec<ExprId> = self.states.iter().map(|s| s.rate).collect();
        let rates = old.rebuild(&rates, &mut graph, |g, reference| {
            let (state, tau) = match reference {
                Reference::Now(Leaf::State(k)) => (k, None),
                Reference::Earlier(Signal::State(k), tau) => (k, Some(tau)),
                other => return g.reference(other),
            };
            match records[state as usize] {
                Some(record) => record.state(g, tau),
                None => g.reference(reference),
            }
        });
        let others: Vec<ExprId> = self.values().collect();
        let others = old.rebuild(&others, &mut graph, Graph::reference);
        model.graph = graph;
        model.states.iter_mut().zip(rates).for_each(|(state, rate)| state.rate = rate);
        model.values_mut().zip(others).for_each(|(value, e)| *value = e);
        Ok(model)
    }

    /// All expressions but the rates: initial values, derived parameters, outputs, trim.
    fn values(&self) -> impl Iterator<Item = ExprId> + '_ {
        let derived = self.derived.iter().map(|d| d.expr);
        let outputs = self.outputs.iter().flat_map(Output::expressions);
        let trim = self.trim.iter().map(|(_, e)| *e);
        self.states.iter().flat_map(State::beside_rate).chain(derived).chain(outputs).chain(trim)
    }

    /// All expressions but the rates, to be changed.
    fn values_mut(&mut self) -> impl Iterator<Item = &mut ExprId> {
        let derived = self.derived.iter_mut().map(|d| &mut d.expr);
        self.states
            .iter_mut()
            .flat_map(State::beside_rate_mut)
            .chain(derived)
            .chain(self.outputs.iter_mut().flat_map(Output::expressions_mut))
            .chain(self.trim.iter_mut().map(|(_, e)| e))
    }

    /// The hidden input that is the record of an output; made when there is none.
    pub(crate) fn measured_input(&mut self, output: usize) -> u32 {
        let known = self.inputs.iter().position(|i| i.measured == Some(output as u32));
        let k = known.unwrap_or_else(|| {
            self.inputs.push(Input::measured(output as u32, &self.outputs[output].quantity));
            self.inputs.len() - 1
        });
        k as u32
    }
}

impl Input {
    /// The hidden input that is the record of an output of this name, doc and unit.
    pub(crate) fn measured(output: u32, of: &Quantity) -> Self {
        let quantity = Quantity { name: format!("measured({})", of.name), ..of.clone() };
        Self { measured: Some(output), ..Self::new(quantity) }
    }
}

/// A record that says what a state was: `(input - offset)/slope`, in the new graph.
#[derive(Debug, Clone, Copy)]
struct Record {
    input: u32,
    slope: ExprId,
    offset: ExprId,
}

impl Record {
    /// Adds what is needed to the model and to its new graph.
    fn new(reading: Reading, model: &mut Model, old: &Graph) -> Self {
        let input = model.measured_input(reading.output);
        let moved = old.rebuild(&[reading.slope, reading.offset], &mut model.graph, Graph::reference);
        Self { input, slope: moved[0], offset: moved[1] }
    }

    /// The state as measured, now or earlier.
    fn state(self, graph: &mut Graph, tau: Option<ExprId>) -> ExprId {
        let record = match tau {
            Some(tau) => graph.delay(Signal::Input(self.input), tau),
            None => graph.leaf(Leaf::Input(self.input)),
        };
        let above = graph.apply(Op::Sub, &[record, self.offset]);
        graph.apply(Op::Div, &[above, self.slope])
    }
}

/// Where an unknown force enters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Entry {
    /// Beside the record of an input, by index.
    Input(u32),
    /// Into the rate of a state, by index.
    Rate(u32),
    /// Beside the value of a parameter, by index, wherever it stands.
    Param(u32),
}

impl Model {
    /// The model with `signals` more inputs behind its own, each of which enters at every one of these places with a factor:
    /// a parameter with the value 0 behind the others, at `params + place*signals + signal`. All other parameters are
    /// fixed, so that derivatives are those by the factors alone; the states are outputs behind the model's own.
    ///
    /// The derivative by a factor is the response to that signal at that place, exactly linear about the model's own response.
    ///
    /// # Panics
    /// When an index is not that of an input, a state or a parameter.
    pub fn forced(&self, entries: &[Entry], signals: usize) -> Self {
        let mut model = Self { graph: Graph::default(), ..self.clone() };
        model.params.iter_mut().for_each(|p| p.fixed = true);
        let (m, p) = (self.inputs.len() as u32, self.params.len() as u32);
        let named = |name: String| Quantity { name, doc: String::new(), unit: None };
        for signal in 0..signals {
            model.inputs.push(Input::new(named(format!("force {signal}"))));
        }
        for place in 0..entries.len() {
            model.params.extend(
                (0..signals).map(|signal| Param::open(named(format!("factor {place}, {signal}")), Origin::Declared)),
            );
        }
        let push = |graph: &mut Graph, entry: Entry, tau: Option<ExprId>, to: ExprId| {
            let Some(place) = entries.iter().position(|e| *e == entry) else { return to };
            (0..signals as u32).fold(to, |sum, k| {
                let factor = graph.leaf(Leaf::Param(p + (place * signals) as u32 + k));
                let signal = match tau {
                    Some(tau) => graph.delay(Signal::Input(m + k), tau),
                    None => graph.leaf(Leaf::Input(m + k)),
                };
                let product = graph.apply(Op::Mul, &[factor, signal]);
                graph.apply(Op::Add, &[sum, product])
            })
        };
        let old: Vec<ExprId> = model.expressions_mut().map(|e| *e).collect();
        let mut graph = Graph::default();
        let new = self.graph.rebuild(&old, &mut graph, |graph, reference| {
            let same = graph.reference(reference);
            match reference {
                Reference::Now(Leaf::Input(k)) => push(graph, Entry::Input(k), None, same),
                Reference::Now(Leaf::Param(k)) => push(graph, Entry::Param(k), None, same),
                Reference::Earlier(Signal::Input(k), tau) => push(graph, Entry::Input(k), Some(tau), same),
                _ => same,
            }
        });
        model.expressions_mut().zip(new).for_each(|(e, new)| *e = new);
        for (k, state) in model.states.iter_mut().enumerate() {
            state.rate = push(&mut graph, Entry::Rate(k as u32), None, state.rate);
            let quantity = named(format!("state {}", state.quantity.name));
            let expr = graph.leaf(Leaf::State(k as u32));
            model.outputs.push(Output::new(quantity, expr));
        }
        model.graph = graph;
        model
    }

    /// Whether no parameter stands in the rate of a state: nothing was left to be found there.
    pub fn is_known_rate(&self, state: usize) -> bool {
        let by_params = self.graph.depends(|leaf| matches!(leaf, Leaf::Param(_)));
        !by_params[self.states[state].rate.index()]
    }
}

#[cfg(test)]
mod forces_tests {
    use super::*;
    use crate::{Source, compile};

    #[test]
    fn forces_enter_where_they_are_wanted_also_behind_a_delay() {
        let text = "model m { input u; state x, z; param a = -1, T = 0.1 in [0, 1]; let d = delay(u, T);
            der(x) = a*x + d; der(z) = x; output y = x + u; }";
        let model = compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}")).model;
        assert!(!model.is_known_rate(0) && model.is_known_rate(1));
        let forced = model.forced(&[Entry::Input(0), Entry::Rate(0)], 2);
        let shown = |e: ExprId| crate::graph::show(&forced.graph, e, &forced);
        assert_eq!((forced.inputs.len(), forced.params.len(), forced.outputs.len()), (3, 6, 3));
        let rate = shown(forced.states[0].rate);
        for part in ["delay(force 0, T)", "delay(force 1, T)", "factor 0, 1", "factor 1, 0", "factor 1, 1"] {
            assert!(rate.contains(part), "{rate}");
        }
        assert_eq!(shown(forced.states[1].rate), "x");
        assert!(shown(forced.outputs[0].expr).contains("factor 0, 0"));
        let at = |leaf: Leaf| match leaf {
            Leaf::Param(k) if k >= 2 => 0.0,
            Leaf::Param(0) => -1.0,
            Leaf::State(0) => 2.0,
            Leaf::Input(0) => 3.0,
            _ => 5.0,
        };
        assert_eq!(forced.graph.evaluate(forced.outputs[0].expr, at), 5.0, "without a force nothing changes");
    }
}
