//! The samples of one run as the doctor sees them: columns over one time.

use crate::finding::Finding;
use fdm_grammar::Model;
use fdm_system::record::{ReadOptions, Run, Summary, Topic};
use std::borrow::Cow;

/// What a channel is to a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Drives the model.
    Input,
    /// Is compared with it.
    Output,
    /// Nobody has said.
    Unknown,
}

/// One channel of a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Its name.
    pub name: String,
    /// Column or field that it is read from.
    pub column: String,
    /// Its unit, where one is known.
    pub unit: Option<String>,
    /// Whether the file states the unit, so that nothing was assumed.
    pub stated: bool,
    /// What it is to the model.
    pub role: Role,
    /// What the file's numbers were multiplied by.
    pub scale: f64,
    /// Samples (N), NaN where there is none.
    pub values: Vec<f64>,
}

impl Channel {
    /// Without the samples that are not to be believed.
    pub(crate) fn without(&self, findings: &[Finding]) -> Cow<'_, Self> {
        let mut clean = Cow::Borrowed(self);
        let own = findings.iter().filter(|f| f.channels.first() == Some(&self.name));
        own.flat_map(|f| &f.samples).for_each(|k| clean.to_mut().values[*k] = f64::NAN);
        clean
    }
}

/// One run: times (N) that rise, and channels over them.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Name of the run.
    pub run: String,
    /// Times of the samples (N).
    pub time: Vec<f64>,
    /// Whether the times are those of a clock; otherwise they count samples.
    pub clocked: bool,
    /// The channels.
    pub channels: Vec<Channel>,
}

impl Record {
    /// A run in the model's units. `summary` says which columns stated theirs; without it all count as stated.
    pub fn of_run(model: &Model, run: &Run, summary: Option<&Summary>) -> Self {
        // rows in front of the first compared sample are no samples of the file, or hold nothing that was measured
        let lead = summary.map_or(0, |s| s.lead).min(run.len());
        let (m, q) = (run.held.len(), run.output_gaps.len());
        let column =
            |rows: &[f64], k: usize, width: usize| rows.iter().skip(lead * width + k).step_by(width).copied().collect();
        let inputs = model.inputs.iter().filter(|i| i.is_declared()).map(|i| (&i.quantity, Role::Input)).enumerate();
        let outputs = model.outputs.iter().map(|o| (&o.quantity, Role::Output)).enumerate();
        let channel = |(k, (quantity, role)): (usize, (&fdm_grammar::model::Quantity, Role))| {
            let source = summary.and_then(|s| s.sources.iter().find(|s| s.channel == quantity.name));
            Channel {
                name: quantity.name.clone(),
                column: source.and_then(|s| s.column.clone()).unwrap_or_else(|| quantity.name.clone()),
                unit: quantity.unit.as_ref().map(ToString::to_string),
                stated: summary.is_none() || source.is_some_and(|s| s.unit.is_some()),
                role,
                scale: source.map_or(1.0, |s| s.scale),
                values: if role == Role::Input { column(&run.inputs, k, m) } else { column(&run.measured, k, q) },
            }
        };
        let channels: Vec<Channel> = inputs.chain(outputs).map(channel).collect();
        let counted = run.time.iter().enumerate().all(|(k, t)| *t == k as f64);
        Self { run: run.name.clone(), time: run.time[lead..].to_vec(), clocked: !counted, channels }
    }

    /// With the columns of its file that no channel is read from: kinematics and the tests of values look at them too. Samples are found by
    /// their times; the run begins where `options` say, else with the first row of the file that is not
    /// before `from`.
    #[must_use]
    pub fn with_other_columns(mut self, topic: &Topic, summary: &Summary, options: &ReadOptions) -> Self {
        let Some(clock) = topic.time.and_then(|k| topic.fields.get(k)) else { return self };
        let scale = summary.sources.iter().find(|s| s.channel == "t").map_or(1.0, |s| s.scale);
        let rows = || clock.values.iter().copied().find(|v| options.from.is_none_or(|f| *v >= f));
        let Some(first) = options.beginning().or_else(rows) else { return self };
        let offset = -scale * first;
        let near = 1e-9 * self.time.last().map_or(1.0, |t| t.abs().max(1.0));
        // the file's row of each sample
        let mut row = 0;
        let rows: Vec<Option<usize>> = self
            .time
            .iter()
            .map(|t| {
                while clock.values.get(row).is_some_and(|v| scale * v + offset < t - near) {
                    row += 1;
                }
                clock.values.get(row).filter(|v| (scale * **v + offset - t).abs() <= near).map(|_| row)
            })
            .collect();
        let read = |name: &str| summary.sources.iter().any(|s| s.column.as_deref().is_some_and(|c| c == name));
        let others = topic.fields.iter().enumerate().filter(|(k, f)| topic.time != Some(*k) && !read(&f.name));
        for (_, field) in others {
            if self.channels.iter().any(|c| c.name == field.name) {
                continue;
            }
            let value = |row: &Option<usize>| row.and_then(|k| field.values.get(k).copied()).unwrap_or(f64::NAN);
            self.channels.push(Channel {
                name: field.name.clone(),
                column: field.name.clone(),
                unit: field.unit.clone(),
                stated: field.unit.is_some(),
                role: Role::Unknown,
                scale: 1.0,
                values: rows.iter().map(value).collect(),
            });
        }
        self
    }

    /// A table of a file, without a model.
    pub fn of_topic(run: &str, topic: &Topic) -> Self {
        let rows = topic.fields.iter().map(|f| f.values.len()).min().unwrap_or(0);
        let time = topic.time.and_then(|k| topic.fields.get(k)).map(|f| f.values[..rows].to_vec());
        let channels = topic.fields.iter().enumerate().filter(|(k, _)| topic.time != Some(*k));
        let channels = channels.map(|(_, field)| Channel {
            name: field.name.clone(),
            column: field.name.clone(),
            unit: field.unit.clone(),
            stated: field.unit.is_some(),
            role: Role::Unknown,
            scale: 1.0,
            values: field.values[..rows].to_vec(),
        });
        let clocked = time.is_some();
        let time = time.unwrap_or_else(|| (0..rows).map(|k| k as f64).collect());
        Self { run: run.into(), time, clocked, channels: channels.collect() }
    }
}
