//! The lack of fit of every output before anything is explained: how large, in which band, when, at which amplitudes.
//!
//! **In** a fitted model, its runs, residuals. **Out** a [`LackOfFit`] for every output, with sentences. **Never** names a
//! cause, simulates or fits. **Start** at [`lack_of_fit()`]; `distribution` (by frequency, time and amplitude), `gain_phase` (gain and
//! phase of the record against the model).

mod distribution;
mod gain_phase;
#[cfg(test)]
mod tests;

pub use distribution::{AmplitudeBin, Band, RunResidual, Window};
pub use gain_phase::Gain;

use distribution::{
    OCTAVES, OutputResidual, Powers, UPPER, bands, by_amplitude, noise_level, root_of_median, shares, windows,
};
use fdm_estimate::residuals::{OutputFit, residuals};
use fdm_system::model::Model;
use gain_phase::{Signals, gains, gains_of};
use serde::{Deserialize, Serialize};

/// What is wrong with one output, all runs together.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct LackOfFit {
    /// The output.
    pub output: String,
    /// Its unit, as text.
    pub unit: Option<String>,
    /// Compared samples.
    pub compared: usize,
    /// Root mean square of the residuals.
    pub rms: f64,
    /// The noise of the record by its upper frequencies, as a root mean square over all of them.
    pub noise_level: f64,
    /// Share of the mean square that is above this level.
    pub above_noise_level: f64,
    /// Theil's inequality coefficient; none where record and response are zero.
    pub tic: Option<f64>,
    /// Parts of the error by frequency, octaves from low to high.
    pub bands: Vec<Band>,
    /// Parts of the error by time, run by run.
    pub windows: Vec<Window>,
    /// The error by the size of the model's response and of the inputs.
    pub amplitudes: Vec<AmplitudeBin>,
    /// Gain and phase of the record against the model's response, where there is power and the difference is clear.
    pub gains: Vec<Gain>,
    /// All that stands out, in words.
    pub sentences: Vec<String>,
}

/// Describes what is wrong with every output that was measured, in the model's order.
pub fn lack_of_fit(model: &Model, runs: &[RunResidual<'_>]) -> Vec<LackOfFit> {
    let q = model.layout().outputs;
    (0..q).filter_map(|output| of_output(model, runs, output, q)).collect()
}

fn of_output(model: &Model, runs: &[RunResidual<'_>], output: usize, q: usize) -> Option<LackOfFit> {
    let runs: Vec<RunResidual<'_>> = runs.iter().copied().filter(|r| r.run.len() > 1).collect();
    let channels: Vec<OutputResidual<'_>> = runs.iter().map(|r| channel(r, output, q)).collect();
    let definition = model.definition();
    let quantity = &definition.outputs[output].quantity;
    let cells = || channels.iter().flat_map(|c| c.residual.iter().zip(&c.response)).filter(|(r, _)| !r.is_nan());
    let (measured, modelled): (Vec<f64>, Vec<f64>) = cells().map(|(r, y)| (r + y, *y)).unzip();
    let fit = OutputFit::new(&quantity.name, "", &measured, &modelled, 0, 1);
    let rms = fit.rms?;
    let noise_level = noise_level(&channels);
    let inputs: Vec<(String, usize)> = definition
        .inputs
        .iter()
        .enumerate()
        .filter(|(_, i)| i.is_declared())
        .map(|(k, i)| (i.quantity.name.clone(), k))
        .collect();
    let mut lack_of_fit = LackOfFit {
        output: quantity.name.clone(),
        unit: quantity.unit.as_ref().map(ToString::to_string),
        compared: fit.compared,
        rms,
        noise_level,
        above_noise_level: if rms > 0.0 { (1.0 - (noise_level / rms).powi(2)).max(0.0) } else { 0.0 },
        tic: fit.tic,
        bands: bands(&channels, noise_level),
        windows: windows(&channels),
        amplitudes: by_amplitude(&quantity.name, &channels, &runs, &inputs),
        gains: gains(&channels),
        sentences: Vec::new(),
    };
    lack_of_fit.sentences = sentences(&lack_of_fit, &definition.time.to_string(), runs.len());
    Some(lack_of_fit)
}

fn channel<'a>(left: &RunResidual<'a>, output: usize, q: usize) -> OutputResidual<'a> {
    let column = |values: &[f64]| -> Vec<f64> { values.iter().skip(output).step_by(q).copied().collect() };
    let (residual, measured) = (column(left.residual), column(&left.run.measured));
    // where nothing was measured the response is not known here, and not compared
    let response = measured.iter().zip(&residual).map(|(z, r)| z - r).collect();
    OutputResidual { run: &left.run.name, time: &left.run.time, interval: left.interval, residual, measured, response }
}

