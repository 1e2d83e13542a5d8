//! Products of fitted sensitivities, responses to a law's functions and residuals in cells of neighbouring lines: whatever the
//! noise's spectrum is, everything that is asked for is a sum over cells.

use super::super::likelihood::Hats;
use super::super::sheet::Sheet;
use nalgebra::DMatrix;
use std::ops::Range;

/// Ratio of the frequencies at which neighbouring cells begin, and the fewest lines of one for each run.
const WIDTH: f64 = 1.25;
const FEWEST: usize = 4;

/// One output in a narrow band, all runs together.
pub(super) struct Cell {
    pub(super) channel: usize,
    pub(super) log_frequency: f64,
    pub(super) lines: f64,
    /// Products of sensitivities (p), responses (K) and residual (1) with each other.
    pub(super) products: DMatrix<f64>,
}

/// Lines of every run that belong to a band.
pub(super) struct Band {
    log_frequency: f64,
    rows: Vec<Range<usize>>,
}

/// Bands that do not overlap and hold lines enough of all runs.
pub(super) fn bands(sheets: &[Sheet]) -> Vec<Band> {
    let mut lines: Vec<f64> = sheets.iter().flat_map(|s| s.frequency.iter().copied()).collect();
    lines.sort_by(f64::total_cmp);
    let fewest = FEWEST * sheets.len();
    let (mut bands, mut first) = (Vec::new(), 0);
    while first < lines.len() {
        let mut last = lines.partition_point(|f| *f < lines[first] * WIDTH).max(first + fewest);
        if lines.len() < last + fewest {
            last = lines.len();
        }
        let edge = lines.get(last).copied().unwrap_or(f64::INFINITY);
        let rows =
            |s: &Sheet| s.frequency.partition_point(|f| *f < lines[first])..s.frequency.partition_point(|f| *f < edge);
        let own = &lines[first..lines.partition_point(|f| *f < edge)];
        let log_frequency = own.iter().map(|f| f.ln()).sum::<f64>() / own.len() as f64;
        bands.push(Band { log_frequency, rows: sheets.iter().map(rows).collect() });
        first += own.len().max(1);
    }
    bands
}

/// Cells of all outputs; `hats` are responses in all runs, the same functions in each, or none.
pub(super) fn cells(sheets: &[Sheet], bands: &[Band], hats: Option<&[Hats]>) -> Vec<Cell> {
    let p = sheets[0].fitted[0].ncols();
    let k = hats.map_or(0, |h| h[0][0].ncols());
    let one = |channel: usize, band: &Band| {
        let count: usize = band.rows.iter().map(ExactSizeIterator::len).sum();
        let mut columns = DMatrix::zeros(count, p + k + 1);
        let mut row = 0;
        for (run, (sheet, rows)) in sheets.iter().zip(&band.rows).enumerate() {
            let (start, n) = (rows.start, rows.len());
            columns.view_mut((row, 0), (n, p)).copy_from(&sheet.fitted[channel].rows(start, n));
            if let Some(hats) = hats {
                let own = &hats[run][channel];
                // responses end where nothing of them is left
                let told = own.nrows().saturating_sub(start).min(n);
                columns.view_mut((row, p), (told, k)).copy_from(&own.rows(start.min(own.nrows()), told));
            }
            columns.view_mut((row, p + k), (n, 1)).copy_from(&sheet.residual.view((start, channel), (n, 1)));
            row += n;
        }
        let products = columns.transpose() * columns;
        Cell { channel, log_frequency: band.log_frequency, lines: count as f64, products }
    };
    (0..sheets[0].channels()).flat_map(|channel| bands.iter().map(move |band| one(channel, band))).collect()
}
