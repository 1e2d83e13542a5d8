//! Runs on even grids: what noise has a spectrum for. Missing samples become empty ones.
//!
//! Where models are compared with records: sample by sample in time, or bin by bin of their spectra.

use crate::candidates::error::DiagnosisError;
use fdm_estimate::{FitOptions, Nonlinear, SpectralBins, SpectralError, SpectralOptions};
use fdm_system::model::Model;
use fdm_system::record::even_grid::{EvenGrid, LONGEST_GAP};
use fdm_system::record::{Run, bridge};
use fdm_system::spectrum::Frequencies;
use serde::Serialize;

/// Fewest samples of which a spectrum can be had.
const LEAST: usize = 8;
/// Part of the interval by which times may leave the grid over a whole record before its gaps are not believed.
const DRIFT: f64 = 0.05;

/// The run on an even grid.
///
/// # Errors
/// [`DiagnosisError::TooShort`], [`DiagnosisError::Uneven`], [`DiagnosisError::LongGap`].
pub(crate) fn evenly(run: &Run) -> Result<Run, DiagnosisError> {
    let name = || run.name.clone();
    if run.len() < LEAST {
        return Err(DiagnosisError::TooShort { run: name(), samples: run.len(), least: LEAST });
    }
    let grid = EvenGrid::of(&run.time).map_err(|_| DiagnosisError::Uneven { run: name() })?;
    let length = grid.length();
    if length == run.len() {
        return Ok(run.clone());
    }
    let longest = grid.place.windows(2).map(|w| w[1] - w[0]).max().unwrap_or(1);
    let last = run.time.last().copied().unwrap_or_default();
    let drift = (grid.interval * (length - 1) as f64 - last).abs() / (grid.interval * length as f64);
    if longest >= LONGEST_GAP || drift > DRIFT {
        return Err(DiagnosisError::LongGap { run: name(), intervals: longest });
    }
    Ok(spread(run, &grid))
}

/// The run as models are compared with it, and what was assumed for that. In time, samples that follow no grid are taken one after the
/// other: white noise stays white, and slow noise has its spectrum by the mean interval. Responses are those at the times recorded.
///
/// # Errors
/// As [`evenly`]; in the frequency domain the samples must be even.
pub(crate) fn prepared(run: &Run, domain: &Domain) -> Result<(Run, Option<String>), DiagnosisError> {
    match evenly(run) {
        Err(DiagnosisError::Uneven { .. } | DiagnosisError::LongGap { .. }) if *domain == Domain::Time => {
            let note = format!(
                "run `{}` is not sampled evenly: its noise is described sample by sample, as if samples were {:.3} apart (time unit)",
                run.name,
                interval(run)
            );
            Ok((run.clone(), Some(note)))
        }
        even => Ok((even?, None)),
    }
}