/// A run in bins of its spectrum: real and imaginary parts one after the other.
#[derive(Debug, Clone)]
pub(crate) struct BinnedResidual {
    /// Its frequencies (2 M, each twice), in cycles per unit of time.
    pub frequency: Vec<f64>,
    /// Measured bins (2 M by q), of the variance of samples; NaN where nothing was measured.
    pub measured: Vec<f64>,
    /// Bins of the model's response (2 M by q).
    pub response: Vec<f64>,
    /// Samples in time.
    pub samples: usize,
}

/// One output of one run.
struct BinnedOutput {
    frequency: Vec<f64>,
    measured: Vec<f64>,
    response: Vec<f64>,
    residual: Vec<f64>,
    samples: usize,
}

/// Describes what is wrong with every output that was measured, in the model's order; sizes are those in the band.
pub(crate) fn lack_of_fit_of_bins(model: &Model, passages: &[BinnedResidual]) -> Vec<LackOfFit> {
    let q = model.layout().outputs;
    (0..q).filter_map(|output| of_binned_output(model, passages, output, q)).collect()
}

fn of_binned_output(model: &Model, passages: &[BinnedResidual], output: usize, q: usize) -> Option<LackOfFit> {
    let columns: Vec<BinnedOutput> = passages.iter().filter_map(|p| column(p, output, q)).collect();
    let definition = model.definition();
    let quantity = &definition.outputs[output].quantity;
    let join = |pick: fn(&BinnedOutput) -> &Vec<f64>| -> Vec<f64> { columns.iter().flat_map(pick).copied().collect() };
    let fit = OutputFit::new(&quantity.name, "", &join(|c| &c.measured), &join(|c| &c.response), 0, 1);
    let (bins, samples) = columns.iter().fold((0, 0), |(l, s), c| (l + c.residual.len(), s + c.samples));
    // what bins have together is spread over all samples
    let spread = (bins as f64 / samples.max(1) as f64).sqrt();
    let upper = |c: &BinnedOutput| c.residual[((1.0 - UPPER) * c.residual.len() as f64) as usize..].to_vec();
    let deviation = root_of_median(columns.iter().flat_map(upper).map(|r| r * r).collect());
    let (rms, noise_level) = (spread * fit.rms?, spread * deviation);
    let mut lack_of_fit = LackOfFit {
        output: quantity.name.clone(),
        unit: quantity.unit.as_ref().map(ToString::to_string),
        compared: fit.compared,
        rms,
        noise_level,
        above_noise_level: if rms > 0.0 { (1.0 - (noise_level / rms).powi(2)).max(0.0) } else { 0.0 },
        tic: fit.tic,
        bands: binned_bands(&columns, deviation),
        windows: Vec::new(),
        amplitudes: Vec::new(),
        gains: gains_of(&columns.iter().map(signals_of).collect::<Vec<_>>()),
        sentences: Vec::new(),
    };
    lack_of_fit.sentences = sentences(&lack_of_fit, &definition.time.to_string(), passages.len());
    Some(lack_of_fit)
}

fn column(passage: &BinnedResidual, output: usize, q: usize) -> Option<BinnedOutput> {
    let pick = |values: &[f64]| -> Vec<f64> { values.iter().skip(output).step_by(q).copied().collect() };
    let (measured, response) = (pick(&passage.measured), pick(&passage.response));
    let residual = residuals(&measured, &response);
    let known = measured.iter().all(|z| z.is_finite()) && !measured.is_empty();
    let (frequency, samples) = (passage.frequency.clone(), passage.samples);
    known.then_some(BinnedOutput { frequency, measured, response, residual, samples })
}

fn signals_of(column: &BinnedOutput) -> Signals {
    // a quarter of a period late: times -j
    let late = column.response.chunks_exact(2).flat_map(|c| [c[1], -c[0]]).collect();
    Signals {
        frequency: column.frequency.clone(),
        measured: column.measured.clone(),
        response: column.response.clone(),
        late,
    }
}

