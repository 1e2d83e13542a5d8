//! The stiff integrator: three-stage Radau IIA on the generated Jacobian, with the exact sensitivities of the discrete equations.
//!
//! Libraries for stiff systems control their error from step to step and differentiate the continuous equations: what they give is not the
//! derivative of what they return, and a Gauss-Newton iteration that is to converge needs exactly that.
//!
//! The stage equations of one step of the three-stage Radau IIA method (order 5, stage order 3, L-stable; Hairer & Wanner, Solving
//! ordinary differential equations II, IV.5 and IV.8), solved to rounding.
//!
//! Unknown `3 i + j` is the increment of state i at stage j, so that a band in the model stays a band in the equations. Newton's
//! method begins at the collocation polynomial of the step before, keeps its factors while they halve the error tenfold, and
//! takes the Jacobians of all three stages where they are, not that of the beginning (Hairer & Wanner do with one
//! because they stop early; here the iteration goes on until rounding, because the sensitivities are derivatives of
//! the exact solution of these equations and of nothing else). Where that fails, it begins again with no increment and with damped steps
//! (Deuflhard, Newton methods for nonlinear problems, 3.3).
//!
//! Sensitivities of a run of implicit steps: the derivative of the solved stage equations,
//! `(A^-1 - h J) Z_theta = h (J S + f_theta)`, all parameters in one pass.
//!
//! J holds every stage's own Jacobian at its own states, so that nothing is neglected: the result is the derivative of the
//! discrete solution (internal differentiation, Bock 1981).

use super::blocks::Sink;
use super::error::Divergence;
use super::steps::{NODES, SQRT_6, STAGES};
use super::tangent::{Sensitivity, add_delays};
use super::trajectory::{Interval, Trajectory, diverged, finite, two_nodes};
use crate::dynamics::{Dynamics, Layout, Point, Workspace};
use fdm_numeric::dense::lu::{Fused, Lu};
use fdm_numeric::lanes::{Aligned, accumulate, widest};

#[cfg(test)]
mod tests;

/// The stage equations have no solution that can be found; the state that was farthest from one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::simulate) struct Unsolved {
    pub(in crate::simulate) state: usize,
}

/// What a step takes over from those before it.
#[derive(Debug, Clone)]
pub(in crate::simulate) struct Past {
    z: Vec<f64>,
    h: f64,
    size: Vec<f64>,
}

/// Corrections below this part of a state's size are rounding.
const ROUNDING: f64 = 1e-16;
/// Corrections that no longer fall, below this part of a state's size, are rounding in the model's equations.
const FLOOR: f64 = 1e-10;
/// Factors are renewed when a correction is more than this part of the one before.
const SLOW: f64 = 0.1;
const MOST_ITERATIONS: usize = 25;
const MOST_DAMPED: usize = 60;
const LEAST_DAMPING: f64 = 1.0 / 1024.0;

/// Memory for the stage equations of one model.
pub(in crate::simulate) struct Collocation {
    n: usize,
    width: usize,
    slots: usize,
    /// Entries of f_x: row, column, slot in a stage's row.
    by_state: Vec<(usize, usize, usize)>,
    /// Increments (3 n), and those of the step before with its length.
    z: Vec<f64>,
    last: Vec<f64>,
    last_h: f64,
    /// Rates at the stages and partials as `rates_and_partials` gives them: one row per stage.
    rates: Vec<f64>,
    partials: Aligned,
    /// States at a stage.
    stage: Vec<f64>,
    /// Correction (3 n), a trial of the damped iteration, and its correction.
    correction: Vec<f64>,
    trial: Vec<f64>,
    next: Vec<f64>,
    /// Largest magnitude of each state so far.
    size: Vec<f64>,
    matrix: Lu<Fused>,
}

impl Collocation {
    pub(in crate::simulate) fn new(layout: &Layout) -> Self {
        let (n, width, slots) = (layout.states, layout.drive(), layout.rate_slots());
        let entries = layout.patterns.rates_by_state.entries().zip(&layout.stage.by_state);
        let unknowns = || vec![0.0; STAGES * n];
        Self {
            n,
            width,
            slots,
            by_state: entries.map(|((_, i, j), slot)| (i, j, *slot as usize)).collect(),
            z: unknowns(),
            last: unknowns(),
            last_h: 0.0,
            rates: unknowns(),
            partials: Aligned::new(STAGES * slots),
            stage: vec![0.0; n],
            correction: unknowns(),
            trial: unknowns(),
            next: unknowns(),
            size: vec![0.0; n],
            matrix: Lu::new(STAGES * n),
        }
    }

