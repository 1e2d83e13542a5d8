//! What drives the model at the stages of every step and at every sample: inputs, and inputs delayed.

use super::grid::Grid;
use super::moments::{Follower, Rule, StageValues};
use super::steps::Steps;
use crate::dynamics::Layout;
use crate::record::{Cursor, Run};
use fdm_grammar::graph::Signal;

/// Values of inputs and delayed inputs where the integrator needs them; delayed states are filled in elsewhere.
#[derive(Debug, Clone)]
pub(super) struct DriveTable {
    width: usize,
    inputs: usize,
    delayed: Vec<Signal>,
    rule: Rule,
    /// Steps by 3 by width: the stages of each step.
    stages: Vec<f64>,
    /// Steps by 3 by delayed signals: slopes of delayed inputs.
    stage_slopes: Vec<f64>,
    /// Samples by width.
    samples: Vec<f64>,
    /// Samples by delayed signals.
    sample_slopes: Vec<f64>,
}

impl DriveTable {
    /// Fills in the inputs that are not delayed; they stay as they are for the whole fit.
    pub(super) fn new(layout: &Layout, run: &Run, grid: &Grid, steps: &Steps) -> Self {
        let (width, inputs, delays, count) = (layout.drive(), layout.inputs, layout.delayed.len(), grid.steps());
        let mut table = Self {
            width,
            inputs,
            delayed: layout.delayed.clone(),
            rule: Rule::of(steps.scheme()),
            stages: vec![0.0; count * 3 * width],
            stage_slopes: vec![0.0; count * 3 * delays],
            samples: vec![0.0; run.len() * width],
            sample_slopes: vec![0.0; run.len() * delays],
        };
        for (sample, row) in run.inputs.chunks_exact(inputs.max(1)).enumerate().filter(|_| inputs > 0) {
            table.samples[sample * width..][..inputs].copy_from_slice(row);
        }
        let mut rows = table.stages.chunks_exact_mut((3 * width).max(1));
        for interval in (0..run.len().saturating_sub(1)).filter(|_| count > 0 && inputs > 0) {
            steps.each(interval, |begin, end| {
                if let Some(stages) = rows.next() {
                    inputs_of_step(run, interval, (begin, end), &table.rule, width, stages);
                }
            });
        }
        table
    }

    /// Fills in the delayed inputs for new delays (one per delayed signal).
    pub(super) fn delay(&mut self, tau: &[f64], run: &Run, grid: &Grid) {
        let delays = self.delayed.len();
        for (d, tau) in tau.iter().enumerate() {
            let Signal::Input(input) = self.delayed[d] else { continue };
            let (input, column) = (input as usize, self.inputs + d);
            let mut follower = Follower::default();
            for k in 0..grid.steps() {
                let (t, h) = grid.step(k);
                let StageValues { value, slope } = follower.step(run, input, (t - tau, h), &self.rule);
                for stage in 0..3 {
                    self.stages[(3 * k + stage) * self.width + column] = value[stage];
                    self.stage_slopes[(3 * k + stage) * delays + d] = slope[stage];
                }
            }
            let mut cursor = Cursor::default();
            for (sample, t) in grid.samples().iter().enumerate() {
                let (value, slope) = run.input(input, cursor.at(&run.time, t - tau));
                self.samples[sample * self.width + column] = value;
                self.sample_slopes[sample * delays + d] = slope;
            }
        }
    }

    /// Drive at the stages of a step (3 by width): with Runge-Kutta its beginning, middle and end.
    #[inline]
    pub(super) fn stages(&self, step: usize) -> &[f64] {
        &self.stages[step * 3 * self.width..][..3 * self.width]
    }

    /// Slopes of the delayed inputs at the same three stages (3 by delayed signals).
    #[inline]
    pub(super) fn stage_slopes(&self, step: usize) -> &[f64] {
        let delays = self.delayed.len();
        &self.stage_slopes[step * 3 * delays..][..3 * delays]
    }

    /// Puts a delayed state into the drive of a step.
    pub(super) fn place(&mut self, step: usize, delayed: usize, seen: StageValues) {
        let delays = self.delayed.len();
        for stage in 0..3 {
            self.stages[(3 * step + stage) * self.width + self.inputs + delayed] = seen.value[stage];
            self.stage_slopes[(3 * step + stage) * delays + delayed] = seen.slope[stage];
        }
    }

    /// Length of a row of the drive.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// Number of delayed signals.
    pub(super) fn delays(&self) -> usize {
        self.delayed.len()
    }

    /// Drive at the three stages of all steps (steps by 3 by width).
    #[inline]
    pub(super) fn all_stages(&self) -> &[f64] {
        &self.stages
    }

    /// Slopes at the same (steps by 3 by delayed signals).
    #[inline]
    pub(super) fn all_stage_slopes(&self) -> &[f64] {
        &self.stage_slopes
    }

    /// Drive at all samples (N by width).
    #[inline]
    pub(super) fn all_samples(&self) -> &[f64] {
        &self.samples
    }

    /// Drive at a sample (width), writable for the delayed states.
    #[inline]
    pub(super) fn sample(&mut self, sample: usize) -> &mut [f64] {
        &mut self.samples[sample * self.width..][..self.width]
    }

    /// Slopes of the delayed inputs at a sample.
    #[inline]
    pub(super) fn sample_slopes(&self, sample: usize) -> &[f64] {
        let delays = self.delayed.len();
        &self.sample_slopes[sample * delays..][..delays]
    }
}

/// Inputs at the stages (3 by width) of the step between two parts of an interval.
pub(super) fn inputs_of_step(
    run: &Run,
    interval: usize,
    (begin, end): (f64, f64),
    rule: &Rule,
    width: usize,
    stages: &mut [f64],
) {
    let inputs = run.held.len();
    for (stage, node) in stages.chunks_exact_mut(width).zip(rule.nodes()) {
        let part = if node == 1.0 { end } else { begin + node * (end - begin) };
        for (input, value) in stage[..inputs].iter_mut().enumerate() {
            let (a, b) = (run.inputs[interval * inputs + input], run.inputs[(interval + 1) * inputs + input]);
            *value = between(a, b, part, run.held[input]);
        }
    }
}

/// A part of the way from a to b, exact at both ends.
fn between(a: f64, b: f64, part: f64, held: bool) -> f64 {
    if held || part == 0.0 {
        a
    } else if part == 1.0 {
        b
    } else {
        a + part * (b - a)
    }
}
