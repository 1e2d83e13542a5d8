//! Sensitivities of one implicit step: the derivative of the solved stage equations,
//! `(A^-1 - h J) Z_theta = h (J S + f_theta)`, all parameters in one pass.
//!
//! J holds every stage's own Jacobian at its own states, so that nothing is neglected: the result is the derivative of the
//! discrete solution (internal differentiation, Bock 1981).

use super::collocation::{Collocation, Interval};
use super::tableau::STAGES;
use crate::dynamics::{Dynamics, Layout, Workspace};
use crate::simulate::vectors::{Aligned, accumulate};

/// Plan and memory for the sensitivities of implicit steps.
pub(super) struct ImplicitTangent {
    n: usize,
    lanes: usize,
    slots: usize,
    forcing: usize,
    /// Entries of f_x: row, column, slot in a stage's row.
    by_state: Vec<(usize, usize, usize)>,
    /// `J S + f_theta` of a row, and right-hand sides: 3 n rows of lanes.
    right: Aligned,
}

impl ImplicitTangent {
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
