//! The noise that fit and candidates leave of a residual: spectrum and projection that belong together, with outliers cut back. A first
//! spectrum is what all candidates together leave, whatever is missing; by it the residual is asked which of them it follows, and only these
//! are taken out.
//!
//! What a resonance leaves where a record begins and ends.
//!
//! A wave of x'' + 2 d x' + w^2 x = noise is cut off at both ends. In the cosine transform over [0, T] the noise then has company: x'(0) +
//! 2 d x(0), and the same of the end with a sign that changes from bin to bin (integration by parts). Both pass through the
//! resonance as the noise does, so that beside each bin's own chance all bins below the resonance have a common one, and those above
//! it the opposite. In units of the noise these are two known columns for each run and output, whose multiples nobody knows: they are
//! fitted.
//!
//! Runs that repeat each other: what differs between them is noise, whatever the model gets wrong.
//!
//! Runs with equal directions are turned, by a rotation, into their mean (times the root of their number) and differences.
//! A rotation leaves noise as it is; the effects are all in the mean, and the differences tell the noise's spectrum without
//! a projection and without a part of the lack of fit in it. A record of several periods is such a set of runs when it is cut into
//! periods.

use super::bands::{Band, Bands};
use super::basis::{Basis, OutputPart};
use super::projection::{Frame, leverage, remainder};
use crate::noise::{LogSpectrum, ResidualPower};
use fdm_numeric::parallel;
use fdm_numeric::random::mixed;
use nalgebra::{DMatrix, DVector};

/// Rounds of noise from residuals and projection by noise: without all that candidates explain, with the shape inside bands that the residual
/// has; and without what the residual follows, with the shape of what is left of it.
const ROUNDS: [usize; 2] = [2, 3];
/// Bins of a band below which it is taken to be fitted away.
const LEAST_FREEDOM: f64 = 0.2;
/// Bins of differences between runs by which alone an output's noise is judged.
const REFERENCE: usize = 100;

/// The noise that was found.
#[derive(Debug, Clone)]
pub(super) struct Noise {
    pub(super) bands: Bands,
    pub(super) spectra: Vec<LogSpectrum>,
    /// S of each band.
    pub(super) density: Vec<f64>,
    /// Combinations of shared columns that are taken out of the residual, and what they are together.
    pub(super) taken: (DMatrix<f64>, DVector<f64>),
    /// Mean square of each output's residual.
    level: Vec<f64>,
}

impl Noise {
    pub(super) fn new(shared: &Basis) -> Self {
        let turned = turned(shared);
        let shared = turned.as_ref().unwrap_or(shared);
        let spectra = shared.spectra.clone();
        let bands = Bands::new(shared, &spectra, false);
        let level = levels(&bands);
        let density = densities(&bands, &spectra);
        let mut noise = Self { bands, spectra, density, taken: Default::default(), level };
        for _ in 0..ROUNDS[0] {
            let frame = Frame::new(shared, &noise.bands, &noise.density);
            let held = frame.saturated(noise.bands.bins());
            noise.renew(&frame, &held, noise.density.clone());
        }
        noise.bands = Bands::new(shared, &noise.spectra, true);
        for _ in 0..ROUNDS[1] {
            let density = likeliest(&noise.bands, &noise.spectra);
            let frame = Frame::new(shared, &noise.bands, &density);
            let residual = frame.residual(&noise.bands, &density);
            let rest = residual.rows(frame.absorbed, frame.directions.nrows()).into_owned();
            let held = frame.beside_fit(&frame.pursuit(noise.bands.bins()).of(&rest));
            noise.renew(&frame, &held, density);
        }
        noise
    }

