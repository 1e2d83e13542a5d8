//! The coefficients of a model's linear model: which there are and which parameters move them ([`Structure`]), and their values with
//! derivatives at any parameters ([`LinearModel`]).

use super::trim::{Equations, TrimError, Unbalanced, sizes};
use crate::code::Bytecode;
use crate::dynamics::{Point, Workspace};
use crate::model::Model;
use crate::record::Run;
use fdm_grammar::Linearisation;
use fdm_grammar::graph::{Leaf, Names, Node, Signal};
use fdm_grammar::op::Build;
use std::collections::BTreeSet;
use std::sync::Arc;

/// How the states and inputs at which a model is linearised were found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Obtained {
    /// The coefficients do not depend on them.
    NotNeeded,
    /// The model's `trim` names all that matter.
    Given,
    /// The rates vanish at the initial values and without input.
    Initial,
    /// Solved from the equations.
    Solved,
}

/// Where a model is linearised.
#[derive(Debug, Clone, PartialEq)]
pub struct Trim {
    /// How it was found.
    pub obtained: Obtained,
    /// What the equations determine; all else has the values that the model gives it.
    pub solved: Vec<Signal>,
    /// What was held at its start value or recorded mean, since the equations alone led nowhere.
    pub assumed: Vec<Signal>,
    /// Values of the states (n).
    pub states: Vec<f64>,
    /// Values of the inputs (m).
    pub inputs: Vec<f64>,
}

/// A model, linear or linearised at its trim, ready to be evaluated at many values of its parameters.
#[derive(Debug, Clone)]
pub struct LinearModel {
    structure: Arc<Structure>,
    program: Bytecode,
    out: Vec<f64>,
    work: Workspace,
    /// For every slope its place among the direct ones, if it is there.
    direct: Vec<Option<u32>>,
    /// (slope, position in by_unknown, unknown): what reaches a slope through the trim.
    through: Vec<(u32, u32, u32)>,
    /// Numbers of direct slopes and of derivatives by unknowns.
    counts: (usize, usize),
    equations: Equations,
    /// Parameters and unknowns from which the equations of the trim are solved.
    start: (Vec<f64>, Vec<f64>),
    /// Unknowns, and their derivatives (unknowns by p), at the last evaluation.
    unknowns: (Vec<f64>, Vec<f64>),
    trim: Trim,
    names: (Vec<String>, Vec<String>),
    given: Vec<String>,
}

impl LinearModel {
    /// Linearises a model; the trim is looked for at the start values of its parameters.
    ///
    /// # Errors
    /// [`TrimError::NotFound`] when rates do not vanish for any values of what the model's `trim` leaves open.
    pub fn new(model: &Model) -> Result<Self, TrimError> {
        Self::near(model, &Recorded::default())
    }

