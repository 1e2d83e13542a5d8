//! Which frequencies are wanted, and which a record can have; each in cycles per sample with twice the digits of a number, so that a phase is
//! right after a million samples.
//!
//! What a user is told about a record that has no spectrum: a sentence with numbers, and what to do.

use fdm_grammar::math;
use num_complex::Complex64;
use serde::Serialize;
use std::f64::consts::TAU;
use std::fmt;
use std::ops::Range;

/// Most coefficients (4 GiB) that a transform may have.
pub(super) const MOST: usize = 1 << 28;

/// A choice of frequencies, in cycles per unit of time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub enum Frequencies {
    /// The record's own, `i/T` for whole i from 1 and below Nyquist, as far as they lie in the band. Coefficients of white noise are
    /// independent there, and what is constant has none.
    Grid {
        /// Lower end; `None` begins with one cycle in the record.
        lowest: Option<f64>,
        /// Upper end; `None` goes up to Nyquist.
        highest: Option<f64>,
    },
    /// From the lower end in equal steps up to the upper one.
    Band {
        /// Lower end.
        lowest: f64,
        /// Upper end; belongs to the band when it is a step.
        highest: f64,
        /// Step; `None` is `1/T`.
        spacing: Option<f64>,
    },
    /// These, rising.
    List(Vec<f64>),
}

/// Frequencies of one record.
#[derive(Debug, Clone, PartialEq)]
pub struct Comb {
    /// Cycles per sample (M), rising.
    pub(super) cycles: Vec<Cycles>,
    /// Angular frequencies per unit of time (M).
    pub(super) omega: Vec<f64>,
    /// Where they are bins of the transform of all samples.
    pub(super) bins: Option<Range<usize>>,
    /// Their distance in cycles per sample, where they are equally far apart.
    pub(super) step: Option<Cycles>,
}

impl Frequencies {
    /// The chosen frequencies of a record of `samples` samples `dt` apart, of `channels` channels.
    ///
    /// # Errors
    /// What [`SpectrumError`] has to say about bands, lists and their size.
    pub fn of(&self, samples: usize, dt: f64, channels: usize) -> Result<Comb, SpectrumError> {
        let record = Record { samples, dt, channels };
        match self {
            Self::Grid { lowest, highest } => record.grid(*lowest, *highest),
            Self::Band { lowest, highest, spacing } => record.band(*lowest, *highest, *spacing),
            Self::List(list) => record.list(list),
        }
    }
}

#[derive(Clone, Copy)]
struct Record {
    samples: usize,
    dt: f64,
    channels: usize,
}

impl Record {
    fn duration(self) -> f64 {
        self.samples as f64 * self.dt
    }

    fn grid(self, lowest: Option<f64>, highest: Option<f64>) -> Result<Comb, SpectrumError> {
        let (spacing, last) = (1.0 / self.duration(), (self.samples - 1) / 2);
        let low = lowest.unwrap_or(spacing);
        let high = highest.unwrap_or(spacing * last as f64);
        self.check(low, high)?;
        // an end that is a bin belongs to the band, rounded or not
        let first = (low * self.duration() - 1e-9).ceil().max(1.0) as usize;
        let end = ((high * self.duration() + 1e-9).floor() as usize).min(last) + 1;
        if first >= end {
            return Err(SpectrumError::BetweenBins { lowest: low, highest: high, spacing });
        }
        self.fits((end - first) as f64)?;
        Ok(Comb {
            cycles: (first..end).map(|i| Cycles::of_bin(i, self.samples)).collect(),
            omega: (first..end).map(|i| TAU * i as f64 / self.duration()).collect(),
            bins: Some(first..end),
            step: Some(Cycles::of_bin(1, self.samples)),
        })
    }

