//! Nonlinear terms carried in as known inputs, so that what remains is linear (`F(theta) z` of the frequency-domain methods).
//!
//! **In** a checked [`Model`]. **Out** [`Carried`]: the same model, affine in states and inputs, in which every other
//! regressor is a hidden input computed from records, and what was carried in the user's words; or [`NotCarried`].
//! **Never** approximates, and never touches an equation that is affine already. **Start** at [`Model::carried`].
//!
//! The linear model that a plan describes.
//!
//! What is to be carried in, and what stands in the way.
//!
//! Why a nonlinear term can not be computed from records.

use crate::graph::{Graph, Leaf, Names, Node, Reference, Signal, show};
use crate::model::reading::{Reading, Unsettled, reading, unsettled};
use crate::model::{Computed, Input, Model, Quantity};
use crate::op::{Build, ExprId, Op};
use crate::schedule::affine_nodes;
use crate::terms::{Term, separate};
use std::fmt;

#[cfg(test)]
mod tests;

/// A model whose nonlinear terms are inputs.
#[derive(Debug, Clone)]
pub struct Carried {
    /// Affine in states, inputs and delayed signals; its coefficients are those of the original. Nothing is changed in a
    /// model that was affine.
    pub model: Model,
    /// What became an input.
    pub terms: Vec<CarriedTerm>,
}

/// One regressor that became a hidden input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CarriedTerm {
    /// The hidden input, by index.
    pub input: usize,
    /// What is computed, as it stands in the equations (`p*abs(p)`), without a delay that all of it has.
    pub text: String,
    /// The equations in which it stands: `der(p)`, `a_m`.
    pub equations: Vec<String>,
    /// The outputs whose records it is computed from.
    pub records: Vec<String>,
}

impl Model {
    /// The model with its nonlinear terms carried in as known inputs. Every rate and output that is not affine in states,
    /// inputs and delayed signals becomes a sum of coefficients (of parameters) times regressors: linear ones stay
    /// dynamic, of the others each is a hidden input (`Input::computed`), in which a state is its measured reading,
    /// `(record - b)/a` of the output that is `a*state + b` with known `a` and `b`. A term of signals that share one delay is
    /// the delayed input, so that the delay can be estimated.
    ///
    /// # Errors
    /// [`NotCarried`] with every term that can not be computed from records, and what would help.
    pub fn carried(&self) -> Result<Carried, NotCarried> {
        let plan = Plan::new(self)?;
        Ok(build(self, plan))
    }
}

/// Writes the equations of a plan anew.
fn build(original: &Model, plan: Plan) -> Carried {
    let mut model = original.clone();
    if plan.equations.is_empty() {
        return Carried { model, terms: Vec::new() };
    }
    model.graph = Graph::default();
    // spectra know neither limits nor events
    for state in &mut model.states {
        state.limits = None;
        state.resets.clear();
    }
    // what is computed refers to records that stand in front of it
    let records: Vec<Option<u32>> = plan.readings.iter().map(|r| r.map(|r| model.measured_input(r.output))).collect();
    let mut builder =
        Builder { original, plan: &plan, records, model, seen: Graph::default(), known: Vec::new(), terms: Vec::new() };
    let mut rows: Vec<ExprId> = roots(original).collect();
    let mut anew = vec![false; rows.len()];
    for equation in &plan.equations {
        rows[equation.row] = builder.sum(equation.row, &equation.parts);
        anew[equation.row] = true;
    }
    let kept: Vec<usize> = (0..rows.len()).filter(|row| !anew[*row]).collect();
    let moved = builder.moved(&kept.iter().map(|row| rows[*row]).collect::<Vec<_>>());
    kept.into_iter().zip(moved).for_each(|(row, e)| rows[row] = e);
    let initial = original.states.iter().map(|s| s.initial);
    let derived = original.derived.iter().map(|d| d.expr);
    let noises = original.states.iter().filter_map(|s| s.noise);
    let noises = noises.chain(original.outputs.iter().filter_map(|o| o.noise_model));
    let trim = original.trim.iter().map(|(_, e)| *e);
    let others: Vec<ExprId> = initial.chain(derived).chain(trim).chain(noises).collect();
    let others = builder.moved(&others);
    let Builder { mut model, terms, .. } = builder;
    let n = model.states.len();
    let (rates, outputs) = rows.split_at(n);
    let (initial, rest) = others.split_at(n);
    let (derived, rest) = rest.split_at(model.derived.len());
    let (trim, noises) = rest.split_at(model.trim.len());
    model.states.iter_mut().zip(rates).for_each(|(s, e)| s.rate = *e);
    model.states.iter_mut().zip(initial).for_each(|(s, e)| s.initial = *e);
    model.outputs.iter_mut().zip(outputs).for_each(|(o, e)| o.expr = *e);
    model.derived.iter_mut().zip(derived).for_each(|(d, e)| d.expr = *e);
    model.trim.iter_mut().zip(trim).for_each(|((_, value), e)| *value = *e);
    let process = model.states.iter_mut().filter_map(|s| s.noise.as_mut());
    let of_outputs = model.outputs.iter_mut().filter_map(|o| o.noise_model.as_mut());
    process.chain(of_outputs).zip(noises).for_each(|(q, e)| *q = *e);
    Carried { model, terms }
}

