//! The channels of a run on its even grid of time, gaps found and bridged.
//!
//! What a bridge over a gap does to the sums of a channel over its samples.
//!
//! A line over a quarter of a period is the signal but for a few per cent. Over longer gaps the record itself says what a bridge of that length
//! does wrong: it is laid over places where the signal is known, and its error is transformed.

use super::frequencies::{ChannelName, SpectrumError};
use super::held_edges::{AtOutputs, HeldEdge};
use crate::record::Run;
use crate::record::even_grid::{LONGEST_GAP, NotEven};
use num_complex::Complex64;

/// Fewest samples of a record that has a spectrum.
const FEWEST: usize = 8;

/// Inputs, then outputs, one row per place of the grid.
#[derive(Debug, Clone)]
pub(super) struct EvenRows {
    /// Distance of neighbouring places in time.
    pub(super) dt: f64,
    /// Number of places.
    pub(super) places: usize,
    /// Numbers in a row.
    pub(super) width: usize,
    /// Places by width; NaN throughout for a channel that was never measured.
    pub(super) rows: Vec<f64>,
    /// The gaps of each channel.
    pub(super) gaps: Vec<Vec<Gap>>,
    /// Changes of held inputs between places.
    edges: Vec<HeldEdge>,
    /// Time of the first place.
    start: f64,
}

/// Places of a channel without a value, one after the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Gap {
    /// The first place.
    pub(super) first: usize,
    /// How many there are.
    pub(super) length: usize,
    /// Whether the value before, or behind, stands in all of them; otherwise a line does from the one to the other.
    pub(super) constant: bool,
}

impl EvenRows {
    /// Lays a run out; `names` of inputs and outputs are for messages.
    ///
    /// # Errors
    /// Too few samples, or intervals that are no multiples of one.
    pub(super) fn of(run: &Run) -> Result<Self, SpectrumError> {
        let few = |found: usize| SpectrumError::TooFewSamples { found, needed: FEWEST };
        let AtOutputs { run, grid, edges, known } = match AtOutputs::of(run) {
            Ok(at) if at.run.len() < FEWEST => return Err(few(at.run.len())),
            Ok(at) => at,
            Err(NotEven::TooFew) => return Err(few(run.len())),
            Err(NotEven::Uneven) => return Err(SpectrumError::Uneven),
        };
        let (n, places) = (run.len(), grid.length());
        let (m, q) = (run.inputs.len() / n, run.measured.len() / n);
        let width = m + q;
        let mut rows = vec![f64::NAN; places * width];
        for (k, place) in grid.place.iter().enumerate() {
            let row = &mut rows[place * width..][..width];
            row[..m].copy_from_slice(&run.inputs[k * m..][..m]);
            row[m..].copy_from_slice(&run.measured[k * q..][..q]);
        }
        known.iter().for_each(|(place, input, value)| rows[place * width + input] = *value);
        // infinite numbers were refused when the file was read; a run made by hand may hold them
        rows.iter_mut().filter(|v| v.is_infinite()).for_each(|v| *v = f64::NAN);
        // the clock's own mean rate, unless a gap was shortened
        let shortened = grid.place.windows(2).any(|p| p[1] - p[0] >= LONGEST_GAP);
        let dt = if shortened { grid.interval } else { (run.time[n - 1] - run.time[0]) / (places - 1) as f64 };
        let mut even = Self { dt, places, width, rows, gaps: Vec::new(), edges, start: run.time[0] };
        even.gaps = (0..width).map(|c| even.bridge(c, c < m && run.held.get(c) == Some(&true))).collect();
        Ok(even)
    }

    /// Changes of one channel between places, for one that is held.
    pub(super) fn edges_of(&self, channel: usize) -> Vec<HeldEdge> {
        self.edges.iter().filter(|edge| edge.input == channel).copied().collect()
    }

    /// Fills the gaps of a channel, linearly or with the value before; gives them.
    fn bridge(&mut self, channel: usize, held: bool) -> Vec<Gap> {
        let (width, mut gaps, mut k) = (self.width, Vec::new(), 0);
        let value = |rows: &[f64], k: usize| rows[k * width + channel];
        while k < self.places {
            if !value(&self.rows, k).is_nan() {
                k += 1;
                continue;
            }
            let end = (k..self.places).find(|e| !value(&self.rows, *e).is_nan()).unwrap_or(self.places);
            gaps.push(Gap { first: k, length: end - k, constant: held || k == 0 || end == self.places });
            let before = (k > 0).then(|| value(&self.rows, k - 1));
            let after = (end < self.places).then(|| value(&self.rows, end));
            for i in k..end {
                let part = (i + 1 - k) as f64 / (end + 1 - k) as f64;
                self.rows[i * width + channel] = match (before, after) {
                    (Some(b), Some(a)) if !held => b + part * (a - b),
                    (Some(v), _) | (None, Some(v)) => v,
                    (None, None) => f64::NAN,
                };
            }
            k = end;
        }
        gaps
    }

