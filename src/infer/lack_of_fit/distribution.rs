//! The error by frequency.
//!
//! The error by time, and by how large the response and the inputs are.

use crate::bins::cosine_lines;
use fdm_system::record::Run;
use serde::{Deserialize, Serialize};

/// The share of bins, at the upper end, by which the noise is judged.
pub(crate) const UPPER: f64 = 0.4;
/// Most octaves that are told apart; what is below the lowest is with it.
pub(crate) const OCTAVES: usize = 12;

/// What a model left of a run.
#[derive(Debug, Clone, Copy)]
pub struct RunResidual<'a> {
    /// The record (N samples of q outputs), evenly sampled.
    pub run: &'a Run,
    /// Measured less modelled (N by q); NaN where nothing was measured.
    pub residual: &'a [f64],
    /// Time between samples.
    pub interval: f64,
}

/// One output of one run.
pub(crate) struct OutputResidual<'a> {
    pub(crate) run: &'a str,
    pub(crate) time: &'a [f64],
    pub(crate) interval: f64,
    /// Measured minus model; NaN where nothing was measured.
    pub(crate) residual: Vec<f64>,
    pub(crate) measured: Vec<f64>,
    pub(crate) response: Vec<f64>,
}

impl OutputResidual<'_> {
    /// The residual, zero where nothing was measured.
    pub(crate) fn filled(&self) -> impl Iterator<Item = f64> + '_ {
        self.residual.iter().map(|r| if r.is_nan() { 0.0 } else { *r })
    }
}

/// Part of the error in one octave.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
pub struct Band {
    /// Lowest frequency, in cycles per unit of time; 0 holds the mean.
    pub low: f64,
    /// Highest.
    pub high: f64,
    /// Share of the mean square of the residuals.
    pub share: f64,
    /// The share that noise would have there which is as strong as in the upper frequencies.
    pub noise: f64,
    /// The part of the record's power there that the model explains, means aside: 1 where nothing is left, below 0 where the model is
    /// worse than none; nothing where the record has no power.
    pub explained: Option<f64>,
}

/// Powers in one band.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Powers {
    pub(crate) error: f64,
    pub(crate) noise: f64,
    /// Those of the record, and of the error, without their means.
    pub(crate) measured: f64,
    pub(crate) moving: f64,
}

/// Frequency of a bin.
pub(crate) fn frequency(channel: &OutputResidual<'_>, bin: usize) -> f64 {
    bin as f64 / (2.0 * channel.time.len() as f64 * channel.interval)
}

/// Values less their mean; zero where nothing was measured.
fn about_mean(values: &[f64]) -> impl Iterator<Item = f64> + '_ {
    let seen = values.iter().filter(|v| !v.is_nan()).count().max(1);
    let mean = values.iter().filter(|v| !v.is_nan()).sum::<f64>() / seen as f64;
    values.iter().map(move |v| if v.is_nan() { 0.0 } else { v - mean })
}

/// Root mean square of white noise that is as strong as the residuals in their upper bins: the median of their powers, so that a
/// bin of a disturbance does not count.
pub(crate) fn noise_level(channels: &[OutputResidual<'_>]) -> f64 {
    let mut powers: Vec<f64> = Vec::new();
    for channel in channels {
        let bins = cosine_lines(channel.filled());
        let measured = channel.residual.iter().filter(|r| !r.is_nan()).count();
        let upper = ((1.0 - UPPER) * bins.len() as f64) as usize;
        // gaps take power from all bins alike
        let whole = bins.len() as f64 / measured.max(1) as f64;
        powers.extend(bins[upper..].iter().map(|l| l * l * whole));
    }
    root_of_median(powers)
}

/// The deviation of normal numbers with these squares, by the median of them.
pub(crate) fn root_of_median(mut powers: Vec<f64>) -> f64 {
    powers.sort_by(f64::total_cmp);
    /// The median of chi-square with one degree of freedom.
    const MEDIAN: f64 = 0.454_936;
    powers.get(powers.len() / 2).map_or(0.0, |p| (p / MEDIAN).sqrt())
}

/// The error in octaves below half the sampling frequency.
pub(crate) fn bands(channels: &[OutputResidual<'_>], noise_level: f64) -> Vec<Band> {
    let highest = channels.iter().map(|c| 0.5 / c.interval).fold(0.0, f64::max);
    let longest = channels.iter().map(|c| c.time.len() as f64 * c.interval).fold(0.0, f64::max);
    if highest <= 0.0 || longest <= 0.0 {
        return Vec::new();
    }
    let count = ((highest * longest).log2().floor().max(1.0) as usize).min(OCTAVES);
    let edge = |k: usize| if k == 0 { 0.0 } else { highest * 0.5_f64.powi((count - k) as i32) };
    let mut sums = vec![Powers::default(); count];
    for channel in channels {
        let share = channel.residual.iter().filter(|r| !r.is_nan()).count() as f64 / channel.time.len() as f64;
        let (error, moving) = (cosine_lines(channel.filled()), cosine_lines(about_mean(&channel.residual)));
        let measured = cosine_lines(about_mean(&channel.measured));
        for (bin, ((error, moving), measured)) in error.into_iter().zip(moving).zip(measured).enumerate() {
            let f = frequency(channel, bin);
            let band = &mut sums[(1..count).rev().find(|k| f >= edge(*k)).unwrap_or(0)];
            band.error += error * error;
            band.noise += noise_level * noise_level * share;
            band.moving += moving * moving;
            band.measured += measured * measured;
        }
    }
    shares(&sums, edge)
}

/// Bands from the sums of error and of noise in each, by their shares of the whole error.
pub(crate) fn shares(sums: &[Powers], edge: impl Fn(usize) -> f64) -> Vec<Band> {
    let total: f64 = sums.iter().map(|s| s.error).sum();
    let part = |value: f64| if total > 0.0 { value / total } else { 0.0 };
    let one = |(k, powers): (usize, &Powers)| Band {
        low: edge(k),
        high: edge(k + 1),
        share: part(powers.error),
        noise: part(powers.noise),
        explained: (powers.measured > 0.0).then(|| 1.0 - powers.moving / powers.measured),
    };
    sums.iter().enumerate().map(one).collect()
}

/// Windows of a run.
const WINDOWS: usize = 10;
/// Bins of an amplitude.
const AMPLITUDES: usize = 4;

/// Part of the error in one window of time.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Window {
    /// The run.
    pub run: String,
    /// From this time since the run began.
    pub from: f64,
    /// To this time.
    pub to: f64,
    /// Share of the mean square of the residuals of all runs.
    pub share: f64,
    /// Share of the compared samples.
    pub samples: f64,
}

/// The error where a signal is of some size.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct AmplitudeBin {
    /// The signal: an output of the model (its distance from its middle), or an input.
    pub signal: String,
    /// Least magnitude.
    pub from: f64,
    /// Largest magnitude.
    pub to: f64,
    /// Root mean square of the residuals there.
    pub rms: f64,
    /// Compared samples there.
    pub samples: usize,
}

