//! Sensitivities of one run: the states' Runge-Kutta steps one ahead of the sensitivities' steps.
//!
//! The state chain is bound by latency, the sensitivities by throughput; running the states one step ahead lets the
//! processor overlap both, and gives the forcing terms, written one by one, time to reach the cache before they are read
//! as vectors.

use super::drive::DriveTable;
use super::history::History;
use super::simulator::{Divergence, Simulator, finite, node, two_nodes};
use super::tangent::TangentPlan;
use super::vectors::{Aligned, VECTOR, accumulate, copy_vectors, gather};
use crate::dynamics::{Dynamics, Layout, Point, Step};
use fdm_grammar::graph::Signal;
use pulp::{Simd, WithSimd};

/// Copies one number of a result to a lane.
#[derive(Debug, Clone, Copy)]
struct Scatter {
    from: u32,
    to: u32,
}

/// Adds `entry * -slope * tau_theta` to a lane: a delay's part in the forcing.
#[derive(Debug, Clone, Copy)]
struct DelayTerm {
    /// Slot of the entry of f_delay.
    entry: u32,
    /// Which delayed signal.
    delayed: u32,
    /// Position of tau_theta in `known`.
    tau: u32,
    /// Slot of the lane.
    to: u32,
    /// Whether the model writes this lane too; otherwise it must be cleared before.
    written: bool,
}

/// Adds `entry * row` of sensitivities to a row of outputs.
#[derive(Debug, Clone, Copy)]
struct OutputTerm {
    /// Position of the entry of h_x or h_delay in the result.
    entry: u32,
    /// First lane of the row that is read.
    from: u32,
    /// First lane of the row that is added to.
    to: u32,
}

/// Plans and memory for one choice of columns.
pub(super) struct Sensitivity {
    columns: Vec<usize>,
    /// Lane of each column; empty when column k is lane k and no lane is left out.
    lane_of: Vec<u32>,
    lanes: usize,
    stride: usize,
    width: usize,
    outputs: usize,
    plan: TangentPlan,
    initial: Vec<Scatter>,
    rates_by_delay: Vec<DelayTerm>,
    outputs_by_param: Vec<Scatter>,
    outputs_by_state: Vec<OutputTerm>,
    outputs_by_delayed: Vec<OutputTerm>,
    /// (position of tau_theta in known, delayed signal, lane)
    tau: Vec<(usize, usize, usize)>,
    /// For each output the state that it is, when every output is a state.
    observed: Option<Vec<u32>>,
    s: Aligned,
    scratch: Aligned,
    partials: [Aligned; 2],
    /// Result of `outputs_and_partials`, sensitivities of delayed signals, and rows of outputs in lanes.
    output: Vec<f64>,
    delayed: Vec<f64>,
    rows: Vec<f64>,
    /// Result of `rates_and_partials` at the ends of a step, for the history.
    ends: Vec<f64>,
}