    /// Linearises a model; where the model alone says too little, the trim is looked for at recorded means.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn near(model: &Model, recorded: &Recorded) -> Result<Self, TrimError> {
        let definition = model.definition();
        let theta = definition.start();
        let found = found(definition, &theta, recorded, Need::Coefficients)?;
        Ok(Self::at(definition, found, theta))
    }

    /// Linearises a model with every state and input that the equations determine solved for, even where no coefficient
    /// depends on them: where a manoeuvre begins.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn at_rest(model: &Model) -> Result<Self, TrimError> {
        let definition = model.definition();
        let theta = definition.start();
        let found = found(definition, &theta, &Recorded::default(), Need::Rest)?;
        Ok(Self::at(definition, found, theta))
    }

    fn at(definition: &fdm_grammar::Model, found: Found, theta: Vec<f64>) -> Self {
        let Found { linearisation, z, obtained, assumed } = found;
        let Linearisation { terms, slopes, by_unknown, delayed, tau_slopes, coefficients, balance } = linearisation;
        let free = |k: &u32| !definition.params[*k as usize].fixed;
        let moved: BTreeSet<u32> = balance.by_param.iter().map(|(_, k)| *k).filter(free).collect();
        let through = by_unknown.iter().flat_map(|(t, _)| moved.iter().map(|k| (*t, *k)));
        let all: BTreeSet<(u32, u32)> = slopes.iter().copied().chain(through).collect();
        let all: Vec<(u32, u32)> = all.into_iter().collect();
        let place = |slope: (u32, u32)| all.binary_search(&slope).unwrap_or_default() as u32;
        let chains = by_unknown.iter().enumerate();
        let through = chains.flat_map(|(k, (t, z))| moved.iter().map(move |p| ((*t, *p), k as u32, *z)));
        let through = through.map(|(slope, k, z)| (place(slope), k, z)).collect();
        let structure = Structure {
            states: definition.states.len(),
            inputs: definition.inputs.len(),
            outputs: definition.outputs.len(),
            params: definition.params.len(),
            delayed,
            terms: terms.iter().map(|(row, signal)| Term { row: *row, signal: *signal }).collect(),
            slopes: all.iter().map(|(term, param)| Slope { term: *term, param: *param }).collect(),
            tau_slopes: tau_slopes.iter().map(|(d, param)| TauSlope { delayed: *d, param: *param }).collect(),
        };
        let unknowns = balance.unknowns.len();
        Self {
            program: Bytecode::new(&coefficients, unknowns, 0),
            out: vec![0.0; coefficients.width],
            work: Workspace::default(),
            direct: all.iter().map(|s| slopes.binary_search(s).ok().map(|k| k as u32)).collect(),
            through,
            counts: (slopes.len(), by_unknown.len()),
            unknowns: (z.clone(), vec![0.0; unknowns * theta.len()]),
            given: definition
                .trim
                .iter()
                .map(|(s, _)| *s)
                .chain(assumed.iter().copied())
                .map(|s| name(definition, s))
                .collect(),
            trim: Trim { obtained, solved: balance.unknowns.clone(), assumed, states: Vec::new(), inputs: Vec::new() },
            equations: Equations::new(balance),
            start: (theta, z),
            names: names(definition),
            structure: Arc::new(structure),
        }
    }

    /// Which coefficients there are, and which parameters move them.
    pub fn structure(&self) -> &Arc<Structure> {
        &self.structure
    }

    /// The coefficients at these parameters (p), written over `values`.
    ///
    /// # Errors
    /// [`TrimError::NotFound`] when the trim that there is at the start values cannot be followed to these parameters;
    /// [`TrimError::NotFinite`] when an equation has no derivative at the trim.
    pub fn evaluate(&mut self, theta: &[f64], values: &mut Values) -> Result<(), TrimError> {
        if !self.trim.solved.is_empty() {
            self.follow(theta)?;
        }
        let at = Point { t: 0.0, x: &self.unknowns.0, drive: &[], known: theta };
        self.program.run(at, &mut self.out, &mut self.work);
        let s = &self.structure;
        let (terms, rest) = self.out.split_at(s.terms.len());
        let (direct, rest) = rest.split_at(self.counts.0);
        let (by_unknown, rest) = rest.split_at(self.counts.1);
        let (tau, tau_slopes) = rest.split_at(s.delayed.len());
        copy(&mut values.terms, terms);
        copy(&mut values.tau, tau);
        copy(&mut values.tau_slopes, tau_slopes);
        values.slopes.clear();
        values.slopes.extend(self.direct.iter().map(|k| k.map_or(0.0, |k| direct[k as usize])));
        for (slope, k, z) in &self.through {
            let param = s.slopes[*slope as usize].param as usize;
            let moved = self.unknowns.1[*z as usize * s.params + param];
            // what stands still adds nothing, even where the coefficient has no derivative by it
            if moved != 0.0 {
                values.slopes[*slope as usize] += by_unknown[*k as usize] * moved;
            }
        }
        self.finite(values)
    }

    /// Where the model was linearised by the last evaluation.
    pub fn trim(&mut self, theta: &[f64]) -> Trim {
        let (n, m) = (self.structure.states, self.structure.inputs);
        self.equations.evaluate(theta, &self.unknowns.0);
        let mut all = self.equations.known()[..n + m].to_vec();
        for (signal, value) in self.trim.solved.iter().zip(&self.unknowns.0) {
            all[place(*signal, n)] = *value;
        }
        let inputs = all.split_off(n);
        Trim { states: all, inputs, ..self.trim.clone() }
    }

    /// What the equations of the trim were solved for by the last evaluation ([`Trim::solved`]): values, and their derivatives by all
    /// parameters (values by p).
    pub fn unknowns(&self) -> (&[f64], &[f64]) {
        (&self.unknowns.0, &self.unknowns.1)
    }

    /// Solves the equations of the trim, from the start values; where that fails, on the way from the start parameters to these.
    fn follow(&mut self, theta: &[f64]) -> Result<(), TrimError> {
        let mut z = self.start.1.clone();
        if let Err(unbalanced) = self.equations.solve(theta, &mut z) {
            z = self.wander(theta).ok_or_else(|| self.lost(unbalanced))?;
        }
        let slopes = &mut self.unknowns.1;
        slopes.fill(0.0);
        let determined = self.equations.slopes(&z, slopes);
        self.unknowns.0 = z;
        if determined { Ok(()) } else { Err(self.lost(Unbalanced((0..self.equations.balance.rows.len()).collect()))) }
    }

    /// From the start parameters to others in steps that the equations can be followed over.
    fn wander(&mut self, theta: &[f64]) -> Option<Vec<f64>> {
        let (from, mut z) = self.start.clone();
        let (mut done, mut step) = (0.0_f64, 0.25);
        for _ in 0..64 {
            let reached = (done + step).min(1.0);
            let between = |(a, b): (&f64, &f64)| if reached == 1.0 { *b } else { a + reached * (b - a) };
            let at: Vec<f64> = from.iter().zip(theta).map(between).collect();
            let mut trial = z.clone();
            if self.equations.solve(&at, &mut trial).is_ok() {
                (z, done, step) = (trial, reached, 1.5 * step);
            } else {
                step *= 0.5;
            }
            if done == 1.0 {
                return Some(z);
            }
        }
        None
    }

    fn lost(&self, unbalanced: Unbalanced) -> TrimError {
        let rows = &self.equations.balance.rows;
        let equations = unbalanced.0.iter().map(|i| self.names.0[rows[*i] as usize].clone()).collect();
        TrimError::NotFound { equations, given: self.given.clone(), open: Vec::new() }
    }

    fn finite(&self, values: &Values) -> Result<(), TrimError> {
        let s = &self.structure;
        let wrong = |term: usize, value: f64, slope: bool| {
            let Term { row, signal } = s.terms[term];
            let (equation, signal) = (self.names.0[row as usize].clone(), self.names.1[signal as usize].clone());
            Err(TrimError::NotFinite { equation, signal, value, slope })
        };
        if let Some(k) = values.terms.iter().position(|v| !v.is_finite()) {
            return wrong(k, values.terms[k], false);
        }
        if let Some(k) = values.slopes.iter().position(|v| !v.is_finite()) {
            return wrong(s.slopes[k].term as usize, values.slopes[k], true);
        }
        Ok(())
    }
}

