//! The channels of a run on its even grid of time, gaps found and bridged.

use super::error::{ChannelName, SpectrumError};
use super::held_edges::{AtOutputs, HeldEdge};
use crate::record::Run;
use crate::record::even_grid::{LONGEST_GAP, NotEven};

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
