//! The noise that fit and candidates together leave of a residual: spectrum and projection that belong together, with outliers cut
//! back.

use super::cells::{Cell, Cells};
use super::ends::with_ends;
use super::noise::{Left, LogSpectrum};
use super::projection::{Frame, left_over, leverage};
use super::repeats::turned;
use super::rest::{Outlier, Rest};
use super::shared::Shared;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Rounds of noise from residuals and projection by noise: with the shape inside cells that the residual has, and with that of what
/// is left of it.
const ROUNDS: [usize; 2] = [2, 2];
/// Lines of a cell below which it is taken to be fitted away.
const LEAST_FREEDOM: f64 = 0.2;
/// Lines of differences between runs by which alone an output's noise is judged.
const REFERENCE: usize = 100;
/// Times that outliers are looked for.
const CLIPS: usize = 3;

/// The noise that was found.
#[derive(Debug, Clone)]
pub(super) struct Noise {
    pub(super) cells: Cells,
    pub(super) spectra: Vec<LogSpectrum>,
    /// S of each cell.
    pub(super) density: Vec<f64>,
    /// What the projection leaves of each cell's lines.
    pub(super) freedom: Vec<f64>,
    /// Combinations of shared columns that are taken out of the residual, and what they are together.
    pub(super) taken: (DMatrix<f64>, DVector<f64>),
    /// Mean square of each output's residual.
    level: Vec<f64>,
}

impl Noise {
    pub(super) fn new(shared: &Shared) -> Self {
        let turned = turned(shared);
        let shared = turned.as_ref().unwrap_or(shared);
        let spectra = shared.spectra.clone();
        let cells = Cells::new(shared, &spectra);
        let level = levels(&cells);
        let density = densities(&cells, &spectra);
        let mut noise = Self { cells, spectra, density, freedom: Vec::new(), taken: Default::default(), level };
        noise.settle(shared, ROUNDS[0]);
        for rounds in &ROUNDS[1..] {
            noise.cells = Cells::new(shared, &noise.spectra);
            noise.density = densities(&noise.cells, &noise.spectra);
            noise.settle(shared, *rounds);
        }
        noise
    }

    fn settle(&mut self, shared: &Shared, rounds: usize) {
        for _ in 0..rounds {
            let frame = Frame::new(shared, &self.cells, &self.density);
            let held = frame.saturated();
            let basis = &frame.axes * &held;
            let multiples = &basis * held.tr_mul(&frame.residual(&self.cells, &self.density));
            let left: Vec<f64> = self.cells.list.par_iter().map(|cell| left_over(cell, &multiples)).collect();
            let own = self.cells.list.iter().zip(&self.density);
            let own: Vec<(&Cell, &f64)> = own.collect();
            self.freedom = own.par_iter().map(|(c, s)| (c.count as f64 - leverage(c, **s, &basis)).max(0.0)).collect();
            self.taken = (basis, multiples);
            self.spectra = self.fitted(&left);
            self.density = densities(&self.cells, &self.spectra);
        }
    }

    /// Spectra by what is left of a residual in each cell.
    pub(super) fn fitted(&self, left: &[f64]) -> Vec<LogSpectrum> {
        let of = |channel: usize| {
            let own = self.cells.list.iter().zip(left).zip(&self.freedom);
            // differences between runs know nothing of a misfit, even of one that no candidate explains
            let lines = |c: &Cell| if c.channel == channel && c.reference { c.count } else { 0 };
            let referred = self.cells.list.iter().map(lines).sum::<usize>() >= REFERENCE;
            let own = own.filter(|((cell, _), _)| cell.channel == channel);
            let left: Vec<Left> = own
                .map(|((cell, left), freedom)| {
                    // a cell that was fitted away says nothing about its noise, but has some
                    let told = (cell.reference || !referred) && *freedom > LEAST_FREEDOM;
                    let (power, freedom) = if told { (left / freedom, *freedom) } else { (1.0, 0.0) };
                    Left { log_frequency: cell.log_frequency, power, freedom }
                })
                .collect();
            LogSpectrum::fit(&left, self.level[channel])
        };
        (0..self.cells.channels).map(of).collect()
    }
}

/// The mean square of each output's residual.
fn levels(cells: &Cells) -> Vec<f64> {
    let mut sums = vec![(0.0, 0); cells.channels];
    for cell in &cells.list {
        sums[cell.channel].0 += cell.residual;
        sums[cell.channel].1 += cell.count;
    }
    sums.iter().map(|(sum, count)| if *count > 0 { sum / *count as f64 } else { 0.0 }).collect()
}

/// S of each cell.
pub(super) fn densities(cells: &Cells, spectra: &[LogSpectrum]) -> Vec<f64> {
    cells.list.iter().map(|cell| spectra[cell.channel].at(cell.log_frequency)).collect()
}

/// A residual without outliers, and its noise.
pub(super) struct Saturated {
    pub(super) shared: Shared,
    pub(super) noise: Noise,
    pub(super) outliers: Vec<Outlier>,
    pub(super) rest: Rest,
}

impl Saturated {
    pub(super) fn new(mut shared: Shared) -> Self {
        let mut noise = Noise::new(&shared);
        if let Some(grown) = with_ends(&shared, &noise.spectra) {
            shared = grown;
            shared.spectra = noise.spectra;
            noise = Noise::new(&shared);
        }
        let mut rest = Rest::new(&shared, &noise);
        let mut outliers: Vec<Outlier> = Vec::new();
        for _ in 0..CLIPS {
            let found = rest.clip(&mut shared);
            if found.is_empty() {
                break;
            }
            // what is cut back again has been told, and was larger
            let known = |o: &Outlier| (o.run, o.channel, o.place);
            let new: Vec<Outlier> =
                found.into_iter().filter(|new| outliers.iter().all(|old| known(old) != known(new))).collect();
            outliers.extend(new);
            shared.spectra = noise.spectra;
            noise = Noise::new(&shared);
            rest = Rest::new(&shared, &noise);
        }
        Self { shared, noise, outliers, rest }
    }
}
