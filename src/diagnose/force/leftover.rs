//! Whether residuals are noise: noise of independent sensors has no line in common with the inputs, with products of states and
//! inputs, nor with the noise of another sensor.
//!
//! In every band of lines the residual of an output is regressed on a signal and its quadrature, with one gain and phase
//! for all runs. For noise whose spectrum is flat across the band the share that they explain has the distribution of a
//! Beta variate, whatever the noise's power there: nothing that a spectrum can swallow. The least chance of all outputs, signals
//! and bands is judged by what it is for residuals that are drawn as noise, with the fit taken out of them.

use super::driven::Driven;
use super::likelihood::settle;
use super::place::{ForceError, Passage};
use super::quadrature::Quadrature;
use super::sheet::{Cosines, DROPPED, Sheet, sheets};
use super::signals::Signals;
use super::spectra::{Density, Spectra};
use crate::diagnose::screen::{Normal, exceedance};
use crate::model::Model;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::Serialize;

/// Widths of bands: ratio of their ends, and the fewest lines of the longest run.
const WIDTHS: [(f64, usize); 3] = [(1.06, 6), (1.25, 10), (2.0, 20)];
/// Draws of residuals that are noise.
const DRAWS: usize = 200;
/// Most findings that are told.
const TOLD: usize = 12;

/// What a residual hangs together with.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Partner {
    /// An input.
    Input(String),
    /// A function of states and inputs.
    Function(String),
    /// The residual of another output.
    Output(String),
}

/// A band in which a residual is not noise of its own.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coherence {
    /// The output.
    pub output: String,
    /// With what.
    pub partner: Partner,
    /// Lowest frequency of the band, in cycles per unit of time.
    pub low: f64,
    /// Highest.
    pub high: f64,
    /// The share of the residual's power in the band that follows the partner.
    pub share: f64,
    /// The chance of such a share for noise, in this band alone.
    pub chance: f64,
}

impl std::fmt::Display for Coherence {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { output, low, high, share, .. } = self;
        let partner = match &self.partner {
            Partner::Input(name) => format!("follows the input {name}"),
            Partner::Function(text) => format!("follows {text}"),
            Partner::Output(name) => format!("is common to {output} and {name}"),
        };
        write!(
            f,
            "{output}: {:.0} % of what is left between {low:.3} and {high:.3} cycles per unit of time {partner}",
            100.0 * share
        )
    }
}

/// Whether residuals are noise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Leftover {
    /// The chance that independent noise in every output looks as structured as this.
    pub chance: f64,
    /// The chance that it looks as much like the inputs and their products: a cause that repeats.
    pub repeatable: f64,
    /// The chance that the outputs' noises look as much alike: a cause in front of the sensors.
    pub common: f64,
    /// What stands out, by rising chance, at most one band for every output and partner.
    pub coherences: Vec<Coherence>,
}

/// Asks whether the residuals of a fit are noise.
///
/// # Errors
/// [`ForceError`]
pub fn leftover(model: &Model, passages: &[Passage<'_>]) -> Result<Leftover, ForceError> {
    let q = model.layout().outputs;
    let sheets = sheets(passages, q)?;
    let null = settle(&sheets, None, &Spectra::floor(&sheets));
    let signals = Signals::new(model, &Driven::new(model, &[]), passages)?;
    let judge = Judge::new(&sheets, &signals, &null.spectra);
    let residuals: Vec<DMatrix<f64>> = sheets.iter().map(|s| s.residual.clone()).collect();
    let found = judge.tests(&judge.whitened(&residuals));
    let drawn: Vec<(f64, f64)> = (0..DRAWS as u64).into_par_iter().map(|seed| judge.draw(seed)).collect();
    let (own, common) = judge.least(&found);
    let chance = |pick: fn(&(f64, f64)) -> f64, value: f64| {
        let mut all: Vec<f64> = drawn.iter().map(pick).collect();
        if all.iter().all(|v| *v <= 0.0) { 1.0 } else { exceedance(&mut all, value) }
    };
    let (repeatable, common) = (chance(|d| d.0, own), chance(|d| d.1, common));
    // the better of two
    let least = repeatable.min(common);
    Ok(Leftover {
        chance: 1.0 - (1.0 - least) * (1.0 - least),
        repeatable,
        common,
        coherences: judge.told(model, &signals, found),
    })
}

/// Lines of one run that belong to a band.
type Rows = std::ops::Range<usize>;

/// One band: where it lies, and its lines in every run.
struct Band {
    low: f64,
    high: f64,
    rows: Vec<Rows>,
}

/// An output against a partner in a band: share and chance.
#[derive(Debug, Clone, Copy)]
struct Test {
    output: usize,
    /// Signals first, then outputs.
    partner: usize,
    band: usize,
    share: f64,
    chance: f64,
}

struct Judge<'a> {
    sheets: &'a [Sheet],
    densities: Vec<Density>,
    bands: Vec<Band>,
    signals: usize,
    /// For every signal and band an orthonormal basis of signal and quadrature (lines of all runs by 2).
    bases: Vec<Vec<DMatrix<f64>>>,
    quadratures: Vec<Quadrature>,
    /// Takes the fit out of drawn residuals: (J'J/S)^-1 J'/S.
    fitted: DMatrix<f64>,
}

