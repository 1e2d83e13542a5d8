//! Evidence for an unknown law at every place.

use super::super::driven::Driven;
use super::super::ground::Ground;
use super::super::likelihood::Hats;
use super::super::localise::CLEAR;
use super::super::place::{ForceError, Kind, Passage, Place, places};
use super::super::sheet::{Cosines, Sheet};
use super::super::spectra::Spectra;
use super::super::spectrum::SmoothSpectrum;
use super::super::standing::rank;
use super::cells::{bands, cells};
use super::functions::{Functions, functions};
use super::variables::variables;
use super::weighing::{Settled, settle};
use crate::model::Model;
use nalgebra::DMatrix;
use rayon::prelude::*;
use serde::Serialize;

/// What a law's size costs in log-likelihood, and that the better of many places is taken.
const PRICE: f64 = 2.0;
/// Most functions, and the fewest.
const MOST: usize = 48;
const FEWEST: usize = 12;
/// Most numbers in all responses: fewer functions where records are long.
const ROOM: usize = 6_000_000;
/// Responses are followed to this multiple of the band of the fitted sensitivities.
const REACH: f64 = 8.0;

/// An unknown law at one place.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Law {
    /// The place.
    pub place: Place,
    /// Logarithm of the odds of such a force here, beside noise of any smooth spectrum in every output, against such noise alone.
    pub evidence: f64,
}

/// Unknown laws everywhere.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Laws {
    /// Inputs, equations and sensors, the likeliest first; an equation before an input that moves it where both are as likely.
    pub list: Vec<Law>,
}

impl Laws {
    /// Evidence of the best place; 0 where there is none.
    pub fn evidence(&self) -> f64 {
        self.list.iter().map(|law| law.evidence).fold(0.0, f64::max)
    }

    /// The places that these data cannot tell from the best one.
    pub fn group(&self) -> impl Iterator<Item = &Law> {
        let least = self.evidence() - CLEAR;
        self.list.iter().filter(move |law| law.evidence > 0.0 && law.evidence >= least)
    }
}

/// Asks every place for a force that is the same function of states and inputs in all runs.
pub(in super::super) fn laws(model: &Model, passages: &[Passage<'_>], ground: &Ground) -> Result<Laws, ForceError> {
    let (sheets, q) = (ground.independent().0, model.layout().outputs);
    let low = REACH * ground.band;
    let places = places(model);
    let driven = Driven::new(model, &places);
    let rows: usize = sheets.iter().map(|s| q * s.below(low)).sum();
    let most = (ROOM / (rows * places.len().max(1)).max(1)).clamp(FEWEST, MOST);
    let Some(Functions { courses, single }) = functions(&variables(model, &driven, passages)?, most) else {
        return Ok(Laws { list: Vec::new() });
    };
    let at_places = responses(&driven, places.len(), passages, sheets, &courses, low)?;
    let at_sensors = in_sensors(sheets, &courses, low);
    let outputs = model.definition().outputs.iter().enumerate();
    let sensor = |(index, o): (usize, &fdm_grammar::model::Output)| Place {
        kind: Kind::Output,
        index,
        name: o.quantity.name.clone(),
    };
    let places: Vec<Place> = places.into_iter().chain(outputs.map(sensor)).collect();
    let mut list = weigh(sheets, &places, at_places.into_iter().chain(at_sensors).collect(), &single);
    rank(model, &mut list, |law| (&law.place, law.evidence));
    Ok(Laws { list })
}

fn weigh(sheets: &[Sheet], places: &[Place], responses: Vec<Vec<Hats>>, single: &DMatrix<f64>) -> Vec<Law> {
    let p = sheets[0].fitted[0].ncols();
    let bands = bands(sheets);
    let floor: Vec<SmoothSpectrum> = Spectra::floor(sheets).channels;
    let alone = cells(sheets, &bands, None);
    let none = DMatrix::zeros(0, 0);
    let null = settle(&alone, p, &none, &floor);
    let better = |a: Settled, b: Settled| if b.score > a.score { b } else { a };
    let found: Vec<Settled> = responses
        .into_par_iter()
        .map(|own| {
            let cells = cells(sheets, &bands, Some(&own));
            // noise alone may have taken for noise what a law did, and the floor may be too low
            better(settle(&cells, p, single, &floor), settle(&cells, p, single, &null.spectra))
        })
        .collect();
    // noise alone may begin where any law has left it
    let null = found.iter().fold(null, |best, own| better(best, settle(&alone, p, &none, &own.spectra)));
    let each = places.iter().zip(found);
    each.map(|(place, own)| Law { place: place.clone(), evidence: own.score - null.score - PRICE }).collect()
}

/// Responses at every place (outermost) of every run, in lines.
fn responses(
    driven: &Driven,
    places: usize,
    passages: &[Passage<'_>],
    sheets: &[Sheet],
    courses: &[Vec<Vec<f64>>],
    low: f64,
) -> Result<Vec<Vec<Hats>>, ForceError> {
    let one = |run: usize| -> Result<Vec<Hats>, ForceError> {
        let (sheet, own) = (&sheets[run], &courses[run]);
        let low = sheet.below(low);
        let mut found = vec![vec![DMatrix::zeros(low, own.len()); sheet.channels()]; places];
        let mut cosines = Cosines::new(sheet.samples);
        driven.respond(run, passages[run], own, &mut |place, course, response| {
            for (channel, lines) in sheet.response(&mut cosines, &response, low).into_iter().enumerate() {
                found[place][channel].column_mut(course).copy_from_slice(&lines);
            }
        })?;
        Ok(found)
    };
    let runs: Vec<Result<Vec<Hats>, ForceError>> = (0..passages.len()).into_par_iter().map(one).collect();
    let mut by_place = vec![Vec::with_capacity(passages.len()); places];
    for run in runs {
        by_place.iter_mut().zip(run?).for_each(|(list, own)| list.push(own));
    }
    Ok(by_place)
}

/// The functions themselves in one sensor, for every sensor (outermost) and run.
fn in_sensors(sheets: &[Sheet], courses: &[Vec<Vec<f64>>], low: f64) -> Vec<Vec<Hats>> {
    let q = sheets[0].channels();
    let one = |sensor: usize| {
        let of = |(sheet, courses): (&Sheet, &Vec<Vec<f64>>)| -> Hats {
            let low = sheet.below(low);
            let mut cosines = Cosines::new(sheet.samples);
            let mut own = vec![DMatrix::zeros(low, courses.len()); q];
            for (k, course) in courses.iter().enumerate() {
                let lines = sheet.sensed(&mut cosines, course, sensor, low);
                own.iter_mut().zip(lines).for_each(|(own, lines)| own.column_mut(k).copy_from_slice(&lines));
            }
            own
        };
        sheets.iter().zip(courses).map(of).collect()
    };
    (0..q).map(one).collect()
}
