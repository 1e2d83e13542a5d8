//! The equations of a model as regressions: a rate, what is known of it, and a column for every parameter, from the text.

use super::error::Refusal;
use fdm_grammar::Model;
use fdm_grammar::graph::{Graph, Leaf, Node, Signal, show};
use fdm_grammar::model::reading::{Reading, reading, unsettled};
use fdm_grammar::op::{Build, ExprId, Op};
use fdm_grammar::terms::{Combination, Separated, combinations, separate};

/// `rate - known = sum parameter*column`; expressions of signals, time and known parameters.
#[derive(Debug, Clone)]
pub(super) struct Equation {
    pub(super) state: usize,
    pub(super) known: ExprId,
    /// Free parameters, rising, with their columns.
    pub(super) columns: Vec<(u32, ExprId)>,
}

/// All equations of a model that are regressions.
#[derive(Debug, Clone)]
pub(super) struct Equations {
    /// The model's graph with the columns.
    pub(super) graph: Graph,
    pub(super) equations: Vec<Equation>,
    pub(super) refused: Vec<Refusal>,
    /// How outputs show the states (n).
    pub(super) readings: Vec<Option<Reading>>,
}

impl Equations {
    pub(super) fn new(model: &Model) -> Self {
        let mut graph = model.graph.clone();
        let readings = (0..model.states.len()).map(|k| reading(model, &mut graph, k as u32)).collect();
        let free = |k: u32| !model.params[k as usize].fixed;
        let rates: Vec<ExprId> = model.states.iter().map(|s| s.rate).collect();
        let separated = separate(&mut graph, &rates, free);
        let coefficients: Vec<ExprId> = separated.iter().flat_map(|s| &s.terms).map(|t| t.coefficient).collect();
        let mut combined = combinations(&mut graph, &coefficients, free).into_iter();
        let mut found = Self { graph, equations: Vec::new(), refused: Vec::new(), readings };
        for (state, sum) in separated.iter().enumerate() {
            let slopes: Vec<Option<Combination>> = combined.by_ref().take(sum.terms.len()).collect();
            match found.equation(model, state, sum, &slopes) {
                Ok(equation) if equation.columns.is_empty() => {}
                Ok(equation) => found.equations.push(equation),
                Err(refusal) => found.refused.push(refusal),
            }
        }
        found
    }

    /// What the k-th is called: `der(x)`.
    pub(super) fn name(&self, model: &Model, k: usize) -> String {
        format!("der({})", model.states[self.equations[k].state].quantity.name)
    }

    fn equation(
        &mut self,
        model: &Model,
        state: usize,
        sum: &Separated,
        slopes: &[Option<Combination>],
    ) -> Result<Equation, Refusal> {
        let equation = format!("der({})", model.states[state].quantity.name);
        let text = |graph: &Graph, e: ExprId| show(graph, e, model);
        let has_free = sum
            .terms
            .iter()
            .chain(&sum.rest)
            .any(|t| !self.free_below(model, &[t.coefficient, t.regressor]).is_empty());
        if has_free && self.readings[state].is_none() {
            let unsettled = unsettled(model, &mut self.graph, state as u32).map(Box::new);
            let state = model.states[state].quantity.name.clone();
            return Err(Refusal::RateUnmeasured { equation, state, unsettled });
        }
        if let Some(term) = sum.rest.first() {
            let parameters = self.free_below(model, &[term.regressor]);
            return Err(Refusal::Inside { equation, term: text(&self.graph, term.regressor), parameters });
        }
        let zero = self.graph.number(0.0);
        let mut known = zero;
        let mut columns: Vec<(u32, ExprId)> = Vec::new();
        for (term, slopes) in sum.terms.iter().zip(slopes) {
            let Some(slopes) = slopes else {
                let coefficient = text(&self.graph, term.coefficient);
                return Err(Refusal::NotAffine { equation, coefficient, term: text(&self.graph, term.regressor) });
            };
            if has_free {
                self.check_signals(model, &equation, term.regressor)?;
            }
            known = self.added(known, slopes.constant, term.regressor);
            for (param, slope) in &slopes.slopes {
                let at = columns.binary_search_by_key(param, |(k, _)| *k).unwrap_or_else(|at| {
                    columns.insert(at, (*param, zero));
                    at
                });
                columns[at].1 = self.added(columns[at].1, *slope, term.regressor);
            }
        }
        Ok(Equation { state, known, columns })
    }

    fn added(&mut self, sum: ExprId, coefficient: ExprId, regressor: ExprId) -> ExprId {
        let product = self.graph.apply(Op::Mul, &[coefficient, regressor]);
        self.graph.apply(Op::Add, &[sum, product])
    }

    /// Whether every signal of a regressor is recorded, at times that are known.
    fn check_signals(&mut self, model: &Model, equation: &str, regressor: ExprId) -> Result<(), Refusal> {
        let (equation, term) = (equation.to_string(), show(&self.graph, regressor, model));
        for e in self.graph.reachable([regressor]) {
            let Node::Leaf(leaf) = self.graph.node(e) else { continue };
            let state = match leaf {
                Leaf::State(k) => Some(k),
                Leaf::Delayed(k) => {
                    let delayed = self.graph.delayed()[k as usize];
                    let parameters = self.free_below(model, &[delayed.tau]);
                    if !parameters.is_empty() {
                        return Err(Refusal::FreeDelay { equation, term, parameters });
                    }
                    if let Signal::State(k) = delayed.signal { Some(k) } else { None }
                }
                _ => None,
            };
            if let Some(k) = state.map(|k| k as usize).filter(|k| self.readings[*k].is_none()) {
                let unsettled = unsettled(model, &mut self.graph, k as u32).map(Box::new);
                let state = model.states[k].quantity.name.clone();
                return Err(Refusal::SignalUnmeasured { equation, state, term, unsettled });
            }
        }
        Ok(())
    }

    fn free_below(&self, model: &Model, roots: &[ExprId]) -> Vec<String> {
        let below = self.graph.reachable(roots.iter().copied());
        let params = below.into_iter().filter_map(|e| match self.graph.node(e) {
            Node::Leaf(Leaf::Param(k)) => Some(&model.params[k as usize]),
            _ => None,
        });
        let mut names: Vec<String> = params.filter(|p| !p.fixed).map(|p| p.quantity.name.clone()).collect();
        names.sort();
        names
    }
}
