//! The model near a trim: `x' = A x + B v`, `y = C x + D v` with every coefficient an expression of parameters.
//!
//! **In** a checked [`Model`], and which of its states and inputs at the trim are unknown. **Out** [`Linearisation`]: the structural nonzeros
//! of A, B, C, D, of their derivatives and of the delays as a [`Program`], and a program of the equations that the unknowns must
//! fulfil. **Never** solves them: numbers are for whoever runs the programs. **Start** at [`Linearisation::new`].
//!
//! At the trim everything rests: a delayed signal has the value of the signal itself, the time is zero, a `measured(.)` has
//! the value of its output. What is known there is put into the expressions before they are differentiated by the parameters, so that
//! derivatives through the trim need no rule of their own; what is unknown stays a leaf, and the implicit function theorem
//! (f_z z_theta = -f_theta) takes its place.

use crate::derive::{self, Derivatives, Jacobian, differentiate};
use crate::graph::{Graph, Leaf, Node, Reference, Signal};
use crate::model::{Model, Origin};
use crate::op::{Build, ExprId};
use crate::schedule::{Operand, Program, straight_line};

/// A linear model as programs. In both, parameters are [`Operand::Known`] and unknowns [`Operand::State`].
#[derive(Debug, Clone)]
pub struct Linearisation {
    /// (row, signal) of the coefficients that can be other than zero, rising. Rows are the rates of the states (0..n), then the outputs;
    /// signals the states (0..n), the inputs (n..n + m), then the delayed signals.
    pub terms: Vec<(u32, u32)>,
    /// (term, parameter) of their derivatives while the unknowns stand still, rising; none by fixed parameters.
    pub slopes: Vec<(u32, u32)>,
    /// (term, unknown) of their derivatives by the unknowns, rising.
    pub by_unknown: Vec<(u32, u32)>,
    /// What the delayed signals are delayed versions of.
    pub delayed: Vec<Signal>,
    /// (delayed signal, parameter) of the derivatives of the delays, rising.
    pub tau_slopes: Vec<(u32, u32)>,
    /// Terms, slopes, by_unknown, delays, tau_slopes, in this order.
    pub coefficients: Program,
    /// What the unknowns must fulfil.
    pub balance: Balance,
}

/// The equations of the trim: the rates that must vanish there, and their derivatives.
#[derive(Debug, Clone)]
pub struct Balance {
    /// What is unknown.
    pub unknowns: Vec<Signal>,
    /// The states whose rates must vanish: those that a rate or a coefficient depends on. What nothing depends on (a heading, a
    /// distance) may grow steadily.
    pub rows: Vec<u32>,
    /// (position in `rows`, unknown), rising.
    pub by_unknown: Vec<(u32, u32)>,
    /// (position in `rows`, parameter), rising; fixed ones too, which say how large the terms of an equation are.
    pub by_param: Vec<(u32, u32)>,
    /// Rates, by_unknown, by_param, then the values of all states and inputs as far as they are not unknown (zero else): n + m.
    pub program: Program,
}

impl Linearisation {
    /// The model with the given states and inputs unknown at the trim. All others have the value of the `trim` statement,
    /// else their initial value (zero, when it is free), inputs zero.
    pub fn new(model: &Model, unknowns: &[Signal]) -> Self {
        let mut model = model.clone();
        let d = differentiate(&mut model);
        let mut trim = Trim::new(&model, unknowns);
        let (mut terms, coefficients) = entries(&model, &d);
        let mut coefficients = trim.put(&model, &coefficients);
        let keep: Vec<bool> = coefficients.iter().map(|c| trim.graph.constant(*c) != Some(0.0)).collect();
        retain(&mut terms, &keep);
        retain(&mut coefficients, &keep);
        let tau: Vec<ExprId> = model.graph.delayed().iter().map(|s| s.tau).collect();
        let tau = trim.put(&model, &tau);
        let rates: Vec<ExprId> = model.states.iter().map(|s| s.rate).collect();
        let rates = trim.put(&model, &rates);
        let rows = rows(&model, &d);
        let values = trim.values(&model);
        let mut graph = trim.graph;
        let free = |leaf: Leaf| matches!(leaf, Leaf::Param(k) if !model.params[k as usize].fixed);
        let slopes = by_leaf(&mut graph, &coefficients, free);
        let by_unknown = by_leaf(&mut graph, &coefficients, |l| matches!(l, Leaf::State(_)));
        let tau_slopes = by_leaf(&mut graph, &tau, free);
        let parts = [&coefficients[..], &slopes.1, &by_unknown.1, &tau, &tau_slopes.1];
        let program = programmed(&graph, &parts.concat());
        let balance = Balance::new(&mut graph, unknowns, rows, &rates, &values);
        Self {
            terms,
            slopes: slopes.0,
            by_unknown: by_unknown.0,
            delayed: model.graph.delayed().iter().map(|s| s.signal).collect(),
            tau_slopes: tau_slopes.0,
            coefficients: program,
            balance,
        }
    }
}