impl Sensitivity {
    /// # Panics
    /// When a column is a parameter that is fixed in the model: its sensitivity would be a silent zero.
    pub(super) fn new(dynamics: &dyn Dynamics, columns: &[usize]) -> Self {
        let layout = dynamics.layout();
        let (n, p, stage) = (layout.states, &layout.patterns, &layout.stage);
        let lane = |param: usize| stage.lane[param].map(|l| l as usize);
        let lane_of: Vec<u32> = columns
            .iter()
            .map(|c| {
                stage.lane[*c].unwrap_or_else(|| panic!("parameter {c} is fixed in the model: it has no derivatives"))
            })
            .collect();
        let all = lane_of.iter().enumerate().all(|(k, l)| k == *l as usize);
        let all = all && columns.len() == stage.lane.iter().flatten().count();
        let scatter = |pattern: &fdm_grammar::Pattern, first: usize| -> Vec<Scatter> {
            let to = |row: usize, column: usize| lane(column).map(|l| (row * stage.lanes + l) as u32);
            let entries = pattern.entries();
            entries.filter_map(|(k, i, j)| to(i, j).map(|to| Scatter { from: (first + k) as u32, to })).collect()
        };
        let terms = |pattern: &fdm_grammar::Pattern, first: usize| -> Vec<OutputTerm> {
            let row = |i: usize| (i * stage.lanes) as u32;
            pattern
                .entries()
                .map(|(k, i, j)| OutputTerm { entry: (first + k) as u32, from: row(j), to: row(i) })
                .collect()
        };
        let at = |(k, d, j)| Some((layout.tau_by_param.start + k, d, lane(j)?));
        let plan = TangentPlan::new(layout);
        let by_param = layout.outputs + p.outputs_by_state.len() + p.outputs_by_delayed.len();
        Self {
            columns: columns.to_vec(),
            lane_of: if all { Vec::new() } else { lane_of },
            lanes: stage.lanes,
            stride: columns.len().next_multiple_of(VECTOR),
            width: stage.width,
            outputs: layout.outputs,
            initial: scatter(&p.initial_by_param, layout.initial_by_param.start),
            rates_by_delay: delay_terms(layout),
            outputs_by_param: scatter(&p.outputs_by_param, by_param),
            outputs_by_state: terms(&p.outputs_by_state, layout.outputs),
            outputs_by_delayed: terms(&p.outputs_by_delayed, layout.outputs + p.outputs_by_state.len()),
            tau: p.tau_by_param.entries().filter_map(at).collect(),
            observed: layout.observed.iter().copied().collect(),
            s: Aligned::new(n * stage.lanes),
            scratch: Aligned::new(plan.scratch()),
            plan,
            partials: [Aligned::new(4 * stage.width), Aligned::new(4 * stage.width)],
            output: vec![0.0; layout.output_slots()],
            delayed: vec![0.0; layout.delayed.len() * stage.lanes],
            rows: vec![0.0; if all { 0 } else { layout.outputs * stage.lanes }],
            ends: vec![0.0; stage.width],
        }
    }

    pub(super) fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// Lanes of a sensitivity row.
    pub(super) fn lanes(&self) -> usize {
        self.lanes
    }

    pub(super) fn run(
        &mut self,
        simulator: &mut Simulator<'_>,
        y: &mut [f64],
        jacobian: &mut [f64],
    ) -> Result<(), Divergence> {
        self.s.fill(0.0);
        for c in &self.initial {
            self.s[c.to as usize] = simulator.known[c.from as usize];
        }
        pulp::Arch::new().dispatch(March { sensitivity: self, simulator, y, jacobian })
    }

    /// One step of the states; their partials go to the buffer of step k.
    #[inline(always)]
    fn advance(&mut self, simulator: &mut Simulator<'_>, k: usize) -> Result<(), Divergence> {
        let Simulator { dynamics, grid, drive, known, nodes, work, .. } = simulator;
        let (t, h) = grid.step(k);
        let (x, next) = two_nodes(nodes, k);
        let partials = &mut self.partials[k % 2];
        dynamics.step_with_partials(Step { t, h, x, drive: drive.stages(k), known }, next, partials, work);
        finite(grid, k, next)?;
        if !self.rates_by_delay.is_empty() {
            let slopes = drive.stage_slopes(k);
            let delays = slopes.len() / 3;
            for (row, at) in partials.chunks_exact_mut(self.width).zip([0, 1, 1, 2]) {
                add_delays(&self.rates_by_delay, row, &slopes[at * delays..][..delays], known);
            }
        }
        Ok(())
    }

