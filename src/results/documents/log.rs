//! What a log or data file holds, as `fdm data` lists it.

use fdm_system::record::{Field, Log, Topic};
use serde::{Deserialize, Serialize};

/// A log or data file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LogDocument {
    /// The format, as people call it; `text` for tables of text.
    pub format: String,
    /// The topics.
    pub topics: Vec<TopicDocument>,
    /// What was lost, assumed or left out.
    pub remarks: Vec<String>,
}

/// A topic: a table over one clock.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TopicDocument {
    /// Its name; empty for the only table of a file.
    pub name: String,
    /// Number of samples.
    pub samples: usize,
    /// Samples per second, by the median interval; none without a time.
    pub rate: Option<f64>,
    /// The longest interval in seconds.
    pub longest_pause: Option<f64>,
    /// First time in seconds.
    pub from: Option<f64>,
    /// Last time in seconds.
    pub to: Option<f64>,
    /// The fields.
    pub fields: Vec<FieldDocument>,
}

/// A field of a topic.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FieldDocument {
    /// Its name.
    pub name: String,
    /// Its unit, where the file states it.
    pub unit: Option<String>,
    /// The least value.
    pub least: Option<f64>,
    /// The greatest value.
    pub greatest: Option<f64>,
    /// Samples without a number.
    pub gaps: usize,
}

impl LogDocument {
    /// Of a log, with what is to be said of it.
    pub fn of(log: &Log, remarks: Vec<String>) -> Self {
        Self { format: log.format.into(), topics: log.topics.iter().map(TopicDocument::of).collect(), remarks }
    }
}

impl TopicDocument {
    fn of(topic: &Topic) -> Self {
        let time = topic.seconds().filter(|t| t.iter().all(|t| t.is_finite()));
        let mut steps: Vec<f64> = time.iter().flat_map(|t| t.windows(2)).map(|w| w[1] - w[0]).collect();
        let middle = steps.len() / 2;
        let longest = steps.iter().copied().reduce(f64::max);
        let median = (!steps.is_empty()).then(|| *steps.select_nth_unstable_by(middle, f64::total_cmp).1);
        let end = |of: fn(&[f64]) -> Option<&f64>| time.as_deref().and_then(of).copied();
        Self {
            name: topic.name.clone(),
            samples: topic.rows(),
            rate: median.filter(|m| *m > 0.0).map(|m| 1.0 / m),
            longest_pause: longest,
            from: end(<[f64]>::first),
            to: end(<[f64]>::last),
            fields: topic.fields.iter().map(FieldDocument::of).collect(),
        }
    }
}

impl FieldDocument {
    fn of(field: &Field) -> Self {
        let finite = || field.values.iter().copied().filter(|v| v.is_finite());
        Self {
            name: field.name.clone(),
            unit: field.unit.clone(),
            least: finite().reduce(f64::min),
            greatest: finite().reduce(f64::max),
            gaps: field.values.len() - finite().count(),
        }
    }
}
