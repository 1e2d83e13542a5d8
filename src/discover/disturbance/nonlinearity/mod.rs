//! An unmodelled nonlinearity: the same function of states, inputs and their past in every run, at every place.
//!
//! A gust does not repeat, a sensor's noise does not are correlated with the states by feedback: what one function explains in all runs is something
//! that the model lacks, whether or not the catalogue has a name for it.
//!
//! **In** a fitted model with its runs. **Out** [`Nonlinearities`]: for every place the evidence for such a function. **Never** names
//! the function. **Start** at [`nonlinearities`]; `regressors` (what the function may be made of), `likelihood` (noise and
//! nonlinearity found together).

mod likelihood;
mod regressors;
#[cfg(test)]
mod tests;

use super::binned_run::BinnedRun;
use super::forced_response::ForcedResponse;
use super::likelihood::{CourseResponses, Spectra};
use super::null_model::NullModel;
use super::place::{CLEAR, DisturbanceError, FittedRun, Place, PlaceKind, places, rank};
use crate::bins::Cosines;
use crate::noise::SmoothSpectrum;
use fdm_system::model::Model;
use likelihood::{Settled, bands, cells, settle};
use nalgebra::DMatrix;
use rayon::prelude::*;
use regressors::{Functions, functions, variables};
use serde::{Deserialize, Serialize};

/// What a nonlinearity's size costs in log-likelihood, and that the better of many places is taken.
const PENALTY: f64 = 2.0;
/// Most functions, and the fewest.
const MOST: usize = 48;
const FEWEST: usize = 12;
/// Most numbers in all responses: fewer functions where records are long.
const ROOM: usize = 6_000_000;
/// Responses are followed to this multiple of the band of the fitted sensitivities.
const REACH: f64 = 8.0;

/// An unknown nonlinearity at one place.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub(crate) struct Nonlinearity {
    /// The place.
    pub place: Place,
    /// Logarithm of the odds of such a disturbance here, beside noise of any smooth spectrum in every output, against such noise alone.
    pub evidence: f64,
}

/// Unknown nonlinearities everywhere.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub(crate) struct Nonlinearities {
    /// Inputs, equations and sensors, the likeliest first; an equation before an input that moves it where both are as likely.
    pub list: Vec<Nonlinearity>,
}

impl Nonlinearities {
    /// Evidence of the best place; 0 where there is none.
    pub(crate) fn evidence(&self) -> f64 {
        self.list.iter().map(|nonlinearity| nonlinearity.evidence).fold(0.0, f64::max)
    }

    /// The places that these data cannot tell from the best one.
    pub(crate) fn group(&self) -> impl Iterator<Item = &Nonlinearity> {
        let least = self.evidence() - CLEAR;
        self.list.iter().filter(move |nonlinearity| nonlinearity.evidence > 0.0 && nonlinearity.evidence >= least)
    }
}

