//! Faults of a record as hypotheses beside a model: each is an edit of the runs with its prior, weighed by the log evidence of the model on the runs as
//! they were recorded.
//!
//! ```text
//! E = log p(z | model, edits) + log likelihood of kinematics + log prior of sizes, of values, of the kind
//! ```
//!
//! An edit of an output stands on the model's side (`output_edits`), so that all hypotheses are about the same data; one of an input changes what is
//! simulated. Sizes are columns of the linearised model, refitted with its parameters (`ground`). `search` goes from fault to fault.

mod ground;
mod output_edits;
mod search;
mod shifts;
mod told;
mod weighing;

use crate::candidates::fitted_model::FittedModel;
use crate::candidates::initial_fit::{plainly, with_validation_runs};
use crate::candidates::runs::{Domain, Runs, keeps_inputs};
use crate::evidence::climb::Climb;
use crate::evidence::decimation::decimation;
use crate::search::log_sum;
use fdm_doctor::{
    AloneOptions, Channels, Edit, Fault, Finding, Kinematics, Record, Role, Severity, Slot, Witness, aliased, edited,
    examine_alone, information, mask, pace, sort,
};
use fdm_estimate::{Estimate, FitOptions, Termination, Work};
use fdm_system::Model;
use fdm_system::record::{Run, channels};
use ground::{Ground, Planted, Point, doubted};
use search::{FASTEST, Search};
use serde::{Deserialize, Serialize};

/// How a record is judged beside a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BesideOptions {
    /// Odds, against all that is no fault of the record, that a fault must have to be told.
    pub odds: f64,
    /// Most faults that are told.
    pub most: usize,
    /// Whether delays, filters, offsets, scale factors and drifts of clocks are estimated.
    pub estimated: bool,
}

impl Default for BesideOptions {
    fn default() -> Self {
        Self { odds: 20.0, most: 3, estimated: true }
    }
}

/// An explanation of the records, with its probability among all that were weighed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Weighed {
    /// In words.
    pub what: String,
    /// Evidence in nats beside that of records without a fault, prior odds included.
    pub evidence: f64,
    /// Its probability.
    pub probability: f64,
}

/// What stands for no fault among what was weighed.
const NO_FAULT: &str = "no fault of the record";

impl Weighed {
    fn is_none(&self) -> bool {
        self.what == NO_FAULT
    }
}

/// What was found beside a model.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Examination {
    /// All findings, those of the record by itself among them, in their order.
    pub findings: Vec<Finding>,
    /// What was weighed for the first fault, the likeliest first; no fault among them.
    pub weighed: Vec<Weighed>,
    /// Fits that were made.
    pub fits: usize,
    /// What could not be looked at, and why.
    pub notes: Vec<String>,
}

/// The model at the fit of the records as they are.
struct Base {
    fitted: FittedModel,
    estimate: Estimate,
}

/// Judges runs beside their model, as long as the work may go on; then with what was found by then, and a note. `alone` are the findings of the records by
/// themselves: their samples are left out of the fits, and they get their biases. One record (of [`Record::of_run`]) for each run; columns that the model
/// does not read take part in kinematics.
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
    let mut kinematics = Kinematics::of(&clean, &names).exact();
    let tempo = pace(model, runs).map(|p| p.magnitude * p.interval);
    work.stage("the record as it is");
    let base = base(model, &masked, work);
    done.fits += 1;
    if let Some(base) = base.as_ref().filter(|_| tempo.is_none_or(|pace| pace <= FASTEST)) {
        // what the model's own response breaks is meant
        kinematics = held_by(kinematics, &base.fitted, &clean, &names);
    }
    let witness = Witness { kinematics: &kinematics, records: &clean, channels: &names };
    let ended = base.as_ref().map(|b| &b.estimate.termination).filter(|ended| !ended.is_good());
    done.notes.extend(ended.map(|ended| format!("the fit beside the model did not end well: {ended}")));
    // beside a response that is lost no fault makes a difference that means anything
    let lost = matches!(ended, Some(Termination::Unstable { .. }));
    let mut mended = None;
    let mut edits = Vec::new();
    match base.as_ref().filter(|_| !lost && work.goes_on()) {
        Some(base) => {
            let timed = channels(model.definition()).timed;
            match beside(&base.fitted, (&masked, &witness), options, (timed, tempo), work) {
                Some(found) => {
                    done.fits += found.fits;
                    done.findings.extend(found.findings);
                    done.weighed = found.weighed;
                    edits = found.edits;
                    mended = Some(found.model);
                }
                None => {
                    done.notes.push("nothing was compared beside the model: it has no response to these records".into())
                }
            }
        }
        None if lost => (),
        None if work.goes_on() => done.notes.push("nothing was compared beside the model: it has no fit".into()),
        None => (),
    }
    if !work.goes_on() {
        done.notes.push("there was no time to look at everything: these are the findings so far".into());
    }
    if mended.is_none() {
        // what needs no fit is told all the same
        done.findings.extend(witness.faults());
    }
    if let Some(base) = base.as_ref().filter(|_| done.findings.iter().any(|f| !f.samples.is_empty()) && runs != masked)
    {
        add_biases(model, runs, &base.estimate, &mut done, work);
    }
    let lines = records.iter().flat_map(|r| aliased(r, &done.findings)).collect::<Vec<_>>();
    done.findings.extend(kinematics.remarks(&clean, &names, &edits));
    if !lost {
        let at = mended.as_ref().unwrap_or(model);
        done.findings.extend(information(at, runs, records, base.as_ref().map(|b| &b.estimate)));
    }
    done.findings.extend(lines);
    sort(&mut done.findings);
    done
}