    fn band(self, lowest: f64, highest: f64, spacing: Option<f64>) -> Result<Comb, SpectrumError> {
        let spacing = spacing.unwrap_or(1.0 / self.duration());
        if !(spacing > 0.0 && spacing.is_finite()) {
            return Err(SpectrumError::NoSpacing(spacing));
        }
        self.check(lowest, highest)?;
        let count = ((highest - lowest) / spacing * (1.0 + 1e-12) + 1e-9).floor() + 1.0;
        self.fits(count)?;
        let count = count as usize;
        Ok(Comb {
            cycles: (0..count).map(|k| Cycles::of(lowest, spacing, k, self.dt)).collect(),
            omega: (0..count).map(|k| TAU * (lowest + spacing * k as f64)).collect(),
            bins: None,
            step: Some(Cycles::of(0.0, spacing, 1, self.dt)),
        })
    }

    fn list(self, list: &[f64]) -> Result<Comb, SpectrumError> {
        let before = std::iter::once(0.0).chain(list.iter().copied());
        let wrong = before.zip(list).position(|(before, f)| !(*f > before && f.is_finite()));
        let ends = list.first().zip(list.last());
        let (Some((first, last)), None) = (ends, wrong) else {
            return Err(SpectrumError::NoList(wrong.unwrap_or(0) + 1));
        };
        self.check(*first, *last)?;
        self.fits(list.len() as f64)?;
        Ok(Comb {
            cycles: list.iter().map(|f| Cycles::of(*f, 0.0, 0, self.dt)).collect(),
            omega: list.iter().map(|f| TAU * f).collect(),
            bins: None,
            step: None,
        })
    }

    /// Whether samples of this distance and number show the band at all.
    fn check(self, lowest: f64, highest: f64) -> Result<(), SpectrumError> {
        let (nyquist, duration) = (0.5 / self.dt, self.duration());
        if !(lowest > 0.0 && highest >= lowest && highest.is_finite()) {
            return Err(SpectrumError::NoBand { lowest, highest });
        }
        if highest >= nyquist {
            return Err(SpectrumError::BeyondNyquist { highest, nyquist, dt: self.dt });
        }
        if lowest * duration < 1.0 - 1e-9 {
            let (period, least) = (1.0 / lowest, 1.0 / duration);
            return Err(SpectrumError::ShorterThanPeriod { lowest, period, duration, least });
        }
        Ok(())
    }

    fn fits(self, frequencies: f64) -> Result<(), SpectrumError> {
        if frequencies * self.channels.max(1) as f64 <= MOST as f64 {
            return Ok(());
        }
        Err(SpectrumError::TooMany { frequencies, channels: self.channels, limit: MOST })
    }
}

impl Comb {
    /// Number of frequencies M.
    pub fn len(&self) -> usize {
        self.cycles.len()
    }

    /// Never: a choice without frequencies is an error.
    pub fn is_empty(&self) -> bool {
        self.cycles.is_empty()
    }

    /// Angular frequencies (M), rising, in radians per unit of time.
    pub fn omega(&self) -> &[f64] {
        &self.omega
    }
}

/// Cycles per sample, the sum of two numbers (Dekker 1971): at sample k the phase is `k` times this, of which only the part beyond
/// whole cycles counts. A plain number would leave an error of k times its last digit there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cycles {
    high: f64,
    low: f64,
}

impl Cycles {
    /// A frequency in cycles per unit of time, `first + step * count`, seen at samples `dt` apart.
    pub(super) fn of(first: f64, step: f64, count: usize, dt: f64) -> Self {
        let (product, rest) = exact_product(step, count as f64);
        let (sum, error) = exact_sum(first, product);
        let frequency = Self { high: sum, low: error + rest };
        frequency.times(dt)
    }

    /// `bin` cycles in `samples` samples.
    pub(super) fn of_bin(bin: usize, samples: usize) -> Self {
        let (bin, samples) = (bin as f64, samples as f64);
        let high = bin / samples;
        let (product, rest) = exact_product(high, samples);
        Self { high, low: ((bin - product) - rest) / samples }
    }

    /// To the nearest number.
    pub(super) fn value(self) -> f64 {
        self.high + self.low
    }

    pub(super) fn times(self, factor: f64) -> Self {
        let (high, low) = exact_product(self.high, factor);
        let (high, low) = exact_sum(high, low + self.low * factor);
        Self { high, low }
    }

