//! Frequency responses of a fit in the time domain: those that its runs show, and those of the model's response over the same time. Both are estimated by the
//! same windows, so that they share their errors, and a model need not be linear.

use super::decibels::{cost_of, decibels_and_degrees};
use super::fit::PairFit;
use super::measured::{Measured, OVERLAP};
use super::options::ResponseOptions;
use crate::methods::output_error::fit::Fit;
use fdm_system::record::Run;
use fdm_system::spectrum::{Frequencies, FrequencyResponseEstimate, SpectrumOptions, Window};
use std::f64::consts::TAU;

/// Measured and modelled responses of every pair that is coherent anywhere, in the order of outputs, then inputs. Empty where the runs allow none: without
/// inputs, of uneven samples, too short, or with inputs that cannot be told apart.
pub fn responses_of_fit(fit: &Fit, runs: &[Run]) -> Vec<PairFit> {
    let definition = fit.model.definition();
    let declared: Vec<usize> = (0..definition.inputs.len()).filter(|k| definition.inputs[*k].is_declared()).collect();
    let inputs: Vec<usize> = declared.iter().copied().filter(|k| !definition.inputs[*k].known).collect();
    if inputs.is_empty() || inputs.len() < declared.len() || fit.estimate.runs.len() != runs.len() {
        return Vec::new();
    }
    let options = ResponseOptions::default();
    let Ok(measured) = Measured::new(&fit.model, runs, &options) else { return Vec::new() };
    let outputs: Vec<usize> = (0..definition.outputs.len()).collect();
    let answered = runs.iter().zip(&fit.estimate.runs).map(|(run, found)| {
        let values = run.measured.iter().zip(&found.response);
        let answer = values.map(|(z, y)| if z.is_nan() { f64::NAN } else { *y }).collect();
        Run { measured: answer, ..run.clone() }.with_channels(&inputs, &outputs)
    });
    let answered: Vec<Run> = answered.collect();
    let list = Frequencies::List(measured.estimate.omega.iter().map(|w| w / TAU).collect());
    let how = SpectrumOptions::default();
    let modelled =
        FrequencyResponseEstimate::composite(&answered, &list, &measured.lengths, OVERLAP, Window::Hann, &how);
    let Ok(modelled) = modelled.as_ref() else { return Vec::new() };
    if modelled.omega.len() != measured.estimate.omega.len() {
        return Vec::new();
    }
    let name = |output: usize, input: usize| {
        let quantity = |q: &fdm_grammar::model::Quantity| q.name.clone();
        (quantity(&definition.outputs[output].quantity), quantity(&definition.inputs[inputs[input]].quantity))
    };
    let pair = |output: usize, input: usize| {
        let coherence = measured.coherence(output, input);
        let place = measured.estimate.pair(output, input).start;
        let finite = |k: &usize| {
            let both = [measured.estimate.response[place + k], modelled.response[place + k]];
            both.iter().all(|h| h.norm() > 0.0 && h.re.is_finite() && h.im.is_finite())
                && measured.estimate.error[place + k].is_finite()
        };
        let at: Vec<usize> = (0..coherence.len()).filter(finite).collect();
        let shown = |of: &FrequencyResponseEstimate| -> Vec<[f64; 2]> {
            at.iter().map(|k| decibels_and_degrees(of.response[place + k])).collect()
        };
        let mut own = shown(modelled);
        let own_measured = shown(&measured.estimate);
        for (own, measured) in own.iter_mut().zip(&own_measured) {
            own[1] += 360.0 * ((measured[1] - own[1]) / 360.0).round();
        }
        let coherence: Vec<f64> = at.iter().map(|k| coherence[*k]).collect();
        let counted = |k: &usize| coherence[*k] >= options.coherence;
        let errors = (0..at.len()).filter(counted).map(|k| {
            let off = [0, 1].map(|part| own_measured[k][part] - own[k][part]);
            (coherence[k], off)
        });
        let errors: Vec<(f64, [f64; 2])> = errors.collect();
        let (output_name, input_name) = name(output, input);
        (!errors.is_empty()).then(|| PairFit {
            output: output_name,
            input: input_name,
            omega: at.iter().map(|k| measured.estimate.omega[*k]).collect(),
            cost: cost_of(&errors),
            error: at.iter().map(|k| measured.estimate.error[place + k]).collect(),
            left_out: at.len() - errors.len(),
            measured: own_measured,
            modelled: own,
            coherence,
        })
    };
    let all = outputs.iter().flat_map(|o| (0..inputs.len()).map(move |i| (*o, i)));
    all.filter_map(|(o, i)| pair(o, i)).collect()
}