/// The runs as they are, fitted with the fallbacks of a fit; none where nothing can be simulated.
fn base(model: &Model, runs: &[Run], work: &Work<'_>) -> Option<Base> {
    let mut how = FitOptions::default();
    how.options.colour = false;
    how.confidence = false;
    let how = how.with_declared_noise(model);
    let fit = plainly(model, runs, &how, work).ok()?.into_iter().next()?;
    if fit.estimate.runs.is_empty() {
        return None;
    }
    let all = Runs { all: runs, train: runs.len(), domain: &Domain::Time };
    let fitted = with_validation_runs(&fit, all, (&how, work)).ok()?;
    Some(Base { fitted, estimate: fit.estimate })
}

/// What was found beside the model at its fit.
struct Found {
    findings: Vec<Finding>,
    weighed: Vec<Weighed>,
    edits: Vec<Edit>,
    /// With the estimates of the mended records as start values.
    model: Model,
    fits: usize,
    /// States that begin where the records have it.
    begun: Vec<String>,
    /// Evidence of the findings beside records as they are, and the log prior in it.
    evidence: f64,
    prior: f64,
}

fn beside(
    base: &FittedModel,
    (runs, witness): (&[Run], &Witness<'_>),
    options: &BesideOptions,
    (timed, pace): (bool, Option<f64>),
    work: &Work<'_>,
) -> Option<Found> {
    let all = Runs { all: runs, train: runs.len(), domain: &Domain::Time };
    let model = &base.model;
    // samples that are left out of a transient tell less of where a run begins, and nothing else
    let mut every = decimation(base, all, false);
    while every > 1 && !runs.iter().all(|run| keeps_inputs(run, every)) {
        every -= (every / 4).max(1);
    }
    let fewer: Vec<Run> = runs.iter().map(|run| if every > 1 { run.every(every) } else { run.clone() }).collect();
    let own;
    let fitted = match every > 1 {
        false => base,
        true => {
            let compared = Runs { all: &fewer, ..all };
            own = FittedModel::new(model.clone(), compared, base.theta.clone()).ok()?;
            &own
        }
    };
    let (extended, stated) = doubted(model, &base.theta[0]);
    let values: Vec<f64> = stated.iter().map(|s| extended.definition().params[s.param].value).collect();
    let reached: Vec<Vec<f64>> = base.theta.iter().map(|theta| [&theta[..], &values].concat()).collect();
    let ground = Ground::new((&extended, stated), (fitted, &fewer, every), reached.clone(), (runs, witness), work)?;
    let at = |theta: Vec<Vec<f64>>| ground.climbed(Point { theta, faults: Vec::new() }, None);
    let both = [at(reached), at(ground.text.clone())];
    let start = both.into_iter().flatten().max_by(|a, b| a.1.log.total_cmp(&b.1.log))?;
    let search = Search {
        ground: &ground,
        timed,
        estimated: options.estimated,
        most: options.most,
        needed: options.odds.ln(),
        pace,
    };
    let found = search.run(start);
    let weighed = told::weighed(&ground, &found);
    let findings = told::findings(&ground, &found);
    let mut params = model.definition().params.clone();
    for (k, param) in params.iter_mut().enumerate().filter(|(_, p)| !p.fixed && !p.per_run) {
        param.value = found.point.theta[0][k].clamp(param.lower, param.upper);
    }
    let begun = found.point.faults.iter().filter_map(|f| match f {
        Planted::Beginning(k) => Some(ground.stated[*k].name.clone()),
        _ => None,
    });
    Some(Found {
        findings,
        weighed,
        begun: begun.collect(),
        evidence: found.evidence(),
        prior: found.prior(),
        edits: found.point.edits(),
        model: model.with_params(params),
        fits: found.fits,
    })
}

/// Records with their faults mended, for a search for what the model lacks.
pub(crate) struct Mended {
    pub(crate) findings: Vec<Finding>,
    /// Evidence of the findings beside records as they are, and the log prior odds in it.
    pub(crate) evidence: f64,
    pub(crate) prior: f64,
    /// The text with the initial values free that the records contradict, and what they say of inputs between samples.
    pub(crate) model: Model,
    /// Whether the faults are but holds of inputs of which nobody had said how they go between samples.
    pub(crate) assumed: bool,
    pub(crate) runs: Vec<Run>,
}

/// What runs beside a fitted model say of faults that have no size: holds, beginnings, units, signs, places. Those with a size are effects of the
/// catalogue, and weighed there. The second is the evidence that the likeliest of these faults have together.
pub(crate) fn mended(fitted: &FittedModel, runs: &[Run], work: &Work<'_>) -> (Option<Mended>, f64) {
    let model = &fitted.model;
    let definition = model.definition();
    let records: Vec<Record> = runs.iter().map(|run| Record::of_run(definition, run, None)).collect();
    let names = Channels::of(&records);
    let tempo = pace(model, runs).map(|p| p.magnitude * p.interval);
    let mut kinematics = Kinematics::of(&records, &names).exact();
    if tempo.is_none_or(|pace| pace <= FASTEST) {
        kinematics = held_by(kinematics, fitted, &records, &names);
    }
    let witness = Witness { kinematics: &kinematics, records: &records, channels: &names };
    let options = BesideOptions { estimated: false, ..BesideOptions::default() };
    let found = beside(fitted, (runs, &witness), &options, (channels(definition).timed, tempo), work);
    let Some(found) = found else { return (None, f64::NEG_INFINITY) };
    let faults = found.weighed.iter().filter(|w| !w.is_none()).map(|w| w.evidence);
    // odds that are asked of a fault are its prior odds: most records have none
    let prior = -options.odds.ln();
    let together = log_sum(&faults.collect::<Vec<f64>>()) + prior;
    if !found.findings.iter().any(|f| f.severity == Severity::Finding) {
        return (None, together);
    }
    let begun: Vec<&str> = found.begun.iter().map(String::as_str).collect();
    let of = |(run, record): (&Run, &Record)| edited(run, record, &names, &found.edits, definition).ok();
    let mended = runs.iter().zip(&records).map(of).collect::<Option<Vec<Run>>>();
    let of_input = |edit: &Edit| match *edit {
        Edit::Hold(Slot::Input(k), held) => Some((definition.inputs[k].quantity.name.as_str(), held)),
        _ => None,
    };
    let holds: Vec<(&str, bool)> = found.edits.iter().filter_map(of_input).collect();
    let text = fitted.subject.with_free_initials_and_holds(&begun, &holds);
    let model = text.and_then(|text| Model::from_source(text).ok());
    let mended = mended.zip(model).map(|(runs, model)| Mended {
        evidence: found.evidence + prior * found.findings.len() as f64,
        prior: found.prior + prior * found.findings.len() as f64,
        assumed: found.findings.iter().filter(|f| f.severity == Severity::Finding).all(|f| f.fault == Fault::Hold),
        findings: found.findings,
        model,
        runs,
    });
    (mended, together)
}

/// Kinematics without the equations that the response of a model breaks.
fn held_by(kinematics: Kinematics, fitted: &FittedModel, records: &[Record], channels: &Channels) -> Kinematics {
    let mut response: Vec<Record> = records.to_vec();
    let (q, mut foreign) = (fitted.outputs(), vec![true; channels.slots().count()]);
    for (record, y) in response.iter_mut().zip(&fitted.response) {
        for output in 0..q {
            let place = channels.place(Slot::Output(output));
            foreign[place] = false;
            record.channels[place].values = y.iter().skip(output).step_by(q).copied().collect();
        }
    }
    kinematics.held_by(&response, &foreign, channels)
}

/// What samples that are not to be believed do to the parameters.
fn add_biases(model: &Model, runs: &[Run], clean: &Estimate, done: &mut Examination, work: &Work<'_>) {
    let Some(dirty) = base(model, runs, work) else { return };
    done.fits += 1;
    let biases = told::biases_of(&dirty.estimate, clean);
    done.findings.iter_mut().filter(|f| !f.samples.is_empty()).for_each(|f| f.biases = biases.clone());
}

/// What a fit asks when an output is not explained: the likeliest fault of its record, and nothing else. The first finding of the cheap half of the search:
/// units, signs, places and axes. Where none of these is likely, delays, filters, zeros, factors and clocks as well. Faults of other outputs than those that
/// are not explained are no cause. None where no fault is likely, or there was no time.
pub fn first_cause(model: &Model, runs: &[Run], unexplained: &[&str], work: &Work<'_>) -> Option<Finding> {
    let records: Vec<Record> = runs.iter().map(|run| Record::of_run(model.definition(), run, None)).collect();
    let options = AloneOptions { kinematics: false, ..AloneOptions::default() };
    let mut alone: Vec<Finding> = records.iter().flat_map(|record| examine_alone(record, &options)).collect();
    sort(&mut alone);
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
