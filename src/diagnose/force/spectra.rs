//! The noise of every output, as smooth spectra of what is left over, in cells of neighbouring lines.

use super::likelihood::Rest;
use super::sheet::Sheet;
use super::spectrum::{Left, PRICE, SmoothSpectrum};
use nalgebra::{DMatrix, DVector, DVectorView};

/// Ratio of the frequencies at which neighbouring cells begin, and the fewest lines of one.
const WIDTH: f64 = 1.25;
const FEWEST: usize = 4;
/// Freedom of a cell below which it was fitted away.
const LEAST_FREEDOM: f64 = 0.2;
/// The share of lines, at the upper end, in which a floor is looked for.
const UPPER: f64 = 0.4;

/// S at every line of a run (L by q).
#[derive(Debug, Clone)]
pub(super) struct Density {
    values: DMatrix<f64>,
}

impl Density {
    pub(super) fn channel(&self, channel: usize) -> DVectorView<'_, f64> {
        self.values.column(channel)
    }
}

/// A smooth spectrum for each output.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Spectra {
    pub(super) channels: Vec<SmoothSpectrum>,
    /// By how much each beats a white one, less what it costs.
    pub(super) coloured: Vec<f64>,
}

impl Spectra {
    /// White noise as strong as the residual in its upper lines, where models have nothing to say.
    pub(super) fn floor(sheets: &[Sheet]) -> Self {
        let q = sheets[0].channels();
        let of = |channel: usize| {
            let (mut sum, mut count) = (0.0, 0.0);
            for sheet in sheets {
                let lines = sheet.frequency.len();
                let upper = ((1.0 - UPPER) * lines as f64) as usize;
                sum += sheet.residual.column(channel).rows(upper, lines - upper).norm_squared();
                count += (lines - upper) as f64;
            }
            SmoothSpectrum::white(sum / count)
        };
        Self { channels: (0..q).map(of).collect(), coloured: vec![0.0; q] }
    }

    pub(super) fn fit(sheets: &[Sheet], rests: &[Rest]) -> Self {
        let q = sheets[0].channels();
        let (channels, coloured) = (0..q)
            .map(|channel| {
                let left = cells(sheets, rests, channel);
                let (own, white) = (SmoothSpectrum::fit(&left), SmoothSpectrum::level(&left));
                let gain = 0.5 * (white.twice_loss(&left) - own.twice_loss(&left)) - PRICE * (own.size() - 1) as f64;
                (own, gain)
            })
            .unzip();
        Self { channels, coloured }
    }

    pub(super) fn density(&self, sheet: &Sheet) -> Density {
        let logs: Vec<f64> = sheet.frequency.iter().map(|f| f.ln()).collect();
        let values = DMatrix::from_fn(logs.len(), self.channels.len(), |line, channel| {
            self.channels[channel].at(logs[line]).max(f64::MIN_POSITIVE)
        });
        Density { values }
    }

    /// What the spectra cost in log-likelihood.
    pub(super) fn price(&self) -> f64 {
        self.channels.iter().map(|s| PRICE * s.size() as f64).sum()
    }
}

/// What is left of one output in cells of neighbouring lines, all runs together.
fn cells(sheets: &[Sheet], rests: &[Rest], channel: usize) -> Vec<Left> {
    let mut lines: Vec<(f64, f64, f64)> = Vec::new();
    for (sheet, rest) in sheets.iter().zip(rests) {
        let columns: (DVector<f64>, DVector<f64>) =
            (rest.residual.column(channel).into_owned(), rest.freedom.column(channel).into_owned());
        let own = columns.0.iter().zip(columns.1.iter());
        lines.extend(sheet.frequency.iter().zip(own).map(|(f, (r, freedom))| (*f, r * r, *freedom)));
    }
    lines.sort_by(|a, b| a.0.total_cmp(&b.0));
    let fewest = FEWEST * sheets.len();
    let mut cells = Vec::new();
    let mut first = 0;
    while first < lines.len() {
        let mut last = first + fewest.min(lines.len() - first);
        while last < lines.len() && lines[last].0 < lines[first].0 * WIDTH {
            last += 1;
        }
        if lines.len() - last < fewest {
            last = lines.len();
        }
        let own = &lines[first..last];
        let freedom: f64 = own.iter().map(|l| l.2).sum();
        if freedom > LEAST_FREEDOM {
            let log_frequency = own.iter().map(|l| l.0.ln()).sum::<f64>() / own.len() as f64;
            cells.push(Left { log_frequency, power: own.iter().map(|l| l.1).sum::<f64>() / freedom, freedom });
        }
        first = last;
    }
    cells
}
