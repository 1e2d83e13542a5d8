//! What reading a record found, for people to look at before they trust a fit.

use super::channel::Role;
use super::dialect::Dialect;
use super::run::Run;
use std::fmt;

/// What was read from where, and what should be known about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// How the file is written.
    pub dialect: Dialect,
    /// Rows below the header that are not blank.
    pub rows: usize,
    /// Rows that became samples.
    pub used: usize,
    /// The time column (when the record has one), inputs, outputs.
    pub sources: Vec<ChannelSource>,
    /// Spacing of the samples; `None` for one sample, and where samples are counted.
    pub sampling: Option<Sampling>,
    /// What a careful reader would mention.
    pub notes: Vec<Note>,
}

/// Where a channel came from.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelSource {
    /// What it is to the model.
    pub role: Role,
    /// Its name in the model, `t` for the time.
    pub channel: String,
    /// Title of the column; `None` for an output that the file does not have.
    pub column: Option<String>,
    /// Unit of the column, when it is known.
    pub unit: Option<String>,
    /// The model's value is `scale*value + offset`, or the logarithm of that.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
    /// Whether the model's value is the natural logarithm of `scale*value + offset`.
    pub logarithm: bool,
    /// Selected cells without a value.
    pub gaps: usize,
}

/// Spacing of the samples in the model's time unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// The shortest interval.
    pub least: f64,
    /// As many intervals are longer as are shorter.
    pub median: f64,
    /// The longest interval.
    pub greatest: f64,
    /// Time at which the longest interval begins, since the run began.
    pub greatest_at: f64,
}

impl Sampling {
    /// The intervals of rising times; `None` for fewer than two.
    pub fn new(time: &[f64]) -> Option<Self> {
        let mut intervals: Vec<_> = time.windows(2).map(|w| w[1] - w[0]).collect();
        let (at, greatest) =
            intervals.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))?;
        let least = intervals.iter().copied().fold(f64::INFINITY, f64::min);
        let middle = intervals.len() / 2;
        let (_, median, _) = intervals.select_nth_unstable_by(middle, f64::total_cmp);
        Some(Self { least, median: *median, greatest, greatest_at: time[at] })
    }

    /// Whether every interval is within one percent of the median, as clocks with rounded times are.
    pub fn is_even(&self) -> bool {
        self.greatest <= 1.01 * self.median && self.least >= 0.99 * self.median
    }
}

/// Something true and cheap to find that may explain a poor fit.
#[derive(Debug, Clone, PartialEq)]
pub enum Note {
    /// Only one of column and channel states a unit; the numbers are taken as they are.
    UnitAssumed {
        /// What the channel is to the model.
        role: Role,
        /// The channel.
        channel: String,
        /// Title of the column.
        column: String,
        /// The unit that one of them states.
        unit: String,
        /// Whether the column states it and the model does not.
        stated_by_column: bool,
    },
    /// An output that the file does not have, where it need not.
    NotMeasured {
        /// The output.
        output: String,
    },
    /// A channel with one value in all samples.
    Constant {
        /// What the channel is to the model.
        role: Role,
        /// The channel.
        channel: String,
        /// The value, in the model's unit.
        value: f64,
        /// Samples that have it.
        samples: usize,
    },
    /// Rows that repeat the row before to the letter; they are used once.
    Repeated {
        /// How many.
        rows: usize,
        /// Line of the first.
        line: usize,
    },
    /// The last line has no line end: the file may have been cut in its last number.
    OpenEnd,
    /// Inputs without a value in some samples: bridged in time, or the sample is not compared where time is no matter.
    Bridged {
        /// The input.
        input: String,
        /// Samples.
        gaps: usize,
        /// Whether the values come from the neighbours in time; otherwise these samples are not compared.
        in_time: bool,
    },
    /// A pause much longer than the usual interval.
    Pause {
        /// Its length in the model's time unit.
        length: f64,
        /// When it begins, since the run began.
        at: f64,
        /// The usual interval.
        median: f64,
    },
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnitAssumed { role, channel, column, unit, stated_by_column: true } => {
                write!(
                    f,
                    "the {role} `{channel}` has no unit in the model; column `{column}` is taken as it is, in {unit}"
                )
            }
            Self::UnitAssumed { role, channel, column, unit, stated_by_column: false } => {
                write!(
                    f,
                    "column `{column}` states no unit; it is taken to be in {unit}, the unit of the {role} `{channel}`"
                )
            }
            Self::NotMeasured { output } => write!(f, "the file has no column for the output `{output}`"),
            Self::Constant { role, channel, value, samples } => {
                write!(f, "the {role} `{channel}` never changes: {value} in all {samples} samples")
            }
            Self::Repeated { rows, line } => {
                write!(f, "{rows} row(s) repeat the row before, first in line {line}; they are used once")
            }
            Self::OpenEnd => {
                write!(f, "the last line has no line end; if the file was cut, its last number may be short")
            }
            Self::Bridged { input, gaps, in_time: true } => {
                write!(f, "the input `{input}` has no value in {gaps} sample(s); its neighbours in time bridge them")
            }
            Self::Bridged { input, gaps, in_time: false } => {
                write!(f, "the input `{input}` has no value in {gaps} sample(s), which are not compared")
            }
            Self::Pause { length, at, median } => {
                write!(f, "no sample for {length:.6} from {at:.6} on, where the usual interval is {median:.6}")
            }
        }
    }
}

/// The notes that follow from the samples alone; `names` are those of the columns, inputs before outputs.
pub(crate) fn suspicions(run: &Run, names: &[(Role, String)], sampling: Option<Sampling>) -> Vec<Note> {
    const FEWEST: usize = 3;
    /// Intervals of uneven sampling differ; a pause is far beyond that.
    const PAUSE: f64 = 10.0;
    let (width, outputs) = (run.held.len(), run.output_gaps.len());
    let inputs = names.len() - outputs;
    let column = |k: usize| -> (&[f64], usize, usize) {
        if k < inputs { (&run.inputs, width, k) } else { (&run.measured, outputs, k - inputs) }
    };
    let mut notes = Vec::new();
    for (k, (role, name)) in names.iter().enumerate() {
        let (rows, width, at) = column(k);
        let mut values = rows.iter().skip(at).step_by(width).filter(|v| !v.is_nan());
        let Some(first) = values.next() else { continue };
        let samples = values.try_fold(1, |n, v| if v == first { Some(n + 1) } else { None }).unwrap_or(0);
        if samples >= FEWEST {
            notes.push(Note::Constant { role: *role, channel: name.clone(), value: *first, samples });
        }
    }
    if let Some(s) = sampling.filter(|s| s.greatest > PAUSE * s.median) {
        notes.push(Note::Pause { length: s.greatest, at: s.greatest_at, median: s.median });
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampling_is_measured() {
        let s = Sampling::new(&[0.0, 1.0, 2.0, 5.0, 6.5]).unwrap();
        assert_eq!((s.least, s.median, s.greatest, s.greatest_at), (1.0, 1.5, 3.0, 2.0));
        assert!(!s.is_even());
        assert!(Sampling::new(&[0.0, 0.01, 0.02001, 0.03]).unwrap().is_even());
        assert_eq!(Sampling::new(&[0.0]), None);
    }
}
