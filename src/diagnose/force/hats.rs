//! A force's course as a sum of hat functions, and the responses to them at every place.

use super::driven::Driven;
use super::likelihood::Hats;
use super::place::{ForceError, Passage};
use super::sheet::{Cosines, Sheet};
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Fewest and most hats of a run.
const FEWEST: usize = 12;
const MOST: usize = 80;

/// The hats of one run.
#[derive(Debug, Clone)]
pub(super) struct Knots {
    /// Times of their tips since the run began, evenly spaced from its first to its last sample.
    pub(super) times: Vec<f64>,
    /// Lines of a response that can hold anything of them.
    low: usize,
    /// Time from tip to tip.
    spacing: f64,
}

impl Knots {
    /// Hats that follow a force up to twice this frequency.
    pub(super) fn new(sheet: &Sheet, band: f64) -> Self {
        let length = (sheet.samples - 1) as f64 * sheet.interval;
        let wanted = (length * 4.0 * band).ceil() as usize + 1;
        let count = wanted.clamp(FEWEST, MOST.min(sheet.samples / 3).max(FEWEST));
        let spacing = length / (count - 1) as f64;
        let times = (0..count).map(|k| k as f64 * spacing).collect();
        Self { times, low: sheet.below(1.0 / spacing), spacing }
    }

    /// Every hat at the samples.
    fn courses(&self, sheet: &Sheet) -> Vec<Vec<f64>> {
        let hat = |tip: &f64| {
            let at = |k: usize| (1.0 - (k as f64 * sheet.interval - tip).abs() / self.spacing).max(0.0);
            (0..sheet.samples).map(at).collect()
        };
        self.times.iter().map(hat).collect()
    }

    /// The courses (K) that a force of a memory has with unit variance each: cosines, the quick ones the smaller, the smaller
    /// the corner frequency; all alike where there is none.
    pub(super) fn root(&self, corner: Option<f64>) -> DMatrix<f64> {
        let count = self.times.len();
        let size = |mode: usize| {
            let frequency = mode as f64 / (2.0 * count as f64 * self.spacing);
            corner.map_or(1.0, |corner| (1.0 + (frequency / corner).powi(2)).powf(-0.5))
        };
        DMatrix::from_fn(count, count, |knot, mode| {
            let unit = if mode == 0 { 1.0 } else { 2.0_f64.sqrt() } / (count as f64).sqrt();
            unit * size(mode) * fdm_grammar::math::cos(PI * mode as f64 * (knot as f64 + 0.5) / count as f64)
        })
    }
}

/// The responses at every place (outermost) of every run.
pub(super) fn responses(
    driven: &Driven,
    places: usize,
    passages: &[Passage<'_>],
    sheets: &[Sheet],
    knots: &[Knots],
) -> Result<Vec<Vec<Hats>>, ForceError> {
    let runs: Vec<Result<Vec<Hats>, ForceError>> = (0..passages.len())
        .into_par_iter()
        .map(|run| {
            let (sheet, knots) = (&sheets[run], &knots[run]);
            let empty = vec![DMatrix::zeros(knots.low, knots.times.len()); sheet.channels()];
            let mut own = vec![empty; places];
            let mut cosines = Cosines::new(sheet.samples);
            driven.respond(run, passages[run], &knots.courses(sheet), &mut |place, hat, response| {
                for (channel, lines) in sheet.response(&mut cosines, &response, knots.low).into_iter().enumerate() {
                    own[place][channel].column_mut(hat).copy_from_slice(&lines);
                }
            })?;
            Ok(own)
        })
        .collect();
    let mut by_place = vec![Vec::with_capacity(passages.len()); places];
    for run in runs {
        by_place.iter_mut().zip(run?).for_each(|(list, own)| list.push(own));
    }
    Ok(by_place)
}
