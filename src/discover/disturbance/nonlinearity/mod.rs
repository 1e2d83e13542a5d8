//! An unmodelled nonlinearity: the same function of states, inputs and their past in every run, at every place.
//!
//! A gust does not repeat, a sensor's noise does not are correlated with the states by feedback: what one function explains in all runs is something
//! that the model lacks, whether or not the catalogue has a name for it.
//!
//! **In** a fitted model with its runs. **Out** [`Nonlinearities`]: for every place the evidence for such a function. **Never** names
//! the function, but its variable where one is enough. **Start** at [`nonlinearities`]; `regressors` (what the function may be made of), `likelihood` (noise and
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
use crate::noise::{Resonance, SmoothSpectrum};
use fdm_numeric::parallel;
use fdm_system::model::Model;
use likelihood::{Band, Banded, Settled, Singles, bands, cells, settle};
use nalgebra::DMatrix;
use regressors::{Functions, curve, functions, variables};
use serde::{Deserialize, Serialize};

/// What a nonlinearity's size costs in log-likelihood, and that the better of many places is taken.
const PENALTY: f64 = 2.0;
/// Most functions, and the fewest.
const MOST: usize = 48;
const FEWEST: usize = 12;
/// Most numbers in all responses: fewer functions where records are long.
const ROOM: usize = 6_000_000;
/// Prior probability of a function of one variable: waves are flexible, and of 12 records without an effect one had a curve at 0.5.
const ALONE: f64 = 0.1;
/// Courses of all curves over one variable, as a multiple of those of functions of all.
const CURVES: usize = 5;
/// Responses are followed to this multiple of the band of the fitted sensitivities.
const REACH: f64 = 8.0;

/// An unknown nonlinearity at one place.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub(crate) struct Nonlinearity {
    /// The place.
    pub place: Place,
    /// Logarithm of the odds of such a disturbance here, beside noise of any smooth spectrum in every output, against such noise alone.
    pub evidence: f64,
    /// What it is a function of, where one variable is enough.
    pub curve: Option<Curve>,
}

/// An unmodelled nonlinearity as a curve over one state or input, estimated beside the model's parameters.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Curve {
    /// The state or input.
    pub variable: String,
    /// Points over all that it went through, rising; where runs were seldom the deviation is large.
    pub points: Vec<CurvePoint>,
}

/// A point of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
pub struct CurvePoint {
    /// Value of the variable.
    pub at: f64,
    /// What is to be added: to the input, to the derivative of the state, or to the output.
    pub value: f64,
    /// Its standard deviation.
    pub deviation: f64,
}

/// Unknown nonlinearities everywhere.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub(crate) struct Nonlinearities {
    /// Inputs, equations and sensors, the likeliest first; an equation before an input that moves it where both are as likely.
    pub list: Vec<Nonlinearity>,
    /// Nonlinearities that are functions of one variable alone, the likeliest first.
    pub curves: Vec<Nonlinearity>,
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
    let ((binned_runs, noise), q) = (null_model.independent(), model.layout().outputs);
    let low = REACH * null_model.band;
    let places = places(model);
    let forced_response = ForcedResponse::new(model, &places);
    let rows: usize = binned_runs.iter().map(|s| q * s.reached(low)).sum();
    let most = (ROOM / (rows * places.len().max(1)).max(1)).clamp(FEWEST, MOST);
    let variables = variables(model, &forced_response, fitted_runs)?;
    let Some(all) = functions(&variables, most) else {
        return Ok(Nonlinearities { list: Vec::new(), curves: Vec::new() });
    };
    let nodes = (CURVES * most / variables.len()).clamp(FEWEST, most);
    let alone = variables.len() as f64 / ALONE;
    let kinds = std::iter::once((all, 1.0 / (1.0 - ALONE))).chain(variables.iter().map(|v| (curve(v, nodes), alone)));
    let outputs = model.definition().outputs.iter().enumerate();
    let sensor = |(index, o): (usize, &fdm_grammar::model::Output)| Place {
        kind: PlaceKind::Output,
        index,
        name: o.quantity.name.clone(),
    };
    let everywhere: Vec<Place> = places.iter().cloned().chain(outputs.map(sensor)).collect();
    let mut comparison = Weighing::new(binned_runs, &noise.spectra, everywhere.len());
    for (functions, kinds) in kinds {
        let at_places = responses(&forced_response, places.len(), fitted_runs, binned_runs, &functions.courses, low)?;
        let at_sensors = in_sensors(binned_runs, &functions.courses, low);
        comparison.add(&functions, kinds.ln(), at_places.into_iter().chain(at_sensors).collect());
    }
    let (mut list, mut curves) =
        (comparison.list(&everywhere, &comparison.best), comparison.list(&everywhere, &comparison.curves));
    for ranked in [&mut list, &mut curves] {
        rank(model, ranked, |nonlinearity| (&nonlinearity.place, nonlinearity.evidence));
    }
    Ok(Nonlinearities { list, curves })
}