/// Samples of all runs together, and numbers of all directions (candidates by outputs by samples), up to which all are taken.
const MOST_SAMPLES: usize = 200_000;
const MOST_NUMBERS: usize = 60_000_000;
/// Directions of a candidate, about.
const DIRECTIONS: usize = 2;
/// Fewest samples that are left of a run.
const KEPT: usize = 500;
/// Part of the deviation of an input that may be lost, as its root mean square.
const LOST: f64 = 1e-3;
/// Every k-th sample of runs that are longer than a search with so many candidates needs, and what was left out, in a sentence. Where inputs
/// need more samples than that, the outputs are compared at fewer. In time, of the rows between those stay in which an input bends: the
/// motion loses nothing, and a search makes as many steps less. Where inputs bend everywhere that saves numbers only.
pub(crate) fn thinned(
    runs: Vec<Run>,
    outputs: usize,
    candidates: usize,
    domain: &Domain,
) -> (Vec<Run>, Option<String>) {
    let samples: usize = runs.iter().map(Run::len).sum();
    let numbers = samples.saturating_mul(outputs).saturating_mul(DIRECTIONS * candidates.max(1));
    let by_numbers = numbers.div_ceil(MOST_NUMBERS);
    let wanted = samples.div_ceil(MOST_SAMPLES).max(by_numbers);
    let shortest = runs.iter().map(Run::len).filter(|n| *n > KEPT).min().unwrap_or(0);
    let mut every = wanted.min(shortest / KEPT).max(1);
    while every > 1 && !runs.iter().filter(|run| run.len() > KEPT).all(|run| keeps_inputs(run, every)) {
        every -= (every / 4).max(1);
    }
    let part = |run: &Run| if every > 1 && run.len() > KEPT { run.every(every) } else { run.clone() };
    let runs: Vec<Run> = runs.iter().map(part).collect();
    let left: usize = runs.iter().map(Run::len).sum();
    let compared = measured(&runs);
    let in_time = *domain == Domain::Time;
    let fewer = |run: Run| {
        let (few, less) = (wanted.div_ceil(every), by_numbers.div_ceil(every));
        let straight = Some(few).filter(|few| in_time && *few > 1).map(|few| straightened(&sparser(run.clone(), few)));
        // steps are saved as well, or as many measurements stay as there is room for
        let fast = straight.filter(|found| found.len() * 2 <= run.len());
        fast.unwrap_or_else(|| sparser(run, less))
    };
    let runs: Vec<Run> = runs.into_iter().map(fewer).collect();
    let mut said = Vec::new();
    if left < samples {
        said.push(format!("of {samples} samples every {every}th is used ({left})"));
    }
    if measured(&runs) < compared {
        let kept = measured(&runs);
        said.push(format!(
            "of {compared} measurements {kept} are compared, between which the inputs move too much for fewer samples"
        ));
    }
    let note = (!said.is_empty()).then(|| {
        format!(
            "{}, as there are {candidates} candidates; all errors are those of what is left. `--without` and `--only` leave more time for each",
            said.join("; ")
        )
    });
    (runs, note)
}

/// Values of outputs that were measured.
fn measured(runs: &[Run]) -> usize {
    runs.iter().flat_map(|run| &run.measured).filter(|z| !z.is_nan()).count()
}

/// The run with every k-th measurement of each output, but not fewer than are kept of any.
fn sparser(mut run: Run, k: usize) -> Run {
    let q = run.output_gaps.len();
    for o in 0..q {
        let own: Vec<usize> = (0..run.len()).filter(|row| !run.measured[row * q + o].is_nan()).collect();
        let k = k.min(own.len() / KEPT).max(1);
        own.iter()
            .enumerate()
            .filter(|(place, _)| place % k != 0)
            .for_each(|(_, row)| run.measured[row * q + o] = f64::NAN);
    }
    run
}

/// The run without rows at which nothing was measured and every input goes straight on (or keeps its value).
fn straightened(run: &Run) -> Run {
    let (n, m, q) = (run.len(), run.held.len(), run.output_gaps.len());
    let value = |row: usize, i: usize| run.inputs[row * m + i];
    let most: Vec<f64> = (0..m)
        .map(|i| {
            let mean = (0..n).map(|row| value(row, i)).sum::<f64>() / n as f64;
            LOST * ((0..n).map(|row| (value(row, i) - mean).powi(2)).sum::<f64>() / n as f64).sqrt()
        })
        .collect();
    // the row between two in which an input is farthest off, in what may be lost of it; of a held input the first that is
    let bends = |from: usize, to: usize| -> Option<usize> {
        let off = |row: usize| {
            let part = (run.time[row] - run.time[from]) / (run.time[to] - run.time[from]);
            let each = (0..m).map(|i| {
                let part = if run.held[i] { 0.0 } else { part };
                let off = (value(row, i) - value(from, i) - part * (value(to, i) - value(from, i))).abs();
                if off > most[i] { (run.held[i], off / most[i]) } else { (false, 0.0) }
            });
            each.fold((false, 0.0), |(held, worst): (bool, f64), (h, o)| (held || h, worst.max(o)))
        };
        let mut worst = (0.0, None);
        for row in from + 1..to {
            let (held, off) = off(row);
            if held {
                return Some(row);
            }
            if off > worst.0 {
                worst = (off, Some(row));
            }
        }
        worst.1
    };
    let measured = |row: &usize| run.measured[row * q..][..q].iter().any(|z| !z.is_nan());
    let fixed = (0..n).filter(|row| *row == 0 || *row + 1 == n || measured(row));
    let mut rows: Vec<usize> = Vec::new();
    for end in fixed {
        // what is still to be reached, the nearest last
        let mut ahead = vec![end];
        while let Some(to) = ahead.last().copied() {
            match rows.last().and_then(|from| bends(*from, to)) {
                Some(row) => ahead.push(row),
                None => {
                    rows.push(to);
                    ahead.pop();
                }
            }
        }
    }
    at_rows(run, &rows)
}

