//! The screening of all candidates: noise, scores, chances.

use super::consistency::Consistency;
use super::judge::Judge;
use super::lines::{Lines, Record};
use super::noise::LogSpectrum;
use super::rest::Outlier;
use super::saturated::Saturated;
use super::score::Direction;
use super::shared::Shared;
use nalgebra::DMatrix;

/// Fewest samples of a run: below them no spectrum can be had.
const LEAST: usize = 32;

/// Why runs cannot be screened.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ScreeningError {
    /// Nothing to screen.
    #[error("there is no run, no output or no direction to screen")]
    Nothing,
    /// Too few samples.
    #[error("run {run} has {samples} samples; {least} are needed to tell noise from an effect")]
    TooShort {
        /// Index of the run.
        run: usize,
        /// Its samples.
        samples: usize,
        /// The least number.
        least: usize,
    },
    /// A signal that is not a number, or does not have the length of the residual.
    #[error("run {run}: a residual, sensitivity or direction is not finite where something was measured")]
    NotFinite {
        /// Index of the run.
        run: usize,
    },
    /// All residuals are zero.
    #[error("the model reproduces every measurement exactly: nothing is wrong, and there is no noise to judge by")]
    NothingWrong,
    /// More is fitted than there are lines.
    #[error("{fitted} values were fitted to {lines} lines: nothing is left to judge by")]
    TooMany {
        /// Fitted values.
        fitted: usize,
        /// Lines.
        lines: usize,
    },
}

/// How candidates are screened.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScreeningOptions {
    /// Lines that are left out at the low end of every output of every run: the mean, of which noise with a memory as long as
    /// the record says nothing.
    pub dropped: usize,
    /// Draws of residuals by which the best candidate is judged.
    pub draws: usize,
}

impl Default for ScreeningOptions {
    fn default() -> Self {
        Self { dropped: 1, draws: 400 }
    }
}

/// What screening says of one candidate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Its best direction, by index; none where the fitted parameters make up for all of them.
    pub direction: Option<usize>,
    /// Twice the gain in log-likelihood that it promises.
    pub statistic: f64,
    /// The multiple of that direction's size that promises it.
    pub amount: f64,
    /// The chance that noise of the spectrum found gives this candidate as much.
    pub chance: f64,
    /// What is left of its best direction beside the fitted parameters, as a share of its energy: near 0 it cannot be told
    /// from them.
    pub distinct: f64,
    /// The statistic beyond what noise gives it once in a hundred times: by this candidates are ranked.
    pub lead: f64,
    /// The smallest size that would have been seen, at a family-wise chance of 1 %, four times of five; none where no size
    /// that was tried would, or where no draws were made.
    pub detectable: Option<f64>,
}

impl Candidate {
    /// The gain in log-likelihood that it promises.
    pub fn gain(&self) -> f64 {
        self.statistic / 2.0
    }
}

/// The result of screening.
#[derive(Debug, Clone)]
pub struct Screening {
    /// Every candidate, in the order of the directions.
    pub candidates: Vec<Candidate>,
    /// Candidates by rank, the likeliest first.
    pub ranking: Vec<usize>,
    /// The chance that noise alone makes any candidate look as good as the best one does.
    pub family_wise: f64,
    /// Spectrum of each output's noise.
    pub spectra: Vec<LogSpectrum>,
    /// Lines and samples that were cut back because noise does not make them.
    pub outliers: Vec<Outlier>,
    /// Whether noise that outputs share was found, and was taken into account.
    pub correlated: bool,
    /// G: products of the projected directions.
    pub gram: DMatrix<f64>,
    /// What the fitted parameters were moved by, for one unit of each direction (p by m).
    pub compensation: DMatrix<f64>,
    /// Standard errors of the fitted parameters under this noise (p).
    pub errors: Vec<f64>,
    /// The directions that each candidate's statistic is of and their multiples: several where parameters are joined.
    pub amounts: Vec<Vec<(usize, f64)>>,
    /// Whether each candidate's effect is of the same size in all runs; none with one run.
    pub consistency: Vec<Option<Consistency>>,
}

impl Screening {
    /// How far the fitted parameters have been moved by the absence of a candidate's effect, in standard errors (p): what they
    /// are too large by.
    pub fn bias(&self, candidate: usize) -> Vec<f64> {
        let moved = |j: usize| -> f64 {
            self.amounts[candidate].iter().map(|(k, amount)| self.compensation[(j, *k)] * amount).sum()
        };
        let bias = |j: usize| if self.errors[j] > 0.0 { moved(j) / self.errors[j] } else { 0.0 };
        (0..self.errors.len()).map(bias).collect()
    }

