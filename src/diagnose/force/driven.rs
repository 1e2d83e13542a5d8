//! What any force would do: exact responses of the fitted model, linear about its own, to given courses of a force at
//! every place at once.

use super::place::{ForceError, Passage, Place};
use crate::model::Model;
use crate::record::Run;
use crate::simulate::Simulator;
use fdm_grammar::model::Entry;

/// Columns of sensitivities that one simulation carries.
const COLUMNS: usize = 64;
/// Most courses of a force in one simulation.
const MOST: usize = 16;

/// A model that forces can enter.
pub(super) struct Driven {
    model: Model,
    places: usize,
    /// Courses of a force in one simulation.
    signals: usize,
    /// Parameters, inputs, outputs of the model without forces.
    params: usize,
    inputs: usize,
    outputs: usize,
}

impl Driven {
    pub(super) fn new(model: &Model, places: &[Place]) -> Self {
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
    pub(super) fn respond(
        &self,
        at: usize,
        passage: Passage<'_>,
        courses: &[Vec<f64>],
        take: &mut dyn FnMut(usize, usize, Vec<f64>),
    ) -> Result<(), ForceError> {
        let theta = self.theta(passage);
        let (n, q) = (passage.run.len(), self.outputs);
        let all = self.model.layout().outputs;
        for (batch, part) in courses.chunks(self.signals).enumerate() {
            let run = self.widened(passage.run, part);
            let columns: Vec<usize> = (0..self.places)
                .flat_map(|place| (0..part.len()).map(move |k| self.params + place * self.signals + k))
                .collect();
            let mut responses = vec![vec![0.0; n * q]; columns.len()];
            let mut simulator = Simulator::new(self.model.dynamics(), &run, passage.steps.clone())?;
            let copy = &mut |block: crate::simulate::Block<'_>| {
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
                .map_err(|divergence| ForceError::Diverged { run: at, at: divergence })?;
            for (column, response) in responses.into_iter().enumerate() {
                take(column / part.len(), batch * self.signals + column % part.len(), response);
            }
        }
        Ok(())
    }

    /// The states at the samples (N by n), by the fitted model alone.
    pub(super) fn states(&self, at: usize, passage: Passage<'_>) -> Result<Vec<f64>, ForceError> {
        let run = self.widened(passage.run, &[]);
        let (all, q) = (self.model.layout().outputs, self.outputs);
        let mut y = vec![0.0; run.len() * all];
        let mut simulator = Simulator::new(self.model.dynamics(), &run, passage.steps.clone())?;
        simulator
            .simulate(&self.theta(passage), &mut y)
            .map_err(|divergence| ForceError::Diverged { run: at, at: divergence })?;
        Ok(y.chunks_exact(all).flat_map(|row| &row[q..]).copied().collect())
    }

    fn theta(&self, passage: Passage<'_>) -> Vec<f64> {
        let mut theta = passage.theta.to_vec();
        theta.resize(self.params + self.places * self.signals, 0.0);
        theta
    }
}
