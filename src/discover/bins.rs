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
use fdm_numeric::parallel;
use fdm_system::record::even_grid::EvenGrid;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex;
use std::borrow::Cow;
use std::f64::consts::FRAC_1_SQRT_2;
use std::sync::Arc;

/// Bins that are left out at the low end: the mean, and the slowest drift of noise with a long memory.
pub(super) const DROPPED: usize = 4;

/// Where the mean of a record stands among its bins: as if it were the bin of this number. There a spectrum that is continued gives
/// the mean's variance: that of the first bin where the noise is white, 8 times as much for 1/f noise (7 if it began a thousand
/// record lengths ago), 64 times for 1/f^2 (a walk that began twenty record lengths ago).
pub(super) const MEAN: f64 = 0.125;

/// The place of bin `k` among bins: its number, but of the mean.
pub(super) fn ordinal(k: usize) -> f64 {
    (k as f64).max(MEAN)
}

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
    /// What each direction adds to the response, in the order of the directions; at the measured rows only, where they are given.
    pub directions: Vec<Signals>,
    /// Rows at which something was measured; none where that is so at all of them.
    pub rows: Option<MeasuredRows>,
    /// Deviation of the noise at each sample in that of its output (N by q), where it is not even; all signals are divided by it.
    pub deviations: Option<Signals>,
}

/// Rows of a run at which something was measured, rising. Of a thousand directions nothing else is kept.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredRows {
    list: Arc<[usize]>,
    /// Mean time between them, where the rows of the run are not even: a row may be there for its inputs alone.
    interval: Option<f64>,
}

impl MeasuredRows {
    /// Of measurements (N by q) at these times; none where something was measured at every row.
    pub(super) fn of(measured: &[f64], channels: usize, time: &[f64]) -> Option<Self> {
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
    pub(super) fn taken(rows: Option<&Self>, signal: Signals, channels: usize) -> Signals {
        let Some(Self { list, .. }) = rows else { return signal };
        list.iter().flat_map(|k| &signal[k * channels..][..channels]).copied().collect()
    }

    /// The rows, and the time between them, where those of the run are not even.
    pub(super) fn uneven(&self) -> Option<(&[usize], f64)> {
        self.interval.map(|interval| (&*self.list, interval))
    }

    /// Where directions hold these samples.
    pub(super) fn places(rows: Option<&Self>, samples: &[usize]) -> Vec<usize> {
        samples.iter().map(|k| rows.map_or(*k, |rows| rows.place(*k))).collect()
    }

    /// The place of a row among them.
    fn place(&self, row: usize) -> usize {
        self.list.partition_point(|own| *own < row)
    }

    /// Time between samples at which an output was measured, in a run with rows so far apart.
    pub(super) fn between(rows: Option<&Self>, samples: &[usize], interval: f64) -> f64 {
        match rows.and_then(|rows| rows.interval.map(|own| (rows, own))) {
            Some((rows, own)) => own * spacing(&samples.iter().map(|k| rows.place(*k)).collect::<Vec<_>>()),
            None => interval * spacing(samples),
        }
    }
}

impl Record {
    /// A direction at all rows (N by q), zero where nothing was measured.
    pub(super) fn direction(&self, direction: usize, channels: usize) -> Cow<'_, [f64]> {
        let own = &self.directions[direction];
        let Some(MeasuredRows { list, .. }) = &self.rows else { return Cow::Borrowed(own) };
        let mut whole = vec![0.0; self.residual.len()];
        for (k, values) in list.iter().zip(own.chunks_exact(channels)) {
            whole[k * channels..][..channels].copy_from_slice(values);
        }
        Cow::Owned(whole)
    }

