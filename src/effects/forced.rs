//! Many small changes of one model in one program, for their derivatives where none of them is made.
//!
//! **In** a model, and extensions of it with new parameters at values where they change nothing. **Out** one model with the equations of
//! the base model, and for each new parameter what it adds to these: a column of f_theta and h_theta. To first order nothing else is needed:
//! `s' = f_x s + df/deta`, with f_x of the base model (the tangent-linear model, Maine & Iliff 1986). So a thousand extensions cost a
//! few programs. **Never** second derivatives, and never a value but the null. **Start** at [`Forced`].
//!
//! States that an extension brings are driven by the base model and do not act on it at the null. They are integrated, and their own
//! sensitivities are left out.

use fdm_grammar::derive::{Jacobian, Pattern, differentiate, tangents};
use fdm_grammar::graph::{Graph, Leaf, Reference, Signal};
use fdm_grammar::model::{Model, Origin, State};
use fdm_grammar::op::{Build, ExprId};
use fdm_grammar::schedule::Schedule;
use std::collections::BTreeMap;

/// What a parameter of an extension is there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Role {
    /// A parameter of the base model, by index.
    Base(usize),
    /// This number in every run.
    Known(f64),
    /// A number that differs from run to run, or that the caller gives.
    Given,
    /// One whose column is wanted, at this null.
    Wanted(f64),
}

/// Where the parameters of an extension stand in the forced model; none for numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Added {
    /// Parameters whose columns are wanted: (in the extension, here).
    pub columns: Vec<(usize, usize)>,
    /// Parameters that the caller gives: (in the extension, here).
    pub given: Vec<(usize, usize)>,
}

/// A model and what parameters of its extensions add to it.
#[derive(Debug, Clone)]
pub struct Forced {
    model: Model,
    /// States of the base model.
    own: usize,
    rates: BTreeMap<(u32, u32), ExprId>,
    outputs: BTreeMap<(u32, u32), ExprId>,
    initial: BTreeMap<(u32, u32), ExprId>,
}

impl Forced {
    /// The base model alone; none of its own parameters has a column.
    pub fn new(base: &Model) -> Self {
        let mut model = base.clone();
        model.params.iter_mut().for_each(|p| p.fixed = true);
        model.derived.clear();
        model.states.iter_mut().for_each(|s| s.noise = None);
        let own = model.states.len();
        let (rates, outputs, initial) = Default::default();
        Self { model, own, rates, outputs, initial }
    }

    /// Number of parameters by now.
    pub fn params(&self) -> usize {
        self.model.params.len()
    }

