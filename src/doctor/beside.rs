//! A record beside a model: which faults make it likeliest together, and what each does to the parameters.

use crate::aliasing;
use crate::biases::{biases_of, mask};
use crate::finding::{Finding, in_order};
use crate::hypothesis::Channels;
use crate::information;
use crate::kinematics::Kinematics;
use crate::likelihood::{Begin, Evidence, THOROUGH, Trial};
use crate::record::Record;
use crate::search::{Found, Search, faults};
use fdm_estimate::{Termination, Work};
use fdm_system::Model;
use fdm_system::record::{Run, channels};

/// How a record is judged beside a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BesideOptions {
    /// Odds that a fault must have to be told. As the prior odds of any fault are 1 : 1, a record without one has a finding with a
    /// probability of at most one over these odds, by Markov's inequality for likelihood ratios.
    pub odds: f64,
    /// Most faults that are told.
    pub most: usize,
    /// Whether delays, offsets, scale factors and drifts of clocks are estimated: some fits for each channel.
    pub estimated: bool,
}

impl Default for BesideOptions {
    fn default() -> Self {
        Self { odds: 20.0, most: 3, estimated: true }
    }
}

/// What was found beside a model.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Examination {
    /// All findings, those of the record by itself among them, in their order.
    pub findings: Vec<Finding>,
    /// Fits that were made.
    pub fits: usize,
    /// What could not be looked at, and why.
    pub notes: Vec<String>,
}

/// Judges runs beside their model, as long as the work may go on; then with what was found by then, and a note. `alone` are the findings
/// of the records by themselves: their samples are left out of the fits, and they get their biases. One record (of
/// [`Record::of_run`]) for each run; columns that the model does not read take part in kinematics.
pub fn examine_beside(
    model: &Model,
    runs: &[Run],
    records: &[Record],
    alone: Vec<Finding>,
    options: &BesideOptions,
    work: &Work<'_>,
) -> Examination {
    let names = Channels::of(records);
    let (masked, clean) = mask(&names, runs, records, &alone);
    let mut done = Examination { findings: alone, ..Examination::default() };
    let kinematics = Kinematics::of(&clean, &names);
    let pace = information::pace(model, runs).map(|p| p.magnitude * p.interval);
    let mut evidence =
        Evidence { model: Some(model), runs: &masked, records: &clean, channels: &names, kinematics, pace, work };
    work.stage("the record as it is");
    let Some(current) = evidence.base().or_else(|| evidence.unexplained(&[])) else {
        done.notes.push("nothing was compared beside the model: no output has samples".into());
        return done;
    };
    done.fits += 1;
    let current = evidence.without_broken_equations(current);
    add_biases(&evidence, runs, records, &current, &mut done);
    let timed = channels(model.definition()).timed;
    let ended = current.estimate.as_ref().map(|e| &e.termination).filter(|ended| !ended.is_good());
    done.notes.extend(ended.map(|ended| format!("the fit beside the model did not end well: {ended}")));
    // beside a response that is lost no fault makes a difference that means anything
    let lost = matches!(ended, Some(Termination::Unstable { .. }));
    let found = match lost {
        true => Found { findings: Vec::new(), edits: Vec::new(), last: current, fits: 0 },
        false => faults(&Search { evidence: &evidence, timed, options }, current),
    };
    if (lost || !work.goes_on()) && found.findings.is_empty() {
        // what needs no fit is told all the same
        let work = &work.endless();
        let alone = Evidence { model: None, kinematics: evidence.kinematics.clone(), work, ..evidence };
        let start = alone.trial(Begin::TEXT, &[], 0);
        let search = Search { evidence: &alone, timed, options };
        done.findings.extend(start.map(|start| faults(&search, start).findings).unwrap_or_default());
    }
    if !work.goes_on() {
        done.notes.push("there was no time to look at everything: these are the findings so far".into());
    }
    done.fits += found.fits;
    let lines = records.iter().flat_map(|r| aliasing::examine(r, &done.findings)).collect::<Vec<_>>();
    done.findings.extend(found.findings);
    done.findings.extend(evidence.kinematics.remarks(&clean, &names, &found.edits));
    if !lost {
        // derivatives of a lost response tell nothing apart
        done.findings.extend(information::of(model, runs, records, &found.last));
    }
    done.findings.extend(lines);
    in_order(&mut done.findings);
    done
}

/// The fits with and without the samples that are not to be believed.
fn add_biases(masked: &Evidence<'_>, runs: &[Run], records: &[Record], clean: &Trial, done: &mut Examination) {
    if !done.findings.iter().any(|f| !f.samples.is_empty()) || runs == masked.runs {
        return;
    }
    let kinematics = Kinematics::default();
    let whole = Evidence { runs, records, kinematics, ..*masked };
    if let Some(dirty) = whole.trial(Begin::TEXT, &[], THOROUGH) {
        done.fits += 1;
        let biases = biases_of(dirty.estimate.as_ref(), clean.estimate.as_ref());
        done.findings.iter_mut().filter(|f| !f.samples.is_empty()).for_each(|f| f.biases = biases.clone());
    }
}