    /// Forgets all steps before.
    pub(in crate::simulate) fn begin(&mut self) {
        self.last_h = 0.0;
        self.size.fill(0.0);
    }

    /// Takes step k of a run.
    pub(in crate::simulate) fn advance(&mut self, trajectory: &mut Trajectory<'_>, k: usize) -> Result<(), Divergence> {
        let dynamics = trajectory.dynamics;
        let (step, next, work) = trajectory.interval(k);
        match self.step(dynamics, step, next, work) {
            Ok(()) => {
                trajectory.hold(k);
                finite(&trajectory.grid, k, two_nodes(&mut trajectory.nodes, k).1)
            }
            Err(unsolved) => Err(diverged(&trajectory.grid, k, Some(unsolved.state))),
        }
    }

    /// Solves a step, in the machine's widest registers; the states at its end go to `end`.
    pub(in crate::simulate) fn step(
        &mut self,
        dynamics: &dyn Dynamics,
        step: Interval<'_>,
        end: &mut [f64],
        work: &mut Workspace,
    ) -> Result<(), Unsolved> {
        widest(
            #[inline(always)]
            || self.solve(dynamics, step, end, work),
        )
    }

    #[inline(always)]
    fn solve(
        &mut self,
        dynamics: &dyn Dynamics,
        step: Interval<'_>,
        end: &mut [f64],
        work: &mut Workspace,
    ) -> Result<(), Unsolved> {
        for (size, x) in self.size.iter_mut().zip(step.x) {
            *size = size.max(x.abs());
        }
        self.predict(step.h);
        if !self.newton(dynamics, step, work) {
            self.z.fill(0.0);
            if !self.damped(dynamics, step, work) {
                self.last_h = 0.0;
                return Err(Unsolved { state: self.worst() });
            }
        }
        for (i, (end, x)) in end.iter_mut().zip(step.x).enumerate() {
            *end = x + self.z[STAGES * i + STAGES - 1];
        }
        self.last.copy_from_slice(&self.z);
        self.last_h = step.h;
        Ok(())
    }

    /// Partials at the solved stages (one row of `rates_and_partials` each) and the factors of the equations there.
    #[inline(always)]
    fn linearise(
        &mut self,
        dynamics: &dyn Dynamics,
        step: Interval<'_>,
        work: &mut Workspace,
    ) -> Option<(&mut [f64], &Lu<Fused>)> {
        let z = std::mem::take(&mut self.z);
        let solved = self.factors(dynamics, step, &z, work);
        self.z = z;
        solved.then_some((&mut self.partials[..], &self.matrix))
    }

    /// What the next step begins with.
    pub(in crate::simulate) fn past(&self) -> Past {
        Past { z: self.last.clone(), h: self.last_h, size: self.size.clone() }
    }

    /// Takes up a past again, so that what was tried since does not count.
    pub(in crate::simulate) fn resume(&mut self, past: &Past) {
        self.last.copy_from_slice(&past.z);
        self.size.copy_from_slice(&past.size);
        self.last_h = past.h;
    }

    /// Increments that continue the collocation polynomial of the step before.
    #[inline(always)]
    fn predict(&mut self, h: f64) {
        if self.last_h == 0.0 {
            self.z.fill(0.0);
            return;
        }
        for (j, node) in NODES.iter().enumerate() {
            let weights = weights(1.0 + node * h / self.last_h);
            for i in 0..self.n {
                let last = &self.last[STAGES * i..][..STAGES];
                let sum = weights[0] * last[0] + weights[1] * last[1] + weights[2] * last[2];
                self.z[STAGES * i + j] = sum - last[STAGES - 1];
            }
        }
    }

