//! What a record can tell of its model: parameters that it does not determine, inputs that move together, samples that are too far apart.

use crate::finding::{Fault, Finding};
use crate::record::{Channel, Record, Role};
use crate::repair::Repair;
use fdm_estimate::Estimate;
use fdm_system::Model;
use fdm_system::linear::{LinearModel, Modes, Recorded, Values};
use fdm_system::record::Run;

/// Remarks about the information in records; `model` has its estimates as start values.
pub fn information(model: &Model, runs: &[Run], records: &[Record], estimate: Option<&Estimate>) -> Vec<Finding> {
    let mut remarks = correlated_inputs(runs, records);
    remarks.extend(slow_sampling(model, runs));
    remarks.extend(estimate.and_then(|estimate| not_determined(runs, records, estimate)));
    remarks
}

fn name_of(runs: &[Run]) -> &str {
    if let [run] = runs { &run.name } else { "all" }
}

/// Inputs that move together in all runs: beyond a correlation of 0.95 the variance of their effects is ten times that of inputs by
/// themselves (variance inflation; Belsley, Kuh and Welsch 1980).
fn correlated_inputs(runs: &[Run], records: &[Record]) -> Vec<Finding> {
    const MOST: f64 = 0.95;
    let inputs: Vec<usize> = records
        .first()
        .map_or_else(Vec::new, |r| (0..r.channels.len()).filter(|k| r.channels[*k].role == Role::Input).collect());
    let about_mean = |c: &Channel| {
        let mean = c.values.iter().sum::<f64>() / c.values.len().max(1) as f64;
        c.values.iter().map(move |v| v - mean).collect::<Vec<f64>>()
    };
    let columns: Vec<Vec<f64>> =
        inputs.iter().map(|k| records.iter().flat_map(|r| about_mean(&r.channels[*k])).collect()).collect();
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let mut remarks = Vec::new();
    for (i, a) in columns.iter().enumerate() {
        for (j, b) in columns.iter().enumerate().skip(i + 1) {
            let correlation = product(a, b) / (product(a, a) * product(b, b)).sqrt();
            if correlation.is_nan() || correlation.abs() < MOST {
                continue;
            }
            let [one, other] = [i, j].map(|k| records[0].channels[inputs[k]].name.clone());
            // of two columns of length 1 with this cosine
            let condition = ((1.0 + correlation.abs()) / (1.0 - correlation.abs()).max(1e-16)).sqrt();
            let what = format!(
                "moves with `{other}` (correlation {correlation:+.3}, condition number {condition:.1}): what each does alone is hardly determined"
            );
            let mut remark = Finding::by_chance(name_of(runs), &one, Fault::CorrelatedInputs, 1.0, what).remark();
            remark.channels.push(other);
            remarks.push(
                remark.repaired_by(Repair::words("add a run that moves one of them alone: `fdm design` proposes one")),
            );
        }
    }
    remarks
}

/// The fastest mode that an input moves and an output shows, beside the usual interval of the samples.
#[derive(Debug, Clone, Copy)]
pub struct Pace {
    /// Magnitude of the mode's root, and its imaginary part.
    pub magnitude: f64,
    turning: f64,
    /// The usual interval.
    pub interval: f64,
}

/// At the model's start values; none where it has no such mode, or too many.
pub fn pace(model: &Model, runs: &[Run]) -> Option<Pace> {
    const MOST_STATES: usize = 40;
    let states = model.layout().states;
    let steps = runs.iter().flat_map(|r| r.time.windows(2).map(|w| w[1] - w[0]));
    let mut steps: Vec<f64> = steps.filter(|d| *d > 0.0).collect();
    if states == 0 || states > MOST_STATES || steps.is_empty() {
        return None;
    }
    let middle = steps.len() / 2;
    let interval = steps.select_nth_unstable_by(middle, f64::total_cmp).1.to_owned();
    let mut linear = LinearModel::near(model, &Recorded::of(model.definition(), runs)).ok()?;
    let mut values = Values::default();
    linear.evaluate(&model.definition().start(), &mut values).ok()?;
    let modes = Modes::new(linear.structure(), &values).ok()?;
    let seen = modes.modes.iter().filter(|m| m.shown && m.moved).map(|m| (m.s.norm(), m.s.im));
    let (magnitude, turning) = seen.max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(Pace { magnitude, turning, interval })
}

/// Samples that are further apart than the fastest mode lasts: beyond half a turn its motion is aliased.
fn slow_sampling(model: &Model, runs: &[Run]) -> Option<Finding> {
    let Pace { magnitude, turning, interval } = pace(model, runs)?;
    if magnitude * interval <= 1.0 {
        return None;
    }
    let word = match turning.abs() * interval > std::f64::consts::PI {
        true => "it is aliased",
        false => "it is over between two samples",
    };
    let what = format!("an interval of {interval:.4}, where the model's fastest mode has |s| = {magnitude:.4}: {word}");
    let finding = Finding::by_chance(name_of(runs), "t", Fault::SlowSampling, 1.0, what);
    let repair = Repair::words("record it faster, or leave the mode out of the model (a steady state in its place)");
    Some(finding.remark().repaired_by(repair))
}

/// What the record does not determine, and the inputs that never change.
fn not_determined(runs: &[Run], records: &[Record], estimate: &Estimate) -> Option<Finding> {
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
