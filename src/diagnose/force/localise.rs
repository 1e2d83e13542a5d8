//! At which place an unknown force explains the residuals best, and what its course was.

use super::driven::Driven;
use super::ground::Ground;
use super::hats::{Knots, responses};
use super::likelihood::{Hats, Settled, course, settle};
use super::place::{ForceError, Kind, Passage, Place, places};
use super::sheet::Sheet;
use super::spectra::Spectra;
use super::spectrum::SmoothSpectrum;
use super::standing::rank;
use crate::model::Model;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::Serialize;

/// What the strength and the memory of a force cost in log-likelihood.
const PRICE: f64 = 2.0;
/// The corner of a force with a memory, as a part of the band.
const CORNER: f64 = 1.0 / 16.0;
/// Evidence above which a force is there: odds of 20 to 1.
pub(super) const CLEAR: f64 = 3.0;

/// One ordinate of a reconstructed force.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Ordinate {
    /// Time since the run began.
    pub time: f64,
    /// The force: what is added to the input, or to the rate of the state.
    pub value: f64,
    /// Its standard deviation.
    pub deviation: f64,
}

/// What the residuals say about one place.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Site {
    /// The place.
    pub place: Place,
    /// For inputs and equations: logarithm of the odds of a random force here, beside noise of any smooth spectrum in every
    /// output, against such noise alone. For outputs: of coloured noise against white noise.
    pub evidence: f64,
    /// Standard deviation of the force at a typical time; 0 for outputs.
    pub size: f64,
    /// The force's course in every run; empty for outputs, and where there is no force.
    pub course: Vec<Vec<Ordinate>>,
}

/// Where an unknown force enters.
#[derive(Debug, Clone, PartialEq)]
pub struct Localisation {
    /// Inputs and equations, the likeliest first; an equation before an input that moves it where both are as likely.
    pub forces: Vec<Site>,
    /// Outputs, the most coloured first.
    pub sensors: Vec<Site>,
    /// Logarithm of the likelihood of the residuals when all of them are noise of smooth spectra, less what the spectra
    /// cost: comparable between models that were fitted to the same runs.
    pub noise_alone: f64,
    /// The same with the best force in it, less its cost; that of noise alone when no force is better.
    pub with_force: f64,
    /// Spectrum of each output's noise when there is no force.
    pub spectra: Vec<SmoothSpectrum>,
    /// The frequency up to which forces were followed.
    pub band: f64,
}

impl Localisation {
    /// Evidence of the best place; 0 where there is none.
    pub fn evidence(&self) -> f64 {
        self.forces.iter().map(|s| s.evidence).reduce(f64::max).unwrap_or(0.0)
    }

    /// The places that these data cannot tell from the best one.
    pub fn group(&self) -> impl Iterator<Item = &Site> {
        let least = self.evidence() - CLEAR;
        self.forces.iter().filter(move |s| s.evidence > 0.0 && s.evidence >= least)
    }
}

/// Asks every input and every equation that left something to be found.
pub(super) fn localise(model: &Model, passages: &[Passage<'_>], ground: &Ground) -> Result<Localisation, ForceError> {
    let (sheets, null) = ground.independent();
    let band = ground.band;
    let places = places(model);
    let driven = Driven::new(model, &places);
    let knots: Vec<Knots> = sheets.iter().map(|s| Knots::new(s, band)).collect();
    let hats = responses(&driven, places.len(), passages, sheets, &knots)?;
    let tried: Vec<Tried> = hats.par_iter().map(|own| Tried::best(sheets, &knots, own, null, band)).collect();
    // noise alone may begin where any force has left it
    let null = tried
        .iter()
        .map(|t| settle(sheets, None, &t.settled.spectra))
        .fold(null.clone(), |best, other| if other.score > best.score { other } else { best });
    let mut forces: Vec<(Site, f64)> = places
        .into_iter()
        .zip(&tried)
        .map(|(place, tried)| {
            let evidence = tried.settled.score - PRICE - null.score;
            let site = Site { place, evidence, size: tried.size(&knots), course: tried.course(sheets, &knots) };
            (site, tried.settled.profile - PRICE)
        })
        .collect();
    rank(model, &mut forces, |(site, _)| (&site.place, site.evidence));
    let with_force = forces.first().filter(|f| f.0.evidence > 0.0).map_or(null.profile, |f| f.1);
    Ok(Localisation {
        with_force: ground.measured(with_force),
        forces: forces.into_iter().map(|(site, _)| site).collect(),
        sensors: sensors(model, &ground.noise),
        noise_alone: ground.measured(null.profile),
        spectra: ground.noise.spectra.channels.clone(),
        band,
    })
}

fn sensors(model: &Model, null: &Settled) -> Vec<Site> {
    let outputs = model.definition().outputs.iter().enumerate();
    let mut sensors: Vec<Site> = outputs
        .zip(&null.spectra.coloured)
        .map(|((index, output), evidence)| Site {
            place: Place { kind: Kind::Output, index, name: output.quantity.name.clone() },
            evidence: *evidence,
            size: 0.0,
            course: Vec::new(),
        })
        .collect();
    sensors.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    sensors
}

/// The best force at one place.
struct Tried {
    settled: Settled,
    /// Responses to courses of unit variance.
    hats: Vec<Hats>,
    corner: Option<f64>,
}

impl Tried {
    fn best(sheets: &[Sheet], knots: &[Knots], hats: &[Hats], null: &Settled, band: f64) -> Self {
        let floor = Spectra::floor(sheets);
        let mut best: Option<Self> = None;
        for corner in [None, Some(CORNER * band)] {
            let turned: Vec<Hats> = hats
                .iter()
                .zip(knots)
                .map(|(own, knots)| {
                    let root = knots.root(corner);
                    own.iter().map(|channel| channel * &root).collect()
                })
                .collect();
            // noise alone may have taken for noise what a force did, and the floor may be too low
            for start in [&floor, &null.spectra] {
                let settled = settle(sheets, Some(&turned), start);
                if best.as_ref().is_none_or(|b| settled.score > b.settled.score) {
                    best = Some(Self { settled, hats: turned.clone(), corner });
                }
            }
        }
        // the first corner always gives one
        best.unwrap_or_else(|| Self { settled: null.clone(), hats: hats.to_vec(), corner: None })
    }

    /// Root mean square of the force that its strength stands for.
    fn size(&self, knots: &[Knots]) -> f64 {
        let variance = |knots: &Knots| {
            let root = knots.root(self.corner);
            root.norm_squared() / root.nrows() as f64
        };
        (self.settled.strength * knots.iter().map(variance).sum::<f64>() / knots.len() as f64).sqrt()
    }

    fn course(&self, sheets: &[Sheet], knots: &[Knots]) -> Vec<Vec<Ordinate>> {
        if self.settled.strength <= 0.0 {
            return Vec::new();
        }
        let found = course(sheets, &self.hats, &self.settled);
        let one = |((values, covariance), knots): (&(DVector<f64>, DMatrix<f64>), &Knots)| {
            let root = knots.root(self.corner);
            let (values, spread) = (&root * values, &root * covariance);
            let at = |k: usize| Ordinate {
                time: knots.times[k],
                value: values[k],
                deviation: spread.row(k).dot(&root.row(k)).max(0.0).sqrt(),
            };
            (0..knots.times.len()).map(at).collect()
        };
        found.iter().zip(knots).map(one).collect()
    }
}
