//! What is to be carried in, and what stands in the way.

use super::obstacle::{NotCarried, Obstacle};
use crate::graph::{Graph, Leaf, Node, Signal, show};
use crate::model::Model;
use crate::model::reading::{Reading, reading, unsettled};
use crate::op::ExprId;
use crate::schedule::affine_nodes;
use crate::terms::{Term, separate};

/// How the signals of a regressor stand in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Lag {
    /// All signals are delayed by this: what is computed is delayed as a whole.
    Common(ExprId),
    /// Each as it is; delays are known.
    Own,
}

/// A term of an equation that is not affine.
#[derive(Debug, Clone, Copy)]
pub(super) enum Part {
    /// Stays dynamic: a signal, or a constant.
    Linear(Term),
    /// Becomes a hidden input.
    Carried(Term, Lag),
}

/// An equation that is to be written anew.
#[derive(Debug, Clone)]
pub(super) struct Equation {
    /// Its place: rates of the states, then outputs.
    pub(super) row: usize,
    pub(super) parts: Vec<Part>,
}

/// Everything about a model that its linear form needs.
pub(super) struct Plan {
    /// The model's graph with the nodes of coefficients and regressors.
    pub(super) graph: Graph,
    pub(super) equations: Vec<Equation>,
    /// What the states in carried terms are read from (n).
    pub(super) readings: Vec<Option<Reading>>,
}

impl Plan {
    pub(super) fn new(model: &Model) -> Result<Self, NotCarried> {
        let affine = affine_nodes(&model.graph);
        let all: Vec<ExprId> = roots(model).collect();
        let rows: Vec<usize> = (0..all.len()).filter(|row| !affine[all[*row].index()]).collect();
        let wanted: Vec<ExprId> = rows.iter().map(|row| all[*row]).collect();
        let mut search = Search {
            model,
            graph: model.graph.clone(),
            readings: vec![None; model.states.len()],
            obstacles: Vec::new(),
        };
        let separated = separate(&mut search.graph, &wanted, |k| !model.params[k as usize].fixed);
        let mut equations = Vec::new();
        for (row, sum) in rows.into_iter().zip(separated) {
            sum.rest.iter().for_each(|term| search.unknown(row, term));
            let parts = sum.terms.iter().filter_map(|term| search.part(row, *term)).collect();
            equations.push(Equation { row, parts });
        }
        let Search { graph, readings, mut obstacles, .. } = search;
        obstacles.sort();
        obstacles.dedup();
        if obstacles.is_empty() { Ok(Self { graph, equations, readings }) } else { Err(NotCarried { obstacles }) }
    }
}

/// Rates, then outputs.
pub(super) fn roots(model: &Model) -> impl Iterator<Item = ExprId> + '_ {
    model.states.iter().map(|s| s.rate).chain(model.outputs.iter().map(|o| o.expr))
}

/// `der(x)`, or the name of an output.
pub(super) fn equation_name(model: &Model, row: usize) -> String {
    match row.checked_sub(model.states.len()) {
        None => format!("der({})", model.states[row].quantity.name),
        Some(output) => model.outputs[output].quantity.name.clone(),
    }
}

struct Search<'a> {
    model: &'a Model,
    graph: Graph,
    readings: Vec<Option<Reading>>,
    obstacles: Vec<Obstacle>,
}

impl Search<'_> {
    fn names(&self, row: usize, e: ExprId) -> (String, String) {
        (show(&self.graph, e, self.model), equation_name(self.model, row))
    }

    /// Names of the free parameters below some expressions.
    fn free_below(&self, roots: &[ExprId]) -> Vec<String> {
        let params = self.graph.reachable(roots.iter().copied()).into_iter().filter_map(|e| match self.graph.node(e) {
            Node::Leaf(Leaf::Param(k)) => Some(&self.model.params[k as usize]),
            _ => None,
        });
        let mut names: Vec<String> = params.filter(|p| !p.fixed).map(|p| p.quantity.name.clone()).collect();
        names.sort();
        names
    }

    fn unknown(&mut self, row: usize, term: &Term) {
        let (text, equation) = self.names(row, term.regressor);
        let parameters = self.free_below(&[term.regressor]);
        self.obstacles.push(Obstacle::Unknown { term: text, equation, parameters });
    }

    /// A term as part of a linear equation, if nothing stands in the way.
    fn part(&mut self, row: usize, term: Term) -> Option<Part> {
        match self.graph.node(term.regressor) {
            Node::Constant(_) => return Some(Part::Linear(term)),
            Node::Leaf(leaf) if leaf != Leaf::Time => return Some(Part::Linear(term)),
            _ => {}
        }
        let leaves: Vec<Leaf> =
            self.graph.reachable([term.regressor]).into_iter().filter_map(|e| self.leaf(e)).collect();
        let lag = self.lag(row, term, &leaves);
        let known = leaves.iter().all(|leaf| match self.state(*leaf) {
            Some(state) => self.is_read(row, term, state),
            None => true,
        });
        lag.filter(|_| known).map(|lag| Part::Carried(term, lag))
    }

    fn leaf(&self, e: ExprId) -> Option<Leaf> {
        if let Node::Leaf(leaf) = self.graph.node(e) { Some(leaf) } else { None }
    }

    /// The state that a leaf is, now or earlier.
    fn state(&self, leaf: Leaf) -> Option<u32> {
        match leaf {
            Leaf::State(k) => Some(k),
            Leaf::Delayed(k) => match self.graph.delayed()[k as usize].signal {
                Signal::State(k) => Some(k),
                Signal::Input(_) => None,
            },
            _ => None,
        }
    }

    fn is_read(&mut self, row: usize, term: Term, state: u32) -> bool {
        let k = state as usize;
        if self.readings[k].is_none() {
            self.readings[k] = reading(self.model, &mut self.graph, state);
        }
        if self.readings[k].is_none() {
            let (text, equation) = self.names(row, term.regressor);
            let name = self.model.states[k].quantity.name.clone();
            let unsettled = unsettled(self.model, &mut self.graph, state);
            self.obstacles.push(Obstacle::Unshown { term: text, equation, state: name, unsettled });
        }
        self.readings[k].is_some()
    }

    fn lag(&mut self, row: usize, term: Term, leaves: &[Leaf]) -> Option<Lag> {
        let tau = |leaf: &Leaf| match leaf {
            Leaf::Delayed(k) => Some(self.graph.delayed()[*k as usize].tau),
            _ => None,
        };
        let taus: Vec<ExprId> = leaves.iter().filter_map(tau).collect();
        let undelayed = leaves.iter().any(|l| matches!(l, Leaf::State(_) | Leaf::Input(_) | Leaf::Time));
        let parameters = self.free_below(&taus);
        match taus.first() {
            Some(first) if !undelayed && taus.iter().all(|t| t == first) => Some(Lag::Common(*first)),
            Some(_) if !parameters.is_empty() => {
                let (text, equation) = self.names(row, term.regressor);
                self.obstacles.push(Obstacle::Apart { term: text, equation, parameters });
                None
            }
            _ => Some(Lag::Own),
        }
    }
}
