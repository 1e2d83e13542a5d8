//! Standard errors for the noise that there really is: which sandwich that is follows from what the numbers of the runs are.

use super::coloured::corrected;
use super::known_noise::corrected_known;
use super::sandwich::{Corrected, Sandwich, Uncorrected};
use super::spectra::corrected_spectra;
use super::varying_noise::{allow, allow_spectra};
use crate::iteration::priors::Priors;
use crate::problem::{Numbers, Problem};
use crate::residuals::NoiseVariation;
use crate::work::Work;

/// An estimation that has ended.
pub(crate) struct Ended<'e> {
    /// All unknowns.
    pub(crate) values: &'e [f64],
    /// The responses of all runs to them (N by q each).
    pub(crate) responses: &'e [Vec<f64>],
    pub(crate) priors: &'e Priors,
    /// Whether it ended at a minimum.
    pub(crate) good: bool,
}

/// The corrected covariance, and whether the noise of each output is of one size, as far as that can be told.
///
/// # Errors
/// [`Uncorrected`] when that is not possible.
pub(crate) fn correct(
    problem: &mut Problem<'_>,
    sandwich: &Sandwich<'_>,
    ended: &Ended<'_>,
    work: &Work<'_>,
) -> Result<(Corrected, Vec<NoiseVariation>), Uncorrected> {
    let Sandwich { unknowns, bound } = *sandwich;
    let Ended { values, responses, .. } = *ended;
    let priors = || ended.priors.rows(values);
    match problem.numbers() {
        Numbers::KnownNoise => Ok((corrected_known(problem, unknowns, values, bound, priors())?, Vec::new())),
        Numbers::Coefficients => {
            let mut own = corrected_spectra(problem, unknowns, values, bound, priors())?;
            let variation = match ended.good && work.goes_on() {
                true => allow_spectra(problem, unknowns, values, bound, &mut own)?,
                false => Vec::new(),
            };
            Ok((own, variation))
        }
        Numbers::Standardised => Ok((corrected(problem, unknowns, values, bound, priors())?.0, Vec::new())),
        Numbers::InTime => {
            let (mut own, rows) = corrected(problem, unknowns, values, bound, priors())?;
            let variation = allow(problem, responses, &rows, sandwich, priors(), &mut own)?;
            Ok((own, variation))
        }
    }
}
