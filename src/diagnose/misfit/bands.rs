//! The error by frequency.

use super::misfit::Channel;
use rustdct::DctPlanner;
use serde::Serialize;

/// The share of lines, at the upper end, by which the noise is judged.
pub(super) const UPPER: f64 = 0.4;
/// Most octaves that are told apart; what is below the lowest is with it.
pub(super) const MOST: usize = 12;

/// Part of the error in one octave.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
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
pub(super) struct Powers {
    pub(super) error: f64,
    pub(super) noise: f64,
    /// Those of the record, and of the error, without their means.
    pub(super) measured: f64,
    pub(super) moving: f64,
}

/// Orthonormal cosine lines of a signal.
pub(super) fn cosine_lines(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut lines: Vec<f64> = values.collect();
    let n = lines.len();
    DctPlanner::new().plan_dct2(n).process_dct2(&mut lines);
    let scale = (2.0 / n.max(1) as f64).sqrt();
    lines.iter_mut().for_each(|l| *l *= scale);
    if let Some(first) = lines.first_mut() {
        *first *= 0.5_f64.sqrt();
    }
    lines
}

/// Frequency of a line.
pub(super) fn frequency(channel: &Channel<'_>, line: usize) -> f64 {
    line as f64 / (2.0 * channel.time.len() as f64 * channel.interval)
}

/// Values less their mean; zero where nothing was measured.
fn about_mean(values: &[f64]) -> impl Iterator<Item = f64> + '_ {
    let seen = values.iter().filter(|v| !v.is_nan()).count().max(1);
    let mean = values.iter().filter(|v| !v.is_nan()).sum::<f64>() / seen as f64;
    values.iter().map(move |v| if v.is_nan() { 0.0 } else { v - mean })
}

/// Root mean square of white noise that is as strong as the residuals in their upper lines: the median of their powers, so that a
/// line of a disturbance does not count.
pub(super) fn floor(channels: &[Channel<'_>]) -> f64 {
    let mut powers: Vec<f64> = Vec::new();
    for channel in channels {
        let lines = cosine_lines(channel.filled());
        let measured = channel.residual.iter().filter(|r| !r.is_nan()).count();
        let upper = ((1.0 - UPPER) * lines.len() as f64) as usize;
        // gaps take power from all lines alike
        let whole = lines.len() as f64 / measured.max(1) as f64;
        powers.extend(lines[upper..].iter().map(|l| l * l * whole));
    }
    root_of_median(powers)
}

/// The deviation of normal numbers with these squares, by the median of them.
pub(super) fn root_of_median(mut powers: Vec<f64>) -> f64 {
    powers.sort_by(f64::total_cmp);
    /// The median of chi-square with one degree of freedom.
    const MEDIAN: f64 = 0.454_936;
    powers.get(powers.len() / 2).map_or(0.0, |p| (p / MEDIAN).sqrt())
}

/// The error in octaves below half the sampling frequency.
pub(super) fn bands(channels: &[Channel<'_>], floor: f64) -> Vec<Band> {
    let highest = channels.iter().map(|c| 0.5 / c.interval).fold(0.0, f64::max);
    let longest = channels.iter().map(|c| c.time.len() as f64 * c.interval).fold(0.0, f64::max);
    if highest <= 0.0 || longest <= 0.0 {
        return Vec::new();
    }
    let count = ((highest * longest).log2().floor().max(1.0) as usize).min(MOST);
    let edge = |k: usize| if k == 0 { 0.0 } else { highest * 0.5_f64.powi((count - k) as i32) };
    let mut sums = vec![Powers::default(); count];
    for channel in channels {
        let share = channel.residual.iter().filter(|r| !r.is_nan()).count() as f64 / channel.time.len() as f64;
        let (error, moving) = (cosine_lines(channel.filled()), cosine_lines(about_mean(&channel.residual)));
        let measured = cosine_lines(about_mean(&channel.measured));
        for (line, ((error, moving), measured)) in error.into_iter().zip(moving).zip(measured).enumerate() {
            let f = frequency(channel, line);
            let band = &mut sums[(1..count).rev().find(|k| f >= edge(*k)).unwrap_or(0)];
            band.error += error * error;
            band.noise += floor * floor * share;
            band.moving += moving * moving;
            band.measured += measured * measured;
        }
    }
    shares(&sums, edge)
}

/// Bands from the sums of error and of noise in each, by their shares of the whole error.
pub(super) fn shares(sums: &[Powers], edge: impl Fn(usize) -> f64) -> Vec<Band> {
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
