//! What a fit asks when an output is not explained: the likeliest fault of its record, and nothing else.

use crate::alone::{AloneOptions, examine_alone};
use crate::beside::{BesideOptions, examine_beside};
use crate::finding::{Finding, Severity, in_order};
use crate::record::{Record, Role};
use fdm_estimate::Work;
use fdm_system::Model;
use fdm_system::record::Run;

/// The first finding of the cheap half of the search beside the model: units, signs, places and axes, one fault. Where none of these is likely,
/// delays, filters, zeros, factors and clocks as well. Faults of other outputs than those that are not explained are no cause. None where no fault is likely, or there was no time.
pub fn first_cause(model: &Model, runs: &[Run], unexplained: &[&str], work: &Work<'_>) -> Option<Finding> {
    let records: Vec<Record> = runs.iter().map(|run| Record::of_run(model.definition(), run, None)).collect();
    let options = AloneOptions { kinematics: false, ..AloneOptions::default() };
    let mut alone: Vec<Finding> = records.iter().flat_map(|record| examine_alone(record, &options)).collect();
    in_order(&mut alone);
    let channels = records.first().map_or(&[][..], |r| &r.channels);
    let explained = |name: &String| {
        let output = channels.iter().any(|c| c.name == *name && c.role == Role::Output);
        output && !unexplained.contains(&name.as_str())
    };
    [false, true].into_iter().filter(|_| work.goes_on()).find_map(|estimated| {
        let options = BesideOptions { most: 1, estimated, ..BesideOptions::default() };
        let found = examine_beside(model, runs, &records, alone.clone(), &options, work);
        found.findings.into_iter().find(|f| f.severity == Severity::Finding && !f.channels.iter().all(explained))
    })
}
