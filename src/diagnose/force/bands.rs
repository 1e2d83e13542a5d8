//! Bands of lines in which a residual is held against a signal.

use super::sheet::Sheet;
use nalgebra::DMatrix;
use std::ops::Range;

/// Widths of bands: ratio of their ends, and the fewest lines of the longest run.
pub(super) const WIDTHS: [(f64, usize); 3] = [(1.06, 6), (1.25, 10), (2.0, 20)];

/// One band: where it lies, and its lines in every run.
#[derive(Debug, Clone)]
pub(super) struct Band {
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) rows: Vec<Range<usize>>,
    /// Which of the widths it has, where it is one of those that do not overlap.
    pub(super) disjoint: Option<usize>,
}

impl Band {
    /// From one frequency to another.
    pub(super) fn between(sheets: &[Sheet], low: f64, high: f64) -> Self {
        let rows = |s: &Sheet| s.frequency.partition_point(|v| *v < low)..s.below(high);
        Self { low: low.max(0.0), high, rows: sheets.iter().map(rows).collect(), disjoint: None }
    }

    /// Lines of all runs.
    pub(super) fn lines(&self) -> usize {
        self.rows.iter().map(ExactSizeIterator::len).sum()
    }

    /// The lines of the band of all runs, one below the other.
    pub(super) fn gathered(&self, lines: &[DMatrix<f64>]) -> DMatrix<f64> {
        let mut all = DMatrix::zeros(self.lines(), lines[0].ncols());
        let mut row = 0;
        for (lines, rows) in lines.iter().zip(&self.rows) {
            all.rows_mut(row, rows.len()).copy_from(&lines.rows(rows.start, rows.len()));
            row += rows.len();
        }
        all
    }
}

/// Overlapping bands of several widths.
pub(super) fn bands(sheets: &[Sheet]) -> Vec<Band> {
    let Some(longest) = sheets.iter().max_by_key(|s| s.frequency.len()) else { return Vec::new() };
    let f = &longest.frequency;
    let mut bands = Vec::new();
    for (width, (ratio, fewest)) in WIDTHS.into_iter().enumerate() {
        let (mut first, mut free) = (0, 0);
        while first + fewest <= f.len() {
            let last = f.partition_point(|v| *v < f[first] * ratio).max(first + fewest).min(f.len());
            let disjoint = first >= free;
            if disjoint {
                free = last;
            }
            let band = Band::between(sheets, f[first], f[last - 1]);
            bands.push(Band { disjoint: disjoint.then_some(width), ..band });
            // each begins in the middle of the one before
            first += ((last - first) / 2).max(1);
        }
    }
    bands
}
