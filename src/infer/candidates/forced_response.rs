//! What any disturbance would do: exact responses of the fitted model, linear about its own, to given courses of a disturbance at
//! every place at once.

use super::place::Place;
use fdm_grammar::model::Entry;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Simulator, Steps};

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

    /// The response (N by q) to every course at every place is handed to `take` with the place and the course; none where there is none.
    pub(crate) fn respond(
        &self,
        (run, steps): (&Run, &Steps),
        theta: &[f64],
        courses: &[Vec<f64>],
        take: &mut dyn FnMut(usize, usize, Vec<f64>),
    ) -> Option<()> {
        if self.places == 0 {
            return Some(());
        }
        let mut all_theta = theta.to_vec();
        all_theta.resize(self.params + self.places * self.signals, 0.0);
        let (n, q) = (run.len(), self.outputs);
        for (batch, part) in courses.chunks(self.signals).enumerate() {
            let run = self.widened(run, part);
            let columns: Vec<usize> = (0..self.places)
                .flat_map(|place| (0..part.len()).map(move |k| self.params + place * self.signals + k))
                .collect();
            let mut responses = vec![vec![0.0; n * q]; columns.len()];
            let mut simulator = Simulator::new(self.model.dynamics(), &run, steps.clone()).ok()?;
            let copy = &mut |block: fdm_system::simulate::Block<'_>| {
                for sample in 0..block.samples() {
                    for output in 0..q {
                        let own = &block.layout.outputs[output].columns;
                        for (column, value) in own.iter().zip(block.row(sample, output)) {
                            responses[*column as usize][(block.first + sample) * q + output] = *value;
                        }
                    }
                }
            };
            simulator.stream(&all_theta, &columns, copy).ok()?;
            for (column, response) in responses.into_iter().enumerate() {
                take(column / part.len(), batch * self.signals + column % part.len(), response);
            }
        }
        Some(())
    }
}