/// Some rows of a run.
pub(crate) fn at_rows(run: &Run, rows: &[usize]) -> Run {
    let of = |values: &[f64], width: usize| -> Vec<f64> {
        rows.iter().flat_map(|row| &values[row * width..][..width]).copied().collect()
    };
    Run {
        time: rows.iter().map(|row| run.time[*row]).collect(),
        inputs: of(&run.inputs, run.held.len()),
        measured: of(&run.measured, run.output_gaps.len()),
        ..run.clone()
    }
}

/// Whether the rows of a run are as far apart as each other.
pub(crate) fn is_even(run: &Run) -> bool {
    EvenGrid::of(&run.time).is_ok_and(|grid| grid.length() == run.len())
}

/// Whether every k-th sample of the inputs says all of them, as they are interpolated: what is lost would be taken for an effect.
pub(crate) fn keeps_inputs(run: &Run, k: usize) -> bool {
    let (n, m) = (run.len(), run.held.len());
    (0..m).all(|i| {
        let value = |row: usize| run.inputs[row * m + i];
        let mean = (0..n).map(value).sum::<f64>() / n as f64;
        let (mut off, mut size) = (0.0, 0.0);
        for row in 0..n {
            let (from, to) = (row / k * k, (row / k * k + k).min((n - 1) / k * k));
            let part = if to > from && !run.held[i] { (row - from) as f64 / (to - from) as f64 } else { 0.0 };
            off += (value(row) - value(from) - part * (value(to) - value(from))).powi(2);
            size += (value(row) - mean).powi(2);
        }
        off <= LOST * LOST * size
    })
}

/// Samples at their places; inputs are bridged, outputs stay empty.
fn spread(run: &Run, grid: &EvenGrid) -> Run {
    let (n, m) = (grid.length(), run.held.len());
    let q = run.output_gaps.len();
    let mut wide = Run {
        time: (0..n).map(|k| k as f64 * grid.interval).collect(),
        inputs: vec![f64::NAN; n * m],
        measured: vec![f64::NAN; n * q],
        ..run.clone()
    };
    for (k, place) in grid.place.iter().enumerate() {
        wide.inputs[place * m..][..m].copy_from_slice(&run.inputs[k * m..][..m]);
        wide.measured[place * q..][..q].copy_from_slice(&run.measured[k * q..][..q]);
    }
    for k in 0..m {
        bridge(&wide.time, &mut wide.inputs, m, k, run.held[k]);
    }
    wide
}

/// Time between samples.
pub(crate) fn interval(run: &Run) -> f64 {
    let (first, last) = (run.time.first().copied().unwrap_or(0.0), run.time.last().copied().unwrap_or(1.0));
    (last - first) / (run.len().max(2) - 1) as f64
}

/// A validation run must not be one of those that the model is learned from.
///
/// # Errors
/// [`DiagnosisError::HeldOutTwice`]
pub(crate) fn apart(runs: &[Run], validation: &[Run]) -> Result<(), DiagnosisError> {
    let bits = |values: &[f64]| -> Vec<u64> { values.iter().map(|v| v.to_bits()).collect() };
    for other in validation {
        let same =
            |run: &&Run| bits(&run.measured) == bits(&other.measured) && bits(&run.inputs) == bits(&other.inputs);
        if let Some(run) = runs.iter().find(same) {
            return Err(DiagnosisError::ValidationTwice { validation: other.name.clone(), run: run.name.clone() });
        }
    }
    Ok(())
}

