//! What a user is told about a record that has no spectrum: a sentence with numbers, and what to do.

use std::fmt;

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