    /// Outputs and their sensitivities at the sample of node k.
    #[inline(always)]
    fn observe(
        &mut self,
        simulator: &mut Simulator<'_>,
        sample: usize,
        k: usize,
        y: &mut [f64],
        jacobian: &mut [f64],
    ) -> Result<(), Divergence> {
        let q = self.outputs;
        let y = &mut y[sample * q..][..q];
        let rows = &mut jacobian[sample * q * self.stride..][..q * self.stride];
        if let Some(observed) = &self.observed {
            let x = &simulator.nodes[node(k)];
            for ((state, y), row) in observed.iter().zip(y).zip(rows.chunks_exact_mut(self.stride.max(1))) {
                *y = x[*state as usize];
                let lanes = &self.s[*state as usize * self.lanes..][..self.lanes];
                if self.lane_of.is_empty() { copy_vectors(lanes, row) } else { gather(&self.lane_of, lanes, row) }
            }
            return Ok(());
        }
        if self.lane_of.is_empty() {
            return self.outputs(simulator, sample, k, y, rows);
        }
        let mut in_lanes = std::mem::take(&mut self.rows);
        let result = self.outputs(simulator, sample, k, y, &mut in_lanes);
        for (row, lanes) in rows.chunks_exact_mut(self.stride.max(1)).zip(in_lanes.chunks_exact(self.lanes.max(1))) {
            gather(&self.lane_of, lanes, row);
        }
        self.rows = in_lanes;
        result
    }

    /// The general case: `h_theta + h_x S + h_delay S_delay`, q rows of lanes.
    #[inline(always)]
    fn outputs(
        &mut self,
        simulator: &mut Simulator<'_>,
        sample: usize,
        k: usize,
        y: &mut [f64],
        rows: &mut [f64],
    ) -> Result<(), Divergence> {
        let dynamics = simulator.dynamics;
        let layout = dynamics.layout();
        let (q, lanes, t) = (layout.outputs, self.lanes, simulator.run.time[sample]);
        if !layout.delayed.is_empty() {
            self.delay_signals(layout, simulator.history.as_ref(), sample, t, &simulator.known, &mut simulator.drive);
        }
        let x = &simulator.nodes[node(k)];
        let at = Point { t, x, drive: simulator.drive.sample(sample), known: &simulator.known };
        dynamics.outputs_and_partials(at, &mut self.output, &mut simulator.work);
        y.copy_from_slice(&self.output[..q]);
        rows.fill(0.0);
        for c in &self.outputs_by_param {
            rows[c.to as usize] = self.output[c.from as usize];
        }
        for (terms, from) in [(&self.outputs_by_state, &self.s[..]), (&self.outputs_by_delayed, &self.delayed[..])] {
            for term in terms {
                let (from, to) = (&from[term.from as usize..][..lanes], &mut rows[term.to as usize..][..lanes]);
                accumulate(self.output[term.entry as usize], from, to);
            }
        }
        if y.iter().all(|y| y.is_finite()) { Ok(()) } else { Err(Divergence { time: t, state: None, sample }) }
    }

    /// Delayed signals at a sample with their sensitivities: the signal's own, and -slope times tau_theta.
    #[inline(always)]
    fn delay_signals(
        &mut self,
        layout: &Layout,
        history: Option<&History>,
        sample: usize,
        t: f64,
        known: &[f64],
        drive: &mut DriveTable,
    ) {
        self.delayed.fill(0.0);
        for (d, signal) in layout.delayed.iter().enumerate() {
            let lanes = &mut self.delayed[d * self.lanes..][..self.lanes];
            let slope = match (*signal, history) {
                (Signal::State(state), Some(history)) => {
                    let (value, slope) = history.at(t - known[layout.tau.start + d], state as usize, lanes);
                    drive.sample(sample)[layout.inputs + d] = value;
                    slope
                }
                _ => drive.sample_slopes(sample)[d],
            };
            for (at, _, lane) in self.tau.iter().filter(|(_, delayed, _)| *delayed == d) {
                lanes[*lane] -= slope * known[*at];
            }
        }
    }