impl Balance {
    fn new(graph: &mut Graph, unknowns: &[Signal], rows: Vec<u32>, rates: &[ExprId], values: &[ExprId]) -> Self {
        let rates: Vec<ExprId> = rows.iter().map(|k| rates[*k as usize]).collect();
        let by_unknown = by_leaf(graph, &rates, |l| matches!(l, Leaf::State(_)));
        let by_param = by_leaf(graph, &rates, |l| matches!(l, Leaf::Param(_)));
        let parts = [&rates[..], &by_unknown.1, &by_param.1, values];
        Self {
            unknowns: unknowns.to_vec(),
            program: programmed(graph, &parts.concat()),
            rows,
            by_unknown: by_unknown.0,
            by_param: by_param.0,
        }
    }
}

/// Where the model is looked at: the value of every state and input as an expression of a new graph, in which the
/// leaf `State(k)` is unknown k.
struct Trim {
    graph: Graph,
    states: Vec<ExprId>,
    inputs: Vec<ExprId>,
}

impl Trim {
    fn new(model: &Model, unknowns: &[Signal]) -> Self {
        let mut trim = Self { graph: Graph::default(), states: Vec::new(), inputs: Vec::new() };
        let value = |graph: &mut Graph, signal: Signal, otherwise: Option<ExprId>| {
            if let Some(k) = unknowns.iter().position(|u| *u == signal) {
                return graph.leaf(Leaf::State(k as u32));
            }
            let said = model.trim.iter().find(|(s, _)| *s == signal).map(|(_, e)| *e);
            match said.or(otherwise) {
                Some(e) => model.graph.rebuild(&[e], graph, Graph::reference)[0],
                None => graph.number(0.0),
            }
        };
        for (k, state) in model.states.iter().enumerate() {
            let free = model.params.iter().any(|p| p.origin == Origin::FreeInitial(k as u32));
            let value = value(&mut trim.graph, Signal::State(k as u32), (!free).then_some(state.initial));
            trim.states.push(value);
        }
        for k in 0..model.inputs.len() {
            let value = value(&mut trim.graph, Signal::Input(k as u32), None);
            trim.inputs.push(value);
        }
        // the record of an output is what the model says there; an output that contains its own record sees zero
        let outputs: Vec<ExprId> = model.outputs.iter().map(|o| o.expr).collect();
        let outputs = trim.put(model, &outputs);
        for (k, input) in model.inputs.iter().enumerate() {
            if let Some(output) = input.measured {
                trim.inputs[k] = outputs[output as usize];
            }
        }
        trim
    }

    fn put(&mut self, model: &Model, expressions: &[ExprId]) -> Vec<ExprId> {
        let (states, inputs) = (&self.states, &self.inputs);
        model.graph.rebuild(expressions, &mut self.graph, |graph, reference| match reference {
            Reference::Now(Leaf::State(k)) | Reference::Earlier(Signal::State(k), _) => states[k as usize],
            Reference::Now(Leaf::Input(k)) | Reference::Earlier(Signal::Input(k), _) => inputs[k as usize],
            Reference::Now(Leaf::Time) => graph.number(0.0),
            Reference::Now(leaf) => graph.leaf(leaf),
        })
    }

    /// The values of states and inputs, zero in the place of unknowns.
    fn values(&mut self, model: &Model) -> Vec<ExprId> {
        let zero = self.graph.number(0.0);
        let unknown = self.graph.depends(|leaf| matches!(leaf, Leaf::State(_)));
        let all = self.states.iter().chain(&self.inputs[..model.inputs.len()]);
        all.map(|e| if unknown[e.index()] { zero } else { *e }).collect()
    }
}

/// All partials by signals with their places, in the order of rows and signals.
fn entries(model: &Model, d: &Derivatives) -> (Vec<(u32, u32)>, Vec<ExprId>) {
    let (n, m) = (model.states.len(), model.inputs.len());
    let (mut places, mut expressions) = (Vec::new(), Vec::new());
    for (first, len, partials) in [(0, n, &d.rates), (n, model.outputs.len(), &d.outputs)] {
        for i in 0..len {
            let groups: [(&Jacobian, usize); 3] =
                [(&partials.state, 0), (&partials.input, n), (&partials.delayed, n + m)];
            for (jacobian, offset) in groups {
                for (k, j) in jacobian.pattern.row(i) {
                    places.push(((first + i) as u32, (offset + j) as u32));
                    expressions.push(jacobian.entries[k]);
                }
            }
        }
    }
    (places, expressions)
}

