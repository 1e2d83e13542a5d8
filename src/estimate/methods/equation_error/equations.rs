//! The equations of a model as regressions: a rate or an output, what is known of it, and a column for every parameter, from the text.

use super::error::Refusal;
use fdm_grammar::Model;
use fdm_grammar::graph::{Graph, Leaf, Node, Signal, show};
use fdm_grammar::model::reading::{Reading, biased_reading, reading, unsettled};
use fdm_grammar::op::{Build, ExprId, Op};
use fdm_grammar::terms::{Combination, Separated, combinations, separate};

/// What an equation explains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Left {
    /// The rate of a state.
    Rate(usize),
    /// An output.
    Output(usize),
}

impl Left {
    /// `der(x)`, or the output.
    pub(super) fn name(self, model: &Model) -> String {
        match self {
            Self::Rate(state) => format!("der({})", model.states[state].quantity.name),
            Self::Output(output) => model.outputs[output].quantity.name.clone(),
        }
    }
}

/// `left - known = sum parameter*column`; expressions of signals, time and known parameters.
#[derive(Debug, Clone)]
pub(super) struct Equation {
    pub(super) left: Left,
    pub(super) known: ExprId,
    /// Free parameters, rising, with their columns. Behind the parameters of the model stand the biases of equations, each with a number of
    /// its own.
    pub(super) columns: Vec<(u32, ExprId)>,
    /// Whether its bias is one of every run.
    pub(super) bias_per_run: bool,
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
    /// Parameters that a reading knows a state up to (n): biases of outputs.
    biases: Vec<Vec<u32>>,
}

impl Equations {
    /// Of the rates of all states that outputs show as they are: what can be followed sample by sample.
    pub(super) fn of_rates(model: &Model) -> Self {
        let mut graph = model.graph.clone();
        let readings = (0..model.states.len()).map(|k| reading(model, &mut graph, k as u32)).collect();
        let biases = vec![Vec::new(); model.states.len()];
        Self { graph, equations: Vec::new(), refused: Vec::new(), readings, biases }.separated(model, &[])
    }

    /// Of the rates of all states that outputs show, also where they add a bias, and of all other outputs. A bias of a signal is one of every
    /// equation in which it stands.
    pub(super) fn new(model: &Model) -> Self {
        let mut graph = model.graph.clone();
        let (mut readings, mut biases) = (Vec::new(), Vec::new());
        for k in 0..model.states.len() as u32 {
            let settled = reading(model, &mut graph, k).map(|reading| (reading, Vec::new()));
            let (reading, bias) = settled.or_else(|| biased_reading(model, &mut graph, k)).unzip();
            readings.push(reading);
            biases.push(bias.unwrap_or_default());
        }
        let shows = |o: usize| readings.iter().flatten().any(|r: &Reading| r.output == o);
        let outputs: Vec<usize> = (0..model.outputs.len()).filter(|o| !shows(*o)).collect();
        Self { graph, equations: Vec::new(), refused: Vec::new(), readings, biases }.separated(model, &outputs)
    }

    fn separated(mut self, model: &Model, outputs: &[usize]) -> Self {
        let free = |k: u32| !model.params[k as usize].fixed;
        let rates = model.states.iter().enumerate().map(|(k, s)| (Left::Rate(k), s.rate));
        let outputs = outputs.iter().map(|o| (Left::Output(*o), model.outputs[*o].expr));
        let (lefts, roots): (Vec<Left>, Vec<ExprId>) = rates.chain(outputs).unzip();
        let separated = separate(&mut self.graph, &roots, free);
        let coefficients: Vec<ExprId> = separated.iter().flat_map(|s| &s.terms).map(|t| t.coefficient).collect();
        let mut combined = combinations(&mut self.graph, &coefficients, free).into_iter();
        for (left, sum) in lefts.into_iter().zip(&separated) {
            let slopes: Vec<Option<Combination>> = combined.by_ref().take(sum.terms.len()).collect();
            match self.equation(model, left, sum, &slopes) {
                Ok(equation) if equation.columns.is_empty() => {}
                Ok(mut equation) => {
                    self.add_bias(model, &mut equation);
                    self.equations.push(equation);
                }
                // an output of signals that nobody measured is no equation that anybody asked for
                Err(Refusal::SignalUnmeasured { .. }) if matches!(left, Left::Output(_)) => {}
                Err(refusal) => self.refused.push(refusal),
            }
        }
        self
    }

    /// What the k-th is called: `der(x)`, or the output.
    pub(super) fn name(&self, model: &Model, k: usize) -> String {
        self.equations[k].left.name(model)
    }

    /// A column of ones where a signal of the equation has a bias that is to be estimated, and no parameter is a constant already.
    fn add_bias(&mut self, model: &Model, equation: &mut Equation) {
        let of_state = |k: u32| self.biases[k as usize].iter().copied();
        let signals = |root: ExprId| {
            let below = self.graph.reachable([root]).into_iter().filter_map(|e| match self.graph.node(e) {
                Node::Leaf(leaf) => Some(leaf),
                Node::Constant(_) | Node::Apply(..) => None,
            });
            below.filter(|leaf| !matches!(leaf, Leaf::Param(_))).collect::<Vec<_>>()
        };
        let roots = || std::iter::once(equation.known).chain(equation.columns.iter().map(|(_, column)| *column));
        let biases: Vec<u32> = roots()
            .flat_map(signals)
            .filter_map(|leaf| match leaf {
                Leaf::State(k) => Some(k),
                Leaf::Delayed(k) => match self.graph.delayed()[k as usize].signal {
                    Signal::State(k) => Some(k),
                    Signal::Input(_) => None,
                },
                _ => None,
            })
            .flat_map(of_state)
            .collect();
        let constant = equation.columns.iter().any(|(_, column)| signals(*column).is_empty());
        if !biases.is_empty() && !constant {
            let one = self.graph.number(1.0);
            equation.columns.push(((model.params.len() + self.equations.len()) as u32, one));
            equation.bias_per_run = biases.iter().any(|k| model.params[*k as usize].per_run);
        }
    }

    fn equation(
        &mut self,
        model: &Model,
        left: Left,
        sum: &Separated,
        slopes: &[Option<Combination>],
    ) -> Result<Equation, Refusal> {
        let equation = left.name(model);
        let text = |graph: &Graph, e: ExprId| show(graph, e, model);
        let has_free = sum
            .terms
            .iter()
            .chain(&sum.rest)
            .any(|t| !self.free_below(model, &[t.coefficient, t.regressor]).is_empty());
        if let Left::Rate(state) = left
            && has_free
            && self.readings[state].is_none()
        {
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
        Ok(Equation { left, known, columns, bias_per_run: false })
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