/// The error in octaves of the band.
fn binned_bands(columns: &[BinnedOutput], deviation: f64) -> Vec<Band> {
    let all = || columns.iter().flat_map(|c| c.frequency.iter().zip(c.residual.iter().zip(&c.measured)));
    let highest = all().map(|(f, _)| *f).fold(0.0, f64::max);
    let lowest = all().map(|(f, _)| *f).fold(f64::INFINITY, f64::min);
    if highest <= 0.0 {
        return Vec::new();
    }
    let count = ((highest / lowest).log2().ceil().max(1.0) as usize).min(OCTAVES);
    let edge = |k: usize| if k == 0 { 0.0 } else { highest * 0.5_f64.powi((count - k) as i32) };
    let mut sums = vec![Powers::default(); count];
    for (f, (r, z)) in all() {
        let band = &mut sums[(1..count).rev().find(|k| *f > edge(*k)).unwrap_or(0)];
        band.error += r * r;
        band.noise += deviation * deviation;
        band.moving += r * r;
        band.measured += z * z;
    }
    shares(&sums, edge)
}

/// Below this share above the noise level an output is matched to its noise.
const NOTHING: f64 = 0.1;
/// A band is told that holds more of the error than this, and twice as much as its noise.
const BAND_SHARE: f64 = 0.2;
/// Windows together that are told hold this much of the error, in at most a third of the time.
const WINDOW_SHARE: f64 = 0.6;
/// The error is told to grow with amplitude when it does by this factor.
const GROWTH: f64 = 1.5;
/// Phases and gains that are told.
const DEGREES: f64 = 2.0;
const PERCENT: f64 = 3.0;

/// Everything that stands out.
pub(crate) fn sentences(lack_of_fit: &LackOfFit, time: &str, runs: usize) -> Vec<String> {
    let name = &lack_of_fit.output;
    let unit = lack_of_fit.unit.as_ref().map_or(String::new(), |u| format!(" {u}"));
    if lack_of_fit.above_noise_level < NOTHING {
        return vec![format!("{name}: the error of {}{unit} is the noise of the record", short(lack_of_fit.rms))];
    }
    let mut said = vec![format!(
        "{name}: the error is {}{unit}, {} times the noise of the record ({}{unit})",
        short(lack_of_fit.rms),
        short(lack_of_fit.rms / lack_of_fit.noise_level.max(f64::MIN_POSITIVE)),
        short(lack_of_fit.noise_level)
    )];
    said.extend(band(lack_of_fit, time));
    said.extend(phase(lack_of_fit, time, runs));
    said.extend(when(lack_of_fit, time));
    said.extend(growth(lack_of_fit));
    said
}

/// `Hz`, or cycles per the model's unit of time.
fn per(time: &str) -> String {
    match time {
        "s" => "Hz".into(),
        "1" | "" => "per unit of time".into(),
        other => format!("1/{other}"),
    }
}

/// The band that holds what is above the noise: from the first to the last octave that sticks out.
fn band(lack_of_fit: &LackOfFit, time: &str) -> Option<String> {
    let out: Vec<usize> = (0..lack_of_fit.bands.len())
        .filter(|k| {
            lack_of_fit.bands[*k].share > 2.0 * lack_of_fit.bands[*k].noise
                && lack_of_fit.bands[*k].share > BAND_SHARE / 4.0
        })
        .collect();
    let (first, last) = (*out.first()?, *out.last()?);
    let share: f64 = lack_of_fit.bands[first..=last].iter().map(|b| b.share).sum();
    if share < BAND_SHARE {
        return None;
    }
    let (name, per) = (&lack_of_fit.output, per(time));
    let (low, high) = (lack_of_fit.bands[first].low, lack_of_fit.bands[last].high);
    let percent = (100.0 * share).round();
    Some(if first == 0 {
        format!("{name}: {percent} % of the error is below {} {per}", short(high))
    } else if last + 1 == lack_of_fit.bands.len() {
        format!("{name}: {percent} % of the error is above {} {per}", short(low))
    } else {
        format!("{name}: {percent} % of the error is between {} and {} {per}", short(low), short(high))
    })
}