    /// Fitted sensitivities, then directions, each with the places at which it holds these samples.
    fn signals<'a>(&'a self, samples: &'a [usize], places: &'a [usize]) -> Vec<Option<(&'a Signals, &'a [usize])>> {
        let fitted = self.fitted.iter().map(|own| own.as_ref().map(|own| (own, samples)));
        fitted.chain(self.directions.iter().map(|own| Some((own, places)))).collect()
    }

    /// Where directions hold these samples.
    fn places(&self, samples: &[usize]) -> Vec<usize> {
        MeasuredRows::places(self.rows.as_ref(), samples)
    }

    /// Leaves the rows at which something was measured, where those of the run are not even: which they are. Directions are not for this.
    pub(super) fn where_measured(&mut self, channels: usize) -> Option<Vec<usize>> {
        let rows = self.rows.take_if(|rows| rows.uneven().is_some())?;
        let (list, interval) = rows.uneven()?;
        let taken = |signal: &mut Signals| *signal = MeasuredRows::taken(Some(&rows), std::mem::take(signal), channels);
        taken(&mut self.residual);
        self.fitted.iter_mut().flatten().for_each(taken);
        self.deviations.as_mut().map(taken);
        (self.interval, self.directions) = (interval, Vec::new());
        Some(list.to_vec())
    }

    /// Samples N.
    pub(super) fn samples(&self, channels: usize) -> usize {
        self.residual.len() / channels.max(1)
    }

    /// Samples at which an output was measured.
    pub(super) fn measured(&self, channels: usize, channel: usize) -> Vec<usize> {
        (0..self.samples(channels)).filter(|k| !self.residual[k * channels + channel].is_nan()).collect()
    }
}

/// One output of one run as bins, without the first ones.
#[derive(Debug, Clone)]
pub(super) struct OutputBins {
    /// The run.
    pub(super) run: usize,
    /// The output.
    pub(super) channel: usize,
    /// Samples that were transformed (or bins that were given), by their places in the run.
    pub(super) samples: Vec<usize>,
    /// Whether the bins are a cosine transform of samples, which they can be turned back into.
    pub(super) sampled: bool,
    /// Frequencies, in cycles per unit of time.
    pub(super) frequency: Vec<f64>,
    /// Fitted sensitivities, then directions, by columns.
    pub(super) columns: DMatrix<f64>,
    /// The residual.
    pub(super) residual: DVector<f64>,
}

/// A run, an output, its measured samples, and their transform.
type Planned = (usize, usize, Vec<usize>, CosineTransform);

impl OutputBins {
    /// Transforms every output with at least `least` measured samples; the first `dropped` bins (the mean and the slowest
    /// drift) are left out.
    pub(super) fn of(records: &[Record], channels: usize, dropped: usize, least: usize) -> Vec<Self> {
        let mut planned: Vec<Planned> = Vec::new();
        for (run, record) in records.iter().enumerate() {
            for channel in 0..channels {
                let samples = record.measured(channels, channel);
                if samples.len() >= least {
                    let dct = CosineTransform::new(samples.len());
                    planned.push((run, channel, samples, dct));
                }
            }
        }
        let transformed = |(run, channel, samples, dct): Planned| {
            Self::one(&records[run], (run, channel, channels), samples, dropped, dct)
        };
        parallel::map(planned, transformed)
    }

    /// Takes signals that are bins already, with the frequency of every row of each run; outputs with at least `least` of
    /// them.
    pub(super) fn given(records: &[Record], frequencies: &[Vec<f64>], channels: usize, least: usize) -> Vec<Self> {
        let place = |run: usize| (0..channels).map(move |channel| (run, channel));
        let one = |(run, channel): (usize, usize)| {
            let (record, own) = (&records[run], &frequencies[run]);
            let samples = record.measured(channels, channel);
            let pick = |signal: &Signals, places: &[usize]| {
                DVector::from_iterator(samples.len(), places.iter().map(|k| signal[k * channels + channel]))
            };
            let places = record.places(&samples);
            let signals = record.signals(&samples, &places);
            let mut columns = DMatrix::zeros(samples.len(), signals.len());
            for (k, signal) in signals.iter().enumerate() {
                signal.iter().for_each(|(signal, places)| columns.set_column(k, &pick(signal, places)));
            }
            let (residual, frequency) = (pick(&record.residual, &samples), samples.iter().map(|k| own[*k]).collect());
            Self { run, channel, samples, sampled: false, frequency, columns, residual }
        };
        let bins = parallel::map((0..records.len()).flat_map(place), one);
        bins.into_iter().filter(|l| l.samples.len() >= least).collect()
    }

