//! Sensitivities of one run without delayed states: the states' Runge-Kutta steps one ahead of the sensitivities' steps.
//!
//! The state chain is bound by latency, the sensitivities by throughput; running the states one step ahead lets the
//! processor overlap both, and gives the forcing terms, written one by one, time to reach the cache before they are read
//! as vectors.

use super::implicit::{ImplicitTangent, Interval};
use super::observation::{Observation, Scatter, scatter};
use super::simulator::{Divergence, Simulator, diverged, finite, two_nodes};
use super::tangent::TangentPlan;
use super::vectors::Aligned;
use crate::dynamics::{Dynamics, Layout, Step};
use pulp::{Simd, WithSimd};

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
    lanes: usize,
    width: usize,
    plan: TangentPlan,
    initial: Vec<Scatter>,
    rates_by_delay: Vec<DelayTerm>,
    observation: Observation,
    s: Aligned,
    scratch: Aligned,
    partials: [Aligned; 2],
    /// Made when the implicit method first needs it.
    implicit: Option<ImplicitTangent>,
}

impl Sensitivity {
    /// # Panics
    /// As [`Observation::new`].
    pub(super) fn new(dynamics: &dyn Dynamics, columns: &[usize]) -> Self {
        let layout = dynamics.layout();
        let (n, stage, plan) = (layout.states, &layout.stage, TangentPlan::new(layout));
        Self {
            columns: columns.to_vec(),
            lanes: stage.lanes,
            width: stage.width,
            initial: scatter(layout, &layout.patterns.initial_by_param, layout.initial_by_param.start),
            rates_by_delay: delay_terms(layout),
            observation: Observation::new(layout, columns),
            s: Aligned::new(n * stage.lanes),
            scratch: Aligned::new(plan.scratch()),
            plan,
            partials: [Aligned::new(4 * stage.width), Aligned::new(4 * stage.width)],
            implicit: None,
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
        if simulator.implicit.is_some() {
            self.implicit.get_or_insert_with(|| ImplicitTangent::new(simulator.dynamics.layout()));
            return pulp::Arch::new().dispatch(|| self.march_implicitly(simulator, y, jacobian));
        }
        pulp::Arch::new().dispatch(March { sensitivity: self, simulator, y, jacobian })
    }

    /// The loop over the steps of the implicit method: states, then their sensitivities.
    #[inline(always)]
    fn march_implicitly(
        &mut self,
        simulator: &mut Simulator<'_>,
        y: &mut [f64],
        jacobian: &mut [f64],
    ) -> Result<(), Divergence> {
        let steps = simulator.grid.steps();
        for k in 0..=steps {
            if let Some(sample) = simulator.grid.sample_at(k) {
                self.observe(simulator, sample, k, y, jacobian)?;
            }
            if k < steps {
                simulator.advance_implicitly(k)?;
                self.follow(simulator, k)?;
            }
        }
        Ok(())
    }

    /// Sensitivities over the implicit step k, which the states have taken.
    #[inline(always)]
    fn follow(&mut self, simulator: &mut Simulator<'_>, k: usize) -> Result<(), Divergence> {
        let Simulator { dynamics, grid, drive, known, nodes, work, implicit, .. } = simulator;
        let (Some(collocation), Some(tangent)) = (implicit, &mut self.implicit) else { return Ok(()) };
        let ((t, h), (x, _)) = (grid.step(k), two_nodes(nodes, k));
        let step = Interval { t, h, x, drive: drive.stages(k), known };
        let (terms, width, slopes) = (&self.rates_by_delay, self.width, drive.stage_slopes(k));
        let delays = slopes.len() / 3;
        let complete = |partials: &mut [f64]| {
            if !terms.is_empty() {
                for (at, row) in partials.chunks_exact_mut(width).enumerate() {
                    add_delays(terms, row, &slopes[at * delays..][..delays], known);
                }
            }
        };
        if tangent.step(collocation, (*dynamics, step), complete, &mut self.s, work) {
            return Ok(());
        }
        Err(diverged(grid, k, None))
    }

    /// Outputs and their sensitivities at the sample of node k, to their places among all samples.
    #[inline(always)]
    fn observe(
        &mut self,
        simulator: &mut Simulator<'_>,
        sample: usize,
        k: usize,
        y: &mut [f64],
        jacobian: &mut [f64],
    ) -> Result<(), Divergence> {
        let (q, row) = (simulator.outputs(), self.observation.stride);
        let (y, rows) = (&mut y[sample * q..][..q], &mut jacobian[sample * q * row..][..q * row]);
        self.observation.observe(simulator, (sample, k), &self.s, y, rows)
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