impl<'a> Judge<'a> {
    fn new(sheets: &'a [Sheet], signals: &Signals, spectra: &Spectra) -> Self {
        let bands = bands(sheets);
        let quadratures: Vec<Quadrature> = sheets.iter().map(|s| Quadrature::new(s.samples)).collect();
        let count = signals.functions.len();
        let bases = (0..count)
            .into_par_iter()
            .map(|signal| {
                let lines = |run: usize| {
                    let mut cosines = Cosines::new(sheets[run].samples);
                    quadratures[run].lines(&mut cosines, &signals.courses[run][signal])
                };
                let lines: Vec<DMatrix<f64>> = (0..sheets.len()).map(lines).collect();
                bands.iter().map(|band| basis(&gathered(&lines, band))).collect()
            })
            .collect();
        let densities: Vec<Density> = sheets.iter().map(|s| spectra.density(s)).collect();
        let p = sheets[0].fitted[0].ncols();
        let mut products = DMatrix::zeros(p, p);
        for (sheet, density) in sheets.iter().zip(&densities) {
            for channel in 0..sheet.channels() {
                let mut weighed = sheet.fitted[channel].clone();
                for mut column in weighed.column_iter_mut() {
                    column.component_div_assign(&density.channel(channel));
                }
                products += weighed.tr_mul(&sheet.fitted[channel]);
            }
        }
        let fitted = products.cholesky().map_or_else(|| DMatrix::zeros(p, p), |c| c.inverse());
        Self { sheets, densities, bands, signals: count, bases, quadratures, fitted }
    }

    /// Residuals over the deviation of their noise.
    fn whitened(&self, residuals: &[DMatrix<f64>]) -> Vec<DMatrix<f64>> {
        let one = |(residual, density): (&DMatrix<f64>, &Density)| {
            let mut white = residual.clone();
            for (channel, mut column) in white.column_iter_mut().enumerate() {
                column.iter_mut().zip(density.channel(channel).iter()).for_each(|(r, s)| *r /= s.sqrt());
            }
            white
        };
        residuals.iter().zip(&self.densities).map(one).collect()
    }

    /// Every output against every partner in every band.
    fn tests(&self, white: &[DMatrix<f64>]) -> Vec<Test> {
        let q = self.sheets[0].channels();
        let own: Vec<Vec<DMatrix<f64>>> = (0..q)
            .map(|channel| {
                let columns: Vec<DMatrix<f64>> = white.iter().map(|w| w.columns(channel, 1).into_owned()).collect();
                self.bands.iter().map(|band| gathered(&columns, band)).collect()
            })
            .collect();
        let mut tests = Vec::with_capacity(self.bands.len() * q * (self.signals + q));
        let mut test = |output: usize, partner: usize, band: usize, basis: &DMatrix<f64>| {
            let lines = &own[output][band];
            let (total, free) = (lines.norm_squared(), lines.nrows() as f64 - 2.0);
            if basis.ncols() < 2 || total <= 0.0 {
                return;
            }
            let share = (basis.tr_mul(lines).norm_squared() / total).min(1.0);
            tests.push(Test { output, partner, band, share, chance: (1.0 - share).powf(free / 2.0) });
        };
        for (signal, bases) in self.bases.iter().enumerate() {
            for (band, basis) in bases.iter().enumerate() {
                (0..q).for_each(|output| test(output, signal, band, basis));
            }
        }
        for other in 0..q.saturating_sub(1) {
            let lines: Vec<DMatrix<f64>> = (0..white.len()).map(|run| self.late(run, &white[run], other)).collect();
            for band in 0..self.bands.len() {
                let basis = basis(&gathered(&lines, &self.bands[band]));
                (other + 1..q).for_each(|output| test(output, self.signals + other, band, &basis));
            }
        }
        tests
    }

    /// Whitened lines of an output with their quadrature (L by 2).
    fn late(&self, run: usize, white: &DMatrix<f64>, output: usize) -> DMatrix<f64> {
        let sheet = &self.sheets[run];
        let mut cosines = Cosines::new(sheet.samples);
        let signal = cosines.samples(white.column(output).as_slice());
        self.quadratures[run].lines(&mut cosines, &signal)
    }