    /// By what is left without these combinations (d by k) of the axes of a frame, which is that of a density.
    fn renew(&mut self, frame: &Frame, held: &DMatrix<f64>, density: Vec<f64>) {
        let basis = &frame.axes * held;
        let multiples = &basis * held.tr_mul(&frame.residual(&self.bands, &density));
        let left: Vec<f64> = parallel::map(self.bands.list.iter(), |band| remainder(band, &multiples));
        let own: Vec<(&Band, &f64)> = self.bands.list.iter().zip(&density).collect();
        let combinations = basis.transpose();
        let freedom: Vec<f64> =
            parallel::map(own.iter(), |(c, s)| (c.count as f64 - leverage(c, **s, &combinations)).max(0.0));
        self.taken = (basis, multiples);
        self.spectra = self.fitted(&left, &freedom, None);
        self.density = densities(&self.bands, &self.spectra);
    }

    /// Spectra by what is left of a residual in each band, and of its bins; these may be like those.
    pub(super) fn fitted(&self, left: &[f64], freedom: &[f64], like: Option<&[LogSpectrum]>) -> Vec<LogSpectrum> {
        let of = |channel: usize| {
            let own = self.bands.list.iter().zip(left).zip(freedom);
            // differences between runs know nothing of a lack of fit, even of one that no candidate explains
            let bins = |c: &Band| if c.channel == channel && c.reference { c.count } else { 0 };
            let referred = self.bands.list.iter().map(bins).sum::<usize>() >= REFERENCE;
            let own = own.filter(|((band, _), _)| band.channel == channel);
            let left: Vec<ResidualPower> = own
                .map(|((band, left), freedom)| {
                    // a band that was fitted away says nothing about its noise, but has some
                    let told = (band.reference || !referred) && *freedom > LEAST_FREEDOM;
                    let (power, freedom) = if told { (left / freedom, *freedom) } else { (1.0, 0.0) };
                    ResidualPower { log_frequency: band.log_frequency, power, freedom }
                })
                .collect();
            LogSpectrum::of_bands((&left, self.level[channel]), self.bands.narrow, like.map(|like| &like[channel]))
        };
        parallel::map(0..self.bands.channels, of)
    }
}

/// The mean square of each output's residual.
fn levels(bands: &Bands) -> Vec<f64> {
    let mut sums = vec![(0.0, 0); bands.channels];
    for band in &bands.list {
        sums[band.channel].0 += band.residual;
        sums[band.channel].1 += band.count;
    }
    sums.iter().map(|(sum, count)| if *count > 0 { sum / *count as f64 } else { 0.0 }).collect()
}

/// S of each band, as far as it is believed.
pub(super) fn densities(bands: &Bands, spectra: &[LogSpectrum]) -> Vec<f64> {
    bands.list.iter().map(|band| spectra[band.channel].inflated(band.log_frequency)).collect()
}

/// S of each band, however little is known of it: by this it is judged what a residual follows. Where there are several
/// runs it is without a word of their means: such that are off for want of an effect would be called noise that
/// wanders, and no offset be followed by them. One mean alone may be slow noise as well.
pub(super) fn likeliest(bands: &Bands, spectra: &[LogSpectrum]) -> Vec<f64> {
    let of = |band: &Band| {
        let (spectrum, several) = (&spectra[band.channel], band.count > 1);
        if several { spectrum.without_means_at(band.log_frequency) } else { spectrum.at(band.log_frequency) }
    };
    bands.list.iter().map(of).collect()
}

/// How far a resonance stands out of what is beside it, in log S.
pub(super) const PROMINENT: f64 = 1.5;

