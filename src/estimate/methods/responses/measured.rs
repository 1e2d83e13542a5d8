//! Composite frequency responses of sweeps (Tischler and Remple 2012, chapter 10), and which of their points are coherent enough to count.
//!
//! Frequency responses of a fit in the time domain: those that its runs show, and those of the model's response over the same time. Both are estimated by the
//! same windows, so that they share their errors, and a model need not be linear.

use super::decibels::{cost_of, decibels_and_degrees};
use super::fit::PairFit;
use super::options::{ResponseError, ResponseOptions};
use crate::methods::output_error::fit::Fit;
use crate::methods::spectra::setting::{all_spectra, moved};
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::spectrum::{Frequencies, FrequencyResponseEstimate, SpectrumError, SpectrumOptions, Window};
use std::f64::consts::TAU;

/// Ratio of a frequency to the one below it.
const RATIO: f64 = 1.1;
/// Lengths of segments where none were chosen.
const LENGTHS: usize = 2;
/// Periods of the highest frequency that the shortest of them holds.
const PERIODS: f64 = 10.0;
/// Part of a segment that the next one shares.
pub(super) const OVERLAP: f64 = 0.75;
/// Most frequencies: products of all pairs of them are formed for the errors.
const MOST: f64 = 2_000.0;

/// What sweeps show.
pub(super) struct Measured {
    pub(super) estimate: FrequencyResponseEstimate,
    /// Lengths of the segments, falling.
    pub(super) lengths: Vec<f64>,
    /// Length of the segments that dominate at each frequency (M), from their numbers of averages.
    pub(super) dominant: Vec<f64>,
    /// For each input of the model the one of which it is the derivative.
    pub(super) slopes: Vec<Option<usize>>,
}

impl Measured {
    /// Composite responses of all outputs to all inputs.
    ///
    /// # Errors
    /// [`ResponseError`].
    pub(super) fn new(model: &Model, runs: &[Run], options: &ResponseOptions) -> Result<Self, ResponseError> {
        let how = names(model);
        let durations: Vec<f64> = runs.iter().map(duration).collect();
        let (low, high) = band(model, runs, options)?;
        let lengths = match &options.segments[..] {
            [] => lengths(&durations, how.inputs.len(), high),
            given => checked(given, &durations)?,
        };
        let longest = lengths.iter().copied().fold(0.0, f64::max);
        let choice = match &options.frequencies {
            Frequencies::Grid { .. } => logarithmic(low.unwrap_or(2.0 / longest), high, longest),
            given => given.clone(),
        };
        too_many(&choice, how.inputs.len() + how.outputs.len())?;
        let definition = model.definition();
        let declared: Vec<usize> = (0..how.inputs.len()).collect();
        let outputs: Vec<usize> = (0..definition.outputs.len()).collect();
        let runs: Vec<Run> = runs.iter().map(|run| run.with_channels(&declared, &outputs)).collect();
        let slopes = definition.inputs.iter().map(|i| i.slope.map(|s| s.of as usize)).collect();
        let estimate = FrequencyResponseEstimate::composite(&runs, &choice, &lengths, OVERLAP, Window::Hann, &how)
            .map_err(ResponseError::Spectrum)?;
        // averages are in proportion to what a length leaves of the records
        let averages = || estimate.averages.iter().copied();
        let fewest = averages().fold(f64::INFINITY, f64::min);
        let dominant = averages().map(|a| longest * (fewest / a).min(1.0)).collect();
        Ok(Self { estimate, lengths, dominant, slopes })
    }

    /// Coherence of a pair (M): of the output with this input, what the others do taken out.
    pub(super) fn coherence(&self, output: usize, input: usize) -> &[f64] {
        &self.estimate.partial_coherence[self.estimate.pair(output, input)]
    }

    /// Positions of the frequencies at which a pair is coherent.
    pub(super) fn coherent(&self, output: usize, input: usize, least: f64) -> Vec<usize> {
        let at = self.estimate.pair(output, input).start;
        let finite = |k: usize| {
            let (h, error) = (self.estimate.response[at + k], self.estimate.error[at + k]);
            h.norm() > 0.0 && h.re.is_finite() && h.im.is_finite() && error.is_finite()
        };
        let coherence = self.coherence(output, input);
        (0..coherence.len()).filter(|k| coherence[*k] >= least && finite(*k)).collect()
    }
}