    pub(super) fn minus(self, other: Self) -> Self {
        let (high, low) = exact_sum(self.high, -other.high);
        let (high, low) = exact_sum(high, low + (self.low - other.low));
        Self { high, low }
    }

    /// `exp(-j 2 pi cycles k)`, right to rounding for whole k up to 2^53.
    pub(super) fn turned(self, k: f64) -> Complex64 {
        let (high, rest) = exact_product(self.high, k);
        let part = (high - high.round()) + (rest + self.low * k);
        let phase = TAU * (part - part.round());
        Complex64::new(math::cos(phase), -math::sin(phase))
    }
}

/// `a b` and what rounding took from it; halves of 26 digits multiply without rounding.
fn exact_product(a: f64, b: f64) -> (f64, f64) {
    let halves = |x: f64| {
        let far = 134_217_729.0 * x;
        let high = far - (far - x);
        (high, x - high)
    };
    let product = a * b;
    let ((a1, a2), (b1, b2)) = (halves(a), halves(b));
    (product, ((a1 * b1 - product) + a1 * b2 + a2 * b1) + a2 * b2)
}

/// `a + b` and what rounding took from it.
fn exact_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let seen = sum - a;
    (sum, (a - (sum - seen)) + (b - seen))
}

/// A channel as a message names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelName {
    /// `input` or `output`.
    pub role: &'static str,
    /// Its name in the model, or its number from 1.
    pub name: String,
}

impl fmt::Display for ChannelName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} `{}`", self.role, self.name)
    }
}

