//! What any disturbance would do: exact responses of the fitted model, linear about its own, to given courses of a disturbance at
//! every place at once.

use super::place::{DisturbanceError, FittedRun, Place};
use fdm_grammar::model::Entry;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::Simulator;

/// Columns of sensitivities that one simulation carries.
const COLUMNS: usize = 64;
/// Most courses of a disturbance in one simulation.
const MOST: usize = 16;

/// A model that disturbances can enter.
pub(crate) struct ForcedResponse {
    model: Model,
    places: usize,
    /// Courses of a disturbance in one simulation.
    signals: usize,
    /// Parameters, inputs, outputs of the model without disturbances.
    params: usize,
    inputs: usize,
    outputs: usize,
}

impl ForcedResponse {
    pub(crate) fn new(model: &Model, places: &[Place]) -> Self {
        let entries: Vec<Entry> = places.iter().filter_map(Place::entry).collect();
        let signals = (COLUMNS / entries.len().max(1)).clamp(1, MOST);
        let definition = model.definition();
        Self {
            model: model.altered(definition.forced(&entries, signals)),
            places: entries.len(),
            signals,
            params: definition.params.len(),
            inputs: definition.inputs.len(),
            outputs: definition.outputs.len(),
        }
    }

    /// The run with these courses (each N) as inputs behind its own.
    fn widened(&self, run: &Run, courses: &[Vec<f64>]) -> Run {
        let (n, m) = (run.len(), self.inputs);
        let mut inputs = Vec::with_capacity(n * (m + self.signals));
        for k in 0..n {
            inputs.extend_from_slice(&run.inputs[k * m..(k + 1) * m]);
            inputs.extend((0..self.signals).map(|s| courses.get(s).map_or(0.0, |course| course[k])));
        }
        let mut wide = Run { inputs, ..run.clone() };
        wide.held.resize(m + self.signals, false);
        wide.input_gaps.resize(m + self.signals, 0);
        wide
    }

    /// The response (N by q) to every course at every place is handed to `take` with the place and the course.
    pub(crate) fn respond(
        &self,
        at: usize,
        fitted_run: FittedRun<'_>,
        courses: &[Vec<f64>],
        take: &mut dyn FnMut(usize, usize, Vec<f64>),
    ) -> Result<(), DisturbanceError> {
        if self.places == 0 {
            return Ok(());
        }
        let theta = self.theta(fitted_run);
        let (n, q) = (fitted_run.run.len(), self.outputs);
        let all = self.model.layout().outputs;
        for (batch, part) in courses.chunks(self.signals).enumerate() {
            let run = self.widened(fitted_run.run, part);
            let columns: Vec<usize> = (0..self.places)
                .flat_map(|place| (0..part.len()).map(move |k| self.params + place * self.signals + k))
                .collect();
            let mut responses = vec![vec![0.0; n * q]; columns.len()];
            let mut simulator = Simulator::new(self.model.dynamics(), &run, fitted_run.steps.clone())?;
            let copy = &mut |block: fdm_system::simulate::Block<'_>| {
                debug_assert_eq!(block.layout.outputs.len(), all);
                for sample in 0..block.samples() {
                    for output in 0..q {
                        let own = &block.layout.outputs[output].columns;
                        for (column, value) in own.iter().zip(block.row(sample, output)) {
                            responses[*column as usize][(block.first + sample) * q + output] = *value;
                        }
                    }
                }
            };
            simulator
                .stream(&theta, &columns, copy)
                .map_err(|divergence| DisturbanceError::Diverged { run: at, at: divergence })?;
            for (column, response) in responses.into_iter().enumerate() {
                take(column / part.len(), batch * self.signals + column % part.len(), response);
            }
        }
        Ok(())
    }

    /// The states at the samples (N by n), by the fitted model alone.
    pub(super) fn states(&self, at: usize, fitted_run: FittedRun<'_>) -> Result<Vec<f64>, DisturbanceError> {
        let run = self.widened(fitted_run.run, &[]);
        let (all, q) = (self.model.layout().outputs, self.outputs);
        let mut y = vec![0.0; run.len() * all];
        let mut simulator = Simulator::new(self.model.dynamics(), &run, fitted_run.steps.clone())?;
        simulator
            .simulate(&self.theta(fitted_run), &mut y)
            .map_err(|divergence| DisturbanceError::Diverged { run: at, at: divergence })?;
        Ok(y.chunks_exact(all).flat_map(|row| &row[q..]).copied().collect())
    }

    fn theta(&self, fitted_run: FittedRun<'_>) -> Vec<f64> {
        let mut theta = fitted_run.theta.to_vec();
        theta.resize(self.params + self.places * self.signals, 0.0);
        theta
    }
}