fn names(model: &Model) -> SpectrumOptions {
    let definition = model.definition();
    SpectrumOptions {
        inputs: definition.inputs.iter().filter(|i| i.is_declared()).map(|i| i.quantity.name.clone()).collect(),
        outputs: definition.outputs.iter().map(|o| o.quantity.name.clone()).collect(),
        ..SpectrumOptions::default()
    }
}

fn duration(run: &Run) -> f64 {
    run.time.last().zip(run.time.first()).map_or(0.0, |(last, first)| last - first)
}

/// Lengths that some record holds.
fn checked(lengths: &[f64], durations: &[f64]) -> Result<Vec<f64>, ResponseError> {
    let longest = durations.iter().copied().fold(0.0, f64::max);
    let wrong = |length: f64| match length {
        l if !(l > 0.0 && l.is_finite()) => Some(ResponseError::NoSegment(l)),
        l if l > longest => Some(ResponseError::Spectrum(SpectrumError::NoneFits { length: l })),
        _ => None,
    };
    lengths.iter().find_map(|l| wrong(*l)).map_or_else(|| Ok(lengths.to_vec()), Err)
}

/// The band's ends: as given, else the frequency up to which inputs hold their power.
fn band(model: &Model, runs: &[Run], options: &ResponseOptions) -> Result<(Option<f64>, f64), ResponseError> {
    match &options.frequencies {
        Frequencies::Grid { lowest, highest: Some(highest) } => {
            // whether the records can show it at all
            all_spectra(model, runs, &options.frequencies)?;
            Ok((*lowest, *highest))
        }
        Frequencies::Grid { lowest, highest: None } => {
            let inputs = names(model).inputs.len();
            let all = all_spectra(model, runs, &Frequencies::Grid { lowest: None, highest: None })?;
            Ok((*lowest, all.iter().map(|s| moved(s, inputs)).fold(0.0, f64::max)))
        }
        Frequencies::Band { lowest, highest, .. } => Ok((Some(*lowest), *highest)),
        Frequencies::List(list) => Ok((list.first().copied(), list.last().copied().unwrap_or(f64::NAN))),
    }
}

/// The longest segment leaves five of its length in all records, and two for every input; the other is half as long, where that holds enough periods. Shorter
/// ones average more, and smear more: at 5 % noise that is what is left of the error.
fn lengths(durations: &[f64], inputs: usize, highest: f64) -> Vec<f64> {
    let (longest, sum) = (durations.iter().copied().fold(0.0, f64::max), durations.iter().sum::<f64>());
    let first = (0.5 * longest).min(sum / 5.0_f64.max(2.0 * (inputs as f64 + 1.0)));
    let halves = (0..LENGTHS as i32).map(|k| first / 2.0_f64.powi(k));
    halves.enumerate().filter(|(k, length)| *k == 0 || length * highest >= PERIODS).map(|(_, length)| length).collect()
}

/// Frequencies in equal ratios, nowhere closer than a segment resolves.
fn logarithmic(low: f64, high: f64, longest: f64) -> Frequencies {
    let usable = low > 0.0 && high >= low && high.is_finite() && longest > 0.0;
    if !usable || (high / low).ln() / RATIO.ln() > MOST {
        // to be refused with the reason
        return Frequencies::Band { lowest: low, highest: high, spacing: None };
    }
    let next = |f: &f64| Some((f * RATIO).max(f + 1.0 / longest));
    let mut list: Vec<f64> = std::iter::successors(Some(low), next).take_while(|f| *f <= high * (1.0 + 1e-9)).collect();
    list.iter_mut().for_each(|f| *f = f.min(high));
    Frequencies::List(list)
}

/// Whether a choice of frequencies is within what errors can be computed for.
fn too_many(choice: &Frequencies, channels: usize) -> Result<(), ResponseError> {
    let count = match choice {
        Frequencies::Band { lowest, highest, spacing: Some(spacing) } => (highest - lowest) / spacing + 1.0,
        Frequencies::List(list) => list.len() as f64,
        _ => 0.0,
    };
    if count > MOST {
        let limit = MOST as usize * channels;
        return Err(ResponseError::Spectrum(SpectrumError::TooMany { frequencies: count, channels, limit }));
    }
    Ok(())
}

