//! Standard errors for the noise that there really is: which sandwich that is follows from what the numbers of the runs are.

use super::coloured::corrected;
use super::sandwich::corrected_known;
use super::sandwich::{Corrected, Ended, Uncorrected};
use super::spectra::corrected_spectra;
use super::varying_noise::{allow, allow_spectra};
use crate::problem::{LimitedNoise, Numbers, Problem};
use crate::residuals::NoiseVariation;
use crate::work::Work;

/// The Cramer-Rao covariance of samples some of which are known by a limit alone, for the degrees of freedom that fitting took from the others.
fn of_values(ended: &Ended<'_>, limited: LimitedNoise) -> Corrected {
    let inverse = &ended.sandwich.bound.inverse;
    let (values, count) = (limited.values as f64, inverse.chosen.len());
    let left = values - count.saturating_sub(limited.params) as f64;
    if limited.params == 0 || left < 1.0 {
        return Corrected::of(inverse.values.clone());
    }
    let covariance = inverse.values.iter().map(|c| c * values / left).collect();
    Corrected { freedom: vec![left; count], ..Corrected::of(covariance) }
}

/// The corrected covariance, and whether the noise of each output is of one size, as far as that can be told.
///
/// # Errors
/// [`Uncorrected`] when that is not possible.
pub(crate) fn correct(
    problem: &mut Problem<'_>,
    ended: &Ended<'_>,
    work: &Work<'_>,
) -> Result<(Corrected, Vec<NoiseVariation>), Uncorrected> {
    if ended.sandwich.bound.inverse.chosen.is_empty() {
        // all at their bounds, or without any effect
        return Err(Uncorrected::NoDegreesOfFreedom);
    }
    if let Some(limited) = problem.limited {
        // the colour of what is left of the noise is not that of the noise
        return Ok((of_values(ended, limited), Vec::new()));
    }
    match problem.numbers() {
        Numbers::KnownNoise => Ok((corrected_known(problem, ended)?, Vec::new())),
        Numbers::Coefficients => {
            let mut own = corrected_spectra(problem, ended)?;
            let variation = match ended.good && work.goes_on() {
                true => allow_spectra(problem, ended, &mut own)?,
                false => Vec::new(),
            };
            Ok((own, variation))
        }
        Numbers::Standardised => Ok((corrected(problem, ended)?.0, Vec::new())),
        Numbers::InTime => {
            let (mut own, rows) = corrected(problem, ended)?;
            let variation = allow(problem, ended, &rows, &mut own)?;
            Ok((own, variation))
        }
    }
}