struct Builder<'a> {
    original: &'a Model,
    plan: &'a Plan,
    /// The hidden input that records each state (n).
    records: Vec<Option<u32>>,
    model: Model,
    /// All that is computed, so that the same expression is one input.
    seen: Graph,
    /// Expression in `seen` and its input.
    known: Vec<(ExprId, usize)>,
    terms: Vec<CarriedTerm>,
}

impl Builder<'_> {
    /// Expressions as they were, in the new graph.
    fn moved(&mut self, expressions: &[ExprId]) -> Vec<ExprId> {
        self.plan.graph.rebuild(expressions, &mut self.model.graph, Graph::reference)
    }

    fn sum(&mut self, row: usize, parts: &[Part]) -> ExprId {
        let mut sum = self.model.graph.number(0.0);
        for part in parts {
            let (coefficient, signal) = match part {
                Part::Linear(term) => {
                    let moved = self.moved(&[term.coefficient, term.regressor]);
                    (moved[0], moved[1])
                }
                Part::Carried(term, lag) => {
                    let input = self.input(row, term.regressor, *lag) as u32;
                    let coefficient = self.moved(&[term.coefficient])[0];
                    let signal = match lag {
                        Lag::Common(tau) => {
                            let tau = self.moved(&[*tau])[0];
                            self.model.graph.delay(Signal::Input(input), tau)
                        }
                        Lag::Own => self.model.graph.leaf(Leaf::Input(input)),
                    };
                    (coefficient, signal)
                }
            };
            let product = self.model.graph.apply(Op::Mul, &[coefficient, signal]);
            sum = self.model.graph.apply(Op::Add, &[sum, product]);
        }
        sum
    }

    /// The hidden input that is computed as a regressor says; made when there is none.
    fn input(&mut self, row: usize, regressor: ExprId, lag: Lag) -> usize {
        let (plan, records) = (self.plan, &self.records);
        let mut words = Graph::default();
        let regressor = plan.graph.rebuild(&[regressor], &mut words, |g, reference| match (reference, lag) {
            (Reference::Earlier(Signal::State(k), _), Lag::Common(_)) => g.leaf(Leaf::State(k)),
            (Reference::Earlier(Signal::Input(k), _), Lag::Common(_)) => g.leaf(Leaf::Input(k)),
            (other, _) => g.reference(other),
        })[0];
        let moved = words.rebuild(&[regressor], &mut self.seen, |g, reference| {
            let (state, tau) = match reference {
                Reference::Now(Leaf::State(k)) => (k, None),
                Reference::Earlier(Signal::State(k), tau) => (k, Some(tau)),
                other => return g.reference(other),
            };
            match (plan.readings[state as usize], records[state as usize]) {
                (Some(reading), Some(input)) => read(g, &plan.graph, reading, input, tau),
                _ => g.reference(reference),
            }
        })[0];
        let equation = equation_name(self.original, row);
        if let Some((_, input)) = self.known.iter().find(|(e, _)| *e == moved) {
            let input = *input;
            if let Some(term) = self.terms.iter_mut().find(|t| t.input == input)
                && !term.equations.contains(&equation)
            {
                term.equations.push(equation);
            }
            return input;
        }
        let mut graph = Graph::default();
        let expr = self.seen.rebuild(&[moved], &mut graph, Graph::reference)[0];
        let text = show(&words, regressor, &Words { model: self.original, graph: &words });
        let term = CarriedTerm {
            input: self.model.inputs.len(),
            text,
            equations: vec![equation],
            records: self.recorded(&graph, expr),
        };
        let input = term.input;
        let name = if term.records.is_empty() { term.text.clone() } else { format!("measured({})", term.text) };
        let quantity = Quantity { name, doc: "nonlinear term, computed from records".into(), unit: None };
        self.model.inputs.push(Input { computed: Some(Computed { graph, expr }), ..Input::new(quantity) });
        self.known.push((moved, input));
        self.terms.push(term);
        input
    }

    /// The outputs whose records an expression reads.
    fn recorded(&self, graph: &Graph, e: ExprId) -> Vec<String> {
        let signals = graph.reachable([e]).into_iter().filter_map(|e| match graph.node(e) {
            Node::Leaf(Leaf::Input(k)) => Some(k),
            Node::Leaf(Leaf::Delayed(k)) => match graph.delayed()[k as usize].signal {
                Signal::Input(k) | Signal::State(k) => Some(k),
            },
            _ => None,
        });
        let outputs = signals.filter_map(|k| self.model.inputs[k as usize].measured);
        let mut outputs: Vec<u32> = outputs.collect();
        outputs.sort_unstable();
        outputs.dedup();
        outputs.into_iter().map(|o| self.model.outputs[o as usize].quantity.name.clone()).collect()
    }
}