    /// Adds node k to the history with rates and their sensitivities on both sides.
    #[inline(always)]
    fn remember(&mut self, simulator: &mut Simulator<'_>, k: usize) {
        let Some(mut history) = simulator.history.take() else { return };
        let dynamics = simulator.dynamics;
        let layout = dynamics.layout();
        let (n, lanes, stage, delays) = (layout.states, self.lanes, &layout.stage, layout.delayed.len());
        let x = &simulator.nodes[node(k)];
        let t = simulator.time_of(k);
        history.push(t, x, &self.s);
        for (end, step, row) in simulator.sides(k) {
            let drive = &simulator.drive.stages(step)[row * layout.drive()..][..layout.drive()];
            let at = Point { t, x, drive, known: &simulator.known };
            dynamics.rates_and_partials(at, &mut self.ends, &mut simulator.work);
            let slopes = &simulator.drive.stage_slopes(step)[row * delays..][..delays];
            add_delays(&self.rates_by_delay, &mut self.ends, slopes, &simulator.known);
            let (rates, rows) = history.rates(end, end);
            rates.copy_from_slice(&self.ends[..n]);
            rows.copy_from_slice(&self.ends[stage.forcing..][..n * lanes]);
            for ((_, i, j), slot) in layout.patterns.rates_by_state.entries().zip(&stage.by_state) {
                accumulate(self.ends[*slot as usize], &self.s[j * lanes..][..lanes], &mut rows[i * lanes..][..lanes]);
            }
        }
        simulator.history = Some(history);
    }
}

/// What delays of inputs add to f_theta.
fn delay_terms(layout: &Layout) -> Vec<DelayTerm> {
    let (p, stage) = (&layout.patterns, &layout.stage);
    let mut terms: Vec<DelayTerm> = Vec::new();
    for (k, i, d) in p.rates_by_delayed.entries() {
        for (entry, j) in p.tau_by_param.row(d) {
            let Some(to) = stage.by_param(i, j) else { continue };
            let by_model = p.rates_by_param.row(i).any(|(_, column)| column == j);
            terms.push(DelayTerm {
                entry: (stage.by_delayed + k) as u32,
                delayed: d as u32,
                tau: (layout.tau_by_param.start + entry) as u32,
                to: to as u32,
                written: by_model || terms.iter().any(|t| t.to == to as u32),
            });
        }
    }
    terms
}

fn add_delays(terms: &[DelayTerm], row: &mut [f64], slopes: &[f64], known: &[f64]) {
    for d in terms {
        let part = row[d.entry as usize] * slopes[d.delayed as usize] * known[d.tau as usize];
        let lane = &mut row[d.to as usize];
        *lane = if d.written { *lane } else { 0.0 } - part;
    }
}

/// The loop over the steps, compiled for the machine's widest registers.
struct March<'m, 'a> {
    sensitivity: &'m mut Sensitivity,
    simulator: &'m mut Simulator<'a>,
    y: &'m mut [f64],
    jacobian: &'m mut [f64],
}

impl WithSimd for March<'_, '_> {
    type Output = Result<(), Divergence>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { sensitivity, simulator, y, jacobian } = self;
        let steps = simulator.grid.steps();
        if steps > 0 {
            sensitivity.advance(simulator, 0)?;
        }
        for k in 0..=steps {
            if simulator.history.is_some() {
                sensitivity.remember(simulator, k);
            }
            if let Some(sample) = simulator.grid.sample_at(k) {
                sensitivity.observe(simulator, sample, k, y, jacobian)?;
            }
            if k + 1 < steps {
                sensitivity.advance(simulator, k + 1)?;
            }
            if k < steps {
                let Sensitivity { plan, partials, s, scratch, .. } = &mut *sensitivity;
                plan.step(simd, simulator.grid.step(k).1, &partials[k % 2], s, scratch);
            }
        }
        simulator.stateless(|simulator, sample| sensitivity.observe(simulator, sample, 0, y, jacobian))
    }
}
