//! A run of implicit steps with sensitivities.

use super::collocation::Collocation;
use super::tangent::ImplicitTangent;
use crate::dynamics::Dynamics;
use crate::simulate::block::Sink;
use crate::simulate::sensitivity::{Sensitivity, add_delays};
use crate::simulate::simulator::{Divergence, Simulator, diverged};

/// Plans and memory for one choice of columns.
pub(in crate::simulate) struct ImplicitSensitivity {
    /// S, and how outputs are observed: as in explicit steps.
    base: Sensitivity,
    width: usize,
    tangent: ImplicitTangent,
}

impl ImplicitSensitivity {
    /// # Panics
    /// As [`Sensitivity::new`].
    pub(in crate::simulate) fn new(dynamics: &dyn Dynamics, columns: &[usize]) -> Self {
        let layout = dynamics.layout();
        Self {
            base: Sensitivity::new(dynamics, columns),
            width: layout.stage.width,
            tangent: ImplicitTangent::new(layout),
        }
    }

    pub(in crate::simulate) fn columns(&self) -> &[usize] {
        self.base.columns()
    }

    /// Outputs and their sensitivities of a whole run that has begun.
    pub(in crate::simulate) fn run(
        &mut self,
        collocation: &mut Collocation,
        simulator: &mut Simulator<'_>,
        sink: &mut Sink<'_>,
    ) -> Result<(), Divergence> {
        self.base.begin(&simulator.known);
        pulp::Arch::new().dispatch(|| self.march(collocation, simulator, sink))?;
        self.base.flush(sink);
        Ok(())
    }

    /// The loop over the steps: states, then their sensitivities.
    #[inline(always)]
    fn march(
        &mut self,
        collocation: &mut Collocation,
        simulator: &mut Simulator<'_>,
        sink: &mut Sink<'_>,
    ) -> Result<(), Divergence> {
        let steps = simulator.grid.steps();
        for k in 0..=steps {
            if let Some(sample) = simulator.grid.sample_at(k) {
                self.base.observe(simulator, sample, k, sink)?;
            }
            if k < steps {
                collocation.advance(simulator, k)?;
                self.follow(collocation, simulator, k)?;
            }
        }
        Ok(())
    }

    /// Sensitivities over step k, which the states have taken.
    #[inline(always)]
    fn follow(
        &mut self,
        collocation: &mut Collocation,
        simulator: &mut Simulator<'_>,
        k: usize,
    ) -> Result<(), Divergence> {
        let dynamics = simulator.dynamics;
        let (step, _, work) = simulator.interval(k);
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
            return Ok(());
        }
        Err(diverged(&simulator.grid, k, None))
    }
}