    /// Cosine of the angle between what two candidates add, beside what was fitted, as each promises the most: near 1 or -1
    /// these runs cannot tell them apart, and of a gain by one the other has the square of this as a share.
    pub fn cosine(&self, a: usize, b: usize) -> f64 {
        let product = |a: usize, b: usize| -> f64 {
            let pairs = self.amounts[a].iter().flat_map(|i| self.amounts[b].iter().map(move |j| (i, j)));
            pairs.map(|((i, x), (j, y))| x * y * self.gram[(*i, *j)]).sum()
        };
        let sizes = product(a, a) * product(b, b);
        if sizes > 0.0 { (product(a, b) / sizes.sqrt()).clamp(-1.0, 1.0) } else { 0.0 }
    }
}

/// Screens directions against the residuals of a fit.
///
/// # Errors
/// [`ScreeningError`]
pub fn screen(
    records: &[Record],
    channels: usize,
    directions: &[Direction],
    options: &ScreeningOptions,
) -> Result<Screening, ScreeningError> {
    screened(records, None, channels, directions, options)
}

/// The same for signals that are lines of some transform already, in which noise is independent from line to line: `frequencies` has
/// the frequency of every row of each run, rising. None of them is left out.
///
/// # Errors
/// [`ScreeningError`]; what it calls samples are lines.
pub fn screen_lines(
    records: &[Record],
    frequencies: &[Vec<f64>],
    channels: usize,
    directions: &[Direction],
    options: &ScreeningOptions,
) -> Result<Screening, ScreeningError> {
    screened(records, Some(frequencies), channels, directions, options)
}

fn screened(
    records: &[Record],
    frequencies: Option<&[Vec<f64>]>,
    channels: usize,
    directions: &[Direction],
    options: &ScreeningOptions,
) -> Result<Screening, ScreeningError> {
    if directions.is_empty() {
        return Err(ScreeningError::Nothing);
    }
    let shared = gathered(records, frequencies, channels, options)?;
    let judge = Judge::new(shared, directions);
    Ok(judge.verdict(options.draws))
}

/// The spectrum of each output's noise alone: what the fit and the directions of the records, if they have any, together leave of the
/// residuals.
///
/// # Errors
/// [`ScreeningError`]
pub fn spectra(
    records: &[Record],
    channels: usize,
    options: &ScreeningOptions,
) -> Result<Vec<LogSpectrum>, ScreeningError> {
    Ok(Saturated::new(gathered(records, None, channels, options)?).noise.spectra)
}

/// The same for signals that are lines already.
///
/// # Errors
/// [`ScreeningError`]; what it calls samples are lines.
pub fn spectra_of_lines(
    records: &[Record],
    frequencies: &[Vec<f64>],
    channels: usize,
    options: &ScreeningOptions,
) -> Result<Vec<LogSpectrum>, ScreeningError> {
    Ok(Saturated::new(gathered(records, Some(frequencies), channels, options)?).noise.spectra)
}

fn gathered(
    records: &[Record],
    frequencies: Option<&[Vec<f64>]>,
    channels: usize,
    options: &ScreeningOptions,
) -> Result<Shared, ScreeningError> {
    if records.is_empty() || channels == 0 {
        return Err(ScreeningError::Nothing);
    }
    let least = if frequencies.is_some() { LEAST } else { LEAST.max(2 * options.dropped) };
    let samples = |r: &Record| (0..channels).map(|c| r.measured(channels, c).len()).max().unwrap_or(0);
    if let Some((run, samples)) = records.iter().map(samples).enumerate().find(|(_, n)| *n < least) {
        return Err(ScreeningError::TooShort { run, samples, least });
    }
    if let Some(run) = records.iter().position(|r| !is_finite(r)) {
        return Err(ScreeningError::NotFinite { run });
    }
    let mut lines = match frequencies {
        Some(frequencies) => Lines::given(records, frequencies, channels, least),
        None => Lines::of(records, channels, options.dropped, least),
    };
    let fitted = records[0].fitted.len();
    let count: usize = lines.iter().map(|l| l.frequency.len()).sum();
    if 2 * fitted > count {
        return Err(ScreeningError::TooMany { fitted, lines: count });
    }
    let right: Vec<bool> = (0..channels)
        .map(|c| lines.iter().filter(|l| l.channel == c).all(|l| l.residual.norm_squared() == 0.0))
        .collect();
    lines.retain(|l| !right[l.channel]);
    if lines.is_empty() {
        return Err(ScreeningError::NothingWrong);
    }
    Ok(Shared::new(lines, channels, fitted))
}

/// Whether every signal is a number wherever something was measured, and has the residual's length.
fn is_finite(record: &Record) -> bool {
    let fits = |signal: &[f64]| {
        let mut pairs = signal.iter().zip(&record.residual);
        signal.len() == record.residual.len() && pairs.all(|(value, residual)| residual.is_nan() || value.is_finite())
    };
    record.interval > 0.0
        && record.interval.is_finite()
        && fits(&record.residual)
        && record.fitted.iter().flatten().all(|s| fits(s))
        && record.directions.iter().all(|s| fits(s))
}