    /// The longest gap of a channel: places that are missing, and time of the first.
    pub(super) fn longest_gap(&self, channel: usize) -> (usize, f64) {
        let longest = self.gaps[channel].iter().rev().max_by_key(|gap| gap.length);
        longest.map_or((0, self.start), |gap| (gap.length, self.start + gap.first as f64 * self.dt))
    }

    /// Whether a channel has no values at all.
    pub(super) fn never_measured(&self, channel: usize) -> bool {
        self.rows.get(channel).is_none_or(|v| v.is_nan())
    }

    /// Whether the gaps of a channel are short enough: one sample, or a quarter of the shortest period, over which a line is the
    /// signal but for a few per cent.
    ///
    /// # Errors
    /// [`SpectrumError::Gap`] otherwise.
    pub(super) fn check_gap(&self, channel: usize, highest: f64, name: ChannelName) -> Result<(), SpectrumError> {
        let (missing, time) = self.longest_gap(channel);
        let quarter = (0.25 / (highest * self.dt)).floor();
        let allowed = (quarter.clamp(1.0, (LONGEST_GAP / 2) as f64) as usize).min(self.places / 10).max(1);
        if missing <= allowed {
            return Ok(());
        }
        Err(SpectrumError::Gap { channel: name, missing, time, allowed, highest })
    }
}

/// Largest error of a coefficient that is kept, as a part of the coefficient.
const ERROR: f64 = 0.02;
/// Variance that may be added to that of the noise.
const ADDED: f64 = 0.25;
/// Bridges that are tried for one length: so many places in all, and so many bridges.
const PLACES: usize = 4096;
const TRIED: (usize, usize) = (8, 64);
/// Fewest bridges that say anything.
const FEWEST_BRIDGED: usize = 4;
/// Most frequencies at which errors are computed; those between have the greater one of their neighbours.
const FREQUENCIES: usize = 256;
/// Longest gap that is bridged, as a part of the record.
const LONGEST: f64 = 0.1;
/// Neighbours on each side over which the size of a coefficient is averaged.
const NEIGHBOURS: usize = 2;

/// A channel of a run with gaps that are longer than a quarter of the shortest period.
#[derive(Debug, Clone, PartialEq)]
pub struct Bridge {
    /// The channel.
    pub channel: ChannelName,
    /// Places of the record without a value.
    pub missing: usize,
    /// Places of the longest gap.
    pub longest: usize,
    /// Root mean square error that the bridges make in the coefficients that are kept, as a part of their root mean square; none when none
    /// is kept.
    pub error: Option<f64>,
    /// Frequencies that are not compared, since the error is too large there; those of all outputs where the channel is an input.
    pub left_out: usize,
}

impl Bridge {
    pub(super) fn new(name: ChannelName, even: &EvenRows, channel: usize, trust: &Trust) -> Self {
        Self {
            channel: name,
            missing: even.gaps[channel].iter().map(|gap| gap.length).sum(),
            longest: even.longest_gap(channel).0,
            error: trust.error,
            left_out: trust.kept.iter().filter(|kept| !**kept).count(),
        }
    }
}

/// Where the bridges over the gaps of a channel may be trusted.
pub(super) struct Trust {
    /// For each frequency (M) whether the coefficient is kept.
    pub(super) kept: Vec<bool>,
    /// As [`Bridge::error`].
    pub(super) error: Option<f64>,
}

/// Compares what the bridges of a channel do wrong with its sums at these angular frequencies (M).
pub(super) fn trust(even: &EvenRows, channel: usize, omega: &[f64], sums: &[Complex64]) -> Trust {
    let none = || Trust { kept: vec![false; omega.len()], error: None };
    let Some(errors) = errors(even, channel, omega) else { return none() };
    let squares: Vec<f64> = sums.iter().map(|s| s.norm_sqr()).collect();
    let around = |k: usize| {
        let near = &squares[k.saturating_sub(NEIGHBOURS)..(k + NEIGHBOURS + 1).min(squares.len())];
        near.iter().sum::<f64>() / near.len() as f64
    };
    let mut sorted = squares.clone();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let floor = median.min(even.places as f64 * noise(even, channel).unwrap_or(0.0));
    let kept: Vec<bool> =
        errors.iter().enumerate().map(|(k, e)| *e <= ERROR * ERROR * around(k) || *e <= ADDED * floor).collect();
    let sum = |values: &[f64]| values.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(v, _)| v).sum::<f64>();
    let (error, size) = (sum(&errors), sum(&squares));
    Trust { error: (size > 0.0).then(|| (error / size).sqrt()), kept }
}

