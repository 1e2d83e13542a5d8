//! Sensitivities of a run of implicit steps: the derivative of the solved stage equations,
//! `(A^-1 - h J) Z_theta = h (J S + f_theta)`, all parameters in one pass.
//!
//! J holds every stage's own Jacobian at its own states, so that nothing is neglected: the result is the derivative of the
//! discrete solution (internal differentiation, Bock 1981).

use super::collocation::Collocation;
use crate::dynamics::{Dynamics, Layout, Workspace};
use crate::simulate::blocks::Sink;
use crate::simulate::error::Divergence;
use crate::simulate::runge_kutta::{Sensitivity, add_delays};
use crate::simulate::steps::STAGES;
use crate::simulate::trajectory::{Interval, Trajectory, diverged};
use fdm_numeric::lanes::{Aligned, accumulate, widest};

/// Plans and memory for one choice of columns.
pub(in crate::simulate) struct StiffSensitivity {
    /// S, and how outputs are observed: as in explicit steps.
    base: Sensitivity,
    width: usize,
    tangent: StiffTangent,
}

impl StiffSensitivity {
    /// # Panics
    /// As [`Sensitivity::new`].
    pub(in crate::simulate) fn new(dynamics: &dyn Dynamics, columns: &[usize]) -> Self {
        let layout = dynamics.layout();
        Self {
            base: Sensitivity::new(dynamics, columns),
            width: layout.stage.width,
            tangent: StiffTangent::new(layout),
        }
    }

    pub(in crate::simulate) fn columns(&self) -> &[usize] {
        self.base.columns()
    }

    /// Outputs and their sensitivities of a whole run that has begun.
    pub(in crate::simulate) fn run(
        &mut self,
        collocation: &mut Collocation,
        trajectory: &mut Trajectory<'_>,
        sink: &mut Sink<'_>,
    ) -> Result<(), Divergence> {
        self.base.begin(&trajectory.known);
        widest(
            #[inline(always)]
            || self.march(collocation, trajectory, sink),
        )?;
        self.base.flush(sink);
        Ok(())
    }

    /// The loop over the steps: states, then their sensitivities.
    #[inline(always)]
    fn march(
        &mut self,
        collocation: &mut Collocation,
        trajectory: &mut Trajectory<'_>,
        sink: &mut Sink<'_>,
    ) -> Result<(), Divergence> {
        let steps = trajectory.grid.steps();
        for k in 0..=steps {
            if let Some(sample) = trajectory.grid.sample_at(k) {
                self.base.observe(trajectory, sample, k, sink)?;
            }
            if k < steps {
                collocation.advance(trajectory, k)?;
                self.follow(collocation, trajectory, k)?;
            }
        }
        Ok(())
    }

    /// Sensitivities over step k, which the states have taken.
    #[inline(always)]
    fn follow(
        &mut self,
        collocation: &mut Collocation,
        trajectory: &mut Trajectory<'_>,
        k: usize,
    ) -> Result<(), Divergence> {
        let dynamics = trajectory.dynamics;
        let (step, _, work) = trajectory.interval(k);
        let (known, slopes, terms, width) = (step.known, step.slopes, &self.base.rates_by_delay, self.width);
        let delays = slopes.len() / 3;
        let complete = |partials: &mut [f64]| {
            if !terms.is_empty() {
                for (at, row) in partials.chunks_exact_mut(width).enumerate() {
                    add_delays(terms, row, &slopes[at * delays..][..delays], known);
                }
            }
        };
        if self.tangent.step(collocation, (dynamics, step), complete, &mut self.base.s, work) {
            trajectory.stops.follow(k, &trajectory.known, &mut self.base.s);
            return Ok(());
        }
        Err(diverged(&trajectory.grid, k, None))
    }
}

/// Plan and memory for the sensitivities of implicit steps.
pub(super) struct StiffTangent {
    n: usize,
    lanes: usize,
    slots: usize,
    forcing: usize,
    /// Entries of f_x: row, column, slot in a stage's row.
    by_state: Vec<(usize, usize, usize)>,
    /// `J S + f_theta` of a row, and right-hand sides: 3 n rows of lanes.
    right: Aligned,
}

impl StiffTangent {
    pub(super) fn new(layout: &Layout) -> Self {
        let stage = &layout.stage;
        let entries = layout.patterns.rates_by_state.entries().zip(&stage.by_state);
        Self {
            n: layout.states,
            lanes: stage.lanes,
            slots: stage.width,
            forcing: stage.forcing,
            by_state: entries.map(|((_, i, j), slot)| (i, j, *slot as usize)).collect(),
            right: Aligned::new(STAGES * layout.states * stage.lanes),
        }
    }

    /// Advances S (n by lanes) over the step that `collocation` has just solved; `complete` adds what delays contribute to
    /// the three rows of partials. `false` when the equations have no factors there.
    #[inline(always)]
    pub(super) fn step(
        &mut self,
        collocation: &mut Collocation,
        (dynamics, step): (&dyn Dynamics, Interval<'_>),
        complete: impl FnOnce(&mut [f64]),
        s: &mut [f64],
        work: &mut Workspace,
    ) -> bool {
        let lanes = self.lanes;
        let Some((partials, factors)) = collocation.linearise(dynamics, step, work) else { return false };
        complete(partials);
        for (j, row) in partials.chunks_exact(self.slots).enumerate() {
            for i in 0..self.n {
                let (from, to) = (self.forcing + i * lanes, (STAGES * i + j) * lanes);
                for (to, from) in self.right[to..][..lanes].iter_mut().zip(&row[from..][..lanes]) {
                    *to = step.h * from;
                }
            }
            for (i, k, slot) in &self.by_state {
                let to = &mut self.right[(STAGES * i + j) * lanes..][..lanes];
                accumulate(step.h * row[*slot], &s[k * lanes..][..lanes], to);
            }
        }
        factors.solve_lanes(&mut self.right, lanes);
        for i in 0..self.n {
            // the last stage is the end of the step
            let end = factors.row(STAGES * i + STAGES - 1);
            for (s, z) in s[i * lanes..][..lanes].iter_mut().zip(&self.right[end * lanes..][..lanes]) {
                *s += z;
            }
        }
        true
    }
}
