//! Spectra of records of unequal length on one footing.
//!
//! A coefficient of noise has a variance in inverse proportion to the length of the record. Scaled by the root of their length the
//! coefficients of all runs have the noise of one spectral density, which is what the likelihood is about; the response is linear in inputs and
//! end values and is scaled with them.

use crate::spectrum::Spectrum;

/// Spectra scaled by the root of their duration over that of the longest.
pub(super) fn on_one_footing(spectra: &[Spectrum]) -> Vec<Spectrum> {
    let longest = spectra.iter().map(Spectrum::duration).fold(0.0, f64::max);
    spectra.iter().map(|s| scaled(s, (s.duration() / longest).sqrt())).collect()
}

/// The factor by which a spectrum was scaled among others.
pub(super) fn weight(spectra: &[Spectrum], run: usize) -> f64 {
    let longest = spectra.iter().map(Spectrum::duration).fold(0.0, f64::max);
    (spectra[run].duration() / longest).sqrt()
}

/// A spectrum times a number.
pub(super) fn scaled(spectrum: &Spectrum, factor: f64) -> Spectrum {
    let mut scaled = spectrum.clone();
    if factor != 1.0 {
        let coefficients = [&mut scaled.inputs, &mut scaled.sampled_inputs, &mut scaled.outputs];
        coefficients.into_iter().flatten().for_each(|v| *v *= factor);
        let ends = scaled.input_ends.iter_mut().chain(&mut scaled.output_ends);
        ends.flatten().chain(&mut scaled.input_samples).chain(&mut scaled.input_before).for_each(|v| *v *= factor);
    }
    scaled
}