    fn one(
        record: &Record,
        (run, channel, channels): (usize, usize, usize),
        samples: Vec<usize>,
        dropped: usize,
        mut dct: CosineTransform,
    ) -> Self {
        let n = samples.len();
        let scale = (2.0 / n as f64).sqrt();
        let mut buffer = vec![0.0; n];
        let mut transform = |signal: &Signals, places: &[usize], bins: &mut [f64]| {
            for ((value, k), place) in buffer.iter_mut().zip(&samples).zip(places) {
                let deviation = record.deviations.as_ref().map_or(1.0, |own| own[k * channels + channel]);
                *value = signal[place * channels + channel] / deviation;
            }
            dct.forward(&mut buffer);
            for (bin, value) in bins.iter_mut().zip(&buffer[dropped..]) {
                *bin = value * scale;
            }
            if dropped == 0 {
                bins[0] *= FRAC_1_SQRT_2;
            }
        };
        let places = record.places(&samples);
        let signals = record.signals(&samples, &places);
        let mut columns = DMatrix::zeros(n - dropped, signals.len());
        for (mut column, signal) in columns.column_iter_mut().zip(signals) {
            if let Some((signal, places)) = signal {
                transform(signal, places, column.as_mut_slice());
            }
        }
        let mut residual = DVector::zeros(n - dropped);
        transform(&record.residual, &samples, residual.as_mut_slice());
        let interval = MeasuredRows::between(record.rows.as_ref(), &samples, record.interval);
        let frequency = (dropped..n).map(|k| ordinal(k) / (2.0 * n as f64 * interval)).collect();
        Self { run, channel, samples, sampled: true, frequency, columns, residual }
    }
}

/// The usual distance between samples that follow each other.
fn spacing(samples: &[usize]) -> f64 {
    let mut steps: Vec<usize> = samples.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_unstable();
    steps.get(steps.len() / 2).map_or(1.0, |step| *step as f64)
}

/// Cosine transform of one length, without its first bins.
pub(super) struct Cosines {
    transform: CosineTransform,
    buffer: Vec<f64>,
}

impl Cosines {
    pub(super) fn new(samples: usize) -> Self {
        Self { transform: CosineTransform::new(samples), buffer: vec![0.0; samples] }
    }

    /// The first bins behind those that are dropped, of values that are zero where nothing was measured.
    pub(super) fn bins(&mut self, values: impl Iterator<Item = f64>, into: &mut [f64]) {
        let n = self.buffer.len();
        self.buffer.iter_mut().zip(values).for_each(|(b, v)| *b = v);
        self.transform.forward(&mut self.buffer);
        let scale = (2.0 / n as f64).sqrt();
        into.iter_mut().zip(&self.buffer[DROPPED..]).for_each(|(bin, value)| *bin = value * scale);
    }
}

/// Orthonormal cosine bins of a signal.
pub(super) fn cosine_lines(values: impl Iterator<Item = f64>) -> Vec<f64> {
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
pub(super) struct Quadrature {
    fft: ComplexFft,
    samples: usize,
}

impl Quadrature {
    pub(super) fn new(samples: usize) -> Self {
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

    /// Bins of a signal (without its mean) and of its quadrature (L by 2).
    pub(super) fn bins(&mut self, cosines: &mut Cosines, signal: &[f64]) -> DMatrix<f64> {
        let mean = signal.iter().sum::<f64>() / signal.len().max(1) as f64;
        let centred: Vec<f64> = signal.iter().map(|v| v - mean).collect();
        let late = self.of(&centred);
        let mut bins = DMatrix::zeros(self.samples - DROPPED, 2);
        cosines.bins(centred.into_iter(), bins.column_mut(0).as_mut_slice());
        cosines.bins(late.into_iter(), bins.column_mut(1).as_mut_slice());
        bins
    }
}

/// A signal a quarter of a period late, at every frequency.
pub(super) fn late(signal: &[f64]) -> Vec<f64> {
    Quadrature::new(signal.len()).of(signal)
}
