//! Records as they would be with other noise, where records stand in the equations.
//!
//! A nonlinear term that is carried in is computed from measured records: their noise is in the output and in what moves the model, and both move the
//! estimates. Noise of the size that the residuals show is added to the records; what that does to outputs and to the response is kept apart.

use super::fault::SpectralError;
use super::options::SpectralOptions;
use super::setting::{Setting, samples, spectra};
use super::weights::{scaled, weight};
use crate::estimate::problem::{CarriedNoise, NoiseShift, Response};
use crate::record::Run;
use crate::spectrum::{Frequencies, Spectrum};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use statrs::distribution::{ContinuousCDF, Normal};
use std::f64::consts::TAU;

/// Times that the noise of an output is drawn.
const DRAWS: usize = 10;

/// The records of a setting, to be drawn again.
pub(super) struct Redrawn<'s> {
    pub(super) setting: &'s Setting,
    /// As they were measured.
    pub(super) runs: &'s [Run],
    pub(super) options: &'s SpectralOptions,
}

impl CarriedNoise for Redrawn<'_> {
    fn shifts(&self, run: usize, theta: &[f64], covariance: &[f64]) -> Option<Vec<Vec<NoiseShift>>> {
        let q = self.setting.linear.structure().outputs;
        let longest = self.setting.spectra.iter().map(|s| s.samples).max().unwrap_or(1) as f64;
        // a coefficient's real part has the variance of a sample over twice their number
        let deviation = |o: usize| (2.0 * longest * covariance[o * q + o]).sqrt();
        let base = self.answer(&self.setting.weighted[run], theta).ok()??;
        (0..q).map(|o| self.drawn(run, theta, (o, deviation(o)), &base).ok()).collect()
    }
}

/// Measured coefficients and those of the model (2 M by q).
type Answer = (Vec<f64>, Vec<f64>);

impl Redrawn<'_> {
    /// None where the model does not answer.
    fn answer(&self, spectrum: &Spectrum, theta: &[f64]) -> Result<Option<Answer>, SpectralError> {
        let mut response = self.setting.response(spectrum)?;
        let mut y = vec![0.0; response.samples() * response.outputs()];
        let done = response.simulate(theta, &mut y);
        Ok(done.is_ok().then_some((samples(spectrum), y)))
    }

    /// Draws of the noise of one output.
    fn drawn(
        &self,
        run: usize,
        theta: &[f64],
        (output, deviation): (usize, f64),
        (measured, answered): &Answer,
    ) -> Result<Vec<NoiseShift>, SpectralError> {
        let setting = self.setting;
        let frequencies = Frequencies::List(setting.weighted[run].omega.iter().map(|w| w / TAU).collect());
        let options = SpectralOptions { frequencies, ..self.options.clone() };
        let (law, q) = (Normal::standard(), setting.linear.structure().outputs);
        let mut shifts = Vec::with_capacity(DRAWS);
        for draw in 0..DRAWS {
            let mut chance = ChaCha8Rng::seed_from_u64(((run * q + output) * DRAWS + draw) as u64);
            let mut noisy = self.runs[run].clone();
            for v in noisy.measured.iter_mut().skip(output).step_by(q) {
                // not at the ends of the interval, where the normal law ends nowhere
                *v += deviation * law.inverse_cdf(chance.random::<f64>().clamp(1e-12, 1.0 - 1e-12));
            }
            let noisy = noisy.with_measured(setting.model.definition()).map_err(SpectralError::Incomplete)?;
            let drawn = spectra(&setting.model, &[noisy], &options)?;
            let drawn = scaled(&drawn[0], weight(&setting.spectra, run));
            let Some((z, y)) = self.answer(&drawn, theta)? else { continue };
            let difference = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
            let shift = NoiseShift { seen: difference(&z, measured), carried: difference(answered, &y) };
            shifts.push(shift);
        }
        Ok(shifts)
    }
}