fn copy(to: &mut Vec<f64>, from: &[f64]) {
    to.clear();
    to.extend_from_slice(from);
}

/// Means of records, for a trim that the model alone does not find.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recorded {
    /// Of the declared inputs; nothing where that is not known.
    inputs: Vec<f64>,
    /// Of the states that an output shows as they are (state, mean).
    states: Vec<(u32, f64)>,
}

impl Recorded {
    /// The means over all samples of runs of this model.
    pub fn of(model: &fdm_grammar::Model, runs: &[Run]) -> Self {
        let mean = |values: &mut dyn Iterator<Item = f64>| {
            let (sum, count) = values.filter(|v| v.is_finite()).fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
            (count > 0.0).then(|| sum / count)
        };
        let declared = model.inputs.iter().filter(|i| i.is_declared()).count();
        let input = |k: usize| {
            mean(&mut runs.iter().flat_map(|r| r.inputs.iter().skip(k).step_by(r.held.len().max(1)).copied()))
        };
        let q = model.outputs.len();
        let output = |o: usize| mean(&mut runs.iter().flat_map(|r| r.measured.iter().skip(o).step_by(q).copied()));
        let shown = model.outputs.iter().enumerate().filter_map(|(o, shown)| match model.graph.node(shown.expr) {
            Node::Leaf(Leaf::State(k)) => Some((k, output(o)?)),
            _ => None,
        });
        Self { inputs: (0..declared).map_while(input).collect(), states: shown.collect() }
    }

