//! Sensitivities of a run that sees delayed states: `S' = f_x S + f_theta + f_delay (S delayed - slope tau_theta)`.
//!
//! The delayed sensitivities enter a step by the weights of the delayed states. Where a step sees itself they satisfy
//! linear equations, those of the last Newton correction, which are solved for all parameters at once.

use super::DelayedStates;
use super::step::{DRIVE_ROW, rest};
use crate::dynamics::{Dynamics, Layout};
use crate::simulate::blocks::Sink;
use crate::simulate::error::Divergence;
use crate::simulate::runge_kutta::{Sensitivity, add_delays};
use crate::simulate::trajectory::{Trajectory, node};
use fdm_numeric::lanes::{Aligned, Simd, WithSimd, accumulate, dispatch};

/// Plans and memory for one choice of columns.
pub(in crate::simulate) struct DelayedSensitivity {
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
    /// Limited states that rest at the beginning and at the end of the step.
    resting: [Vec<usize>; 2],
}

impl DelayedSensitivity {
    /// # Panics
    /// As [`Sensitivity::new`].
    pub(in crate::simulate) fn new(dynamics: &dyn Dynamics, columns: &[usize], delayed: &DelayedStates) -> Self {
        let (layout, base) = (dynamics.layout(), Sensitivity::new(dynamics, columns));
        let (n, lanes) = (layout.states, base.lanes);
        let f_x = &layout.patterns.rates_by_state;
        let row = |i: usize| f_x.row(i).map(|(k, j)| (layout.stage.by_state[k] as usize, j)).collect();
        Self {
            base,
            forcing: layout.stage.forcing,
            f_x: (0..n).map(row).collect(),
            trial: Aligned::new(n * lanes),
            seen: vec![0.0; 3 * lanes * delayed.lags.len()],
            own: vec![0.0; 3 * lanes * delayed.unknown.len()],
            resting: std::array::from_fn(|_| Vec::with_capacity(layout.limited.len())),
        }
    }

    pub(in crate::simulate) fn columns(&self) -> &[usize] {
        self.base.columns()
    }

    /// A whole run for which the trajectory is prepared.
    pub(in crate::simulate) fn run(
        &mut self,
        delayed: &mut DelayedStates,
        trajectory: &mut Trajectory<'_>,
        sink: &mut Sink<'_>,
    ) -> Result<(), Divergence> {
        self.base.begin(&trajectory.known);
        dispatch(March { sensitivity: self, delayed, trajectory, sink })
    }

    /// One step of states and sensitivities, and its memory.
    #[inline(always)]
    fn advance<S: Simd>(
        &mut self,
        simd: S,
        delayed: &mut DelayedStates,
        trajectory: &mut Trajectory<'_>,
        k: usize,
    ) -> Result<(), Divergence> {
        let layout = trajectory.dynamics.layout();
        delayed.clear(layout);
        delayed.step(trajectory, k, &mut self.seen, true)?;
        self.delays(layout, delayed, trajectory, k);
        self.force(delayed);
        let h = trajectory.grid.step(k).1;
        if delayed.short {
            self.close(simd, delayed, h);
        }
        trajectory.hold(k);
        for (end, resting) in self.resting.iter_mut().enumerate() {
            resting.clear();
            rest(trajectory, k + end, &mut delayed.rates[end], |state| resting.push(state));
        }
        let Trajectory { history: Some(history), known, stops, .. } = trajectory else { return Ok(()) };
        for end in 0..2 {
            if end == 1 {
                let Sensitivity { plan, s, scratch, .. } = &mut self.base;
                plan.step(simd, h, &delayed.partials, s, scratch);
                stops.follow(k, known, s);
            }
            let row = if end == 0 { &delayed.partials[..delayed.width] } else { &delayed.ends[..] };
            let (kept, rows) = history.rates(end, &delayed.rates[end]);
            for (state, to) in kept.iter().zip(rows.chunks_exact_mut(self.base.lanes.max(1))) {
                match self.resting[end].contains(state) {
                    true => to.fill(0.0),
                    false => self.slope(row, *state, &self.base.s, to),
                }
            }
        }
        history.node(trajectory.grid.end(k), &trajectory.nodes[node(k + 1)], &self.base.s);
        Ok(())
    }

    /// What the delays' own sensitivities add to f_theta: `-f_delay slope tau_theta`.
    #[inline(always)]
    fn delays(&mut self, layout: &Layout, delayed: &mut DelayedStates, trajectory: &Trajectory<'_>, k: usize) {
        let (slopes, delays) = (trajectory.drive.stage_slopes(k), layout.delayed.len());
        let DelayedStates { partials, ends, width, .. } = delayed;
        let rows = partials.chunks_exact_mut(*width).zip(DRIVE_ROW).chain([(&mut ends[..], 2)]);
        for (row, at) in rows {
            add_delays(&self.base.rates_by_delay, row, &slopes[at * delays..][..delays], &trajectory.known);
        }
    }

    /// Adds `f_delay S_delayed` to f_theta of the four stages and of the end.
    #[inline(always)]
    fn force(&self, delayed: &mut DelayedStates) {
        let (lanes, DelayedStates { partials, ends, width, entries, .. }) = (self.base.lanes, delayed);
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
    fn close<S: Simd>(&mut self, simd: S, delayed: &mut DelayedStates, h: f64) {
        let lanes = self.base.lanes;
        let mut own = std::mem::take(&mut self.own);
        self.trial.copy_from_slice(&self.base.s);
        let Sensitivity { plan, scratch, .. } = &mut self.base;
        plan.step(simd, h, &delayed.partials, &mut self.trial, scratch);
        for (state, rows) in delayed.unknown.iter().zip(own.chunks_exact_mut(3 * lanes.max(1))) {
            let (x1, rates) = rows.split_at_mut(lanes);
            let (f0, f1) = rates.split_at_mut(lanes);
            x1.copy_from_slice(&self.trial[state * lanes..][..lanes]);
            self.slope(&delayed.partials[..delayed.width], *state, &self.base.s, f0);
            self.slope(&delayed.ends, *state, &self.trial, f1);
        }
        delayed.lu.solve_lanes(&mut own, lanes);
        self.seen.fill(0.0);
        for (k, lag) in delayed.lags.iter().enumerate() {
            for row in 0..3 {
                let to = &mut self.seen[(3 * k + row) * lanes..][..lanes];
                for which in 0..3 {
                    let weight = lag.own.value[row][1 + which];
                    let from = delayed.lu.row(3 * lag.unknown + which);
                    accumulate(weight, &own[from * lanes..][..lanes], to);
                }
            }
        }
        self.own = own;
        self.force(delayed);
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
    sensitivity: &'m mut DelayedSensitivity,
    delayed: &'m mut DelayedStates,
    trajectory: &'m mut Trajectory<'a>,
    sink: &'m mut Sink<'m>,
}

impl WithSimd for March<'_, '_> {
    type Output = Result<(), Divergence>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { sensitivity, delayed, trajectory, sink } = self;
        let steps = trajectory.grid.steps();
        if let Some(history) = &mut trajectory.history {
            history.node(trajectory.grid.samples()[0], &trajectory.nodes[0], &sensitivity.base.s);
        }
        for k in 0..=steps {
            if let Some(sample) = trajectory.grid.sample_at(k) {
                sensitivity.base.observe(trajectory, sample, k, sink)?;
            }
            if k < steps {
                sensitivity.advance(simd, delayed, trajectory, k)?;
            }
        }
        sensitivity.base.flush(sink);
        Ok(())
    }
}
