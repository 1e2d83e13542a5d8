//! What manoeuvres would tell, and the best of them one after the other.

use super::manoeuvre::{Kept, run, survey, within_limits};
use super::question::Question;
use fdm_estimate::{Halt, Information, NoInformation};
use fdm_numeric::parallel;
use fdm_results::documents::design::{Design, Gain, Manoeuvre, Outlook, Step};

/// Why a manoeuvre was not looked at.
pub(super) const STOPPED: &str = "the work was stopped before it was looked at";

/// A manoeuvre and what it tells.
struct Told {
    manoeuvre: Manoeuvre,
    information: Information,
    excursions: Vec<f64>,
}

/// Answers a question; manoeuvres that have not been looked at when the work is to end are left out.
///
/// # Errors
/// Everything that makes it impossible, one sentence each.
pub fn design(question: &Question<'_>, halt: &Halt) -> Result<Design, Vec<String>> {
    question.examine().map_err(|all| all.iter().map(ToString::to_string).collect::<Vec<_>>())?;
    let now = known(question).map_err(|e| vec![e.to_string()])?;
    let (mut told, mut lost) = (Vec::new(), Vec::new());
    let manoeuvres = survey(question);
    let one = |m: &Manoeuvre| match halt.goes_on() {
        true => within_limits(question, m, |m| tell(question, m)),
        false => Err(STOPPED.into()),
    };
    let answers: Vec<Result<Kept<Information>, String>> = parallel::map(manoeuvres.iter(), one);
    for (manoeuvre, answer) in manoeuvres.into_iter().zip(answers) {
        match answer {
            Ok(Kept { manoeuvre, told: information, excursions }) => {
                told.push(Told { manoeuvre, information, excursions });
            }
            Err(reason) => lost.push((manoeuvre, reason)),
        }
    }
    let sizes = sizes(question);
    let before = now.bits(&sizes);
    let gain = |t: &Told| {
        let then = now.plus(&t.information);
        let (bits, errors) = (then.bits(&sizes) - before, then.errors());
        Gain { manoeuvre: t.manoeuvre.clone(), bits, errors, excursions: t.excursions.clone() }
    };
    let mut gains: Vec<Gain> = parallel::map(told.iter(), gain);
    let (steps, after) = planned(&now, &told, &sizes, question.runs);
    let everything = told.iter().fold(now.clone(), |sum, t| sum.plus(&t.information));
    // equal gains stay in the order of the survey
    gains.sort_by(|a, b| b.bits.total_cmp(&a.bits));
    Ok(Design {
        outlook: outlook(question, &now, &after, &gains),
        undetermined_now: now.undetermined(),
        undetermined_then: everything.undetermined(),
        steps,
        gains,
        lost,
    })
}

/// What the runs so far tell.
pub(super) fn known(question: &Question<'_>) -> Result<Information, NoInformation> {
    let prior = Information::prior(question.model);
    if question.known.is_empty() {
        return Ok(prior);
    }
    let (runs, thetas): (Vec<_>, Vec<_>) = question.known.iter().cloned().unzip();
    Ok(prior.plus(&Information::of(question.model, &runs, &thetas, &question.deviations)?.0))
}

/// What a manoeuvre tells, and how far the outputs move.
fn tell(question: &Question<'_>, manoeuvre: &Manoeuvre) -> Result<(Information, Vec<f64>), String> {
    let run = run(question, manoeuvre).ok_or("it cannot be sampled")?;
    let theta = vec![question.theta.clone()];
    let told = Information::of(question.model, std::slice::from_ref(&run), &theta, &question.deviations);
    let (information, responses) = told.map_err(|e| e.to_string())?;
    Ok((information, excursions(&responses[0], question.deviations.len())))
}

pub(super) fn excursions(response: &[f64], q: usize) -> Vec<f64> {
    let from = |o: usize| response.iter().skip(o).step_by(q).map(move |v| (v - response[o]).abs());
    (0..q).map(|o| from(o).fold(0.0, f64::max)).collect()
}

/// What counts as knowing nothing but the size of a parameter: its value, or where that is 0 half its bounds, or 1.
fn sizes(question: &Question<'_>) -> Vec<f64> {
    let params = question.model.definition().params.iter().zip(&question.theta);
    let size = |(p, value): (&fdm_grammar::model::Param, &f64)| {
        let width = 0.5 * (p.upper - p.lower);
        match value.abs() {
            0.0 if width.is_finite() => width,
            0.0 => 1.0,
            size => size,
        }
    };
    params.filter(|(p, _)| !p.fixed && !p.per_run).map(size).collect()
}

/// The most telling run, then the one that adds most to it, and so on; and what is known after each.
fn planned(now: &Information, told: &[Told], sizes: &[f64], runs: usize) -> (Vec<Step>, Vec<Information>) {
    let (mut steps, mut after, mut sum) = (Vec::new(), Vec::new(), now.clone());
    for _ in 0..runs {
        let before = sum.bits(sizes);
        let with: Vec<f64> = parallel::map(told.iter(), |t| sum.plus(&t.information).bits(sizes));
        let best = (0..told.len()).rev().max_by(|a, b| with[*a].total_cmp(&with[*b]));
        let Some(best) = best else { break };
        sum = sum.plus(&told[best].information);
        steps.push(Step { manoeuvre: told[best].manoeuvre.clone(), bits: with[best] - before });
        after.push(sum.clone());
    }
    (steps, after)
}

fn outlook(question: &Question<'_>, now: &Information, after: &[Information], gains: &[Gain]) -> Vec<Outlook> {
    let params = question.model.definition().params.iter().zip(&question.theta);
    let (errors, then) = (now.errors(), after.iter().map(Information::errors).collect::<Vec<_>>());
    let free = params.filter(|(p, _)| !p.fixed && !p.per_run).enumerate();
    let one = |(k, (p, value)): (usize, (&fdm_grammar::model::Param, &f64))| {
        let left = gains.iter().enumerate().filter_map(|(g, gain)| Some((g, gain.errors[k]?)));
        Outlook {
            parameter: p.quantity.name.clone(),
            value: *value,
            unit: p.quantity.unit.as_ref().map(ToString::to_string),
            now: errors[k],
            then: then.iter().map(|errors| errors[k]).collect(),
            best: left.min_by(|a, b| a.1.total_cmp(&b.1)),
        }
    };
    free.map(one).collect()
}