/// Asks every place for a disturbance that is the same function of states and inputs in all runs.
pub(in super::super) fn nonlinearities(
    model: &Model,
    fitted_runs: &[FittedRun<'_>],
    null_model: &NullModel,
) -> Result<Nonlinearities, DisturbanceError> {
    let (binned_runs, q) = (null_model.independent().0, model.layout().outputs);
    let low = REACH * null_model.band;
    let places = places(model);
    let forced_response = ForcedResponse::new(model, &places);
    let rows: usize = binned_runs.iter().map(|s| q * s.below(low)).sum();
    let most = (ROOM / (rows * places.len().max(1)).max(1)).clamp(FEWEST, MOST);
    let Some(Functions { courses, single }) = functions(&variables(model, &forced_response, fitted_runs)?, most) else {
        return Ok(Nonlinearities { list: Vec::new() });
    };
    let at_places = responses(&forced_response, places.len(), fitted_runs, binned_runs, &courses, low)?;
    let at_sensors = in_sensors(binned_runs, &courses, low);
    let outputs = model.definition().outputs.iter().enumerate();
    let sensor = |(index, o): (usize, &fdm_grammar::model::Output)| Place {
        kind: PlaceKind::Output,
        index,
        name: o.quantity.name.clone(),
    };
    let places: Vec<Place> = places.into_iter().chain(outputs.map(sensor)).collect();
    let mut list = weigh(binned_runs, &places, at_places.into_iter().chain(at_sensors).collect(), &single);
    rank(model, &mut list, |nonlinearity| (&nonlinearity.place, nonlinearity.evidence));
    Ok(Nonlinearities { list })
}

fn weigh(
    binned_runs: &[BinnedRun],
    places: &[Place],
    responses: Vec<Vec<CourseResponses>>,
    single: &DMatrix<f64>,
) -> Vec<Nonlinearity> {
    let p = binned_runs[0].fitted[0].ncols();
    let bands = bands(binned_runs);
    let floor: Vec<SmoothSpectrum> = Spectra::floor(binned_runs).channels;
    let alone = cells(binned_runs, &bands, None);
    let none = DMatrix::zeros(0, 0);
    let null = settle(&alone, p, &none, &floor);
    let better = |a: Settled, b: Settled| if b.score > a.score { b } else { a };
    let found: Vec<Settled> = responses
        .into_par_iter()
        .map(|own| {
            let cells = cells(binned_runs, &bands, Some(&own));
            // noise alone may have taken for noise what a nonlinearity did, and the floor may be too low
            better(settle(&cells, p, single, &floor), settle(&cells, p, single, &null.spectra))
        })
        .collect();
    // noise alone may begin where any nonlinearity has left it
    let null = found.iter().fold(null, |best, own| better(best, settle(&alone, p, &none, &own.spectra)));
    let each = places.iter().zip(found);
    each.map(|(place, own)| Nonlinearity { place: place.clone(), evidence: own.score - null.score - PENALTY }).collect()
}

/// Responses at every place (outermost) of every run, in bins.
fn responses(
    forced_response: &ForcedResponse,
    places: usize,
    fitted_runs: &[FittedRun<'_>],
    binned_runs: &[BinnedRun],
    courses: &[Vec<Vec<f64>>],
    low: f64,
) -> Result<Vec<Vec<CourseResponses>>, DisturbanceError> {
    let one = |run: usize| -> Result<Vec<CourseResponses>, DisturbanceError> {
        let (binned, own) = (&binned_runs[run], &courses[run]);
        let low = binned.below(low);
        let mut found = vec![vec![DMatrix::zeros(low, own.len()); binned.channels()]; places];
        let mut cosines = Cosines::new(binned.samples);
        forced_response.respond(run, fitted_runs[run], own, &mut |place, course, response| {
            for (channel, bins) in binned.response(&mut cosines, &response, low).into_iter().enumerate() {
                found[place][channel].column_mut(course).copy_from_slice(&bins);
            }
        })?;
        Ok(found)
    };
    let runs: Vec<Result<Vec<CourseResponses>, DisturbanceError>> =
        (0..fitted_runs.len()).into_par_iter().map(one).collect();
    let mut by_place = vec![Vec::with_capacity(fitted_runs.len()); places];
    for run in runs {
        by_place.iter_mut().zip(run?).for_each(|(list, own)| list.push(own));
    }
    Ok(by_place)
}

/// The functions themselves in one sensor, for every sensor (outermost) and run.
fn in_sensors(binned_runs: &[BinnedRun], courses: &[Vec<Vec<f64>>], low: f64) -> Vec<Vec<CourseResponses>> {
    let q = binned_runs[0].channels();
    let one = |sensor: usize| {
        let of = |(binned, courses): (&BinnedRun, &Vec<Vec<f64>>)| -> CourseResponses {
            let low = binned.below(low);
            let mut cosines = Cosines::new(binned.samples);
            let mut own = vec![DMatrix::zeros(low, courses.len()); q];
            for (k, course) in courses.iter().enumerate() {
                let bins = binned.sensed(&mut cosines, course, sensor, low);
                own.iter_mut().zip(bins).for_each(|(own, bins)| own.column_mut(k).copy_from_slice(&bins));
            }
            own
        };
        binned_runs.iter().zip(courses).map(of).collect()
    };
    (0..q).map(one).collect()
}
