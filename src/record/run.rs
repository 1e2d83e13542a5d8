//! One recorded manoeuvre, in the model's own channels, order and units.

use std::ops::Range;

/// A record ready for simulation: what drove the vehicle and what was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Name that tables show, unique among the runs of a problem.
    pub name: String,
    /// Time since the run began (N), in the model's time unit, strictly rising from 0. For a model without states
    /// and without explicit time it counts samples.
    pub time: Vec<f64>,
    /// Inputs, one row per sample (N by m), in the model's units, hidden ones (records of outputs) behind the declared
    /// ones; gaps are bridged linearly and counted.
    pub inputs: Vec<f64>,
    /// Whether an input keeps its value until the next sample (m); otherwise it is linear between samples.
    pub held: Vec<bool>,
    /// Measured outputs, one row per sample (N by q), in the model's units; NaN where nothing is to be compared.
    pub measured: Vec<f64>,
    /// Cells of each input that were empty (m).
    pub input_gaps: Vec<usize>,
    /// Cells of each output that were empty (q).
    pub output_gaps: Vec<usize>,
}

impl Run {
    /// Number of samples N.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Some neighbouring samples as a run of the same name; their times stay those of the whole record, so that a part that
    /// does not begin with the first sample begins later than 0.
    ///
    /// # Panics
    /// When there are fewer samples than the range wants.
    pub fn part(&self, samples: Range<usize>) -> Self {
        let n = self.len().max(1);
        let (m, q) = (self.inputs.len() / n, self.measured.len() / n);
        let rows = |values: &[f64], width: usize| values[samples.start * width..samples.end * width].to_vec();
        Self {
            time: self.time[samples.clone()].to_vec(),
            inputs: rows(&self.inputs, m),
            measured: rows(&self.measured, q),
            ..self.clone()
        }
    }

    /// The run with these inputs and outputs only, in this order.
    ///
    /// # Panics
    /// When there is no such channel.
    pub fn with_channels(&self, inputs: &[usize], outputs: &[usize]) -> Self {
        let (m, q) = (self.held.len(), self.output_gaps.len());
        let columns = |values: &[f64], width: usize, chosen: &[usize]| -> Vec<f64> {
            values.chunks_exact(width.max(1)).flat_map(|row| chosen.iter().map(|c| row[*c])).collect()
        };
        Self {
            name: self.name.clone(),
            time: self.time.clone(),
            inputs: columns(&self.inputs, m, inputs),
            held: inputs.iter().map(|i| self.held[*i]).collect(),
            measured: columns(&self.measured, q, outputs),
            input_gaps: inputs.iter().map(|i| self.input_gaps[*i]).collect(),
            output_gaps: outputs.iter().map(|o| self.output_gaps[*o]).collect(),
        }
    }
}
