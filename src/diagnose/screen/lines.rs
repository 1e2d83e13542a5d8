//! Samples to lines: the orthonormal cosine transform of every output of every run.
//!
//! The DCT-II sees no jump between the ends of a record, so that noise of long memory does not leak, and its lines are
//! nearly independent with the variance of the noise's spectrum at k / (2 N dt) (Ahmed, Natarajan & Rao 1974).

use nalgebra::DMatrix;
use rustdct::DctPlanner;

/// Signals at the samples of one run, N by q row-major.
pub type Signals = Vec<f64>;

/// One run as screening sees it. All signals are N by q.
#[derive(Debug, Clone)]
pub struct Record {
    /// Time between samples.
    pub interval: f64,
    /// Measured minus model; NaN where nothing was measured.
    pub residual: Signals,
    /// Derivatives of the response by everything that was fitted; `None` for what belongs to other runs.
    pub fitted: Vec<Option<Signals>>,
    /// What each direction adds to the response, in the order of the directions.
    pub directions: Vec<Signals>,
}

impl Record {
    /// Samples N.
    pub(super) fn samples(&self, channels: usize) -> usize {
        self.residual.len() / channels.max(1)
    }
}

/// One output of one run as lines, without the first ones.
#[derive(Debug, Clone)]
pub(super) struct Lines {
    /// The output.
    pub(super) channel: usize,
    /// Frequencies, in cycles per unit of time.
    pub(super) frequency: Vec<f64>,
    /// Fitted sensitivities, then directions, then the residual, by columns.
    pub(super) columns: DMatrix<f64>,
}

impl Lines {
    /// Transforms all outputs of a run; the first `dropped` lines (the mean and the slowest drift) are left out.
    pub(super) fn of(record: &Record, channels: usize, dropped: usize, planner: &mut DctPlanner<f64>) -> Vec<Self> {
        let n = record.samples(channels);
        let dct = planner.plan_dct2(n);
        let scale = (2.0 / n as f64).sqrt();
        let mut buffer = vec![0.0; n];
        let count = record.fitted.len() + record.directions.len() + 1;
        let fitted = record.fitted.iter().map(Option::as_ref);
        let signals: Vec<Option<&Signals>> =
            fitted.chain(record.directions.iter().map(Some)).chain([Some(&record.residual)]).collect();
        (0..channels)
            .map(|channel| {
                let mut columns = DMatrix::zeros(n - dropped, count);
                for (mut column, signal) in columns.column_iter_mut().zip(&signals) {
                    let Some(signal) = signal else { continue };
                    for (k, value) in buffer.iter_mut().enumerate() {
                        let at = k * channels + channel;
                        // where nothing was measured, nothing is known to be wrong
                        *value = if record.residual[at].is_nan() { 0.0 } else { signal[at] };
                    }
                    dct.process_dct2(&mut buffer);
                    for (line, value) in column.iter_mut().zip(&buffer[dropped..]) {
                        *line = value * scale;
                    }
                }
                let frequency = (dropped..n).map(|k| k as f64 / (2.0 * n as f64 * record.interval)).collect();
                Self { channel, frequency, columns }
            })
            .collect()
    }
}