    /// Newton's iteration with factors that are kept while they serve.
    #[inline(always)]
    fn newton(&mut self, dynamics: &dyn Dynamics, step: Interval<'_>, work: &mut Workspace) -> bool {
        let (mut renew, mut before) = (true, f64::INFINITY);
        for _ in 0..MOST_ITERATIONS {
            let z = std::mem::take(&mut self.z);
            let possible = if renew {
                self.factors(dynamics, step, &z, work)
            } else {
                self.evaluate(dynamics, step, &z, work);
                true
            };
            self.z = z;
            if !possible {
                return false;
            }
            let mut correction = std::mem::take(&mut self.correction);
            self.residual(step.h, &self.z, &mut correction);
            self.matrix.solve(&mut correction);
            for (z, d) in self.z.iter_mut().zip(&correction) {
                *z += d;
            }
            self.correction = correction;
            let now = self.magnitude(&self.correction);
            if !now.is_finite() {
                return false;
            }
            if now <= ROUNDING {
                return true;
            }
            if before.is_finite() {
                let rate = now / before;
                // what is left after this correction, if the next ones fall as this one did
                if rate < 1.0 && now * rate <= ROUNDING * (1.0 - rate) {
                    return true;
                }
                if renew && rate > 0.5 && now <= FLOOR {
                    return true;
                }
                if renew && rate > 2.0 {
                    return false;
                }
                renew = rate > SLOW;
            } else {
                renew = false;
            }
            before = now;
        }
        false
    }

    /// Newton's iteration with steps that are shortened until the next correction would be smaller.
    fn damped(&mut self, dynamics: &dyn Dynamics, step: Interval<'_>, work: &mut Workspace) -> bool {
        let (mut z, mut trial) = (std::mem::take(&mut self.z), std::mem::take(&mut self.trial));
        let (mut d, mut next) = (std::mem::take(&mut self.correction), std::mem::take(&mut self.next));
        let mut solved = false;
        let mut damping = 1.0_f64;
        'iteration: for _ in 0..MOST_DAMPED {
            if !self.factors(dynamics, step, &z, work) {
                break;
            }
            self.residual(step.h, &z, &mut d);
            self.matrix.solve(&mut d);
            let now = self.magnitude_at(&z, &d);
            if !now.is_finite() {
                break;
            }
            if now <= ROUNDING {
                solved = true;
                break;
            }
            loop {
                for (t, (z, d)) in trial.iter_mut().zip(z.iter().zip(&d)) {
                    *t = z + damping * d;
                }
                self.evaluate(dynamics, step, &trial, work);
                self.residual(step.h, &trial, &mut next);
                self.matrix.solve(&mut next);
                let ahead = self.magnitude_at(&trial, &next);
                if ahead <= (1.0 - 0.25 * damping) * now {
                    z.copy_from_slice(&trial);
                    damping = (2.0 * damping).min(1.0);
                    break;
                }
                if now <= FLOOR {
                    // no shorter step helps against rounding
                    solved = true;
                    break 'iteration;
                }
                damping *= 0.5;
                if damping < LEAST_DAMPING {
                    break 'iteration;
                }
            }
        }
        (self.z, self.trial, self.correction, self.next) = (z, trial, d, next);
        solved
    }

    /// Rates at the stages.
    #[inline(always)]
    fn evaluate(&mut self, dynamics: &dyn Dynamics, step: Interval<'_>, z: &[f64], work: &mut Workspace) {
        for (j, node) in NODES.iter().enumerate() {
            let t = step.t + node * step.h;
            stage_states(&mut self.stage, step.x, z, j);
            let drive = &step.drive[j * self.width..][..self.width];
            let at = Point { t, x: &self.stage, drive, known: step.known };
            dynamics.rates(at, &mut self.rates[j * self.n..][..self.n], work);
        }
    }

    /// Rates and partials at the stages, and the factors of `A^-1 - h J`; `false` when there are none.
    #[inline(always)]
    fn factors(&mut self, dynamics: &dyn Dynamics, step: Interval<'_>, z: &[f64], work: &mut Workspace) -> bool {
        self.matrix.clear();
        for i in 0..self.n {
            for (j, row) in INVERSE.iter().enumerate() {
                for (l, weight) in row.iter().enumerate() {
                    *self.matrix.entry_mut(STAGES * i + j, STAGES * i + l) += *weight;
                }
            }
        }
        for (j, node) in NODES.iter().enumerate() {
            let t = step.t + node * step.h;
            stage_states(&mut self.stage, step.x, z, j);
            let drive = &step.drive[j * self.width..][..self.width];
            let row = &mut self.partials[j * self.slots..][..self.slots];
            dynamics.rates_and_partials(Point { t, x: &self.stage, drive, known: step.known }, row, work);
            self.rates[j * self.n..][..self.n].copy_from_slice(&row[..self.n]);
            for (i, k, slot) in &self.by_state {
                *self.matrix.entry_mut(STAGES * i + j, STAGES * k + j) += -step.h * row[*slot];
            }
        }
        self.matrix.factorise(0.0)
    }

    /// `h F - A^-1 Z`
    #[inline(always)]
    fn residual(&self, h: f64, z: &[f64], out: &mut [f64]) {
        for i in 0..self.n {
            let z = &z[STAGES * i..][..STAGES];
            for (j, row) in INVERSE.iter().enumerate() {
                let sum = row[0] * z[0] + row[1] * z[1] + row[2] * z[2];
                out[STAGES * i + j] = h * self.rates[j * self.n + i] - sum;
            }
        }
    }

    #[inline(always)]
    fn magnitude(&self, correction: &[f64]) -> f64 {
        self.magnitude_at(&self.z, correction)
    }

    /// Largest part of its state's size that a correction is; infinite when one is not a number.
    #[inline(always)]
    fn magnitude_at(&self, z: &[f64], correction: &[f64]) -> f64 {
        let mut most = 0.0_f64;
        for (k, (z, d)) in z.iter().zip(correction).enumerate() {
            if *d != 0.0 {
                let part = d.abs() / self.size[k / STAGES].max(z.abs());
                most = if part > most || part.is_nan() { part } else { most };
                if most.is_nan() {
                    return f64::INFINITY;
                }
            }
        }
        most
    }

    /// The state whose last correction was largest.
    fn worst(&self) -> usize {
        let part = |k: usize| self.correction[k].abs() / self.size[k / STAGES].max(self.z[k].abs());
        let mut worst = 0;
        for k in 0..self.correction.len() {
            if part(k).is_nan() {
                return k / STAGES;
            }
            if part(k) > part(worst) {
                worst = k;
            }
        }
        worst / STAGES
    }
}