/// Part of the sampling frequency up to which bins are taken, where the inputs move less.
const UPPER: f64 = 0.45;
/// Fewest bins of a run by which noise is told from an effect.
const LEAST_BINS: usize = 32;

/// Where models are compared with records.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub enum Domain {
    /// Responses are integrated.
    #[default]
    Time,
    /// Responses of linear models at the frequencies of the records.
    Frequency(Box<SpectralOptions>),
}

impl Domain {
    /// This domain with everything chosen that was left open; `runs` are the training runs.
    ///
    /// # Errors
    /// [`DiagnosisError`]: models without a linear response, bands without bins.
    pub(crate) fn settled(&self, model: &Model, runs: &[Run]) -> Result<Self, DiagnosisError> {
        let Self::Frequency(options) = self else { return Ok(Self::Time) };
        let mut options = options.clone();
        options.finish = false;
        options.nonlinear = nonlinear(model, options.nonlinear)?;
        let bins = SpectralBins::new(model, runs, &options)?;
        if let Frequencies::Grid { lowest: None, highest: None } = options.frequencies {
            let rates = runs.iter().map(|run| 1.0 / interval(run));
            let highest = rates.map(|rate| UPPER * rate).fold(f64::INFINITY, f64::min).max(bins.band().1);
            options.frequencies = Frequencies::Grid { lowest: None, highest: Some(highest) };
        }
        if let Frequencies::Band { spacing: Some(spacing), .. } = options.frequencies {
            let apart = |run: &&Run| spacing * interval(run) * (run.len() as f64) < 1.0 - 1e-9;
            if let Some(run) = runs.iter().find(apart) {
                let least = 1.0 / (interval(run) * run.len() as f64);
                return Err(DiagnosisError::TooClose { run: run.name.clone(), spacing, least });
            }
        }
        let bins = SpectralBins::new(model, runs, &options)?;
        for (k, run) in runs.iter().enumerate() {
            let count = bins.frequencies(k).len();
            if count < LEAST_BINS {
                let (low, high) = bins.band();
                return Err(DiagnosisError::FewLines {
                    run: run.name.clone(),
                    bins: count,
                    least: LEAST_BINS,
                    low,
                    high,
                });
            }
        }
        Ok(Self::Frequency(options))
    }
}

/// What is done about nonlinear terms: those of candidates must be known from records as those of the model are.
fn nonlinear(model: &Model, asked: Nonlinear) -> Result<Nonlinear, DiagnosisError> {
    match asked {
        Nonlinear::Linearised if !SpectralBins::is_linear(model) => Ok(Nonlinear::Linearised),
        _ => match model.definition().carried() {
            Ok(_) => Ok(Nonlinear::MeasuredRegressors),
            Err(reason) => Err(DiagnosisError::NotLinear(SpectralError::NotCarried(reason).to_string())),
        },
    }
}

/// The runs of a diagnosis: the training runs, then those that are for validation.
#[derive(Clone, Copy)]
pub(crate) struct Runs<'a> {
    /// All of them.
    pub(crate) all: &'a [Run],
    /// How many are learned from.
    pub(crate) train: usize,
    /// Where they are compared with models.
    pub(crate) domain: &'a Domain,
}

impl<'a> Runs<'a> {
    pub(crate) fn train(&self) -> &'a [Run] {
        &self.all[..self.train]
    }

    pub(crate) fn validation(&self) -> &'a [Run] {
        &self.all[self.train..]
    }
}

/// How to search.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DiagnosisOptions {
    /// Most effects that are accepted.
    pub most: usize,
    /// How the model as it stands is fitted.
    pub fit: FitOptions,
    /// Where models are compared with records.
    pub domain: Domain,
}

impl Default for DiagnosisOptions {
    fn default() -> Self {
        Self { most: 4, fit: FitOptions::default(), domain: Domain::Time }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(time: Vec<f64>) -> Run {
        let n = time.len();
        Run {
            name: "r".into(),
            inputs: time.iter().map(|t| 2.0 * t).collect(),
            measured: (0..n).map(|k| k as f64).collect(),
            time,
            held: vec![false],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0],
        }
    }

