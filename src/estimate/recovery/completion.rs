//! What follows a fit by squares and noise of one size: the noise that the model states, or the loss that was asked for.

use crate::methods::output_error::attempt::Attempt;
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::noise_model::{deviations, fit_noise_model};
use crate::methods::output_error::robust::fit_robust;
use crate::work::termination::Termination;
use fdm_system::model::Model;

/// Goes on from `first`, which was fitted by squares from the same starts. Stated noise is tried from where that ended and from the starts
/// themselves, or from `reached` alone where it has been tried from both before.
///
/// # Errors
/// [`FitError`], as any fit.
pub(crate) fn completed(attempt: &Attempt<'_>, reached: Option<&[Vec<f64>]>, first: Fit) -> Result<Fit, FitError> {
    let Attempt { model, starts, options, .. } = *attempt;
    let end = &first.estimate.termination;
    let Some(deviations) = deviations(model, &options.options.noise, &options.censored).filter(|_| !end.is_stopped())
    else {
        // without iterations the start values are judged
        let only_judged = options.options.iterations == 0 && matches!(end, Termination::IterationLimit);
        return match options.loss.is_squares() || !end.is_good() && !only_judged {
            true => Ok(first),
            false => fit_robust(&Attempt { model: &without_noise(model), ..*attempt }, first),
        };
    };
    let mut places: Vec<Vec<Vec<f64>>> = Vec::new();
    match reached {
        Some(reached) => places.push(reached.to_vec()),
        None => {
            let ended = attempt.reached(&first.estimate);
            places.extend(first.estimate.cost.map(|_| ended).filter(|ended| ended != starts));
            places.push(starts.to_vec());
        }
    }
    fit_noise_model(&Attempt { model: &without_process_noise(model), ..*attempt }, &places, (first, &deviations))
}

/// The model with the parameters of noises held: they move no response, so that squares of residuals say nothing of them.
pub(crate) fn without_noise(model: &Model) -> Model {
    held(model, model.definition().only_in_noise())
}

/// The model with those held that stand in the equations' noise alone: output error says nothing of them.
fn without_process_noise(model: &Model) -> Model {
    let definition = model.definition();
    let output = definition.only_in_output_noise();
    held(model, definition.only_in_noise().iter().zip(output).map(|(noise, output)| *noise && !output).collect())
}

fn held(model: &Model, only: Vec<bool>) -> Model {
    if !only.contains(&true) {
        return model.clone();
    }
    let mut params = model.definition().params.clone();
    params.iter_mut().zip(only).filter(|(_, only)| *only).for_each(|(p, _)| p.fixed = true);
    model.with_params(params)
}
