//! Weight variation (Goodman and Sargent 1971, section III): estimates with other weights of the outputs. Parameters that move
//! much deserve little confidence.

use crate::estimate::estimate::ParameterEstimate;
use crate::estimate::noise::Noise;
use crate::estimate::problem::Options;
use crate::estimate::progress::Observer;
use crate::estimate::road::attempt::again;
use crate::estimate::road::fit::{Fit, FitOptions};
use crate::estimate::road::fit_error::FitError;
use crate::estimate::road::start::after;
use crate::estimate::termination::Termination;
use crate::record::Run;
use serde::Serialize;

/// What was different about the weight of an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Weight {
    /// Its noise was taken as half of what it is.
    NoiseHalved,
    /// Its noise was taken as twice what it is.
    NoiseDoubled,
    /// It was not compared.
    LeftOut,
}

/// One fit with other weights.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Variation {
    /// The output whose weight was changed.
    pub output: String,
    /// What was different about it.
    pub weight: Weight,
    /// How the iteration ended.
    pub termination: Termination,
    /// Change of each parameter in its standard errors, in the order of [`Reweighting::parameters`]; none where the
    /// parameter is not determined with these weights.
    pub changes: Vec<Option<f64>>,
}

/// Estimates under other weights of the outputs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reweighting {
    /// The estimated parameters, with the noise of each output held at what was estimated.
    pub parameters: Vec<ParameterEstimate>,
    /// The variations, output by output.
    pub variations: Vec<Variation>,
}

impl Reweighting {
    /// Largest change of a parameter (by its place in `parameters`) in its standard errors; infinite when some variation
    /// leaves it undetermined.
    pub fn largest(&self, parameter: usize) -> f64 {
        let sizes = self.variations.iter().map(|v| v.changes[parameter].map_or(f64::INFINITY, f64::abs));
        sizes.fold(0.0, f64::max)
    }
}

/// Refits with the noise of each output halved and doubled, and each output left out. None when there is nothing to vary:
/// the fit went wrong, or its data have no noise.
pub(in crate::estimate) fn reweighted(
    fit: &Fit,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    observer: &mut dyn Observer,
) -> Result<Option<Reweighting>, FitError> {
    let Some(noise) = fit.estimate.noise.as_ref().filter(|_| fit.estimate.noise_free.is_empty()) else {
        return Ok(None);
    };
    if !fit.estimate.termination.is_good() {
        return Ok(None);
    }
    let q = noise.size;
    let deviations: Vec<Option<f64>> =
        (0..q).map(|o| Some(noise.at(o, o).sqrt()).filter(|s| *s > 0.0 && s.is_finite())).collect();
    let starts = after(&fit.model, runs, &fit.estimate, starts);
    let mut with = |deviations: &[Option<f64>], runs: &[Run]| {
        let options = Options { noise: Noise::Given(deviations.to_vec()), colour: false, ..options.options.clone() };
        again(fit, runs, &starts, &FitOptions { options, ..FitOptions::default() }, observer)
    };
    let base = with(&deviations, runs)?;
    let known = |p: &&ParameterEstimate| p.start.is_some() && p.standard_error.is_some();
    let parameters: Vec<ParameterEstimate> = base.estimate.parameters.iter().filter(known).cloned().collect();
    let measured: Vec<usize> = (0..q).filter(|o| deviations[*o].is_some()).collect();
    let mut variations = Vec::new();
    for o in &measured {
        for weight in [Weight::NoiseHalved, Weight::NoiseDoubled, Weight::LeftOut] {
            if weight == Weight::LeftOut && measured.len() < 2 {
                continue;
            }
            let varied = match weight {
                Weight::NoiseHalved => with(&scaled(&deviations, *o, 0.5), runs)?,
                Weight::NoiseDoubled => with(&scaled(&deviations, *o, 2.0), runs)?,
                Weight::LeftOut => with(&deviations, &without(runs, *o, q))?,
            };
            let output = fit.model.definition().outputs[*o].quantity.name.clone();
            let termination = varied.estimate.termination.clone();
            if termination == Termination::Interrupted {
                return Ok(Some(Reweighting { parameters, variations }));
            }
            let changes = parameters.iter().map(|p| change(p, &varied)).collect();
            variations.push(Variation { output, weight, termination, changes });
        }
    }
    Ok(Some(Reweighting { parameters, variations }))
}

fn scaled(deviations: &[Option<f64>], output: usize, factor: f64) -> Vec<Option<f64>> {
    let mut scaled = deviations.to_vec();
    scaled[output] = scaled[output].map(|s| s * factor);
    scaled
}

fn without(runs: &[Run], output: usize, q: usize) -> Vec<Run> {
    let mut runs = runs.to_vec();
    for run in &mut runs {
        run.measured.iter_mut().skip(output).step_by(q).for_each(|z| *z = f64::NAN);
        run.output_gaps[output] = run.len();
    }
    runs
}

fn change(base: &ParameterEstimate, varied: &Fit) -> Option<f64> {
    let found = varied.estimate.parameter(&base.name, base.run.as_deref())?;
    let error =
        base.standard_error.filter(|_| varied.estimate.termination.is_good() && found.standard_error.is_some())?;
    Some((found.value - base.value) / error)
}