    fn state(&self, state: u32) -> Option<f64> {
        self.states.iter().find(|(k, _)| *k == state).map(|(_, mean)| *mean)
    }
}

/// What a trim is looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Need {
    /// The coefficients: what none of them depends on is left alone.
    Coefficients,
    /// The states and inputs themselves.
    Rest,
}

/// A linearisation with the unknowns that the equations determine, and their values.
struct Found {
    linearisation: Linearisation,
    z: Vec<f64>,
    obtained: Obtained,
    assumed: Vec<Signal>,
}

/// Most states of a model of which some are held to find a trim, and most of those that are held in pairs.
const MOST_HELD: (usize, usize) = (32, 8);

/// Looks for the trim: from the start values; then with open states held at them, one and two at a time, those first that the equations that
/// will not vanish depend on most (a rate of turn at zero); then with the recorded inputs held at their means.
fn found(model: &fdm_grammar::Model, theta: &[f64], recorded: &Recorded, need: Need) -> Result<Found, TrimError> {
    if model.has_events() {
        return Err(TrimError::Events);
    }
    let nothing = Recorded::default();
    let lost = match sought(model, theta, &nothing, need) {
        Ok(found) => return Ok(found),
        Err(lost) => lost,
    };
    let open = open(model, theta, &lost.rows);
    let hold = |held: &[(Signal, f64)], recorded: &Recorded| -> Option<Found> {
        let mut model = model.clone();
        for (signal, value) in held {
            let value = model.graph.number(*value);
            model.trim.push((*signal, value));
        }
        // where all that matters is held, nothing says that the rates vanish
        let solved = |found: &Found| matches!(found.obtained, Obtained::Initial | Obtained::Solved);
        let found = sought(&model, theta, recorded, need).ok().filter(solved)?;
        Some(Found { assumed: held.iter().map(|(signal, _)| *signal).collect(), ..found })
    };
    if model.states.len() <= MOST_HELD.0 {
        let states: Vec<(Signal, f64)> = open.iter().filter(|(s, _)| matches!(s, Signal::State(_))).copied().collect();
        let given = |s: &Signal| model.trim.iter().any(|(g, _)| g == s);
        let inputs = (0..recorded.inputs.len()).map(|k| (Signal::Input(k as u32), recorded.inputs[k]));
        let inputs: Vec<(Signal, f64)> = inputs.filter(|(s, _)| !given(s)).collect();
        let one = || states.iter().map(|s| vec![*s]);
        let first = &states[..states.len().min(MOST_HELD.1)];
        let two = (0..first.len()).flat_map(|a| (a + 1..first.len()).map(move |b| vec![first[a], first[b]]));
        let tried = one().find_map(|held| hold(&held, &nothing));
        let tried = tried.or_else(|| Some(inputs).filter(|i| !i.is_empty()).and_then(|held| hold(&held, recorded)));
        let tried = tried.or_else(|| one().find_map(|held| hold(&held, recorded)).filter(|_| *recorded != nothing));
        let tried = tried.or_else(|| two.into_iter().find_map(|held| hold(&held, &nothing)));
        if let Some(found) = tried {
            return Ok(found);
        }
    }
    Err(TrimError::NotFound {
        equations: lost.rows.iter().map(|k| name(model, Signal::State(*k))).collect(),
        given: model.trim.iter().map(|(s, _)| name(model, *s)).collect(),
        open: open.iter().map(|(signal, value)| (name(model, *signal), *value)).collect(),
    })
}

