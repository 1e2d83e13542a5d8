//! How far estimates can be trusted (Goodman and Sargent 1971, section III): estimates from records of different length, and
//! with other weights of the outputs. Parameters that settle as the record grows, and stay under other weights, deserve
//! confidence; those that wander do not.

use crate::estimation::ParameterEstimate;
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::{Fit, LengthFit, Reweighting, Variation, Weight};
use crate::methods::output_error::options::FitOptions;
use crate::methods::output_error::options::{Attempt, after};
use crate::problem::Options;
use crate::problem::noise::Noise;
use crate::recovery::continuation::Length;
use crate::recovery::fallback::refit;
use fdm_system::record::Run;
use serde::{Deserialize, Serialize};

/// Lengths that are fitted to see how the parameters settle.
const LENGTHS: usize = 10;

/// Fits a finished fit's model to shorter and shorter parts of its runs, each from the estimates of the one before; the
/// shortest comes first in what is given back. What is too short to determine anything is left out.
pub(crate) fn fit_shorter_records(fit: &Fit, attempt: &Attempt<'_>) -> Result<Vec<LengthFit>, FitError> {
    let Attempt { runs, starts, options, work, .. } = *attempt;
    let mut found = vec![LengthFit::new(runs, fit)];
    let mut starts = after(&fit.model, runs, &fit.estimate, starts);
    let inner = Options { colour: false, ..options.options.clone() };
    let options = &FitOptions { options: inner, ..options.clone() };
    for k in (1..LENGTHS).rev() {
        let parts = Length::Share(k as f64 / LENGTHS as f64).cut(runs);
        let cells = parts.iter().flat_map(|r| &r.measured).filter(|z| !z.is_nan()).count();
        if cells <= found[0].parameters.len() {
            break;
        }
        let shorter = refit(fit, &Attempt { runs: &parts, starts: &starts, options, ..*attempt })?;
        if work.stop_after(&shorter.estimate.termination).is_some() || shorter.estimate.cost.is_none() {
            break;
        }
        found.push(LengthFit::new(&parts, &shorter));
        // a part that went wrong is no start for a shorter one
        if shorter.estimate.is_good() {
            starts = after(&fit.model, &parts, &shorter.estimate, &starts);
        }
    }
    found.reverse();
    Ok(found)
}

/// How a parameter settles while the record grows.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct LengthSensitivity {
    /// Its name.
    pub name: String,
    /// Its run, when it has one.
    pub run: Option<String>,
    /// Its value from the whole record.
    pub value: f64,
    /// Its standard error from the whole record.
    pub standard_error: Option<f64>,
    /// Root mean square of what its value from shorter records differs from that of the whole, over the records from
    /// half the length on.
    pub wander: f64,
    /// `sqrt(wander^2 + standard_error^2)` relative to the value: the smaller, the more confidence it deserves. Infinite
    /// when the whole record does not determine it.
    pub doubt: f64,
}

/// Parameters in order of confidence, the surest first, from estimates by length of which the last is the whole record's.
///
/// A parameter that a shorter record does not determine, or whose fit went wrong there, counts as off by its own size.
pub fn by_confidence(lengths: &[LengthFit]) -> Vec<LengthSensitivity> {
    let Some((whole, shorter)) = lengths.split_last() else { return Vec::new() };
    let late: Vec<&LengthFit> = shorter.iter().filter(|l| l.length >= 0.5 * whole.length * (1.0 - 1e-9)).collect();
    let mut table: Vec<LengthSensitivity> = whole.parameters.iter().map(|p| settling(p, &late)).collect();
    table.sort_by(|a, b| a.doubt.total_cmp(&b.doubt));
    table
}

fn settling(whole: &ParameterEstimate, late: &[&LengthFit]) -> LengthSensitivity {
    let same = |p: &&ParameterEstimate| p.name == whole.name && p.run == whole.run;
    let off = |l: &&LengthFit| match l.parameters.iter().find(same) {
        Some(p) if l.termination.is_good() && p.standard_error.is_some() => p.value - whole.value,
        _ => whole.value,
    };
    let wander = (late.iter().map(|l| off(l).powi(2)).sum::<f64>() / late.len().max(1) as f64).sqrt();
    let doubt = whole.standard_error.map_or(f64::INFINITY, |s| wander.hypot(s) / whole.value.abs());
    LengthSensitivity {
        name: whole.name.clone(),
        run: whole.run.clone(),
        value: whole.value,
        standard_error: whole.standard_error,
        wander,
        doubt: if doubt.is_nan() { f64::INFINITY } else { doubt },
    }
}

/// Refits with the noise of each output halved and doubled, and each output left out. None when there is nothing to vary:
/// the fit went wrong, or its data have no noise.
pub(crate) fn refit_with_weights(fit: &Fit, attempt: &Attempt<'_>) -> Result<Option<Reweighting>, FitError> {
    let Attempt { runs, starts, options, .. } = *attempt;
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
    let with = |deviations: &[Option<f64>], runs: &[Run]| {
        let options = Options { noise: Noise::Given(deviations.to_vec()), colour: false, ..options.options.clone() };
        let options = &FitOptions { options, ..FitOptions::default() };
        refit(fit, &Attempt { runs, starts: &starts, options, ..*attempt })
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
            if termination.is_stopped() {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::Status;
    use crate::work::{Reason, Termination};

    fn parameter(name: &str, value: f64, error: Option<f64>) -> ParameterEstimate {
        ParameterEstimate {
            name: name.into(),
            run: None,
            value,
            standard_error: error,
            corrected_error: None,
            degrees_of_freedom: None,
            unit: None,
            status: Status::Estimated,
            start: None,
            lower: None,
            upper: None,
            limit: None,
            logarithmic: false,
        }
    }

    fn at(length: f64, values: [(f64, Option<f64>); 3]) -> LengthFit {
        let parameters = ["a", "b", "c"].iter().zip(values).map(|(n, (v, e))| parameter(n, v, e)).collect();
        LengthFit { length, samples: 10, termination: Termination::Converged(Reason::SmallStep), parameters }
    }

    #[test]
    fn what_settles_stands_before_what_wanders_and_what_is_not_determined_comes_last() {
        let lengths = [
            at(2.0, [(90.0, Some(1.0)), (2.0, Some(1.0)), (7.0, Some(1.0))]),
            at(5.0, [(1.3, Some(0.1)), (2.0, None), (5.0, None)]),
            at(7.5, [(1.4, Some(0.1)), (2.0, Some(0.1)), (5.0, None)]),
            at(10.0, [(1.0, Some(0.12)), (2.0, Some(0.1)), (5.0, None)]),
        ];
        let order = by_confidence(&lengths);
        assert_eq!(order.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["a", "b", "c"]);
        assert!((order[0].wander - (0.125f64).sqrt()).abs() < 1e-12, "the first length is too short to count");
        assert!((order[0].doubt - (0.125f64 + 0.0144).sqrt()).abs() < 1e-12);
        assert!(
            (order[1].wander - 2f64.sqrt()).abs() < 1e-12,
            "not determined at half the length: off by its own size"
        );
        assert_eq!(order[2].doubt, f64::INFINITY);
    }
}
