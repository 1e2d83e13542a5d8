//! A record by itself: every channel, the time, rows, and rates beside angles.

use crate::aliasing;
use crate::by_kinematics::{self, Witness};
use crate::edit::Channels;
use crate::finding::{Finding, Severity, in_order};
use crate::kinematics::Kinematics;
use crate::record::Record;
use crate::{runs_of_values, time, values};
use fdm_numeric::parallel;

/// How sure a finding has to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AloneOptions {
    /// Probability of a finding in a record without a fault, over all tests and channels of it.
    pub false_alarms: f64,
    /// Whether channels are compared by kinematics; beside a model it is done there.
    pub kinematics: bool,
}

impl Default for AloneOptions {
    fn default() -> Self {
        Self { false_alarms: 0.01, kinematics: true }
    }
}

/// Tests of each channel, and of the time and the rows.
const TESTS: usize = 8;

/// All that a record says by itself, findings first, the surest first. One pass of about ten comparisons a sample; the tests share the rate of
/// false alarms by Bonferroni's inequality.
pub fn examine_alone(record: &Record, options: &AloneOptions) -> Vec<Finding> {
    let alpha = options.false_alarms / (TESTS * (record.channels.len() + 1)) as f64;
    let by_channel: Vec<Vec<Finding>> = parallel::map(record.channels.iter(), |channel| {
        let mut found = Vec::new();
        found.extend(values::sentinel(record, channel, alpha));
        let clean = channel.without(&found);
        found.extend(values::missing(record, channel));
        found.extend(values::wrapped(record, &clean));
        found.extend(values::spikes(record, &clean, alpha));
        let clean = clean.without(&found);
        let quantised = values::quantised(record, &clean);
        found.extend(runs_of_values::examine(record, &clean, alpha));
        found.extend(quantised);
        found.extend(values::angle_unit(record, &clean));
        found
    });
    let mut findings: Vec<Finding> = time::examine(record, alpha);
    let doubled = runs_of_values::doubled_rows(record, alpha);
    findings.extend(doubled);
    findings.extend(by_channel.into_iter().flatten());
    if options.kinematics {
        findings.extend(beside_kinematics(record, &findings));
        findings.extend(aliasing::examine(record, &findings));
    }
    in_order(&mut findings);
    findings
}

/// Signs, units, axes, delays, zeros and the unit of time as kinematics tells them, where no model does.
fn beside_kinematics(record: &Record, found: &[Finding]) -> Vec<Finding> {
    let mut record = record.clone();
    for channel in &mut record.channels {
        *channel = channel.without(found).into_owned();
    }
    let records = std::slice::from_ref(&record);
    let channels = Channels::of(records);
    let kinematics = Kinematics::of(records, &channels);
    if kinematics.is_empty() {
        return Vec::new();
    }
    let (found, edits) = by_kinematics::faults(&Witness { kinematics: &kinematics, records, channels: &channels });
    let remarks = kinematics.remarks(records, &channels, &edits);
    found.into_iter().chain(remarks).collect()
}

/// The first lines of what is found, for a command that does something else: at most three, the last of which counts the rest. Remarks are
/// not among them.
pub fn leading(findings: &[Finding]) -> Vec<String> {
    const MOST: usize = 3;
    let all: Vec<&Finding> = findings.iter().filter(|f| f.severity == Severity::Finding).collect();
    let shown = if all.len() > MOST { MOST - 1 } else { all.len() };
    let line = |f: &&Finding| {
        let channels = f.channels.join("`, `");
        format!("run `{}`: `{channels}`: {}: {} ({})", f.run, f.fault, f.what, f.sureness())
    };
    let mut lines: Vec<String> = all[..shown].iter().map(line).collect();
    if all.len() > shown {
        lines.push(format!("and {} more findings: `fdm doctor` tells them all, with repairs", all.len() - shown));
    }
    lines
}
