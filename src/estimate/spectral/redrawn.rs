//! Records as they would be with other noise, where records stand in the equations.
//!
//! A nonlinear term that is carried in is computed from measured records: their noise is in the output and in what moves the model, and both move the
//! estimates. Noise of the size that the residuals show is added to the records; what that does to outputs and to the response is kept apart. Recorded
//! inputs of which the noise is known are drawn likewise.

use super::fault::SpectralError;
use super::options::SpectralOptions;
use super::setting::{Setting, samples, spectra};
use super::weights::{scaled, weight};
use crate::estimate::problem::{CarriedNoise, NoiseShift, Response};
use crate::record::Run;
use crate::spectrum::{Frequencies, Spectrum};
use fdm_grammar::diagnostic::nearest;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use statrs::distribution::{ContinuousCDF, Normal};
use std::f64::consts::TAU;

/// Times that the noise of an output is drawn.
const DRAWS: usize = 10;

/// The records of a setting, to be drawn again.
pub(super) struct Redrawn<'s> {
    setting: &'s Setting,
    /// As they were measured.
    runs: &'s [Run],
    options: &'s SpectralOptions,
    /// Inputs whose noise is known, and its deviation.
    inputs: Vec<(Source, f64)>,
}

impl<'s> Redrawn<'s> {
    /// None where nothing but what is compared has noise.
    ///
    /// # Errors
    /// [`SpectralError::UnknownInput`], [`SpectralError::NotADeviation`].
    pub(super) fn new(
        setting: &'s Setting,
        runs: &'s [Run],
        options: &'s SpectralOptions,
    ) -> Result<Option<Self>, SpectralError> {
        let names: Vec<&str> = setting.model.definition().inputs.iter().map(|i| i.quantity.name.as_str()).collect();
        let known = |(name, deviation): &(String, f64)| {
            if !(deviation.is_finite() && *deviation >= 0.0) {
                return Err(SpectralError::NotADeviation { input: name.clone(), deviation: *deviation });
            }
            let found = names.iter().position(|own| own == name).ok_or_else(|| SpectralError::UnknownInput {
                name: name.clone(),
                nearest: nearest(name, names.iter().copied()).map(String::from),
            })?;
            Ok((Source::Input(found), *deviation))
        };
        let inputs: Vec<(Source, f64)> = options.input_noise.iter().map(known).collect::<Result<_, _>>()?;
        let silent = setting.carried.is_empty() && inputs.iter().all(|(_, deviation)| *deviation == 0.0);
        Ok((!silent).then_some(Self { setting, runs, options, inputs }))
    }
}

impl CarriedNoise for Redrawn<'_> {
    fn shifts(&self, run: usize, theta: &[f64], covariance: &[f64]) -> Option<Vec<Vec<NoiseShift>>> {
        let q = self.setting.linear.structure().outputs;
        let longest = self.setting.spectra.iter().map(|s| s.samples).max().unwrap_or(1) as f64;
        // a coefficient's real part has the variance of a sample over twice their number
        let of_output = |o: usize| (Source::Output(o), (2.0 * longest * covariance[o * q + o]).sqrt());
        let base = self.answer(&self.setting.weighted[run], theta).ok()??;
        let sources = (0..q).map(of_output).chain(self.inputs.iter().copied());
        sources.enumerate().map(|(k, source)| self.drawn(run, theta, (k, source), &base).ok()).collect()
    }
}

/// A record whose noise is drawn.
#[derive(Debug, Clone, Copy)]
enum Source {
    /// One that is compared.
    Output(usize),
    /// One that moves the model.
    Input(usize),
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

    /// Draws of the noise of one record, the k-th.
    fn drawn(
        &self,
        run: usize,
        theta: &[f64],
        (k, (source, deviation)): (usize, (Source, f64)),
        (measured, answered): &Answer,
    ) -> Result<Vec<NoiseShift>, SpectralError> {
        let setting = self.setting;
        let frequencies = Frequencies::List(setting.weighted[run].omega.iter().map(|w| w / TAU).collect());
        let options = SpectralOptions { frequencies, ..self.options.clone() };
        let (law, q) = (Normal::standard(), setting.linear.structure().outputs);
        let sources = q + self.inputs.len();
        let mut shifts = Vec::with_capacity(DRAWS);
        for draw in 0..DRAWS {
            let mut chance = ChaCha8Rng::seed_from_u64(((run * sources + k) * DRAWS + draw) as u64);
            let mut noisy = self.runs[run].clone();
            let samples = match source {
                Source::Output(o) => noisy.measured.iter_mut().skip(o).step_by(q),
                Source::Input(i) => noisy.inputs.iter_mut().skip(i).step_by(self.runs[run].held.len()),
            };
            // not at the ends of the interval, where the normal law ends nowhere
            samples.for_each(|v| *v += deviation * law.inverse_cdf(chance.random::<f64>().clamp(1e-12, 1.0 - 1e-12)));
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
