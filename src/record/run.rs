//! One recorded manoeuvre, in the model's own channels, order and units.

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
}
