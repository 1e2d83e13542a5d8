//! Steps and inputs of one run, for whoever integrates more than the states: what a filter walks along.

use super::drive::DriveTable;
use super::grid::Grid;
use super::simulator::Unsuited;
use super::steps::Steps;
use crate::dynamics::Layout;
use crate::record::Run;

/// The grid of a run and what drives a model on it.
pub(crate) struct Course<'a> {
    run: &'a Run,
    grid: Grid,
    drive: DriveTable,
}

impl<'a> Course<'a> {
    /// For models of this layout, of any outputs; states are not delayed.
    ///
    /// # Errors
    /// [`Unsuited::OtherInputs`] for a run of another model.
    pub(crate) fn new(layout: &Layout, run: &'a Run, steps: &Steps) -> Result<Self, Unsuited> {
        if run.held.len() != layout.inputs || run.inputs.len() != run.len() * layout.inputs {
            return Err(Unsuited::OtherInputs { found: run.held.len(), expected: layout.inputs });
        }
        let grid = Grid::new(&run.time, steps);
        let drive = DriveTable::new(layout, run, &grid, steps, false);
        Ok(Self { run, grid, drive })
    }

    /// Moves the delayed inputs by these delays.
    pub(crate) fn delay(&mut self, tau: &[f64]) {
        self.drive.delay(tau, self.run, &self.grid, false);
    }

    /// The run.
    pub(crate) fn run(&self) -> &'a Run {
        self.run
    }

    /// Number of steps.
    pub(crate) fn steps(&self) -> usize {
        self.grid.steps()
    }

    /// The sample that stands at the beginning of step k, or at the end of the last one, if one does.
    pub(crate) fn sample_at(&self, node: usize) -> Option<usize> {
        self.grid.sample_at(node)
    }

    /// Beginning and length of a step.
    pub(crate) fn step(&self, k: usize) -> (f64, f64) {
        self.grid.step(k)
    }

    /// Drive at the beginning, in the middle and at the end of a step, and the slopes of the delayed inputs there.
    pub(crate) fn stage(&self, step: usize, stage: usize) -> (&[f64], &[f64]) {
        let (width, delays) = (self.drive.width(), self.drive.delays());
        (&self.drive.stages(step)[stage * width..][..width], &self.drive.stage_slopes(step)[stage * delays..][..delays])
    }

    /// The same at a sample.
    pub(crate) fn sample(&self, sample: usize) -> (&[f64], &[f64]) {
        let width = self.drive.width();
        (&self.drive.all_samples()[sample * width..][..width], self.drive.sample_slopes(sample))
    }
}
