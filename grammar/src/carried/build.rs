//! The linear model that a plan describes.

use super::plan::{Lag, Part, Plan, equation_name, roots};
use super::{Carried, CarriedTerm};
use crate::graph::{Graph, Leaf, Names, Node, Reference, Signal, show};
use crate::model::reading::Reading;
use crate::model::{Computed, Input, Model, Quantity};
use crate::op::{Build, ExprId, Op};

/// Writes the equations of a plan anew.
pub(super) fn build(original: &Model, plan: Plan) -> Carried {
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