/// States and declared inputs that nothing gives, with their start values: those first that these rates depend on most.
fn open(model: &fdm_grammar::Model, theta: &[f64], rows: &[u32]) -> Vec<(Signal, f64)> {
    let given = |s: &Signal| model.trim.iter().any(|(g, _)| g == s);
    let declared = (0..model.inputs.len() as u32).filter(|k| model.inputs[*k as usize].is_declared());
    let all = (0..model.states.len() as u32).map(Signal::State).chain(declared.map(Signal::Input));
    let all: Vec<Signal> = all.filter(|s| !given(s)).collect();
    let mut known = Equations::new(Linearisation::new(model, &[]).balance);
    known.evaluate(theta, &[]);
    let start: Vec<f64> = all.iter().map(|s| known.known()[place(*s, model.states.len())]).collect();
    let mut equations = Equations::new(Linearisation::new(model, &all).balance);
    equations.evaluate(theta, &start);
    let weights = equations.weights(rows);
    let mut order: Vec<usize> = (0..all.len()).collect();
    order.sort_by(|a, b| weights[*b].total_cmp(&weights[*a]));
    order.into_iter().map(|k| (all[k], start[k])).collect()
}

/// States whose rates do not vanish together.
struct Lost {
    rows: Vec<u32>,
}

/// Looks for the trim at what is given, else by solving for the states that are not given, else for the inputs too.
fn sought(model: &fdm_grammar::Model, theta: &[f64], recorded: &Recorded, need: Need) -> Result<Found, Lost> {
    let given = |s: &Signal| model.trim.iter().any(|(g, _)| g == s);
    let states = (0..model.states.len() as u32).map(Signal::State).filter(|s| !given(s)).collect::<Vec<_>>();
    let declared = (0..model.inputs.len() as u32).filter(|k| model.inputs[*k as usize].is_declared());
    let inputs = declared.map(Signal::Input).filter(|s| !given(s));
    let both: Vec<Signal> = states.iter().copied().chain(inputs).collect();
    let known = Linearisation::new(model, &[]);
    let all = Linearisation::new(model, &both);
    if both.is_empty() || all.by_unknown.is_empty() && need == Need::Coefficients {
        let obtained = if depends(model) { Obtained::Given } else { Obtained::NotNeeded };
        return Ok(Found { linearisation: known, z: Vec::new(), obtained, assumed: Vec::new() });
    }
    let mut equations = Equations::new(known.balance);
    equations.evaluate(theta, &[]);
    let n = model.states.len();
    let first = |s: &Signal| match s {
        Signal::State(k) => recorded.state(*k).unwrap_or_else(|| equations.known()[place(*s, n)]),
        Signal::Input(k) => {
            recorded.inputs.get(*k as usize).copied().unwrap_or_else(|| equations.known()[place(*s, n)])
        }
    };
    let starts = [states, both].map(|unknowns| (unknowns.iter().map(first).collect::<Vec<f64>>(), unknowns));
    let mut lost = Lost { rows: Vec::new() };
    for (z, unknowns) in starts {
        match solved(model, theta, unknowns, z) {
            Ok(found) => return Ok(found),
            Err(failure) => lost = failure,
        }
    }
    Err(lost)
}

/// Whether a coefficient depends on a state or an input.
fn depends(model: &fdm_grammar::Model) -> bool {
    let all =
        (0..model.states.len() as u32).map(Signal::State).chain((0..model.inputs.len() as u32).map(Signal::Input));
    !Linearisation::new(model, &all.collect::<Vec<_>>()).by_unknown.is_empty()
}