/// Expected squared error of the sums at each frequency; none where the record does not tell.
fn errors(even: &EvenRows, channel: usize, omega: &[f64]) -> Option<Vec<f64>> {
    let gaps = &even.gaps[channel];
    if gaps.iter().any(|gap| gap.length as f64 > LONGEST * even.places as f64) {
        return None;
    }
    let known = Known::new(even, gaps);
    let mut kinds: Vec<(usize, bool, usize)> = Vec::new();
    for gap in gaps {
        match kinds.iter_mut().find(|(length, constant, _)| (*length, *constant) == (gap.length, gap.constant)) {
            Some((.., count)) => *count += 1,
            None => kinds.push((gap.length, gap.constant, 1)),
        }
    }
    let step = omega.len().div_ceil(FREQUENCIES).max(1);
    let mut places: Vec<usize> = (0..omega.len()).step_by(step).collect();
    places.extend(omega.len().checked_sub(1).filter(|last| places.last() != Some(last)));
    let mut at = vec![0.0; places.len()];
    for (length, constant, count) in kinds {
        let starts = known.starts(length);
        if starts.len() < FEWEST_BRIDGED {
            return None;
        }
        for start in &starts {
            let error = wrong(even, channel, (*start, length), constant);
            for (sum, place) in at.iter_mut().zip(&places) {
                let (turn, mut phase) = (Complex64::cis(-omega[*place] * even.dt), Complex64::ONE);
                let mut total = Complex64::ZERO;
                for e in &error {
                    total += phase * e;
                    phase *= turn;
                }
                *sum += total.norm_sqr() * count as f64 / starts.len() as f64;
            }
        }
    }
    let greater = |k: usize| {
        let behind = places.partition_point(|place| *place < k);
        at[behind].max(at[behind.saturating_sub(usize::from(places[behind] != k))])
    };
    Some((0..omega.len()).map(greater).collect())
}

/// What a bridge over known places does wrong at each of them.
fn wrong(even: &EvenRows, channel: usize, (start, length): (usize, usize), constant: bool) -> Vec<f64> {
    let value = |k: usize| even.rows[k * even.width + channel];
    let (before, behind) = (value(start - 1), value(start + length));
    let bridge =
        |j: usize| if constant { before } else { before + (j + 1) as f64 / (length + 1) as f64 * (behind - before) };
    (0..length).map(|j| value(start + j) - bridge(j)).collect()
}

/// Variance of what changes from place to place, by fourth differences, to which a smooth signal adds little.
fn noise(even: &EvenRows, channel: usize) -> Option<f64> {
    const WEIGHTS: [f64; 5] = [1.0, -4.0, 6.0, -4.0, 1.0];
    let known = Known::new(even, &even.gaps[channel]);
    let at = |k: usize| (0..WEIGHTS.len()).map(|j| WEIGHTS[j] * even.rows[(k + j) * even.width + channel]).sum::<f64>();
    let places = (0..(even.places + 1).saturating_sub(WEIGHTS.len())).filter(|k| known.whole(*k, WEIGHTS.len()));
    let (sum, count) = places.fold((0.0, 0.0), |(sum, count), k| (sum + at(k).powi(2) / 70.0, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

/// Which places have values of their own.
struct Known {
    /// Missing places in front of each (places + 1).
    missing: Vec<usize>,
}

impl Known {
    fn new(even: &EvenRows, gaps: &[Gap]) -> Self {
        let mut missing = vec![0; even.places + 1];
        gaps.iter().flat_map(|gap| gap.first..gap.first + gap.length).for_each(|k| missing[k + 1] = 1);
        (0..even.places).for_each(|k| missing[k + 1] += missing[k]);
        Self { missing }
    }

    /// Whether so many places from this one on have values.
    fn whole(&self, first: usize, count: usize) -> bool {
        self.missing[first] == self.missing[first + count]
    }

    /// Where a bridge of this length can be tried, evenly over the record.
    fn starts(&self, length: usize) -> Vec<usize> {
        let last = (self.missing.len() - 1).saturating_sub(length + 1);
        let all: Vec<usize> = (1..=last).filter(|start| self.whole(start - 1, length + 2)).collect();
        let wanted = (PLACES / length).clamp(TRIED.0, TRIED.1).min(all.len());
        (0..wanted).map(|k| all[k * all.len() / wanted]).collect()
    }
}
