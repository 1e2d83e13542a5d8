//! Sensitivities of a run that sees delayed states: `S' = f_x S + f_theta + f_delay (S delayed - slope tau_theta)`.
//!
//! The delayed sensitivities enter a step by the weights of the delayed states. Where a step sees itself they satisfy
//! linear equations, those of the last Newton correction, which are solved for all parameters at once.

use super::super::block::Sink;
use super::super::sensitivity::{Sensitivity, add_delays};
use super::super::simulator::{Divergence, Simulator, node};
use super::super::vectors::{Aligned, accumulate};
use super::Retarded;
use super::step::DRIVE_ROW;
use crate::dynamics::{Dynamics, Layout};
use pulp::{Simd, WithSimd};

/// Plans and memory for one choice of columns.
pub(in super::super) struct RetardedSensitivity {
    /// S, its step, and how outputs are observed: as without delayed states.
    base: Sensitivity,
    forcing: usize,
    /// Entries of f_x of each state: slot in a stage's row, and column.
    f_x: Vec<Vec<(usize, usize)>>,
    trial: Aligned,
    /// Sensitivities of the stage values of each lag, 3 rows each.
    seen: Vec<f64>,
    /// Sensitivities of x1, f0 and f1 of the states that a step sees of itself.
    own: Vec<f64>,
}

impl RetardedSensitivity {
    /// # Panics
    /// As [`Sensitivity::new`].
    pub(in super::super) fn new(dynamics: &dyn Dynamics, columns: &[usize], retarded: &Retarded) -> Self {
        let (layout, base) = (dynamics.layout(), Sensitivity::new(dynamics, columns));
        let (n, lanes) = (layout.states, base.lanes);
        let f_x = &layout.patterns.rates_by_state;
        let row = |i: usize| f_x.row(i).map(|(k, j)| (layout.stage.by_state[k] as usize, j)).collect();
        Self {
            base,
            forcing: layout.stage.forcing,
            f_x: (0..n).map(row).collect(),
            trial: Aligned::new(n * lanes),
            seen: vec![0.0; 3 * lanes * retarded.lags.len()],
            own: vec![0.0; 3 * lanes * retarded.unknown.len()],
        }
    }

    pub(in super::super) fn columns(&self) -> &[usize] {
        self.base.columns()
    }

    /// A whole run for which the simulator is prepared.
    pub(in super::super) fn run(
        &mut self,
        retarded: &mut Retarded,
        simulator: &mut Simulator<'_>,
        sink: &mut Sink<'_>,
    ) -> Result<(), Divergence> {
        self.base.begin(&simulator.known);
        pulp::Arch::new().dispatch(March { sensitivity: self, retarded, simulator, sink })
    }

    /// One step of states and sensitivities, and its memory.
    #[inline(always)]
    fn advance<S: Simd>(
        &mut self,
        simd: S,
        retarded: &mut Retarded,
        simulator: &mut Simulator<'_>,
        k: usize,
    ) -> Result<(), Divergence> {
        let layout = simulator.dynamics.layout();
        retarded.clear(layout);
        retarded.step(simulator, k, &mut self.seen, true)?;
        self.delays(layout, retarded, simulator, k);
        self.force(retarded);
        let h = simulator.grid.step(k).1;
        if retarded.short {
            self.close(simd, retarded, h);
        }
        let Some(history) = &mut simulator.history else { return Ok(()) };
        for end in 0..2 {
            if end == 1 {
                let Sensitivity { plan, s, scratch, .. } = &mut self.base;
                plan.step(simd, h, &retarded.partials, s, scratch);
            }
            let row = if end == 0 { &retarded.partials[..retarded.width] } else { &retarded.ends[..] };
            let (kept, rows) = history.rates(end, &row[..layout.states]);
            for (state, to) in kept.iter().zip(rows.chunks_exact_mut(self.base.lanes.max(1))) {
                self.slope(row, *state, &self.base.s, to);
            }
        }
        history.node(simulator.grid.end(k), &simulator.nodes[node(k + 1)], &self.base.s);
        Ok(())
    }

