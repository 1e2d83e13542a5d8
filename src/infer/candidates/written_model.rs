//! The extended model as it is written: with estimates of all parameters in its text, and what it does then.
//!
//! Candidates are compared by whitened residuals, in which levels and slow parts count little. A user simulates the text. So the written
//! text is fitted once more by plain output error, as `fit` would, and only what it does is told. It must not do worse than the model
//! without the effects.

use crate::bins::Signals;
use crate::candidates::fitted_model::{FittedModel, shared_from};
use crate::candidates::initial_fit::{own_fit, plain_fit};
use crate::candidates::runs::{DiagnosisOptions, Domain, Runs};
use fdm_estimate::Work;
use fdm_estimate::residuals::add_squares;
use fdm_grammar::model::Origin;
use std::ops::Range;

/// Digits of an estimate in the text.
const DIGITS: usize = 6;
/// A model at the values that stand in its text.
pub(crate) struct WrittenModel {
    /// With its responses; what belongs to a run is estimated there.
    pub(crate) fitted: FittedModel,
    /// Its text.
    pub(crate) text: String,
    /// Squared error over that of the model without the effects, the mean over outputs: on the training runs.
    pub(crate) training: f64,
    /// On the validation runs; none without such runs.
    pub(crate) validation: Option<f64>,
}

impl WrittenModel {
    /// The ratio by which it is judged: on validation runs where there are any.
    pub(crate) fn ratio(&self) -> f64 {
        self.validation.unwrap_or(self.training)
    }

    /// The value of a parameter in the text.
    pub(crate) fn value(&self, name: &str) -> Option<f64> {
        let at = self.fitted.model.definition().param(name)?;
        self.fitted.theta.first().map(|theta| theta[at])
    }
}

/// Writes the estimates into the text of an extended model: those of a plain fit, or the joint ones (`theta`) where these predict
/// validation runs better. `naive` are the responses without the effects.
///
/// # Errors
/// Why there is none, in words.
pub(crate) fn written_model(
    current: &FittedModel,
    theta: &[Vec<f64>],
    naive: &[Signals],
    (runs, options, work): (Runs<'_>, &DiagnosisOptions, &Work<'_>),
) -> Result<WrittenModel, String> {
    let joint = |theta: &[Vec<f64>]| at_values(current, theta, naive, runs);
    let best = match runs.domain {
        Domain::Frequency(_) => joint(theta),
        Domain::Time => match plain_fit(current, theta, runs, (options, work)) {
            // what a plain fit cannot be had of is told as it was found
            Err(_) => {
                own_fit(current, theta, runs, (options, work)).and_then(|theta| joint(&theta)).or_else(|| joint(theta))
            }
            Ok(plain) => {
                let plain = at_values(current, &plain.theta, naive, runs);
                // who simulates the text has initial values and zeros by a plain fit
                let joint = own_fit(current, theta, runs, (options, work)).and_then(|theta| joint(&theta));
                match (plain, joint) {
                    (Some(plain), Some(joint)) => Some(if joint.ratio() < plain.ratio() { joint } else { plain }),
                    (plain, joint) => plain.or(joint),
                }
            }
        },
    };
    best.ok_or_else(|| "the written model cannot be simulated".into())
}

/// The model with these values in its text, to the digits that are written; none where it has no response.
pub(crate) fn at_values(
    current: &FittedModel,
    theta: &[Vec<f64>],
    naive: &[Signals],
    runs: Runs<'_>,
) -> Option<WrittenModel> {
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
    let training = ratio(&fitted, naive, runs, 0..runs.train);
    let validation = (!runs.validation().is_empty()).then(|| ratio(&fitted, naive, runs, runs.train..runs.all.len()));
    Some(WrittenModel { fitted, text, training, validation })
}

/// Squared residuals over those of other responses on these runs, the mean over outputs.
fn ratio(fitted: &FittedModel, naive: &[Signals], runs: Runs<'_>, judged: Range<usize>) -> f64 {
    let after = squares(fitted, &fitted.response, runs, judged.clone());
    let before = squares(fitted, naive, runs, judged);
    let ratios: Vec<f64> = before
        .iter()
        .zip(&after)
        .filter(|(before, _)| before.0 > 0.0)
        .map(|(before, after)| after.0 / before.0)
        .collect();
    if ratios.is_empty() { 1.0 } else { ratios.iter().sum::<f64>() / ratios.len() as f64 }
}

/// Sum of squared residuals of each output on these runs, and the number of measurements.
pub(crate) fn squares(
    fitted: &FittedModel,
    responses: &[Signals],
    runs: Runs<'_>,
    judged: Range<usize>,
) -> Vec<(f64, usize)> {
    let mut sums = vec![(0.0, 0); fitted.outputs()];
    for r in judged {
        add_squares(&mut sums, &fitted.predictors[r].measured(&runs.all[r]), &responses[r]);
    }
    sums
}