/// The names of a model for a graph with delayed signals of its own.
struct Words<'a> {
    model: &'a Model,
    graph: &'a Graph,
}

impl Names for Words<'_> {
    fn leaf(&self, leaf: Leaf) -> String {
        let Leaf::Delayed(k) = leaf else { return self.model.leaf(leaf) };
        let delayed = self.graph.delayed()[k as usize];
        let signal = match delayed.signal {
            Signal::State(k) => Leaf::State(k),
            Signal::Input(k) => Leaf::Input(k),
        };
        format!("delay({}, {})", self.model.leaf(signal), show(self.graph, delayed.tau, self))
    }
}

/// A state as its output was measured, now or earlier: `(record - offset)/slope`.
fn read(graph: &mut Graph, old: &Graph, reading: Reading, input: u32, tau: Option<ExprId>) -> ExprId {
    let known = old.rebuild(&[reading.slope, reading.offset], graph, Graph::reference);
    let record = match tau {
        Some(tau) => graph.delay(Signal::Input(input), tau),
        None => graph.leaf(Leaf::Input(input)),
    };
    let above = graph.apply(Op::Sub, &[record, known[1]]);
    graph.apply(Op::Div, &[above, known[0]])
}

/// How the signals of a regressor stand in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Lag {
    /// All signals are delayed by this: what is computed is delayed as a whole.
    Common(ExprId),
    /// Each as it is; delays are known.
    Own,
}

/// A term of an equation that is not affine.
#[derive(Debug, Clone, Copy)]
enum Part {
    /// Stays dynamic: a signal, or a constant.
    Linear(Term),
    /// Becomes a hidden input.
    Carried(Term, Lag),
}

/// An equation that is to be written anew.
#[derive(Debug, Clone)]
struct Equation {
    /// Its place: rates of the states, then outputs.
    row: usize,
    parts: Vec<Part>,
}

/// Everything about a model that its linear form needs.
struct Plan {
    /// The model's graph with the nodes of coefficients and regressors.
    graph: Graph,
    equations: Vec<Equation>,
    /// What the states in carried terms are read from (n).
    readings: Vec<Option<Reading>>,
}

impl Plan {
    fn new(model: &Model) -> Result<Self, NotCarried> {
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
fn roots(model: &Model) -> impl Iterator<Item = ExprId> + '_ {
    model.states.iter().map(|s| s.rate).chain(model.outputs.iter().map(|o| o.expr))
}

/// `der(x)`, or the name of an output.
fn equation_name(model: &Model, row: usize) -> String {
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

/// A term in the way.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Obstacle {
    /// It holds a state that no output shows.
    Unshown {
        /// The term as it stands in the text.
        term: String,
        /// `der(x)` or the name of an output.
        equation: String,
        /// The state.
        state: String,
        /// The output that would show it if less were to be estimated.
        unsettled: Option<Unsettled>,
    },
    /// It holds a parameter that is to be estimated, in a way that is not a factor.
    Unknown {
        /// The term as it stands in the text.
        term: String,
        /// `der(x)` or the name of an output.
        equation: String,
        /// The parameters.
        parameters: Vec<String>,
    },
    /// It holds signals at different times, and a delay between them is to be estimated.
    Apart {
        /// The term as it stands in the text.
        term: String,
        /// `der(x)` or the name of an output.
        equation: String,
        /// The parameters in the delays.
        parameters: Vec<String>,
    },
}

/// The terms that can not be carried in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NotCarried {
    /// One for each term and reason.
    pub obstacles: Vec<Obstacle>,
}

fn quoted(names: &[String]) -> String {
    names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ")
}

impl fmt::Display for Obstacle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unshown { term, equation, unsettled: Some(unsettled), .. } => write!(
                f,
                "the term `{term}` of `{equation}` is not linear and can not be computed from records: {unsettled}: fix \
                 that, show the state by an output of its own, or linearise the model"
            ),
            Self::Unshown { term, equation, state, unsettled: None } => write!(
                f,
                "the term `{term}` of `{equation}` is not linear and no output shows the state `{state}` in it, so that it \
                 can not be computed from records: measure it (`output {state}_m = {state};`), or linearise the model"
            ),
            Self::Unknown { term, equation, parameters } => write!(
                f,
                "the term `{term}` of `{equation}` is not linear and can not be computed from records while {} \
                 inside it is to be estimated: fix it, or linearise the model",
                quoted(parameters)
            ),
            Self::Apart { term, equation, parameters } => write!(
                f,
                "the term `{term}` of `{equation}` is not linear and takes signals at different times, while the delay by \
                 {} is to be estimated: fix it, or delay the whole term",
                quoted(parameters)
            ),
        }
    }
}

impl fmt::Display for NotCarried {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines: Vec<String> = self.obstacles.iter().map(ToString::to_string).collect();
        f.write_str(&lines.join("\n"))
    }
}

impl std::error::Error for NotCarried {}
