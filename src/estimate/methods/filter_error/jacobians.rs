//! A filter's programs: rates, outputs and their Jacobians as the outputs of two models, so that what the Riccati equation
//! needs, the derivatives of Jacobians, are partials of outputs and exact like all others; and total derivatives of such
//! outputs by the unknowns, through parameters, states and delays.

use fdm_grammar::derive::{Pattern, differentiate};
use fdm_grammar::model::{Output, Quantity};
use fdm_grammar::op::{Build, ExprId};
use fdm_system::dynamics::{Dynamics, Layout, Point, Workspace};
use fdm_system::model::Model;

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
            let output = |expr: ExprId| Output::new(nameless(), expr);
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

/// An entry of the result, the row that it belongs to, and the row (of states, of delayed signals) or lane that it multiplies.
#[derive(Debug, Clone, Copy)]
struct Entry {
    slot: usize,
    row: usize,
    of: usize,
}

/// A program of outputs, and memory for their total derivatives.
pub(super) struct Totals<'a> {
    dynamics: &'a dyn Dynamics,
    known: Vec<f64>,
    work: Workspace,
    lanes: usize,
    by_param: Vec<Entry>,
    by_state: Vec<Entry>,
    by_delayed: Vec<Entry>,
    /// Place of tau_theta in `known`, delayed signal, lane.
    tau: Vec<(usize, usize, usize)>,
    /// Place of x0_theta in `known`, state, lane.
    initial: Vec<(usize, usize, usize)>,
    /// Sensitivities of the delayed signals (delayed signals by lanes).
    delayed: Vec<f64>,
    out: Vec<f64>,
    /// Total derivatives, outputs by lanes.
    pub(super) rows: Vec<f64>,
}

impl<'a> Totals<'a> {
    /// `columns` are the parameters (indices) of the first lanes; lanes behind them are parameters of nobody.
    pub(super) fn new(dynamics: &'a dyn Dynamics, columns: &[usize], lanes: usize) -> Self {
        let layout = dynamics.layout();
        let p = &layout.patterns;
        let lane = |param: usize| columns.iter().position(|c| *c == param);
        let by_delayed = layout.outputs + p.outputs_by_state.len();
        let by_param = by_delayed + p.outputs_by_delayed.len();
        let entry = |slot: usize, row: usize, of: usize| Entry { slot, row, of };
        let own = |pattern: &Pattern, first: usize| -> Vec<(usize, usize, usize)> {
            let lanes = pattern.entries().filter_map(|(k, i, j)| Some((first + k, i, lane(j)?)));
            lanes.collect()
        };
        Self {
            by_param: own(&p.outputs_by_param, by_param).into_iter().map(|(k, i, j)| entry(k, i, j)).collect(),
            by_state: p.outputs_by_state.entries().map(|(k, i, j)| entry(layout.outputs + k, i, j)).collect(),
            by_delayed: p.outputs_by_delayed.entries().map(|(k, i, j)| entry(by_delayed + k, i, j)).collect(),
            tau: own(&p.tau_by_param, layout.tau_by_param.start),
            initial: own(&p.initial_by_param, layout.initial_by_param.start),
            delayed: vec![0.0; layout.delayed.len() * lanes],
            out: vec![0.0; layout.output_slots()],
            rows: vec![0.0; layout.outputs * lanes],
            known: vec![0.0; layout.known],
            work: Workspace::new(dynamics),
            dynamics,
            lanes,
        }
    }

    pub(super) fn layout(&self) -> &'a Layout {
        self.dynamics.layout()
    }

    /// Parameters to everything that depends on them alone.
    pub(super) fn prepare(&mut self, theta: &[f64]) {
        self.dynamics.prepare(theta, &mut self.known, &mut self.work);
    }

    /// Delays of the delayed signals.
    pub(super) fn delays(&self) -> &[f64] {
        &self.known[self.layout().tau.clone()]
    }

    /// Values of the states at the beginning (n), and their derivatives (n by lanes) where there is room for them.
    pub(super) fn begin(&self, x: &mut [f64], s: &mut [f64]) {
        x.copy_from_slice(&self.known[self.layout().initial.clone()]);
        s.fill(0.0);
        if s.is_empty() {
            return;
        }
        for (at, state, lane) in &self.initial {
            s[state * self.lanes + lane] = self.known[*at];
        }
    }

    /// The outputs at a point.
    pub(super) fn values(&mut self, t: f64, x: &[f64], drive: &[f64]) -> &[f64] {
        let q = self.layout().outputs;
        let at = Point { t, x, drive, known: &self.known };
        self.dynamics.outputs(at, &mut self.out[..q], &mut self.work);
        &self.out[..q]
    }

    /// The outputs at a point whose states have the derivatives `s` (n by lanes); theirs go to `rows`.
    pub(super) fn linearise(
        &mut self,
        t: f64,
        (x, s): (&[f64], &[f64]),
        (drive, slopes): (&[f64], &[f64]),
    ) -> (&[f64], &[f64]) {
        let (q, l) = (self.layout().outputs, self.lanes);
        self.dynamics.outputs_and_partials(Point { t, x, drive, known: &self.known }, &mut self.out, &mut self.work);
        self.delayed.fill(0.0);
        for (at, d, lane) in &self.tau {
            self.delayed[d * l + lane] -= slopes[*d] * self.known[*at];
        }
        self.rows.fill(0.0);
        for e in &self.by_param {
            self.rows[e.row * l + e.of] = self.out[e.slot];
        }
        for (entries, from) in [(&self.by_state, s), (&self.by_delayed, &self.delayed[..])] {
            for e in entries {
                add(self.out[e.slot], &from[e.of * l..][..l], &mut self.rows[e.row * l..][..l]);
            }
        }
        (&self.out[..q], &self.rows)
    }
}

/// `to += a from`
#[inline]
pub(super) fn add(a: f64, from: &[f64], to: &mut [f64]) {
    to.iter_mut().zip(from).for_each(|(t, f)| *t += a * f);
}
