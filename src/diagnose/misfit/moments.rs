//! The error by time, and by how large the response and the inputs are.

use super::misfit::{Channel, Left};
use serde::Serialize;

/// Windows of a run.
const WINDOWS: usize = 10;
/// Bins of an amplitude.
const BINS: usize = 4;

/// Part of the error in one window of time.
#[derive(Debug, Clone, PartialEq, Serialize)]
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
#[derive(Debug, Clone, PartialEq, Serialize)]
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

pub(super) fn windows(channels: &[Channel<'_>]) -> Vec<Window> {
    let squares = |c: &Channel<'_>| c.residual.iter().filter(|r| !r.is_nan()).map(|r| r * r).sum::<f64>();
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

pub(super) fn by_amplitude(
    name: &str,
    channels: &[Channel<'_>],
    runs: &[Left<'_>],
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
    for k in 1..=BINS {
        let mut last = (k * pairs.len() / BINS).max(first);
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
