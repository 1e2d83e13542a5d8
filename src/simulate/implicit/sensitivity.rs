//! A run of implicit steps with sensitivities.

use super::collocation::Collocation;
use super::tangent::ImplicitTangent;
use crate::dynamics::Dynamics;
use crate::simulate::block::Sink;
use crate::simulate::emission::Emission;
use crate::simulate::observation::{Scatter, scatter};
use crate::simulate::sensitivity::{DelayTerm, add_delays, delay_terms};
use crate::simulate::simulator::{Divergence, Simulator, diverged};
use crate::simulate::vectors::Aligned;

/// Plans and memory for one choice of columns.
pub(in crate::simulate) struct ImplicitSensitivity {
    columns: Vec<usize>,
    width: usize,
    initial: Vec<Scatter>,
    rates_by_delay: Vec<DelayTerm>,
    emission: Emission,
    tangent: ImplicitTangent,
    s: Aligned,
}

impl ImplicitSensitivity {
    /// # Panics
    /// When a column is a parameter that is fixed in the model: its sensitivity would be a silent zero.
    pub(in crate::simulate) fn new(dynamics: &dyn Dynamics, columns: &[usize]) -> Self {
        let layout = dynamics.layout();
        Self {
            columns: columns.to_vec(),
            width: layout.stage.width,
            initial: scatter(layout, &layout.patterns.initial_by_param, layout.initial_by_param.start),
            rates_by_delay: delay_terms(layout),
            emission: Emission::new(layout, columns),
            tangent: ImplicitTangent::new(layout),
            s: Aligned::new(layout.states * layout.stage.lanes),
        }
    }

    pub(in crate::simulate) fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// Outputs and their sensitivities of a whole run that has begun.
    pub(in crate::simulate) fn run(
        &mut self,
        collocation: &mut Collocation,
        simulator: &mut Simulator<'_>,
        sink: &mut Sink<'_>,
    ) -> Result<(), Divergence> {
        self.emission.begin();
        self.s.fill(0.0);
        for c in &self.initial {
            self.s[c.to as usize] = simulator.known[c.from as usize];
        }
        pulp::Arch::new().dispatch(|| self.march(collocation, simulator, sink))?;
        self.emission.flush(sink);
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
                self.emission.sample(simulator, (sample, k), &self.s, sink)?;
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
        let (known, slopes, terms, width) = (step.known, step.slopes, &self.rates_by_delay, self.width);
        let delays = slopes.len() / 3;
        let complete = |partials: &mut [f64]| {
            if !terms.is_empty() {
                for (at, row) in partials.chunks_exact_mut(width).enumerate() {
                    add_delays(terms, row, &slopes[at * delays..][..delays], known);
                }
            }
        };
        if self.tangent.step(collocation, (dynamics, step), complete, &mut self.s, work) {
            return Ok(());
        }
        Err(diverged(&simulator.grid, k, None))
    }
}