    /// Adds an extension whose inputs, outputs and first states are those of the base model; `roles` has one for each of its parameters.
    /// None where it needs a signal at another time, which the base model does not need.
    pub fn add(&mut self, extended: &Model, roles: &[Role]) -> Option<Added> {
        let (n, base) = (extended.states.len(), &self.model);
        let fits = extended.inputs.len() == base.inputs.len()
            && extended.outputs.len() == base.outputs.len()
            && n >= self.own
            && roles.len() == extended.params.len();
        if !fits {
            return None;
        }
        // derivatives first, in the extension's own graph
        let mut graph = extended.graph.clone();
        let heads = |s: &[State], of: fn(&State) -> ExprId| s.iter().map(of).collect::<Vec<_>>();
        let (rates, initial) = (heads(&extended.states, |s| s.rate), heads(&extended.states, |s| s.initial));
        let outputs: Vec<ExprId> = extended.outputs.iter().map(|o| o.expr).collect();
        let roots = [&rates[..self.own], &outputs[..], &initial[..self.own]].concat();
        if graph.delays_of(&[&rates[..], &outputs[..]].concat()).len() > base.graph.delayed().len() {
            return None;
        }
        let wanted = |leaf| matches!(leaf, Leaf::Param(k) if matches!(roles[k as usize], Role::Wanted(_)));
        let found = tangents(&mut graph, &roots, wanted);
        // a number and a state for everything that is new
        let (first, mut added) = (self.model.states.len(), Added { columns: Vec::new(), given: Vec::new() });
        let mut places = vec![None; roles.len()];
        for (k, role) in roles.iter().enumerate() {
            let here = self.model.params.len();
            match role {
                Role::Base(old) => places[k] = Some(*old),
                Role::Known(_) => continue,
                Role::Given | Role::Wanted(_) => {
                    let mut param = extended.params[k].clone();
                    param.fixed = *role == Role::Given;
                    (param.per_run, param.prior) = (false, None);
                    if !param.is_recorded() {
                        param.origin = Origin::Declared;
                    }
                    param.quantity.name = format!("{} {here}", param.quantity.name);
                    self.model.params.push(param);
                    places[k] = Some(here);
                    if *role == Role::Given { added.given.push((k, here)) } else { added.columns.push((k, here)) }
                }
            }
        }
        let state = |k: u32| if (k as usize) < self.own { k } else { (first + k as usize - self.own) as u32 };
        let reference = |into: &mut Graph, reference: Reference| match reference {
            Reference::Now(Leaf::State(k)) => into.leaf(Leaf::State(state(k))),
            Reference::Now(Leaf::Param(k)) => match (roles[k as usize], places[k as usize]) {
                (Role::Known(value) | Role::Wanted(value), _) => into.number(value),
                (_, Some(here)) => into.leaf(Leaf::Param(here as u32)),
                (_, None) => into.number(f64::NAN),
            },
            Reference::Earlier(Signal::State(k), tau) => into.delay(Signal::State(state(k)), tau),
            other => into.reference(other),
        };
        let derivatives: Vec<ExprId> = found.values().flatten().map(|(_, e)| *e).collect();
        let news: Vec<ExprId> = rates[self.own..].iter().chain(&initial[self.own..]).copied().collect();
        let moved = graph.rebuild(&[&derivatives[..], &news[..]].concat(), &mut self.model.graph, reference);
        let (derivatives, news) = moved.split_at(derivatives.len());
        let (q, own) = (outputs.len(), self.own);
        let each = found.iter().flat_map(|(leaf, column)| column.iter().map(move |(root, _)| (*leaf, *root as usize)));
        for ((leaf, root), e) in each.zip(derivatives) {
            let Leaf::Param(k) = leaf else { continue };
            let Some(column) = places[k as usize] else { continue };
            let (part, row) = match root {
                r if r < own => (&mut self.rates, r),
                r if r < own + q => (&mut self.outputs, r - own),
                r => (&mut self.initial, r - own - q),
            };
            part.insert((row as u32, column as u32), *e);
        }
        let count = n - own;
        for (k, old) in extended.states[own..].iter().enumerate() {
            let mut quantity = old.quantity.clone();
            quantity.name = format!("{} {}", quantity.name, self.model.states.len());
            self.model.states.push(State {
                quantity,
                rate: news[k],
                initial: news[count + k],
                noise: None,
                limits: None,
                resets: Vec::new(),
            });
        }
        Some(added)
    }

    /// The programs, whose only columns are the wanted ones.
    pub fn schedule(mut self) -> Schedule {
        let mut d = differentiate(&mut self.model);
        let (n, q) = (self.model.states.len(), self.model.outputs.len());
        // driven states have no sensitivities that anything needs
        for partials in [&mut d.rates.state, &mut d.rates.delayed, &mut d.rates.input] {
            keep_rows(partials, self.own);
        }
        d.rates.param = jacobian(n, &self.rates);
        d.outputs.param = jacobian(q, &self.outputs);
        d.initial = jacobian(n, &self.initial);
        d.tau = jacobian(self.model.graph.delayed().len(), &BTreeMap::new());
        Schedule::of(&self.model, &d)
    }
}

/// Entries by row and column.
fn jacobian(rows: usize, entries: &BTreeMap<(u32, u32), ExprId>) -> Jacobian {
    let mut pattern = Pattern { rows: vec![0], columns: Vec::new() };
    for row in 0..rows as u32 {
        pattern.columns.extend(entries.range((row, 0)..(row + 1, 0)).map(|((_, column), _)| *column));
        pattern.rows.push(pattern.columns.len() as u32);
    }
    Jacobian { pattern, entries: entries.values().copied().collect() }
}

/// Empties all rows from this one on.
fn keep_rows(jacobian: &mut Jacobian, rows: usize) {
    let Some(end) = jacobian.pattern.rows.get(rows).copied() else { return };
    jacobian.entries.truncate(end as usize);
    jacobian.pattern.columns.truncate(end as usize);
    jacobian.pattern.rows[rows..].iter_mut().for_each(|r| *r = end);
}
