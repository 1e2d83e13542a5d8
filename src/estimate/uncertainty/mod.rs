//! What is known about the estimates: covariance, standard errors, intervals, and what the data do not determine.
//!
//! **In** the quadratic and the residuals at the end of an iteration. **Out** Cramer-Rao bounds ([`cramer_rao`]), directions that are not identifiable
//! ([`identifiability`]), covariances corrected for the noise as it really is, known beforehand or not ([`sandwich`], chosen in [`correction`]): coloured in long runs ([`coloured`]), averaged
//! over noise models in short ones ([`model_averaged`]), beside parameters at their bounds ([`bounds`]), in spectra ([`spectra`], with noise in measured regressors,
//! whose bias is removed, and a test of their colour in [`spectral_colour`]), of a size that varies ([`varying_noise`]); intervals that the likelihood contradicts ([`curvature`]); and the table of
//! the parameters ([`parameters`]).

pub(super) mod bounds;
mod coloured;
#[cfg(test)]
mod coloured_tests;
pub(super) mod correction;
pub(super) mod cramer_rao;
pub(super) mod curvature;
mod flicker;
pub(super) mod identifiability;
pub(super) mod information;
mod measured_regressors;
mod model_averaged;
mod noise_candidates;
pub(super) mod parameters;
#[cfg(test)]
mod prior_tests;
mod restricted_likelihood;
pub(super) mod sandwich;
pub(super) mod sensitivity_rows;
mod spectra;
pub(super) mod spectral_colour;
mod spectral_rows;
mod varying_noise;
#[cfg(test)]
mod varying_noise_tests;