/// Cycles per unit of time.
pub(super) fn cycles(omega: &[f64]) -> Vec<f64> {
    omega.iter().map(|w| w / TAU).collect()
}

/// Measured and modelled responses of every pair that is coherent anywhere, in the order of outputs, then inputs. Empty where the runs allow none: without
/// inputs, of uneven samples, too short, or with inputs that cannot be told apart.
pub fn responses_of_fit(fit: &Fit, runs: &[Run]) -> Vec<PairFit> {
    let definition = fit.model.definition();
    let declared: Vec<usize> = (0..definition.inputs.len()).filter(|k| definition.inputs[*k].is_declared()).collect();
    let inputs: Vec<usize> = declared.iter().copied().filter(|k| !definition.inputs[*k].known).collect();
    if inputs.is_empty() || inputs.len() < declared.len() || fit.estimate.runs.len() != runs.len() {
        return Vec::new();
    }
    let options = ResponseOptions::default();
    let Ok(measured) = Measured::new(&fit.model, runs, &options) else { return Vec::new() };
    let outputs: Vec<usize> = (0..definition.outputs.len()).collect();
    let answered = runs.iter().zip(&fit.estimate.runs).map(|(run, found)| {
        let values = run.measured.iter().zip(&found.response);
        let answer = values.map(|(z, y)| if z.is_nan() { f64::NAN } else { *y }).collect();
        Run { measured: answer, ..run.clone() }.with_channels(&inputs, &outputs)
    });
    let answered: Vec<Run> = answered.collect();
    let list = Frequencies::List(measured.estimate.omega.iter().map(|w| w / TAU).collect());
    let how = SpectrumOptions::default();
    let modelled =
        FrequencyResponseEstimate::composite(&answered, &list, &measured.lengths, OVERLAP, Window::Hann, &how);
    let Ok(modelled) = modelled.as_ref() else { return Vec::new() };
    if modelled.omega.len() != measured.estimate.omega.len() {
        return Vec::new();
    }
    let name = |output: usize, input: usize| {
        let quantity = |q: &fdm_grammar::model::Quantity| q.name.clone();
        (quantity(&definition.outputs[output].quantity), quantity(&definition.inputs[inputs[input]].quantity))
    };
    let pair = |output: usize, input: usize| {
        let coherence = measured.coherence(output, input);
        let place = measured.estimate.pair(output, input).start;
        let finite = |k: &usize| {
            let both = [measured.estimate.response[place + k], modelled.response[place + k]];
            both.iter().all(|h| h.norm() > 0.0 && h.re.is_finite() && h.im.is_finite())
                && measured.estimate.error[place + k].is_finite()
        };
        let at: Vec<usize> = (0..coherence.len()).filter(finite).collect();
        let shown = |of: &FrequencyResponseEstimate| -> Vec<[f64; 2]> {
            at.iter().map(|k| decibels_and_degrees(of.response[place + k])).collect()
        };
        let mut own = shown(modelled);
        let own_measured = shown(&measured.estimate);
        for (own, measured) in own.iter_mut().zip(&own_measured) {
            own[1] += 360.0 * ((measured[1] - own[1]) / 360.0).round();
        }
        let coherence: Vec<f64> = at.iter().map(|k| coherence[*k]).collect();
        let counted = |k: &usize| coherence[*k] >= options.coherence;
        let errors = (0..at.len()).filter(counted).map(|k| {
            let off = [0, 1].map(|part| own_measured[k][part] - own[k][part]);
            (coherence[k], off)
        });
        let errors: Vec<(f64, [f64; 2])> = errors.collect();
        let (output_name, input_name) = name(output, input);
        (!errors.is_empty()).then(|| PairFit {
            output: output_name,
            input: input_name,
            omega: at.iter().map(|k| measured.estimate.omega[*k]).collect(),
            cost: cost_of(&errors),
            error: at.iter().map(|k| measured.estimate.error[place + k]).collect(),
            left_out: at.len() - errors.len(),
            measured: own_measured,
            modelled: own,
            coherence,
        })
    };
    let all = outputs.iter().flat_map(|o| (0..inputs.len()).map(move |i| (*o, i)));
    all.filter_map(|(o, i)| pair(o, i)).collect()
}