    /// What the delays' own sensitivities add to f_theta: `-f_delay slope tau_theta`.
    #[inline(always)]
    fn delays(&mut self, layout: &Layout, retarded: &mut Retarded, simulator: &Simulator<'_>, k: usize) {
        let (slopes, delays) = (simulator.drive.stage_slopes(k), layout.delayed.len());
        let Retarded { partials, ends, width, .. } = retarded;
        let rows = partials.chunks_exact_mut(*width).zip(DRIVE_ROW).chain([(&mut ends[..], 2)]);
        for (row, at) in rows {
            add_delays(&self.base.rates_by_delay, row, &slopes[at * delays..][..delays], &simulator.known);
        }
    }

    /// Adds `f_delay S_delayed` to f_theta of the four stages and of the end.
    #[inline(always)]
    fn force(&self, retarded: &mut Retarded) {
        let (lanes, Retarded { partials, ends, width, entries, .. }) = (self.base.lanes, retarded);
        let rows = partials.chunks_exact_mut(*width).zip(DRIVE_ROW).chain([(&mut ends[..], 2)]);
        for (row, at) in rows {
            for e in entries.iter() {
                let seen = &self.seen[(3 * e.lag + at) * lanes..][..lanes];
                accumulate(row[e.slot], seen, &mut row[self.forcing + e.row * lanes..][..lanes]);
            }
        }
    }

    /// Solves for what the step sees of itself, and adds it to f_theta.
    #[inline(always)]
    fn close<S: Simd>(&mut self, simd: S, retarded: &mut Retarded, h: f64) {
        let lanes = self.base.lanes;
        let mut own = std::mem::take(&mut self.own);
        self.trial.copy_from_slice(&self.base.s);
        let Sensitivity { plan, scratch, .. } = &mut self.base;
        plan.step(simd, h, &retarded.partials, &mut self.trial, scratch);
        for (state, rows) in retarded.unknown.iter().zip(own.chunks_exact_mut(3 * lanes.max(1))) {
            let (x1, rates) = rows.split_at_mut(lanes);
            let (f0, f1) = rates.split_at_mut(lanes);
            x1.copy_from_slice(&self.trial[state * lanes..][..lanes]);
            self.slope(&retarded.partials[..retarded.width], *state, &self.base.s, f0);
            self.slope(&retarded.ends, *state, &self.trial, f1);
        }
        retarded.lu.solve_lanes(&mut own, lanes);
        self.seen.fill(0.0);
        for (k, lag) in retarded.lags.iter().enumerate() {
            for row in 0..3 {
                let to = &mut self.seen[(3 * k + row) * lanes..][..lanes];
                for which in 0..3 {
                    let weight = lag.own.value[row][1 + which];
                    accumulate(weight, &own[(3 * lag.unknown + which) * lanes..][..lanes], to);
                }
            }
        }
        self.own = own;
        self.force(retarded);
    }

    /// One row of `f_x S + f_theta`.
    #[inline(always)]
    fn slope(&self, row: &[f64], state: usize, s: &[f64], to: &mut [f64]) {
        let lanes = self.base.lanes;
        to.copy_from_slice(&row[self.forcing + state * lanes..][..lanes]);
        for (slot, column) in &self.f_x[state] {
            accumulate(row[*slot], &s[column * lanes..][..lanes], to);
        }
    }
}

/// The loop over the steps, compiled for the machine's widest registers.
struct March<'m, 'a> {
    sensitivity: &'m mut RetardedSensitivity,
    retarded: &'m mut Retarded,
    simulator: &'m mut Simulator<'a>,
    sink: &'m mut Sink<'m>,
}

impl WithSimd for March<'_, '_> {
    type Output = Result<(), Divergence>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { sensitivity, retarded, simulator, sink } = self;
        let steps = simulator.grid.steps();
        if let Some(history) = &mut simulator.history {
            history.node(simulator.grid.samples()[0], &simulator.nodes[0], &sensitivity.base.s);
        }
        for k in 0..=steps {
            if let Some(sample) = simulator.grid.sample_at(k) {
                sensitivity.base.observe(simulator, sample, k, sink)?;
            }
            if k < steps {
                sensitivity.advance(simd, retarded, simulator, k)?;
            }
        }
        sensitivity.base.flush(sink);
        Ok(())
    }
}
