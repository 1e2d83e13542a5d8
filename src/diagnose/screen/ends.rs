//! What a resonance leaves where a record begins and ends.
//!
//! A wave of x'' + 2 d x' + w^2 x = noise is cut off at both ends. In the cosine transform over [0, T] the noise then has company: x'(0) +
//! 2 d x(0), and the same of the end with a sign that changes from line to line (integration by parts). Both pass through the
//! resonance as the noise does, so that beside each line's own chance all lines below the resonance have a common one, and those above
//! it the opposite. In units of the noise these are two known columns for each run and output, whose multiples nobody knows: they are
//! fitted.

use super::noise::LogSpectrum;
use super::shared::{Part, Shared};
use nalgebra::DMatrix;

/// How far a resonance stands out of what is beside it, in log S.
const PROMINENT: f64 = 1.5;

/// The same with columns for the ends of all records in whose noise there is a resonance; none where there is none.
pub(super) fn with_ends(shared: &Shared, spectra: &[LogSpectrum]) -> Option<Shared> {
    let peaks: Vec<Option<f64>> = spectra.iter().map(|s| s.peak(PROMINENT)).collect();
    let cut = |part: &Part| part.sampled && peaks[part.channel].is_some();
    let resonant: Vec<usize> = (0..shared.parts.len()).filter(|k| cut(&shared.parts[*k])).collect();
    if resonant.is_empty() {
        return None;
    }
    let (width, added, fitted) = (shared.width(), 2 * resonant.len(), shared.fitted.ncols());
    let mut grown = shared.clone();
    grown.ends += added;
    for matrix in [&mut grown.fitted, &mut grown.directions, &mut grown.unit] {
        *matrix = std::mem::take(matrix).resize_vertically(width + added, 0.0);
    }
    grown.fitted = grown.fitted.resize_horizontally(fitted + added, 0.0);
    (0..added).for_each(|k| grown.fitted[(width + k, fitted + k)] = 1.0);
    for (k, part) in grown.parts.iter_mut().enumerate() {
        part.basis = std::mem::take(&mut part.basis).resize_horizontally(width + added, 0.0);
        let place = resonant.iter().position(|own| *own == k);
        if let Some((place, peak)) = place.zip(peaks[part.channel]) {
            let own = columns(part, &spectra[part.channel], peak);
            part.basis.columns_mut(width + 2 * place, 2).copy_from(&own);
        }
    }
    Some(grown)
}

/// Beginning and end, lines by two.
fn columns(part: &Part, spectrum: &LogSpectrum, peak: f64) -> DMatrix<f64> {
    let (count, dropped) = (part.frequency.len(), part.samples.len() - part.frequency.len());
    DMatrix::from_fn(count, 2, |i, end| {
        let log = part.frequency[i].ln();
        let sign = if (log < peak) == (end == 0 || (i + dropped).is_multiple_of(2)) { 1.0 } else { -1.0 };
        sign * (spectrum.at(log) / count as f64).sqrt()
    })
}