/// Why a run has no spectrum. Frequencies are in cycles per unit of time.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SpectrumError {
    /// Too short a record.
    #[error("{found} samples are too few: a spectrum needs at least {needed}; use a longer part of the record")]
    TooFewSamples {
        /// Samples of the run.
        found: usize,
        /// The least number.
        needed: usize,
    },
    /// No common interval.
    #[error(
        "the samples are not at equal intervals, which a transform needs; resample the record, or estimate in the time domain, \
         which takes any intervals"
    )]
    Uneven,
    /// Too long a gap to bridge.
    #[error(
        "{channel}: {missing} samples in a row are missing at time {time}, and a line across at most {allowed} does no harm up \
         to {highest} cycles per unit of time; choose a part of the record without the gap, or a lower band"
    )]
    Gap {
        /// The channel.
        channel: ChannelName,
        /// How many are missing.
        missing: usize,
        /// Time of the first that is missing.
        time: f64,
        /// The longest gap that is bridged.
        allowed: usize,
        /// Highest frequency asked for.
        highest: f64,
    },
    /// Nothing but gaps.
    #[error("{0} has no values in this run, so that it has no spectrum; leave the run or the channel out")]
    NeverMeasured(ChannelName),
    /// Not a band.
    #[error(
        "a band from {lowest} to {highest} holds no frequency; give its lower end first, both above zero and finite"
    )]
    NoBand {
        /// Lower end.
        lowest: f64,
        /// Upper end.
        highest: f64,
    },
    /// Not a spacing.
    #[error("frequencies cannot be {0} apart; give a spacing above zero")]
    NoSpacing(f64),
    /// No frequency at all, or one that is not a number above zero.
    #[error("a list of frequencies must rise, and every one must be a number above zero; the one in place {0} is not")]
    NoList(usize),
    /// No bin of the grid in the band.
    #[error(
        "none of the record's own frequencies, which are multiples of {spacing}, lies between {lowest} and {highest}; use a wider \
         band or a longer record"
    )]
    BetweenBins {
        /// Lower end.
        lowest: f64,
        /// Upper end.
        highest: f64,
        /// Reciprocal of the record's length.
        spacing: f64,
    },
    /// Samples too rare.
    #[error(
        "the band reaches to {highest} cycles per unit of time, but samples {dt} apart show nothing at or beyond {nyquist} \
         (Nyquist); lower the upper end, or use the record at its full sampling rate"
    )]
    BeyondNyquist {
        /// Upper end.
        highest: f64,
        /// Half the sampling rate.
        nyquist: f64,
        /// Sampling interval.
        dt: f64,
    },
    /// Record too short.
    #[error(
        "the record is {duration} long, less than one period of the band's lower end {lowest} ({period}); raise the lower end to \
         {least} or more, or use a longer record"
    )]
    ShorterThanPeriod {
        /// Lower end.
        lowest: f64,
        /// Its period.
        period: f64,
        /// Length of what is transformed.
        duration: f64,
        /// One cycle in the record.
        least: f64,
    },
    /// Segments too short.
    #[error(
        "segments {length} long hold less than one period of the band's lower end {lowest} ({period}); raise the lower end to {least} or \
         more, or take longer segments, of longer records where these are too short"
    )]
    ShortSegments {
        /// Lower end.
        lowest: f64,
        /// Its period.
        period: f64,
        /// Length of the longest segment.
        length: f64,
        /// One cycle in a segment.
        least: f64,
    },
    /// Something is wrong with one of several runs.
    #[error("run `{run}`: {error}")]
    InRun {
        /// Its name.
        run: String,
        /// What is wrong.
        error: Box<SpectrumError>,
    },
    /// More than memory is for.
    #[error(
        "{frequencies} frequencies of {channels} channels are more than the limit of {limit} coefficients; use a narrower band or \
         a wider spacing"
    )]
    TooMany {
        /// Frequencies asked for.
        frequencies: f64,
        /// Channels.
        channels: usize,
        /// Most coefficients.
        limit: usize,
    },
    /// Not a part of a segment.
    #[error("segments cannot overlap by {0} of their length; choose a part from 0 to below 1, 0.5 for Hann windows")]
    NoOverlap(f64),
    /// Not a length.
    #[error("a segment {length} long holds too few samples; make it at least {least} long")]
    NoSegment {
        /// Its length.
        length: f64,
        /// The least length.
        least: f64,
    },
    /// No run is as long as a segment.
    #[error("no run holds a segment {length} long; use shorter segments or longer records")]
    NoneFits {
        /// Length of the longest segment.
        length: f64,
    },
    /// Runs of different models.
    #[error("run `{run}` has other channels than the runs before it; average runs of the same inputs and outputs")]
    OtherChannels {
        /// Its name.
        run: String,
    },
    /// Fewer segments than unknowns at a frequency.
    #[error(
        "{segments} segments are worth {averages:.1} independent averages, too few to tell the effects of {inputs} inputs apart and to know \
         how well; use shorter segments, or more runs, for at least {}", inputs + 1
    )]
    TooFewAverages {
        /// Segments.
        segments: usize,
        /// What they are worth.
        averages: f64,
        /// Number of inputs.
        inputs: usize,
    },
    /// Nothing to respond to.
    #[error(
        "{channel} has no power between {lowest} and {highest} cycles per unit of time (less than a part of 1e-12 of all it has); leave it out, \
         choose a band in which it moves, or use a run in which it does"
    )]
    NoPower {
        /// The input.
        channel: ChannelName,
        /// Lower end of the band.
        lowest: f64,
        /// Upper end.
        highest: f64,
    },
    /// Inputs that move together.
    #[error(
        "{0} is a combination of the other inputs at every frequency, so that its effect cannot be told from theirs; leave one of them out, or \
         use runs in which they move differently"
    )]
    Dependent(ChannelName),
}

impl SpectrumError {
    /// This error of a run, by its name.
    pub(super) fn in_run(self, run: &str) -> Self {
        match self {
            known @ (Self::InRun { .. } | Self::OtherChannels { .. }) => known,
            error => Self::InRun { run: run.into(), error: Box::new(error) },
        }
    }