fn phase(lack_of_fit: &LackOfFit, time: &str, runs: usize) -> Vec<String> {
    let (name, per) = (&lack_of_fit.output, per(time));
    let within = |agree: usize, of: usize| match (agree == of, runs) {
        (_, 1) => String::new(),
        (true, _) => ", in all runs".into(),
        (false, _) => format!(", in {agree} of {of} runs"),
    };
    let off = |g: &&Gain| g.late.abs().to_radians().max((g.gain - 1.0).abs());
    let strongest = lack_of_fit.gains.iter().max_by(|a, b| off(a).total_cmp(&off(b)));
    let Some(gain) = strongest else { return Vec::new() };
    let (mut said, f) = (Vec::new(), short(gain.frequency));
    if gain.late.abs() > DEGREES {
        let side = if gain.late > 0.0 { "late" } else { "early" };
        let degrees = short(gain.late.abs());
        said.push(format!("{name}: the record is {side} by {degrees} deg at {f} {per}{}", within(gain.runs, gain.of)));
    }
    let percent = 100.0 * (gain.gain - 1.0);
    if percent.abs() > PERCENT {
        let side = if percent > 0.0 { "larger" } else { "smaller" };
        let percent = short(percent.abs());
        said.push(format!(
            "{name}: the record is {percent} % {side} than the response at {f} {per}{}",
            within(gain.runs, gain.of)
        ));
    }
    said
}

/// The fewest windows that hold most of the error, when they are few.
fn when(lack_of_fit: &LackOfFit, time: &str) -> Option<String> {
    let mut order: Vec<&Window> = lack_of_fit.windows.iter().collect();
    order.sort_by(|a, b| b.share.total_cmp(&a.share));
    let (mut share, mut samples, mut chosen) = (0.0, 0.0, Vec::new());
    for window in order {
        if share >= WINDOW_SHARE {
            break;
        }
        share += window.share;
        samples += window.samples;
        chosen.push(window);
    }
    if share < WINDOW_SHARE || samples > 1.0 / 3.0 {
        return None;
    }
    chosen.sort_by(|a, b| (&a.run, a.from).partial_cmp(&(&b.run, b.from)).unwrap_or(std::cmp::Ordering::Equal));
    // neighbours in one run are one stretch
    let mut stretches: Vec<(String, f64, f64)> = Vec::new();
    for window in chosen {
        let length = window.to - window.from;
        match stretches.last_mut() {
            Some((run, _, to)) if *run == window.run && window.from - *to <= 0.2 * length => *to = window.to,
            _ => stretches.push((window.run.clone(), window.from, window.to)),
        }
    }
    let unit = if time == "1" { String::new() } else { format!(" {time}") };
    let told: Vec<String> = stretches
        .iter()
        .take(3)
        .map(|(run, from, to)| format!("from {} to {}{unit} of {run}", short(*from), short(*to)))
        .collect();
    (stretches.len() <= 3).then(|| {
        format!(
            "{}: {} % of the error is in {} % of the time, {}",
            lack_of_fit.output,
            (100.0 * share).round(),
            (100.0 * samples).round(),
            told.join(" and ")
        )
    })
}

fn growth(lack_of_fit: &LackOfFit) -> Vec<String> {
    let mut said = Vec::new();
    for group in lack_of_fit.amplitudes.chunk_by(|a, b| a.signal == b.signal) {
        let (Some(low), Some(high)) = (group.first(), group.last()) else { continue };
        if group.len() < 2 || low.rms.max(high.rms) <= 0.0 {
            continue;
        }
        let times = |a: &AmplitudeBin, b: &AmplitudeBin| a.rms / b.rms.max(f64::MIN_POSITIVE);
        let signal = if low.signal == lack_of_fit.output { "it".into() } else { low.signal.clone() };
        let (name, above, below) = (&lack_of_fit.output, short(high.from), short(low.to));
        if times(high, low) > GROWTH {
            let factor = short(times(high, low));
            said.push(format!("{name}: the error is {factor} times as large where {signal} is large (beyond {above}) as where it is small (below {below})"));
        } else if times(low, high) > GROWTH {
            let factor = short(times(low, high));
            said.push(format!("{name}: the error is {factor} times as large where {signal} is small (below {below}) as where it is large (beyond {above})"));
        }
    }
    said
}

/// Three digits.
fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 12) as usize;
    let text = format!("{value:.digits$}");
    if value.abs() < 1e-4 || value.abs() >= 1e6 {
        return format!("{value:.2e}");
    }
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
}
