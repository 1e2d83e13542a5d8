//! A record by itself: every channel, the time, rows, and rates beside angles.

use crate::finding::{Finding, Severity, in_order};
use crate::record::Record;
use crate::{kinematics, runs_of_values, time, values};
use rayon::prelude::*;

/// How sure a finding has to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AloneOptions {
    /// Probability of a finding in a record without a fault, over all tests and channels of it.
    pub false_alarms: f64,
    /// Whether rates are compared with angles by the names of the channels; a model says it better.
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
    let n = record.time.len();
    let alpha = options.false_alarms / (TESTS * (record.channels.len() + 1)) as f64;
    let by_channel: Vec<Vec<Finding>> = record
        .channels
        .par_iter()
        .map(|channel| {
            let mut found = Vec::new();
            let mut masked = vec![false; n];
            found.extend(values::sentinel(record, channel, alpha));
            found.iter().flat_map(|f| &f.samples).for_each(|k| masked[*k] = true);
            let clean = channel.without(&found);
            found.extend(values::missing(record, channel));
            found.extend(values::wrapped(record, &clean));
            found.extend(values::spikes(record, &clean, &masked, alpha));
            let clean = clean.without(&found);
            let quantised = values::quantised(record, &clean);
            found.extend(runs_of_values::examine(record, &clean, alpha));
            found.extend(quantised);
            found.extend(values::angle_unit(record, &clean));
            found
        })
        .collect();
    let mut findings: Vec<Finding> = time::examine(record, alpha);
    let doubled = runs_of_values::doubled_rows(record, alpha);
    findings.extend(doubled);
    findings.extend(by_channel.into_iter().flatten());
    if options.kinematics {
        findings.extend(kinematics::examine(record, alpha));
    }
    in_order(&mut findings);
    findings
}

/// The first lines of what is found, for a command that does something else: at most three, the last of which counts the rest. Remarks are
/// not among them.
pub fn leading(findings: &[Finding]) -> Vec<String> {
    const MOST: usize = 3;
    let all: Vec<&Finding> = findings.iter().filter(|f| f.severity == Severity::Finding).collect();
    let shown = if all.len() > MOST { MOST - 1 } else { all.len() };
    let line = |f: &&Finding| {
        let channels = f.channels.join("`, `");
        format!("run `{}`: `{channels}`: {}: {} ({})", f.run, f.fault, f.what, f.odds())
    };
    let mut lines: Vec<String> = all[..shown].iter().map(line).collect();
    if all.len() > shown {
        lines.push(format!("and {} more findings: `fdm doctor` tells them all, with repairs", all.len() - shown));
    }
    lines
}
