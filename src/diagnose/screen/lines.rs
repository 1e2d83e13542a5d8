//! Samples to lines: the orthonormal cosine transform of every output of every run.
//!
//! The DCT-II sees no jump between the ends of a record, so that noise of long memory does not leak, and its lines are
//! nearly independent with the variance of the noise's spectrum at k / (2 N dt) (Ahmed, Natarajan & Rao 1974).
//!
//! Where an output was not measured its samples are closed up, in the residual and in all signals alike: every line then
//! stands for one measured sample. An output that is measured at every fourth sample only is transformed at its own rate.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use rustdct::{Dct2, DctPlanner};
use std::sync::Arc;

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

    /// Samples at which an output was measured.
    pub(super) fn measured(&self, channels: usize, channel: usize) -> Vec<usize> {
        (0..self.samples(channels)).filter(|k| !self.residual[k * channels + channel].is_nan()).collect()
    }
}

/// One output of one run as lines, without the first ones.
#[derive(Debug, Clone)]
pub(super) struct Lines {
    /// The run.
    pub(super) run: usize,
    /// The output.
    pub(super) channel: usize,
    /// Samples that were transformed (or lines that were given), by their places in the run.
    pub(super) samples: Vec<usize>,
    /// Whether the lines are a cosine transform of samples, which they can be turned back into.
    pub(super) sampled: bool,
    /// Frequencies, in cycles per unit of time.
    pub(super) frequency: Vec<f64>,
    /// Fitted sensitivities, then directions, by columns.
    pub(super) columns: DMatrix<f64>,
    /// The residual.
    pub(super) residual: DVector<f64>,
}

/// A run, an output, its measured samples, and their transform.
type Planned = (usize, usize, Vec<usize>, Arc<dyn Dct2<f64>>);

impl Lines {
    /// Transforms every output with at least `least` measured samples; the first `dropped` lines (the mean and the slowest
    /// drift) are left out.
    pub(super) fn of(records: &[Record], channels: usize, dropped: usize, least: usize) -> Vec<Self> {
        let mut planner = DctPlanner::new();
        let mut planned: Vec<Planned> = Vec::new();
        for (run, record) in records.iter().enumerate() {
            for channel in 0..channels {
                let samples = record.measured(channels, channel);
                if samples.len() >= least {
                    let dct = planner.plan_dct2(samples.len());
                    planned.push((run, channel, samples, dct));
                }
            }
        }
        let transformed = |(run, channel, samples, dct): Planned| {
            Self::one(&records[run], (run, channel, channels), samples, dropped, &*dct)
        };
        planned.into_par_iter().map(transformed).collect()
    }

    /// Takes signals that are lines already, with the frequency of every row of each run; outputs with at least `least` of
    /// them.
    pub(super) fn given(records: &[Record], frequencies: &[Vec<f64>], channels: usize, least: usize) -> Vec<Self> {
        let place = |run: usize| (0..channels).map(move |channel| (run, channel));
        let one = |(run, channel): (usize, usize)| {
            let (record, own) = (&records[run], &frequencies[run]);
            let samples = record.measured(channels, channel);
            let pick = |signal: &Signals| {
                DVector::from_iterator(samples.len(), samples.iter().map(|k| signal[k * channels + channel]))
            };
            let fitted = record.fitted.iter().map(Option::as_ref);
            let signals: Vec<Option<&Signals>> = fitted.chain(record.directions.iter().map(Some)).collect();
            let mut columns = DMatrix::zeros(samples.len(), signals.len());
            for (k, signal) in signals.iter().enumerate() {
                signal.iter().for_each(|signal| columns.set_column(k, &pick(signal)));
            }
            let (residual, frequency) = (pick(&record.residual), samples.iter().map(|k| own[*k]).collect());
            Self { run, channel, samples, sampled: false, frequency, columns, residual }
        };
        let lines: Vec<Self> =
            (0..records.len()).flat_map(place).collect::<Vec<_>>().into_par_iter().map(one).collect();
        lines.into_iter().filter(|l| l.samples.len() >= least).collect()
    }

    fn one(
        record: &Record,
        (run, channel, channels): (usize, usize, usize),
        samples: Vec<usize>,
        dropped: usize,
        dct: &dyn Dct2<f64>,
    ) -> Self {
        let n = samples.len();
        let scale = (2.0 / n as f64).sqrt();
        let mut buffer = vec![0.0; n];
        let mut scratch = vec![0.0; dct.get_scratch_len()];
        let mut transform = |signal: &Signals, lines: &mut [f64]| {
            for (value, k) in buffer.iter_mut().zip(&samples) {
                *value = signal[k * channels + channel];
            }
            dct.process_dct2_with_scratch(&mut buffer, &mut scratch);
            for (line, value) in lines.iter_mut().zip(&buffer[dropped..]) {
                *line = value * scale;
            }
        };
        let fitted = record.fitted.iter().map(Option::as_ref);
        let signals: Vec<Option<&Signals>> = fitted.chain(record.directions.iter().map(Some)).collect();
        let mut columns = DMatrix::zeros(n - dropped, signals.len());
        for (mut column, signal) in columns.column_iter_mut().zip(signals) {
            if let Some(signal) = signal {
                transform(signal, column.as_mut_slice());
            }
        }
        let mut residual = DVector::zeros(n - dropped);
        transform(&record.residual, residual.as_mut_slice());
        let interval = record.interval * spacing(&samples);
        let frequency = (dropped..n).map(|k| k as f64 / (2.0 * n as f64 * interval)).collect();
        Self { run, channel, samples, sampled: true, frequency, columns, residual }
    }
}

/// The usual distance between samples that follow each other.
fn spacing(samples: &[usize]) -> f64 {
    let mut steps: Vec<usize> = samples.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_unstable();
    steps.get(steps.len() / 2).map_or(1.0, |step| *step as f64)
}
