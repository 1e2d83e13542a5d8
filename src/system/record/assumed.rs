//! Everything that was assumed about a record, in a form that results keep: delimiter and decimal mark, units, rows that were dropped or used once,
//! bridged gaps, converted times.

use super::grid::Mark;
use super::note::Note;
use super::read::{ChannelSource, Summary};
use serde::{Deserialize, Serialize};

/// What was assumed about the record of one run. Results hold it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Assumptions {
    /// Name of the run.
    pub run: String,
    /// The format, as people call it.
    pub format: String,
    /// What separates the cells of a text; none in other formats.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delimiter: Option<String>,
    /// The decimal mark of a text.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decimal: Option<String>,
    /// Rows of the file.
    pub rows: usize,
    /// Rows that became samples.
    pub used: usize,
    /// Where each channel came from.
    pub channels: Vec<AssumedChannel>,
    /// What was assumed, done or left out, in words.
    pub notes: Vec<AssumedNote>,
}

/// Where a channel came from, and how its numbers became the model's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AssumedChannel {
    /// Its name in the model; `t` for the time.
    pub channel: String,
    /// Title of the column; none for what the file does not hold.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
    /// Unit of the column, as far as it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// The model's value is `scale*value + offset`.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
    /// Whether the model's value is the natural logarithm of that.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub logarithm: bool,
    /// Samples without a value.
    pub gaps: usize,
}

/// One thing that was assumed, done or left out.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AssumedNote {
    /// `unit`, `not_measured`, `constant`, `repeated`, `open_end`, `bridged`, `taken`, `clock`, `pause`, `begin`, `taken_for_held`, `masked` or
    /// `unwrapped`.
    pub kind: String,
    /// The channel that it is about.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channel: Option<String>,
    /// In words.
    pub said: String,
}

impl Assumptions {
    /// Of the run of this name, by what was found in its file.
    pub fn of(run: &str, summary: &Summary) -> Self {
        let text = summary.format == "text";
        let decimal = match summary.dialect.decimal {
            Mark::Point => ".",
            Mark::Comma => ",",
        };
        let channel = |s: &ChannelSource| AssumedChannel {
            channel: s.channel.clone(),
            column: s.column.clone(),
            unit: s.unit.clone(),
            scale: s.scale,
            offset: s.offset,
            logarithm: s.logarithm,
            gaps: s.gaps,
        };
        let note = |n: &Note| AssumedNote {
            kind: n.kind().into(),
            channel: n.channel().map(String::from),
            said: n.to_string(),
        };
        Self {
            run: run.into(),
            format: summary.format.into(),
            delimiter: text.then(|| summary.dialect.delimiter.to_string()),
            decimal: text.then(|| decimal.to_string()),
            rows: summary.rows,
            used: summary.used,
            channels: summary.sources.iter().map(channel).collect(),
            notes: summary.notes.iter().map(note).collect(),
        }
    }

    /// Of a run whose samples did not come from a file, or of a table that was looked at without a model.
    pub fn of_samples(run: &str, format: &str, samples: usize) -> Self {
        Self {
            run: run.into(),
            format: format.into(),
            delimiter: None,
            decimal: None,
            rows: samples,
            used: samples,
            channels: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// With a note that is about no single channel.
    #[must_use]
    pub fn noted(mut self, kind: &str, said: String) -> Self {
        self.notes.push(AssumedNote { kind: kind.into(), channel: None, said });
        self
    }

    /// All that a careful reader would mention, each in a sentence.
    pub fn sentences(&self) -> Vec<String> {
        let measured = |c: &&AssumedChannel| {
            let not = |n: &AssumedNote| n.kind == "not_measured" && n.channel.as_ref() == Some(&c.channel);
            c.gaps > 0 && c.column.is_some() && !self.notes.iter().any(not)
        };
        let missing: Vec<String> =
            self.channels.iter().filter(measured).map(|c| format!("{} of `{}`", c.gaps, c.channel)).collect();
        let mut sentences: Vec<String> = self.notes.iter().map(|n| n.said.clone()).collect();
        if !missing.is_empty() {
            sentences.push(format!("missing values: {}", missing.join(", ")));
        }
        sentences
    }
}