/// The basis with columns for the ends of all records in whose noise there is a resonance; none where there is none.
pub(super) fn with_ends(shared: &Basis, spectra: &[LogSpectrum]) -> Option<Basis> {
    let peaks: Vec<Option<f64>> = spectra.iter().map(|s| s.peak(PROMINENT)).collect();
    let cut = |part: &OutputPart| part.sampled && peaks[part.channel].is_some();
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

/// Beginning and end, bins by two.
fn columns(part: &OutputPart, spectrum: &LogSpectrum, peak: f64) -> DMatrix<f64> {
    let (count, dropped) = (part.frequency.len(), part.samples.len() - part.frequency.len());
    DMatrix::from_fn(count, 2, |i, end| {
        let log = part.frequency[i].ln();
        let sign = if (log < peak) == (end == 0 || (i + dropped).is_multiple_of(2)) { 1.0 } else { -1.0 };
        sign * (spectrum.at(log) / count as f64).sqrt()
    })
}

/// Directions of equal runs differ by less than this share of their energy (inputs may be measured ones).
const EQUAL: f64 = 1e-3;
/// Sums of directions by which runs are compared.
const PROBES: usize = 6;

/// The bins with repeated runs turned; `None` where no run repeats another.
pub(super) fn turned(shared: &Basis) -> Option<Basis> {
    let groups = groups(shared);
    if groups.iter().all(|g| g.len() < 2) {
        return None;
    }
    let mut turned = shared.clone();
    for group in groups.iter().filter(|g| g.len() > 1) {
        for channel in 0..shared.channels {
            let place = |run: &usize| shared.parts.iter().position(|p| p.run == *run && p.channel == channel);
            let places: Vec<usize> = group.iter().filter_map(place).collect();
            turn(&mut turned.parts, &places);
        }
    }
    Some(turned)
}

/// Mean first, then each run against the mean of those before it (Helmert).
fn turn(parts: &mut [OutputPart], places: &[usize]) {
    let own: Vec<(DMatrix<f64>, DVector<f64>)> =
        places.iter().map(|k| (parts[*k].basis.clone(), parts[*k].residual.clone())).collect();
    let count = own.len();
    for (row, place) in places.iter().enumerate() {
        let weight = |j: usize| match (row, j) {
            (0, _) => (count as f64).sqrt().recip(),
            (_, j) if j < row => ((row * (row + 1)) as f64).sqrt().recip(),
            (_, j) if j == row => -(row as f64) / ((row * (row + 1)) as f64).sqrt(),
            _ => 0.0,
        };
        let part = &mut parts[*place];
        part.basis.fill(0.0);
        part.residual.fill(0.0);
        for (j, (basis, residual)) in own.iter().enumerate() {
            part.basis.zip_apply(basis, |sum, value| *sum += weight(j) * value);
            part.residual.axpy(weight(j), residual, 1.0);
        }
        part.reference = row > 0;
    }
}

/// Runs that have equal directions, in the order of their first.
fn groups(shared: &Basis) -> Vec<Vec<usize>> {
    let mut runs: Vec<usize> = shared.parts.iter().map(|p| p.run).collect();
    runs.dedup();
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let probes = probes(shared);
    for run in runs {
        match groups.iter_mut().find(|group| equal(shared, &probes, group[0], run)) {
            Some(group) => group.push(run),
            None => groups.push(vec![run]),
        }
    }
    groups
}

fn equal(shared: &Basis, probes: &DMatrix<f64>, a: usize, b: usize) -> bool {
    let of = |run: usize| shared.parts.iter().filter(move |p| p.run == run);
    if of(a).count() != of(b).count() {
        return false;
    }
    let (mut apart, mut energy) = (0.0, 0.0);
    for (a, b) in of(a).zip(of(b)) {
        if a.channel != b.channel || a.samples != b.samples || a.frequency != b.frequency {
            return false;
        }
        let (a, b) = (&a.basis * probes, &b.basis * probes);
        apart += (&a - b).norm_squared();
        energy += a.norm_squared();
    }
    apart < EQUAL * energy
}

/// Sums of all directions, each of unit energy, with signs: the energy of such a sum is on average that of all of them.
fn probes(shared: &Basis) -> DMatrix<f64> {
    let signs =
        DMatrix::from_fn(
            shared.unit.ncols(),
            PROBES,
            |i, k| {
                if mixed((i * PROBES + k) as u64) & 1 == 0 { 1.0 } else { -1.0 }
            },
        );
    &shared.unit * signs
}