/// States at a stage.
#[inline(always)]
fn stage_states(stage: &mut [f64], x: &[f64], z: &[f64], j: usize) {
    for (i, (s, x)) in stage.iter_mut().zip(x).enumerate() {
        *s = x + z[STAGES * i + j];
    }
}

/// Inverse of the Runge-Kutta matrix A: the stage equations are solved as `A^-1 Z = h F(x + Z)`, in which a stage's Jacobian
/// stands in that stage's rows only.
const INVERSE: [[f64; STAGES]; STAGES] = [
    [2.0 + 0.5 * SQRT_6, (29.0 * SQRT_6 - 36.0) / 30.0, (6.0 - 4.0 * SQRT_6) / 15.0],
    [-(36.0 + 29.0 * SQRT_6) / 30.0, 2.0 - 0.5 * SQRT_6, (6.0 + 4.0 * SQRT_6) / 15.0],
    [(8.0 * SQRT_6 - 3.0) / 3.0, -(3.0 + 8.0 * SQRT_6) / 3.0, 5.0],
];

/// Weights of the stages' increments for the increment that the collocation polynomial has at `part` of the step; beyond 1 it
/// extrapolates.
fn weights(part: f64) -> [f64; STAGES] {
    let mut weights = [0.0; STAGES];
    for (i, weight) in weights.iter_mut().enumerate() {
        let others = NODES.iter().enumerate().filter(|(j, _)| *j != i);
        // the increment is zero at the beginning
        *weight = others.fold(part / NODES[i], |w, (_, c)| w * (part - c) / (NODES[i] - c));
    }
    weights
}

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
struct StiffTangent {
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
    fn new(layout: &Layout) -> Self {
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
    fn step(
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

#[cfg(test)]
mod collocation_tests {
    use super::*;

    /// Collocation: the matrix integrates quadratics exactly, and so its inverse differentiates cubics that begin at zero.
    #[test]
    fn the_inverse_differentiates_cubics() {
        for power in 1..=3 {
            for (row, c) in INVERSE.iter().zip(NODES) {
                let got: f64 = row.iter().zip(NODES).map(|(w, c)| w * c.powi(power)).sum();
                let slope = f64::from(power) * c.powi(power - 1);
                assert!((got - slope).abs() < 1e-14, "{power}: {got} {slope}");
            }
        }
    }

    #[test]
    fn weights_continue_cubics() {
        for part in [0.0, 0.3, 1.0, 2.5] {
            for power in 1..=3 {
                let got: f64 = weights(part).iter().zip(NODES).map(|(w, c)| w * c.powi(power)).sum();
                assert!((got - part.powi(power)).abs() < 1e-13 * part.powi(3).max(1.0), "{part} {power}: {got}");
            }
        }
    }
}