pub(crate) fn windows(channels: &[OutputResidual<'_>]) -> Vec<Window> {
    let squares = |c: &OutputResidual<'_>| c.residual.iter().filter(|r| !r.is_nan()).map(|r| r * r).sum::<f64>();
    let count = |residual: &[f64]| residual.iter().filter(|r| !r.is_nan()).count() as f64;
    let total: f64 = channels.iter().map(squares).sum();
    let all: f64 = channels.iter().map(|c| count(&c.residual)).sum();
    let mut windows = Vec::new();
    for channel in channels {
        let n = channel.time.len();
        for k in 0..WINDOWS.min(n) {
            let rows = k * n / WINDOWS.min(n)..(k + 1) * n / WINDOWS.min(n);
            let own = &channel.residual[rows.clone()];
            let error: f64 = own.iter().filter(|r| !r.is_nan()).map(|r| r * r).sum();
            windows.push(Window {
                run: channel.run.to_string(),
                from: channel.time[rows.start],
                to: channel.time[rows.end - 1],
                share: if total > 0.0 { error / total } else { 0.0 },
                samples: if all > 0.0 { count(own) / all } else { 0.0 },
            });
        }
    }
    windows
}

pub(crate) fn by_amplitude(
    name: &str,
    channels: &[OutputResidual<'_>],
    runs: &[RunResidual<'_>],
    inputs: &[(String, usize)],
) -> Vec<AmplitudeBin> {
    let mut bins = Vec::new();
    let mut own: Vec<(f64, f64)> = Vec::new();
    for channel in channels {
        let mut seen: Vec<f64> = channel.response.iter().copied().filter(|y| !y.is_nan()).collect();
        seen.sort_by(f64::total_cmp);
        let middle = seen.get(seen.len() / 2).copied().unwrap_or_default();
        own.extend(channel.response.iter().zip(&channel.residual).map(|(y, r)| ((y - middle).abs(), *r)));
    }
    bins.extend(binned(name, own));
    for (input, k) in inputs {
        let pairs = runs.iter().zip(channels).flat_map(|(left, channel)| {
            let width = left.run.held.len().max(1);
            left.run.inputs.iter().skip(*k).step_by(width).map(|u| u.abs()).zip(channel.residual.iter().copied())
        });
        bins.extend(binned(input, pairs.collect()));
    }
    bins
}

/// Bins with as many samples each; fewer where many values are the same.
fn binned(signal: &str, mut pairs: Vec<(f64, f64)>) -> Vec<AmplitudeBin> {
    pairs.retain(|(a, r)| a.is_finite() && r.is_finite());
    pairs.sort_by(|x, y| x.0.total_cmp(&y.0));
    let mut bins = Vec::new();
    let mut first = 0;
    for k in 1..=AMPLITUDES {
        let mut last = (k * pairs.len() / AMPLITUDES).max(first);
        // equal amplitudes stay together
        while last > first && last < pairs.len() && pairs[last].0 <= pairs[last - 1].0 {
            last += 1;
        }
        let own = &pairs[first..last];
        if let (Some(low), Some(high)) = (own.first(), own.last()) {
            let rms = (own.iter().map(|(_, r)| r * r).sum::<f64>() / own.len() as f64).sqrt();
            bins.push(AmplitudeBin { signal: signal.into(), from: low.0, to: high.0, rms, samples: own.len() });
        }
        first = last;
    }
    bins
}