    #[test]
    fn missing_samples_become_empty_ones_and_inputs_are_bridged() {
        let time: Vec<f64> = (0..50).filter(|k| !(10..13).contains(k)).map(|k| 0.5 * f64::from(k)).collect();
        let even = evenly(&run(time)).expect("even with a gap");
        assert_eq!((even.len(), even.time[11]), (50, 5.5));
        assert!((even.inputs[11] - 11.0).abs() < 1e-12 && even.measured[11].is_nan() && even.measured[13] == 10.0);
    }

    #[test]
    fn long_runs_are_thinned_and_that_is_said() {
        let long = run((0..50_000).map(f64::from).collect());
        let short = run((0..500).map(f64::from).collect());
        let in_time = |runs: Vec<Run>, candidates: usize| thinned(runs, 1, candidates, &Domain::Time);
        let (kept, note) = in_time(vec![long.clone(), short.clone()], 20);
        assert!(note.is_none() && kept == [long.clone(), short.clone()]);
        let mut stepped = long.clone();
        stepped.inputs.iter_mut().enumerate().for_each(|(k, u)| *u = f64::from(u8::from(k % 1000 > 497)));
        let (kept, note) = in_time(vec![stepped.clone()], 4_000);
        // fewer outputs are compared, and of the rows between those stay at which the input bends
        assert!(note.is_some_and(|n| n.contains("of 50000 measurements 7143 are compared")));
        let found = &kept[0];
        assert!((7143..7143 + 201).contains(&found.len()), "{}", found.len());
        for k in 0..50_000 {
            let to = found.time.partition_point(|t| *t < k as f64);
            let from = if found.time[to] == k as f64 { to } else { to - 1 };
            let part =
                if to > from { (k as f64 - found.time[from]) / (found.time[to] - found.time[from]) } else { 0.0 };
            let input = found.inputs[from] + part * (found.inputs[to] - found.inputs[from]);
            assert_eq!(input, stepped.inputs[k], "{k}");
            let measured = if to == from { found.measured[to] } else { f64::NAN };
            assert!(measured == stepped.measured[k] || k % 7 != 0 && measured.is_nan(), "{k}");
        }
        // an input that is held changes where it did
        let held = Run { held: vec![true], ..stepped.clone() };
        let (kept, _) = in_time(vec![held], 4_000);
        for k in 0..50_000 {
            let from = kept[0].time.partition_point(|t| *t <= k as f64) - 1;
            assert_eq!(kept[0].inputs[from], stepped.inputs[k], "{k}");
        }
        // one that bends everywhere keeps all rows
        let rough = Run { inputs: (0..50_000).map(|k| f64::from(k * 7919 % 101)).collect(), ..stepped.clone() };
        let (kept, _) = in_time(vec![rough.clone()], 4_000);
        assert_eq!((&kept[0].inputs, &kept[0].time), (&rough.inputs, &rough.time));
        let (kept, note) = in_time(vec![long, short.clone()], 4_000);
        assert!(note.is_some_and(|n| n.starts_with("of 50500 samples every 7th is used (7643), as there are")));
        assert_eq!((kept[0].len(), kept[0].time[2], kept[0].inputs[2], kept[0].measured[2]), (7143, 14.0, 28.0, 14.0));
        assert_eq!(kept[1], short);
    }

    #[test]
    fn what_has_no_spectrum_is_refused() {
        let short = evenly(&run((0..7).map(f64::from).collect()));
        assert!(matches!(short, Err(DiagnosisError::TooShort { samples: 7, .. })));
        let uneven = evenly(&run((0..60).map(|k| f64::from(k * k)).collect()));
        assert!(matches!(uneven, Err(DiagnosisError::Uneven { .. })));
        let torn = (0..60).map(|k| f64::from(if k < 30 { k } else { k + 5000 })).collect();
        assert!(matches!(evenly(&run(torn)), Err(DiagnosisError::LongGap { .. })));
        let one = run((0..40).map(f64::from).collect());
        assert!(apart(std::slice::from_ref(&one), std::slice::from_ref(&one)).is_err());
    }
}
