//! Sensitivities of one run by the classical Runge-Kutta method: `S' = f_x S + f_theta`, all parameters in lanes.
//!
//! The four stages' partials are known before (they do not depend on S), so a step is linear in S (`tangent.rs`).
//!
//! The state chain is bound by latency, the sensitivities by throughput; running the states one step ahead lets the
//! processor overlap both, and gives the forcing terms, written one by one, time to reach the cache before they are read
//! as vectors.

use super::blocks::{Gathering, RowLayout, Sink};
use super::error::Divergence;
use super::event_steps;
use super::observation::{Observation, Scatter, scatter};
use super::tangent::TangentPlan;
use super::trajectory::{Trajectory, finite, two_nodes};
use crate::dynamics::{Dynamics, Layout, Step};
use fdm_numeric::lanes::{Aligned, Simd, VECTOR, WithSimd, copy_vectors, dispatch};

/// Adds `entry * -slope * tau_theta` to a lane: a delay's part in the forcing.
#[derive(Debug, Clone, Copy)]
pub(super) struct DelayTerm {
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

/// Plans and memory for one choice of columns.
pub(super) struct Sensitivity {
    columns: Vec<usize>,
    pub(super) lanes: usize,
    width: usize,
    pub(super) plan: TangentPlan,
    initial: Vec<Scatter>,
    pub(super) rates_by_delay: Vec<DelayTerm>,
    observation: Observation,
    gathering: Gathering,
    /// Rows of one sample without the free lane, when that is not merely padding.
    bare: Vec<f64>,
    pub(super) s: Aligned,
    pub(super) scratch: Aligned,
    partials: [Aligned; 2],
}

impl Sensitivity {
    /// # Panics
    /// As [`Observation::new`].
    pub(super) fn new(dynamics: &dyn Dynamics, columns: &[usize]) -> Self {
        let layout = dynamics.layout();
        let (n, stage, plan) = (layout.states, &layout.stage, TangentPlan::new(layout, columns));
        let observation = Observation::new(layout, columns);
        let rows = RowLayout::full(layout.outputs, columns.len());
        let bare = if rows.length == layout.outputs * observation.stride { 0 } else { observation.stride };
        Self {
            columns: columns.to_vec(),
            lanes: stage.lanes,
            width: stage.width,
            initial: scatter(layout, &layout.patterns.initial_by_param, layout.initial_by_param.start),
            rates_by_delay: delay_terms(layout),
            observation,
            gathering: Gathering::new(rows),
            bare: vec![0.0; layout.outputs * bare],
            s: Aligned::new(n * stage.lanes),
            scratch: Aligned::new(plan.scratch()),
            plan,
            partials: [Aligned::new(4 * stage.width), Aligned::new(4 * stage.width)],
        }
    }

    pub(super) fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// Back to the initial values.
    pub(super) fn begin(&mut self, known: &[f64]) {
        self.gathering.begin();
        self.s.fill(0.0);
        for c in &self.initial {
            self.s[c.to as usize] = known[c.from as usize];
        }
    }

    /// Hands over the samples that are still gathered.
    pub(super) fn flush(&mut self, sink: &mut Sink<'_>) {
        self.gathering.flush(sink);
    }

    /// A whole run for which the trajectory is prepared.
    pub(super) fn run(&mut self, trajectory: &mut Trajectory<'_>, sink: &mut Sink<'_>) -> Result<(), Divergence> {
        self.begin(&trajectory.known);
        if trajectory.events.is_some() || trajectory.cuts.is_some() {
            return event_steps::run(self, trajectory, sink);
        }
        dispatch(March { sensitivity: self, trajectory, sink })
    }

    /// Outputs and their sensitivities at the sample of node k.
    #[inline(always)]
    pub(super) fn observe(
        &mut self,
        trajectory: &mut Trajectory<'_>,
        sample: usize,
        k: usize,
        sink: &mut Sink<'_>,
    ) -> Result<(), Divergence> {
        let (y, rows) = self.gathering.next();
        if self.bare.is_empty() {
            self.observation.observe(trajectory, (sample, k), &self.s, y, rows)?;
        } else {
            self.observation.observe(trajectory, (sample, k), &self.s, y, &mut self.bare)?;
            let stride = self.observation.stride;
            for (row, bare) in rows.chunks_exact_mut(stride + VECTOR).zip(self.bare.chunks_exact(stride.max(1))) {
                copy_vectors(bare, row);
            }
        }
        self.gathering.filled(1, sink);
        Ok(())
    }

    /// One step of the states; their partials go to the buffer of step k.
    #[inline(always)]
    fn advance(&mut self, trajectory: &mut Trajectory<'_>, k: usize) -> Result<(), Divergence> {
        let Trajectory { dynamics, grid, drive, known, nodes, work, stops, .. } = trajectory;
        let (t, h) = grid.step(k);
        let (x, next) = two_nodes(nodes, k);
        let partials = &mut self.partials[k % 2];
        dynamics.step_with_partials(Step { t, h, x, drive: drive.stages(k), known }, next, partials, work);
        stops.hold(k, *dynamics, known, next);
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
}

/// What estimated delays add to f_theta.
pub(super) fn delay_terms(layout: &Layout) -> Vec<DelayTerm> {
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

pub(super) fn add_delays(terms: &[DelayTerm], row: &mut [f64], slopes: &[f64], known: &[f64]) {
    for d in terms {
        let part = row[d.entry as usize] * slopes[d.delayed as usize] * known[d.tau as usize];
        let lane = &mut row[d.to as usize];
        *lane = if d.written { *lane } else { 0.0 } - part;
    }
}

/// The loop over the steps, compiled for the machine's widest registers.
struct March<'m, 'a> {
    sensitivity: &'m mut Sensitivity,
    trajectory: &'m mut Trajectory<'a>,
    sink: &'m mut Sink<'m>,
}

impl WithSimd for March<'_, '_> {
    type Output = Result<(), Divergence>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { sensitivity, trajectory, sink } = self;
        let steps = trajectory.grid.steps();
        if steps > 0 {
            sensitivity.advance(trajectory, 0)?;
        }
        for k in 0..=steps {
            if let Some(sample) = trajectory.grid.sample_at(k) {
                sensitivity.observe(trajectory, sample, k, sink)?;
            }
            if k + 1 < steps {
                sensitivity.advance(trajectory, k + 1)?;
            }
            if k < steps {
                let Sensitivity { plan, partials, s, scratch, .. } = &mut *sensitivity;
                plan.step(simd, trajectory.grid.step(k).1, &partials[k % 2], s, scratch);
                trajectory.stops.follow(k, &trajectory.known, s);
            }
        }
        trajectory.stateless(|trajectory, sample| sensitivity.observe(trajectory, sample, 0, sink))?;
        sensitivity.flush(sink);
        Ok(())
    }
}
