//! Samples to bins: the orthonormal cosine transform of every output of every run.
//!
//! The DCT-II sees no jump between the ends of a record, so that noise of long memory does not leak, and its bins are
//! nearly independent with the variance of the noise's spectrum at k / (2 N dt) (Ahmed, Natarajan & Rao 1974).
//!
//! Where an output was not measured its samples are closed up, in the residual and in all signals alike: every bin then
//! stands for one measured sample. An output that is measured at every fourth sample only is transformed at its own rate.
//!
//! Signals with their quadratures: what a gain and a phase make of a signal, in cosine bins.

use fdm_numeric::fourier::{ComplexFft, CosineTransform};
use fdm_system::record::even_grid::EvenGrid;
use num_complex::Complex;
use std::sync::Arc;

/// Where the mean of a record stands among its bins: as if it were the bin of this number. There a spectrum that is continued gives
/// the mean's variance: that of the first bin where the noise is white, 8 times as much for 1/f noise (7 if it began a thousand
/// record lengths ago), 64 times for 1/f^2 (a walk that began twenty record lengths ago).
pub(crate) const MEAN: f64 = 0.125;

/// The place of bin `k` among bins: its number, but of the mean.
pub(crate) fn ordinal(k: usize) -> f64 {
    (k as f64).max(MEAN)
}

/// Signals at the samples of one run, N by q row-major.
pub(crate) type Signals = Vec<f64>;

/// Rows of a run at which something was measured, rising. Of a thousand directions nothing else is kept.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MeasuredRows {
    list: Arc<[usize]>,
    /// Mean time between them, where the rows of the run are not even: a row may be there for its inputs alone.
    interval: Option<f64>,
}

impl MeasuredRows {
    /// Of measurements (N by q) at these times; none where something was measured at every row.
    pub(crate) fn of(measured: &[f64], channels: usize, time: &[f64]) -> Option<Self> {
        let rows: Vec<&[f64]> = measured.chunks_exact(channels.max(1)).collect();
        let list: Arc<[usize]> = (0..rows.len()).filter(|k| rows[*k].iter().any(|v| !v.is_nan())).collect();
        if list.len() == rows.len() {
            return None;
        }
        let even = EvenGrid::of(time).is_ok_and(|grid| grid.length() == time.len());
        let ends = list.first().zip(list.last()).filter(|_| !even && list.len() > 1);
        let interval = ends.map(|(first, last)| (time[*last] - time[*first]) / (list.len() - 1) as f64);
        Some(Self { list, interval })
    }

    /// A signal (N by q) at these rows.
    pub(crate) fn taken(rows: Option<&Self>, signal: Signals, channels: usize) -> Signals {
        let Some(Self { list, .. }) = rows else { return signal };
        list.iter().flat_map(|k| &signal[k * channels..][..channels]).copied().collect()
    }

    /// Where directions hold these samples.
    pub(crate) fn places(rows: Option<&Self>, samples: &[usize]) -> Vec<usize> {
        samples.iter().map(|k| rows.map_or(*k, |rows| rows.place(*k))).collect()
    }

    /// The place of a row among them.
    fn place(&self, row: usize) -> usize {
        self.list.partition_point(|own| *own < row)
    }

    /// Time between samples at which an output was measured, in a run with rows so far apart.
    pub(crate) fn between(rows: Option<&Self>, samples: &[usize], interval: f64) -> f64 {
        match rows.and_then(|rows| rows.interval.map(|own| (rows, own))) {
            Some((rows, own)) => own * spacing(&samples.iter().map(|k| rows.place(*k)).collect::<Vec<_>>()),
            None => interval * spacing(samples),
        }
    }
}

/// The usual distance between samples that follow each other.
fn spacing(samples: &[usize]) -> f64 {
    let mut steps: Vec<usize> = samples.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_unstable();
    steps.get(steps.len() / 2).map_or(1.0, |step| *step as f64)
}

/// Orthonormal cosine bins of a signal.
pub(crate) fn cosine_lines(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut bins: Vec<f64> = values.collect();
    let n = bins.len();
    CosineTransform::new(n).forward(&mut bins);
    let scale = (2.0 / n.max(1) as f64).sqrt();
    bins.iter_mut().for_each(|l| *l *= scale);
    if let Some(first) = bins.first_mut() {
        *first *= 0.5_f64.sqrt();
    }
    bins
}

/// Hilbert's transform of one length.
pub(crate) struct Quadrature {
    fft: ComplexFft,
    samples: usize,
}

impl Quadrature {
    pub(crate) fn new(samples: usize) -> Self {
        // twice as long, so that the ends do not meet
        Self { fft: ComplexFft::new(2 * samples), samples }
    }

    /// The signal a quarter of a period late, at every frequency.
    fn of(&mut self, signal: &[f64]) -> Vec<f64> {
        let long = 2 * self.samples;
        // continued by its mirror image, so that it does not jump
        let mirrored = signal.iter().chain(signal.iter().rev());
        let mut bins: Vec<Complex<f64>> = mirrored.map(|v| Complex::new(*v, 0.0)).collect();
        self.fft.forward(&mut bins);
        for (k, bin) in bins.iter_mut().enumerate() {
            *bin = match k {
                0 => Complex::default(),
                k if k < self.samples => *bin * Complex::new(0.0, -1.0),
                k if k > self.samples => *bin * Complex::new(0.0, 1.0),
                _ => Complex::default(),
            };
        }
        self.fft.backward(&mut bins);
        bins[..self.samples].iter().map(|c| c.re / long as f64).collect()
    }
}

/// A signal a quarter of a period late, at every frequency.
pub(crate) fn late(signal: &[f64]) -> Vec<f64> {
    Quadrature::new(signal.len()).of(signal)
}
