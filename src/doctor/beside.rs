//! A record beside a model: which fault makes it likeliest, one after the other, and what each does to the parameters.

use crate::biases::{biases_of, mask};
use crate::finding::{Fault, Finding, Severity, in_order};
use crate::hypothesis::{Channels, Edit, Hypothesis, Slot, column, discrete};
use crate::likelihood::{Searched, Trial, search, trial, trial_from, with};
use crate::record::{Record, Role};
use crate::repair::Repair;
use fdm_system::Model;
use fdm_system::record::{Run, channels};
use rayon::prelude::*;

/// How a record is judged beside a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BesideOptions {
    /// Odds that a fault must have to be told. As the prior odds of any fault are 1 : 1, a record without one has a finding with a
    /// probability of at most one over these odds, by Markov's inequality for likelihood ratios.
    pub odds: f64,
    /// Most faults that are told, one after the other.
    pub most: usize,
    /// Whether delays, offsets, scale factors and drifts of clocks are estimated: some twenty fits for each channel.
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

/// Iterations of the fits that count.
const THOROUGH: usize = 40;

/// Judges runs beside their model. `alone` are the findings of the records by themselves: their samples are left out of the fits, and they get
/// their biases. One record (of [`Record::of_run`]) for each run.
pub fn examine_beside(
    model: &Model,
    runs: &[Run],
    records: &[Record],
    alone: Vec<Finding>,
    options: &BesideOptions,
) -> Examination {
    let masked = mask(model, runs, &alone);
    let mut done = Examination { findings: alone, ..Examination::default() };
    let slots = Channels::new(model.definition());
    let stated: Vec<bool> = (0..slots.inputs + slots.outputs)
        .map(|k| records.iter().all(|r| r.channels.get(k).is_none_or(|c| c.stated)))
        .collect();
    let timed = channels(model.definition()).timed;
    let Some(mut current) = trial(model, &masked, &[], THOROUGH).or_else(|| Trial::unexplained(model, &masked)) else {
        done.notes.push("nothing was compared beside the model: no output has samples".into());
        return done;
    };
    done.fits += 1;
    add_biases(model, runs, &masked, &current, &mut done);
    let mut accepted: Vec<Edit> = Vec::new();
    for _ in 0..options.most {
        let judged = round(
            &Search { model, slots: &slots, runs: &masked, stated: &stated, timed, options },
            &accepted,
            &current,
        );
        done.fits += judged.fits;
        let Some(best) = judged.best.filter(|b| b.log_odds > options.odds.ln()) else { break };
        let (mut edits, after) = (with(&accepted, &best.hypothesis), best.trial);
        let mut finding = told(&slots, runs, &best.hypothesis, best.log_odds, &judged.others);
        finding.biases = biases_of(current.estimate.as_ref(), after.estimate.as_ref());
        done.findings.push(finding);
        std::mem::swap(&mut accepted, &mut edits);
        current = after;
    }
    done.findings.extend(not_determined(runs, records, &current));
    in_order(&mut done.findings);
    done
}

/// What every round of the search has in common.
struct Search<'a> {
    model: &'a Model,
    slots: &'a Channels<'a>,
    runs: &'a [Run],
    stated: &'a [bool],
    timed: bool,
    options: &'a BesideOptions,
}

/// A hypothesis that was tried.
struct Judged {
    hypothesis: Hypothesis,
    log_odds: f64,
    trial: Trial,
}

/// One round: the likeliest hypothesis, and what else is nearly as likely.
struct Round {
    best: Option<Judged>,
    others: Vec<(String, f64)>,
    fits: usize,
}