/// The states that a rate or a coefficient depends on.
fn rows(model: &Model, d: &Derivatives) -> Vec<u32> {
    let (_, coefficients) = entries(model, d);
    let mut matters = vec![false; model.states.len()];
    let delayed = model.graph.delayed();
    d.rates.state.pattern.columns.iter().for_each(|k| matters[*k as usize] = true);
    let late = d.rates.delayed.pattern.columns.iter().map(|k| Leaf::Delayed(*k));
    let leaves = model.graph.reachable(coefficients).into_iter().filter_map(|e| match model.graph.node(e) {
        Node::Leaf(leaf) => Some(leaf),
        _ => None,
    });
    for leaf in late.chain(leaves) {
        match leaf {
            Leaf::State(k) => matters[k as usize] = true,
            Leaf::Delayed(k) => {
                if let Signal::State(k) = delayed[k as usize].signal {
                    matters[k as usize] = true;
                }
            }
            _ => {}
        }
    }
    (0..matters.len() as u32).filter(|k| matters[*k as usize]).collect()
}

/// Derivatives of expressions by the wanted leaves: (expression, leaf's number) rising, and the expressions of the derivatives.
fn by_leaf(graph: &mut Graph, roots: &[ExprId], wanted: impl Fn(Leaf) -> bool) -> (Vec<(u32, u32)>, Vec<ExprId>) {
    let mut all: Vec<((u32, u32), ExprId)> = Vec::new();
    for (leaf, column) in derive::tangents(graph, roots, wanted) {
        if let Leaf::Param(k) | Leaf::State(k) = leaf {
            all.extend(column.into_iter().map(|(root, d)| ((root, k), d)));
        }
    }
    all.sort_unstable_by_key(|(place, _)| *place);
    all.into_iter().unzip()
}

fn programmed(graph: &Graph, roots: &[ExprId]) -> Program {
    let slots: Vec<u32> = (0..roots.len() as u32).collect();
    straight_line(graph, roots, &slots, roots.len(), |_, node| match node {
        Node::Leaf(Leaf::Param(k)) => Some(Operand::Known(k)),
        Node::Leaf(Leaf::State(k)) => Some(Operand::State(k)),
        _ => None,
    })
}

fn retain<T>(list: &mut Vec<T>, keep: &[bool]) {
    let mut flags = keep.iter();
    list.retain(|_| flags.next().copied().unwrap_or(true));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Source, compile};

    fn model(text: &str) -> Model {
        compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}")).model
    }

    #[test]
    fn what_vanishes_at_a_known_trim_is_no_coefficient() {
        let m = model(
            "model m { input u; state x, y; param a = 1; der(x) = a*y*x + u^2; der(y) = -y*cos(x); output z = x*u + y; }",
        );
        let known = Linearisation::new(&m, &[]);
        assert_eq!(known.terms, [(1, 1), (2, 1)]);
        assert!(known.by_unknown.is_empty() && known.slopes.is_empty());
        let unknown = Linearisation::new(&m, &[Signal::State(0), Signal::Input(0)]);
        assert_eq!(unknown.terms, [(0, 1), (0, 2), (1, 1), (2, 0), (2, 1), (2, 2)]);
        assert_eq!(unknown.slopes, [(0, 0)]);
        assert_eq!(unknown.by_unknown, [(0, 0), (1, 1), (2, 0), (3, 1), (5, 0)]);
    }

    #[test]
    fn only_states_that_something_depends_on_must_rest() {
        let m = model(
            "model m { state u = 1, heading, x; param a = 1, tau = 1; der(u) = -a*u^2; der(heading) = u; der(x) = delay(heading, tau)*u;
            output z = x; }",
        );
        assert_eq!(Linearisation::new(&m, &[Signal::State(0)]).balance.rows, [0, 1]);
    }

    #[test]
    fn a_trim_survives_that_delays_are_dropped_and_states_are_replaced() {
        let m = model(
            "model m { state x, y; param a = 1, b = 2; der(x) = -a*delay(delay(x, 1), a)*y; der(y) = -y; output z = x;
            trim { x = a + b; y = b/a; } }",
        );
        for m in [&m, &m.substituted(&[0]).unwrap()] {
            let values: Vec<f64> = m
                .trim
                .iter()
                .map(|(_, e)| {
                    m.graph.evaluate(*e, |l| match l {
                        Leaf::Param(k) => [1.5, 4.0][k as usize],
                        other => panic!("{other:?}"),
                    })
                })
                .collect();
            assert_eq!(values, [5.5, 4.0 / 1.5]);
        }
    }
}