    /// This error of segments, where it was said of a record as long as the longest of them.
    pub(super) fn of_segments(self) -> Self {
        match self {
            Self::ShorterThanPeriod { lowest, period, duration, least } => {
                Self::ShortSegments { lowest, period, length: duration, least }
            }
            other => other,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(choice: Frequencies) -> Result<Vec<f64>, String> {
        // 100 samples at 0.1: Nyquist 5, one cycle 0.1
        let comb = choice.of(100, 0.1, 3).map_err(|e| e.to_string())?;
        assert_eq!(comb.cycles.len(), comb.omega.len());
        for (cycles, omega) in comb.cycles.iter().zip(&comb.omega) {
            assert!((cycles.value() / 0.1 * TAU / omega - 1.0).abs() < 1e-15);
        }
        Ok(comb.omega.iter().map(|w| w / TAU).collect())
    }

    #[test]
    fn the_grid_leaves_out_zero_and_nyquist() {
        let all = of(Frequencies::Grid { lowest: None, highest: None }).expect("a grid");
        assert_eq!(all.len(), 49);
        assert!((all[0] - 0.1).abs() < 1e-15 && (all[48] - 4.9).abs() < 1e-14);
        let some = of(Frequencies::Grid { lowest: Some(0.3), highest: Some(0.7) }).expect("both ends are bins");
        assert_eq!(some.len(), 5);
        let none = of(Frequencies::Grid { lowest: Some(0.32), highest: Some(0.38) });
        assert!(none.unwrap_err().contains("multiples of 0.1, lies between 0.32 and 0.38"));
    }

    #[test]
    fn a_band_includes_both_ends() {
        let band = |lowest, highest, spacing| of(Frequencies::Band { lowest, highest, spacing });
        assert_eq!(band(0.1, 3.0, Some(0.005)).expect("a band").len(), 581);
        assert_eq!(band(0.1, 3.0, None).expect("a band").len(), 30);
        assert_eq!(band(1.0, 1.0, None).expect("one frequency").len(), 1);
    }

    #[test]
    fn impossible_bands_are_told() {
        let band = |lowest, highest, spacing| of(Frequencies::Band { lowest, highest, spacing }).unwrap_err();
        assert!(band(0.1, 5.0, None).contains("at or beyond 5 (Nyquist)"));
        assert!(band(0.05, 3.0, None).contains("10 long, less than one period of the band's lower end 0.05 (20)"));
        assert!(band(3.0, 1.0, None).contains("from 3 to 1 holds no frequency"));
        assert!(band(0.0, 1.0, None).contains("holds no frequency"));
        assert!(band(f64::NAN, 1.0, None).contains("holds no frequency"));
        assert!(band(0.1, 1.0, Some(0.0)).contains("0 apart"));
        assert!(band(0.1, 1.0, Some(1e-300)).contains("limit of 268435456"));
        for list in [vec![], vec![1.0, 1.0], vec![f64::INFINITY], vec![-1.0]] {
            assert!(of(Frequencies::List(list)).unwrap_err().contains("must rise"));
        }
        assert_eq!(of(Frequencies::List(vec![0.5, 0.75])), Ok(vec![0.5, 0.75]));
    }

    #[test]
    fn phases_stay_right_over_a_long_record() {
        // 1/3 and 3/7 cycles per sample return after whole periods, however late
        for (bin, samples) in [(1, 3), (3, 7), (31, 97), (12_345, 99_991)] {
            let cycles = Cycles::of_bin(bin, samples);
            for turns in [1.0, 1e3, 1e7, 1e9] {
                let late = cycles.turned(turns * samples as f64);
                assert!((late - 1.0).norm() < 1e-15, "{bin}/{samples} after {turns}: {late}");
                let next = cycles.turned(turns * samples as f64 + 1.0);
                let phase = TAU * bin as f64 / samples as f64;
                assert!((next - Complex64::new(phase.cos(), -phase.sin())).norm() < 1e-15 * 4.0);
            }
        }
    }

    #[test]
    fn a_frequency_of_a_band_is_the_sum_of_what_it_is_made_of() {
        // 0.5 + 0.25 * 10 = 3 cycles per unit of time, 8 samples per unit
        assert_eq!(Cycles::of(0.5, 0.25, 10, 0.125), Cycles { high: 0.375, low: 0.0 });
        let tenth = Cycles::of(0.1, 0.1, 9, 1.0);
        // ten times the number nearest to 0.1, not the number nearest to 1
        assert_eq!(tenth.high, 1.0);
        assert!((tenth.low - 5.551_115_123_125_783e-17).abs() < 1e-30);
        assert_eq!(tenth.minus(tenth).value(), 0.0);
    }
}