/// Solves for these unknowns, then again for those alone that the equations determine there.
fn solved(model: &fdm_grammar::Model, theta: &[f64], unknowns: Vec<Signal>, start: Vec<f64>) -> Result<Found, Lost> {
    let mut equations = Equations::new(Linearisation::new(model, &unknowns).balance);
    let mut z = start.clone();
    equations.evaluate(theta, &z);
    let at_rest = equations.unbalanced(theta, &z).is_empty();
    if !at_rest && unknowns.iter().all(|u| matches!(u, Signal::State(_))) {
        equations.settle(theta, &mut z);
        if equations.solve(theta, &mut z).is_err() {
            z = start;
        }
    }
    let lost = |unbalanced: Unbalanced, equations: &Equations| Lost {
        rows: unbalanced.0.iter().map(|i| equations.balance.rows[*i]).collect(),
    };
    equations.solve(theta, &mut z).map_err(|u| lost(u, &equations))?;
    let columns = equations.determined(&sizes(&z));
    let chosen: Vec<Signal> = columns.iter().map(|k| unknowns[*k]).collect();
    let linearisation = Linearisation::new(model, &chosen);
    let mut equations = Equations::new(linearisation.balance.clone());
    let mut z: Vec<f64> = columns.iter().map(|k| z[*k]).collect();
    equations.solve(theta, &mut z).map_err(|u| lost(u, &equations))?;
    let obtained = if at_rest { Obtained::Initial } else { Obtained::Solved };
    Ok(Found { linearisation, z, obtained, assumed: Vec::new() })
}

fn place(signal: Signal, states: usize) -> usize {
    match signal {
        Signal::State(k) => k as usize,
        Signal::Input(k) => states + k as usize,
    }
}

fn name(model: &fdm_grammar::Model, signal: Signal) -> String {
    match signal {
        Signal::State(k) => model.states[k as usize].quantity.name.clone(),
        Signal::Input(k) => model.inputs[k as usize].quantity.name.clone(),
    }
}

/// The names of equations (states, outputs) and of signals (states, inputs, delayed ones).
fn names(model: &fdm_grammar::Model) -> (Vec<String>, Vec<String>) {
    let states = || model.states.iter().map(|s| s.quantity.name.clone());
    let outputs = model.outputs.iter().map(|o| o.quantity.name.clone());
    let inputs = model.inputs.iter().map(|i| i.quantity.name.clone());
    let delayed = (0..model.graph.delayed().len() as u32).map(|k| model.leaf(Leaf::Delayed(k)));
    (states().chain(outputs).collect(), states().chain(inputs).chain(delayed).collect())
}

/// A coefficient that can be other than zero: of a signal in an equation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Term {
    /// The equation: rates of the states (0..n), then outputs (n..n + q).
    pub row: u32,
    /// The signal: states (0..n), inputs (n..n + m), then delayed signals.
    pub signal: u32,
}

/// The derivative of a coefficient by a parameter that can be other than zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Slope {
    /// Position in [`Structure::terms`].
    pub term: u32,
    /// Parameter, in the model's order.
    pub param: u32,
}

/// The derivative of a delay by a parameter that can be other than zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct TauSlope {
    /// Position in [`Structure::delayed`].
    pub delayed: u32,
    /// Parameter, in the model's order.
    pub param: u32,
}

/// The sparsity of a linear model and of its derivatives. Constants are left out: they are at zero frequency.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Structure {
    /// Number of states n.
    pub states: usize,
    /// Number of inputs m, hidden ones included.
    pub inputs: usize,
    /// Number of outputs q.
    pub outputs: usize,
    /// Number of parameters p, fixed ones included (these have no slopes).
    pub params: usize,
    /// What the delayed signals are delayed versions of.
    pub delayed: Vec<Signal>,
    /// Coefficients, rising.
    pub terms: Vec<Term>,
    /// Their derivatives, rising.
    pub slopes: Vec<Slope>,
    /// The derivatives of the delays, rising.
    pub tau_slopes: Vec<TauSlope>,
}

/// The numbers of a linear model at one vector of parameters, in the order of its [`Structure`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Values {
    /// Coefficients.
    pub terms: Vec<f64>,
    /// Their derivatives.
    pub slopes: Vec<f64>,
    /// Delays, one for each delayed signal.
    pub tau: Vec<f64>,
    /// Their derivatives.
    pub tau_slopes: Vec<f64>,
}
