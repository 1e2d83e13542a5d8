//! Unknown forces: a model driven by more than what was recorded, at chosen places.

use super::{Input, Model, Origin, Param, Quantity};
use crate::graph::{Graph, Leaf, Reference, Signal};
use crate::op::{Build, ExprId, Op};

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
            model.outputs.push(super::Output::new(quantity, expr));
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
mod tests {
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