fn round(search: &Search<'_>, accepted: &[Edit], current: &Trial) -> Round {
    /// Of the fits that sort the hypotheses.
    const QUICK: usize = 6;
    /// Hypotheses that are fitted to the end.
    const REFINED: usize = 4;
    /// Kinds of estimated faults for each channel, with their shares of the prior probability.
    const SHARE: f64 = 3.0;
    let Search { model, slots, runs, stated, timed, options } = *search;
    let fresh = |h: &Hypothesis| !h.edits.iter().all(|e| accepted.contains(e));
    let tried: Vec<Hypothesis> = discrete(slots, stated, timed).into_iter().filter(fresh).collect();
    let kinds = if options.estimated { SHARE * (slots.inputs + slots.outputs) as f64 } else { 0.0 };
    let whole = tried.iter().map(|h| h.weight).sum::<f64>() + kinds;
    let mut fits = tried.len();
    let judge = |hypothesis: Hypothesis| {
        let trial = trial(model, runs, &with(accepted, &hypothesis), QUICK)?;
        let log_odds = trial.gain_over(current) + (hypothesis.weight / whole).ln();
        Some(Judged { hypothesis, log_odds, trial })
    };
    let mut all: Vec<Judged> = tried.into_par_iter().filter_map(judge).collect();
    if options.estimated {
        let estimated = estimated(search, accepted, current);
        fits += estimated.1;
        all.extend(estimated.0.into_iter().map(|mut judged| {
            judged.log_odds -= whole.ln();
            judged
        }));
    }
    let surest_first = |all: &mut Vec<Judged>| all.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
    surest_first(&mut all);
    // quick fits have sorted them; the first are fitted to the end
    for judged in all.iter_mut().take(REFINED) {
        let whole = trial(model, runs, &with(accepted, &judged.hypothesis), THOROUGH);
        fits += 1;
        if let Some(trial) = whole {
            let gain = trial.gain_over(&judged.trial);
            if gain > 0.0 {
                judged.log_odds += trial.gain_over(current) - judged.trial.gain_over(current);
                judged.trial = trial;
            }
        }
    }
    surest_first(&mut all);
    let best = all.first().map_or(f64::NEG_INFINITY, |b| b.log_odds);
    let near = all.iter().skip(1).filter(|j| j.log_odds > best - 10f64.ln()).take(3);
    let others = near.map(|j| (sentence(slots, &j.hypothesis), j.log_odds)).collect();
    Round { best: (!all.is_empty()).then(|| all.swap_remove(0)), others, fits }
}

/// Delays, offsets, scale factors and drifts of each channel, with their best values.
fn estimated(search_in: &Search<'_>, accepted: &[Edit], current: &Trial) -> (Vec<Judged>, usize) {
    let Search { model, slots, runs, timed, .. } = *search_in;
    /// Iterations of fits that begin at the estimates of one that is near.
    const NEAR: usize = 3;
    let begun = current.begun(model);
    let intervals: Vec<f64> = runs.iter().flat_map(|r| r.time.windows(2).map(|w| w[1] - w[0])).collect();
    let interval = intervals.iter().sum::<f64>() / intervals.len().max(1) as f64;
    let span = runs.iter().filter_map(|r| r.time.last()).copied().fold(0.0, f64::max);
    let mut wanted: Vec<(Slot, Fault, f64)> = Vec::new();
    for slot in slots.slots() {
        let values: Vec<f64> = runs.iter().flat_map(|r| column(r, slot)).filter(|v| v.is_finite()).collect();
        let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
        let deviation = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len().max(1) as f64).sqrt();
        if deviation <= 0.0 || !deviation.is_finite() {
            continue;
        }
        if timed && interval > 0.0 {
            wanted.push((slot, Fault::Delay, 2.0 * interval));
            // what the clock of a channel has gained in the end, in intervals
            wanted.push((slot, Fault::Drift, 4.0 * interval / span));
        }
        wanted.push((slot, Fault::Offset, 0.2 * deviation));
        wanted.push((slot, Fault::Scale, 0.1));
    }
    let edit = |slot: Slot, fault: Fault, value: f64| match fault {
        Fault::Delay => Edit::Delay(slot, value),
        Fault::Drift => Edit::Drift(slot, value),
        Fault::Offset => Edit::Affine(slot, 1.0, value),
        _ => Edit::Affine(slot, value.exp(), 0.0),
    };
    let judge = |(slot, fault, step): &(Slot, Fault, f64)| {
        let (slot, fault) = (*slot, *fault);
        let at = |value: f64| {
            let hypothesis = Hypothesis {
                fault,
                slots: vec![slot],
                edits: vec![edit(slot, fault, value)],
                what: String::new(),
                weight: 1.0,
            };
            trial_from(model, &begun, runs, &with(accepted, &hypothesis), NEAR)
        };
        let Searched { value, error, trial } = search(0.0, *step, current, &at)?;
        // one estimated number costs half the logarithm of the independent samples (Schwarz 1978); a delay below a sample and an offset or
        // factor that leave more than nine tenths of every output's error are no faults of a record
        let penalty = 0.5 * trial.worth().max(1.0).ln();
        let matters = match fault {
            Fault::Delay => value.abs() >= interval,
            Fault::Drift => value.abs() * span >= 2.0 * interval,
            _ => true,
        };
        if !matters || value.abs() < 4.0 * error || trial.least_left(current) > 0.9 {
            return None;
        }
        let unit = slots.unit(slot).map_or_else(String::new, |u| format!(" {u}"));
        let error = if error.is_finite() { format!(" +- {error:.2e}") } else { String::new() };
        let what = match fault {
            Fault::Delay if value > 0.0 => format!("comes {value:.4} too late{error}"),
            Fault::Delay => format!("comes {:.4} too early{error}", -value),
            Fault::Drift => format!("its clock gains {value:.3e} of every unit of time{error}"),
            Fault::Offset => format!("is {:.4}{unit} too large{error}", -value),
            _ => format!("is {:.4} times too large{error}", (-value).exp()),
        };
        // drifts and scale factors are rarer than delays and offsets
        let weight = if matches!(fault, Fault::Delay | Fault::Offset) { 1.0 } else { 0.5 };
        let log_odds = trial.gain_over(current) - penalty + f64::ln(weight);
        let hypothesis = Hypothesis { fault, slots: vec![slot], edits: vec![edit(slot, fault, value)], what, weight };
        Some(Judged { hypothesis, log_odds, trial })
    };
    let found: Vec<Judged> = wanted.par_iter().filter_map(judge).collect();
    // three fits a step, of up to six steps
    (found, 10 * wanted.len())
}

