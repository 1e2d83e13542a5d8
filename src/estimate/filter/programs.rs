//! The programs of a filter: rates, outputs and their Jacobians as the outputs of two models, so that what the Riccati equation
//! needs, the derivatives of Jacobians, are partials of outputs and exact like all others.

use crate::model::Model;
use fdm_grammar::derive::{Pattern, differentiate};
use fdm_grammar::model::{Output, Quantity};
use fdm_grammar::op::{Build, ExprId};

/// A model seen by a filter.
pub(super) struct Programs {
    /// Its outputs are rates (n), the entries of f_x, intensities of noises.
    pub(super) flow: Model,
    /// Its outputs are outputs (q), then the entries of h_x.
    pub(super) sight: Model,
    /// Where the entries of f_x stand (n by n).
    pub(super) transition: Pattern,
    /// Where the entries of h_x stand (q by n).
    pub(super) observation: Pattern,
    /// States whose equations carry noise.
    pub(super) noisy: Vec<usize>,
}

impl Programs {
    pub(super) fn new(model: &Model) -> Self {
        let mut definition = model.definition().clone();
        let (n, q) = (definition.states.len(), definition.outputs.len());
        // derivatives by parameters are those of the two models
        let free: Vec<bool> = definition.params.iter().map(|p| !p.fixed).collect();
        definition.params.iter_mut().for_each(|p| p.fixed = true);
        let partials = differentiate(&mut definition);
        definition.params.iter_mut().zip(free).for_each(|(p, free)| p.fixed = !free);
        let rates: Vec<ExprId> = definition.states.iter().map(|s| s.rate).collect();
        let shown: Vec<ExprId> = definition.outputs.iter().map(|o| o.expr).collect();
        let noisy: Vec<usize> = (0..n).filter(|k| definition.states[*k].noise.is_some()).collect();
        let intensities: Vec<ExprId> = definition.states.iter().filter_map(|s| s.noise).collect();
        let zero = definition.graph.number(0.0);
        // nothing integrates these models
        definition.states.iter_mut().for_each(|s| s.rate = zero);
        let showing = |roots: [&[ExprId]; 3]| {
            let mut definition = definition.clone();
            let output = |expr: ExprId| Output { quantity: nameless(), expr, noise: None };
            definition.outputs = roots.concat().into_iter().map(output).collect();
            model.altered(definition)
        };
        let (transition, observation) = (partials.rates.state, partials.outputs.state);
        debug_assert_eq!((transition.pattern.rows.len(), observation.pattern.rows.len()), (n + 1, q + 1));
        Self {
            flow: showing([&rates, &transition.entries, &intensities]),
            sight: showing([&shown, &observation.entries, &[]]),
            transition: transition.pattern,
            observation: observation.pattern,
            noisy,
        }
    }
}

fn nameless() -> Quantity {
    Quantity { name: String::new(), doc: String::new(), unit: None }
}