/// Noise alone, and the likeliest functions at every place.
struct Weighing<'a> {
    binned_runs: &'a [BinnedRun],
    bands: Vec<Band>,
    floor: Vec<SmoothSpectrum>,
    bands_alone: Banded,
    null: Settled,
    /// The likeliest at each place.
    best: Vec<Likeliest>,
    /// The likeliest function of one variable at each place.
    curves: Vec<Likeliest>,
}

/// Its score, and the curve where it is a function of one variable.
type Likeliest = Option<(f64, Option<Curve>)>;

impl<'a> Weighing<'a> {
    fn new(binned_runs: &'a [BinnedRun], noise: &Spectra, places: usize) -> Self {
        let resonances: Vec<&Resonance> = noise.channels.iter().filter_map(SmoothSpectrum::resonance).collect();
        let bands = bands(binned_runs, &resonances);
        let floor: Vec<SmoothSpectrum> = Spectra::floor(binned_runs).channels;
        let alone = cells(binned_runs, &bands, None);
        let none = DMatrix::zeros(0, 0);
        let null = settle(&alone, binned_runs[0].fitted[0].ncols(), Singles { combinations: &none, alike: 1 }, &floor);
        Self {
            binned_runs,
            bands,
            floor,
            bands_alone: alone,
            null,
            best: vec![None; places],
            curves: vec![None; places],
        }
    }

    /// Weighs functions at all places, by their responses there; `penalty` is the logarithm of how many kinds of them there are.
    fn add(&mut self, functions: &Functions, penalty: f64, responses: Vec<Vec<CourseResponses>>) {
        let p = self.binned_runs[0].fitted[0].ncols();
        let single = Singles { combinations: &functions.single, alike: functions.alike };
        let better = |a: Settled, b: Settled| if b.score > a.score { b } else { a };
        let found: Vec<Settled> = parallel::map(responses, |own| {
            let cells = cells(self.binned_runs, &self.bands, Some(&own));
            // noise alone may have taken for noise what a nonlinearity did, and the floor may be too low
            better(settle(&cells, p, single, &self.floor), settle(&cells, p, single, &self.null.spectra))
        });
        for ((best, alone), own) in self.best.iter_mut().zip(&mut self.curves).zip(&found) {
            let score = own.score - penalty;
            let better = |other: &Likeliest| other.as_ref().is_none_or(|(other, _)| score > *other);
            let (mean, covariance) = &own.coefficients;
            let range = functions.curve.as_ref().filter(|_| mean.len() == functions.single.ncols());
            let told = better(best) || (better(alone) && range.is_some());
            let curve = range.filter(|_| told).map(|range| range.curve(&functions.single, (mean, covariance)));
            if better(alone) && curve.is_some() {
                *alone = Some((score, curve.clone()));
            }
            if better(best) {
                *best = Some((score, curve));
            }
        }
        // noise alone may begin where any nonlinearity has left it
        let none = DMatrix::zeros(0, 0);
        let none = Singles { combinations: &none, alike: 1 };
        self.null = found
            .iter()
            .fold(self.null.clone(), |best, own| better(best, settle(&self.bands_alone, p, none, &own.spectra)));
    }

    fn list(&self, places: &[Place], likeliest: &[Likeliest]) -> Vec<Nonlinearity> {
        let of = |(place, likeliest): (&Place, &Likeliest)| {
            let (score, curve) = likeliest.clone()?;
            Some(Nonlinearity { place: place.clone(), evidence: score - self.null.score - PENALTY, curve })
        };
        places.iter().zip(likeliest).filter_map(of).collect()
    }
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
        let low = binned.reached(low);
        let mut found = vec![vec![DMatrix::zeros(low, own.len()); binned.channels()]; places];
        let mut cosines = Cosines::new(binned.samples);
        forced_response.respond(run, fitted_runs[run], own, &mut |place, course, response| {
            for (channel, bins) in binned.response(&mut cosines, &response, low).into_iter().enumerate() {
                found[place][channel].column_mut(course).copy_from_slice(&bins);
            }
        })?;
        Ok(found)
    };
    let runs: Vec<Result<Vec<CourseResponses>, DisturbanceError>> = parallel::map(0..fitted_runs.len(), one);
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
            let low = binned.reached(low);
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