fn sentence(slots: &Channels<'_>, hypothesis: &Hypothesis) -> String {
    let names: Vec<&str> = hypothesis.slots.iter().map(|s| slots.name(*s)).collect();
    match names[..] {
        [] => hypothesis.what.clone(),
        [first, ..] => format!("`{first}` {}", hypothesis.what),
    }
}

fn told(
    slots: &Channels<'_>,
    runs: &[Run],
    hypothesis: &Hypothesis,
    log_odds: f64,
    others: &[(String, f64)],
) -> Finding {
    let mut names: Vec<String> = hypothesis.slots.iter().map(|s| slots.name(*s).to_string()).collect();
    if names.is_empty() {
        names.push("t".into());
    }
    let mut what = hypothesis.what.clone();
    let mut near = others.iter().peekable();
    if near.peek().is_some() {
        let list: Vec<&str> = near.map(|(s, _)| s.as_str()).collect();
        what.push_str(&format!("; nearly as likely: {}", list.join(", or ")));
    }
    let run = if let [run] = runs { run.name.clone() } else { "all".into() };
    Finding {
        run,
        channels: names,
        fault: hypothesis.fault,
        severity: Severity::Finding,
        place: None,
        what,
        log_odds,
        biases: Vec::new(),
        repair: Some(slots.repair(&hypothesis.edits)),
        samples: Vec::new(),
    }
}

/// The fits with and without the samples that are not to be believed.
fn add_biases(model: &Model, runs: &[Run], masked: &[Run], clean: &Trial, done: &mut Examination) {
    if !done.findings.iter().any(|f| !f.samples.is_empty()) || runs == masked {
        return;
    }
    if let Some(dirty) = trial(model, runs, &[], 40) {
        done.fits += 1;
        let biases = biases_of(dirty.estimate.as_ref(), clean.estimate.as_ref());
        done.findings.iter_mut().filter(|f| !f.samples.is_empty()).for_each(|f| f.biases = biases.clone());
    }
}

/// What the record does not determine, and the inputs that never change.
fn not_determined(runs: &[Run], records: &[Record], current: &Trial) -> Option<Finding> {
    let estimate = current.estimate.as_ref()?;
    let directions = &estimate.undetermined;
    let first = directions.first()?;
    let still = |name: &str| {
        records.iter().all(|r| {
            let channel = r.channels.iter().find(|c| c.name == name && c.role == Role::Input);
            channel.is_some_and(|c| c.values.windows(2).all(|w| w[0] == w[1]))
        })
    };
    let inputs = records.first().into_iter().flat_map(|r| &r.channels).filter(|c| c.role == Role::Input);
    let mut names: Vec<String> = inputs.filter(|c| still(&c.name)).map(|c| c.name.clone()).collect();
    let because = if names.is_empty() { String::new() } else { format!("; never moved: `{}`", names.join("`, `")) };
    if names.is_empty() {
        names.push("t".into());
    }
    let run = if let [run] = runs { run.name.as_str() } else { "all" };
    let what = format!(
        "{} of {} combinations are not determined: {}{because}",
        directions.len(),
        estimate.covered.len(),
        first.sentence
    );
    let mut finding = Finding::by_chance(run, &names[0], Fault::NotDetermined, 1e-6, what);
    finding.channels = names;
    Some(
        finding
            .remark()
            .repaired_by(Repair::words("add a run that moves them: `fdm design` proposes one; or --fix the parameter")),
    )
}