    /// Minus the logarithm of the least chance with signals, and between outputs.
    fn least(&self, tests: &[Test]) -> (f64, f64) {
        let least = |between: bool| {
            let own = tests.iter().filter(|t| (t.partner >= self.signals) == between);
            -own.map(|t| t.chance).fold(1.0, f64::min).max(f64::MIN_POSITIVE).ln()
        };
        (least(false), least(true))
    }

    /// The same for residuals that are noise, with the fit taken out.
    fn draw(&self, seed: u64) -> (f64, f64) {
        let mut normal = Normal::new(seed + 5000);
        let p = self.fitted.nrows();
        let mut score = DVector::zeros(p);
        let mut drawn: Vec<DMatrix<f64>> = Vec::new();
        for (sheet, density) in self.sheets.iter().zip(&self.densities) {
            let mut noise = DMatrix::zeros(sheet.frequency.len(), sheet.channels());
            for (channel, mut column) in noise.column_iter_mut().enumerate() {
                column.iter_mut().zip(density.channel(channel).iter()).for_each(|(v, s)| *v = s.sqrt() * normal.next());
                score += sheet.fitted[channel].tr_mul(&column.component_div(&density.channel(channel)));
            }
            drawn.push(noise);
        }
        let theta = &self.fitted * score;
        for (sheet, noise) in self.sheets.iter().zip(&mut drawn) {
            for (channel, mut column) in noise.column_iter_mut().enumerate() {
                column.gemv(-1.0, &sheet.fitted[channel], &theta, 1.0);
            }
        }
        self.least(&self.tests(&self.whitened(&drawn)))
    }

    fn told(&self, model: &Model, signals: &Signals, mut tests: Vec<Test>) -> Vec<Coherence> {
        tests.sort_by(|a, b| a.chance.total_cmp(&b.chance));
        let outputs = &model.definition().outputs;
        let mut told: Vec<(usize, usize)> = Vec::new();
        let mut coherences = Vec::new();
        for test in tests {
            if coherences.len() == TOLD || told.contains(&(test.output, test.partner)) {
                continue;
            }
            told.push((test.output, test.partner));
            let name = |k: usize| outputs[k].quantity.name.clone();
            let partner = match signals.functions.get(test.partner) {
                Some(function) if function.input => Partner::Input(function.text.clone()),
                Some(function) => Partner::Function(function.text.clone()),
                None => Partner::Output(name(test.partner - self.signals)),
            };
            let band = &self.bands[test.band];
            coherences.push(Coherence {
                output: name(test.output),
                partner,
                low: band.low,
                high: band.high,
                share: test.share,
                chance: test.chance,
            });
        }
        coherences
    }
}

/// The lines of a band of all runs, one below the other.
fn gathered(lines: &[DMatrix<f64>], band: &Band) -> DMatrix<f64> {
    let count: usize = band.rows.iter().map(ExactSizeIterator::len).sum();
    let mut all = DMatrix::zeros(count, lines[0].ncols());
    let mut row = 0;
    for (lines, rows) in lines.iter().zip(&band.rows) {
        all.rows_mut(row, rows.len()).copy_from(&lines.rows(rows.start, rows.len()));
        row += rows.len();
    }
    all
}

/// Two orthonormal columns, or none where there is no signal.
fn basis(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let none = || DMatrix::zeros(columns.nrows(), 0);
    let (first, second) = (columns.column(0), columns.column(1));
    let size = first.norm();
    if size <= 0.0 || !size.is_finite() {
        return none();
    }
    let first = first / size;
    let beside = second - &first * first.dot(&second);
    let rest = beside.norm();
    if rest <= 1e-6 * second.norm() || rest <= 0.0 {
        return none();
    }
    DMatrix::from_columns(&[first, beside / rest])
}

/// Overlapping bands of several widths.
fn bands(sheets: &[Sheet]) -> Vec<Band> {
    let Some(longest) = sheets.iter().max_by_key(|s| s.frequency.len()) else { return Vec::new() };
    let f = &longest.frequency;
    let mut bands = Vec::new();
    for (ratio, fewest) in WIDTHS {
        let mut first = 0;
        while first + fewest <= f.len() {
            let last = f.partition_point(|v| *v < f[first] * ratio).max(first + fewest).min(f.len());
            let (low, high) = (f[first], f[last - 1]);
            let rows = |s: &Sheet| s.frequency.partition_point(|v| *v < low)..s.below(high);
            bands.push(Band { low, high, rows: sheets.iter().map(rows).collect() });
            // each begins in the middle of the one before
            first += ((last - first) / 2).max(1);
        }
    }
    debug_assert!(f.first().is_none_or(|v| *v > 0.0 && DROPPED > 0));
    bands
}
