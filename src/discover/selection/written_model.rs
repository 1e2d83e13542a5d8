//! The extended model as it is written: with estimates of all parameters in its text, and what it does then.
//!
//! Candidates are compared by whitened residuals, in which levels and slow parts count little. A user simulates the text. So the written
//! text is fitted once more by plain output error, as `fit` would, and only what it does is told. It must not do worse than the model
//! without the effects.

use super::fitted_model::{FittedModel, shared_from};
use super::initial_fit::plain_fit;
use super::runs::{DiagnosisOptions, Domain, GoesOn, Runs};
use crate::bins::Signals;
use fdm_grammar::model::Origin;

/// Digits of an estimate in the text.
const DIGITS: usize = 6;

/// A model at the values that stand in its text.
pub(super) struct WrittenModel {
    /// With its responses; what belongs to a run is estimated there.
    pub(super) fitted: FittedModel,
    /// Its text.
    pub(super) text: String,
    /// Squared error over that of the model without the effects, on validation runs where there are any: the mean over outputs.
    pub(super) ratio: f64,
}

/// Writes the estimates into the text of an extended model: those of a plain fit, or the joint ones (`theta`) where these predict
/// validation runs better. `naive` are the responses without the effects.
///
/// # Errors
/// Why it cannot be recommended, in words.
pub(super) fn written_model(
    current: &FittedModel,
    theta: &[Vec<f64>],
    naive: &[Signals],
    (runs, options, goes_on): (Runs<'_>, &DiagnosisOptions, &GoesOn<'_>),
) -> Result<WrittenModel, String> {
    let joint = at(current, theta, naive, runs);
    let best = match runs.domain {
        Domain::Frequency(_) => joint,
        Domain::Time => match plain_fit(current, theta, runs, options, goes_on) {
            // a search that is stopped tells what it knows
            Err(_) if !goes_on() => joint,
            Err(why) => return Err(format!("a plain fit of the written model fails: {why}")),
            Ok(plain) => {
                let plain = at(current, &plain.theta, naive, runs);
                match (plain, joint) {
                    (Some(plain), Some(joint)) => Some(if joint.ratio < plain.ratio { joint } else { plain }),
                    (plain, joint) => plain.or(joint),
                }
            }
        },
    };
    let best = best.ok_or("the written model cannot be simulated")?;
    if best.ratio > 1.0 {
        let percent = 100.0 * (best.ratio.sqrt() - 1.0);
        let whose = if runs.validation().is_empty() { "fitted" } else { "validation" };
        return Err(format!(
            "the residual of the written model is {percent:.1} % larger on {whose} runs than without it"
        ));
    }
    Ok(best)
}

/// The model with these values in its text, to the digits that are written; none where it has no response.
fn at(current: &FittedModel, theta: &[Vec<f64>], naive: &[Signals], runs: Runs<'_>) -> Option<WrittenModel> {
    let short = |v: f64| format!("{v:.*e}", DIGITS - 1).parse().unwrap_or(v);
    let params = current.params();
    let shared: Vec<f64> = params
        .iter()
        .zip(theta.first()?)
        // a value beyond a bound by its last digit is no start value
        .map(|(p, v)| if p.fixed || p.origin != Origin::Declared { *v } else { short(*v).clamp(p.lower, p.upper) })
        .collect();
    let values: Vec<(String, f64)> = params
        .iter()
        .zip(&shared)
        .filter(|(p, _)| !p.fixed && !p.per_run && p.origin == Origin::Declared)
        .map(|(p, v)| (p.quantity.name.clone(), *v))
        .collect();
    let text = current.subject.with_start_values(&values).text().to_string();
    let theta = shared_from(params, &shared, theta);
    let fitted = FittedModel::new(current.model.clone(), runs, theta).ok()?;
    let ratio = ratio(&fitted, naive, runs);
    Some(WrittenModel { fitted, text, ratio })
}

/// Squared residuals over those of other responses, the mean over outputs.
fn ratio(fitted: &FittedModel, naive: &[Signals], runs: Runs<'_>) -> f64 {
    let q = fitted.outputs();
    let judged = if runs.validation().is_empty() { 0..runs.train } else { runs.train..runs.all.len() };
    let mut sums = vec![[0.0; 2]; q];
    for r in judged {
        let measured = fitted.predictors[r].measured(&runs.all[r]);
        let cells = measured.iter().zip(naive[r].iter().zip(&fitted.response[r]));
        for (k, (z, (before, after))) in cells.enumerate().filter(|(_, (z, _))| !z.is_nan()) {
            sums[k % q][0] += (z - before) * (z - before);
            sums[k % q][1] += (z - after) * (z - after);
        }
    }
    let ratios: Vec<f64> =
        sums.iter().filter(|[before, _]| *before > 0.0).map(|[before, after]| after / before).collect();
    if ratios.is_empty() { 1.0 } else { ratios.iter().sum::<f64>() / ratios.len() as f64 }
}
