//! What enters the steps and outputs of a subsystem beside its states: rows of numbers read from the drive.

use super::equations::Part;
use crate::dynamics::Layout;
use crate::simulate::delayed_inputs::TAPS;
use crate::simulate::drive::DriveTable;
use fdm_grammar::graph::Signal;
use std::ops::Range;

/// One number of the feed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reading {
    /// From the values of the drive, at this distance from those of the step or sample.
    Value(u32),
    /// From the samples, at this distance from the one at the beginning of the step: where every step is an interval, the
    /// inputs stand there closer together.
    Sample(u32),
    /// From the slopes of delayed signals, likewise.
    Slope(u32),
    /// One of the neighbouring samples of an input through which its delay is seen.
    Tap { input: u32, delayed: u32, tap: u32 },
    /// 1, for constants.
    One,
}

/// A number of the feed and its coefficients: a combination of the weights at the beginning, in the middle and at the end
/// of a step (outputs: the first alone).
#[derive(Debug, Clone, Copy)]
pub(super) struct Term {
    pub(super) reading: Reading,
    /// Position among the drives of this group of equations; the constant stands behind them.
    pub(super) drive: usize,
    pub(super) weights: [f64; 3],
}

impl Term {
    /// Weights of the three stages: of the signal, and of its slope, which delays are seen by.
    pub(super) fn weights(&self, drive: &DriveTable) -> ([f64; 3], [f64; 3]) {
        match self.reading {
            Reading::Slope(_) => ([0.0; 3], self.weights),
            Reading::Tap { delayed, tap, .. } => {
                let weights = drive.taps(delayed as usize);
                let of = |rows: &[[f64; TAPS]; 3]| [0, 1, 2].map(|stage| rows[stage][tap as usize]);
                (of(&weights.value), of(&weights.slope))
            }
            _ => (self.weights, [0.0; 3]),
        }
    }
}

/// The feed of some steps, one row of numbers for each.
#[inline(always)]
pub(super) fn gather(terms: &[Term], drive: &DriveTable, steps: Range<usize>, feed: &mut [f64]) {
    let (width, count) = (terms.len(), steps.len());
    let feed = &mut feed[..width * count];
    for (m, term) in terms.iter().enumerate() {
        let (table, stride, from) = match term.reading {
            Reading::Value(at) => (drive.all_stages(), 3 * drive.width(), at as usize),
            Reading::Sample(at) => (drive.all_samples(), drive.width(), at as usize),
            Reading::Slope(at) => (drive.all_stage_slopes(), 3 * drive.delays(), at as usize),
            Reading::One => (&[1.0][..], 0, 0),
            Reading::Tap { input, delayed, tap } => {
                let first = drive.taps(delayed as usize).first + i64::from(tap);
                let (begin, end) = (first + steps.start as i64, first + steps.end as i64);
                if begin < 0 || end as usize * drive.width() > drive.all_samples().len() {
                    for (row, sample) in feed.chunks_exact_mut(width).zip(begin..) {
                        row[m] = drive.nearest(sample, input as usize);
                    }
                    continue;
                }
                for (row, sample) in feed
                    .chunks_exact_mut(width)
                    .zip(drive.all_samples()[begin as usize * drive.width()..].chunks_exact(drive.width()))
                {
                    row[m] = sample[input as usize];
                }
                continue;
            }
        };
        place(table, (from + steps.start * stride, stride), feed, (m, width));
    }
}

/// The feed of the outputs at some samples, likewise.
#[inline(always)]
pub(super) fn gather_samples(terms: &[Term], drive: &DriveTable, samples: Range<usize>, feed: &mut [f64]) {
    let width = terms.len();
    for (m, term) in terms.iter().enumerate() {
        let (table, stride, at) = match term.reading {
            Reading::Value(at) | Reading::Sample(at) => (drive.all_samples(), drive.width(), at as usize),
            Reading::Slope(at) => (drive.all_sample_slopes(), drive.delays(), at as usize),
            Reading::One | Reading::Tap { .. } => (&[1.0][..], 0, 0),
        };
        place(table, (samples.start * stride + at, stride), &mut feed[..width * samples.len()], (m, width));
    }
}

/// Numbers of a table, `stride` apart, to column m of rows of `width`.
#[inline(always)]
fn place(table: &[f64], (mut from, stride): (usize, usize), feed: &mut [f64], (m, width): (usize, usize)) {
    for row in feed.chunks_exact_mut(width) {
        row[m] = table[from];
        from += stride;
    }
}

/// What enters a step: an input at its ends (held: at the beginning), a delayed one at three stages, with slopes where
/// the delay is estimated; then the constant.
pub(super) fn step_terms(layout: &Layout, part: &Part, (held, per): (&[bool], usize), table: &DriveTable) -> Vec<Term> {
    let (width, delays) = (layout.drive(), layout.delayed.len());
    let mut terms = Vec::new();
    for (drive, d) in part.drive.iter().enumerate() {
        let value = |stage: usize, weights: [f64; 3]| {
            let reading = Reading::Value((stage * width + d) as u32);
            Term { reading, drive, weights }
        };
        let end = |end: usize, weights: [f64; 3]| match per {
            1 => Term { reading: Reading::Sample((end * width + d) as u32), drive, weights },
            _ => value(2 * end, weights),
        };
        match d.checked_sub(layout.inputs) {
            None if held[*d] => terms.push(end(0, [1.0, 1.0, 1.0])),
            None => terms.extend([end(0, [1.0, 0.5, 0.0]), end(1, [0.0, 0.5, 1.0])]),
            Some(delayed) if table.has_taps() => {
                let Signal::Input(input) = layout.delayed[delayed] else { continue };
                let tap = |tap: u32| Reading::Tap { input, delayed: delayed as u32, tap };
                terms.extend([0, 1, 2].map(|k| Term { reading: tap(k), drive, weights: [0.0; 3] }));
            }
            Some(delayed) => {
                let unit = |stage: usize| [0, 1, 2].map(|s| f64::from(u8::from(s == stage)));
                terms.extend([0, 1, 2].map(|stage| value(stage, unit(stage))));
                if layout.patterns.tau_by_param.row(delayed).next().is_some() {
                    terms.extend([0, 1, 2].map(|stage| {
                        let reading = Reading::Slope((stage * delays + delayed) as u32);
                        Term { reading, drive, weights: unit(stage) }
                    }));
                }
            }
        }
    }
    terms.push(Term { reading: Reading::One, drive: part.drive.len(), weights: [1.0; 3] });
    terms
}

/// What enters outputs: the drive at the sample, slopes where delays are estimated, and the constant.
pub(super) fn output_terms(layout: &Layout, part: &Part) -> Vec<Term> {
    let (mut terms, weights) = (Vec::new(), [1.0, 0.0, 0.0]);
    for (drive, d) in part.output_drive.iter().enumerate() {
        terms.push(Term { reading: Reading::Value(*d as u32), drive, weights });
        if let Some(delayed) = d.checked_sub(layout.inputs)
            && layout.patterns.tau_by_param.row(delayed).next().is_some()
        {
            terms.push(Term { reading: Reading::Slope(delayed as u32), drive, weights });
        }
    }
    terms.push(Term { reading: Reading::One, drive: part.output_drive.len(), weights });
    terms
}
