//! At which place an unknown disturbance explains the residuals best, and what its course was.
//!
//! A disturbance's course as a sum of hat functions, and the responses to them at every place.

use super::binned_run::BinnedRun;
use super::forced_response::ForcedResponse;
use super::likelihood::{CourseResponses, Settled, Spectra, course, settle};
use super::null_model::NullModel;
use super::place::{CLEAR, DisturbanceError, FittedRun, Place, PlaceKind, places, rank};
use crate::bins::Cosines;
use crate::noise::SmoothSpectrum;
use fdm_numeric::parallel;
use fdm_system::model::Model;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// What the strength and the memory of a disturbance cost in log-likelihood.
const PENALTY: f64 = 2.0;
/// The corner of a disturbance with a memory, as a part of the band.
const CORNER: f64 = 1.0 / 16.0;

/// One ordinate of a reconstructed disturbance.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
pub struct Ordinate {
    /// Time since the run began.
    pub time: f64,
    /// The disturbance: what is added to the input, or to the rate of the state.
    pub value: f64,
    /// Its standard deviation.
    pub deviation: f64,
}

/// What the residuals say about one place.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Site {
    /// The place.
    pub place: Place,
    /// For inputs and equations: logarithm of the odds of a random disturbance here, beside noise of any smooth spectrum in every
    /// output, against such noise alone. For outputs: of coloured noise against white noise.
    pub evidence: f64,
    /// Standard deviation of the disturbance at a typical time; 0 for outputs.
    pub size: f64,
    /// The disturbance's course in every run; empty for outputs, and where there is no disturbance.
    pub course: Vec<Vec<Ordinate>>,
}

/// Where an unknown disturbance enters.
#[derive(Debug, Clone, PartialEq)]
pub struct Localisation {
    /// Inputs and equations, the likeliest first; an equation before an input that moves it where both are as likely.
    pub disturbances: Vec<Site>,
    /// Outputs, the most coloured first.
    pub sensors: Vec<Site>,
    /// Logarithm of the likelihood of the residuals when all of them are noise of smooth spectra, less what the spectra
    /// cost: comparable between models that were fitted to the same runs.
    pub noise_alone: f64,
    /// Logarithm of the likelihood with the best disturbance in the residuals, less its cost; `noise_alone` when no
    /// disturbance is better.
    pub with_disturbance: f64,
    /// Spectrum of each output's noise when there is no disturbance.
    pub spectra: Vec<SmoothSpectrum>,
    /// The frequency up to which disturbances were followed.
    pub band: f64,
}

impl Localisation {
    /// Evidence of the best place; 0 where there is none.
    pub fn evidence(&self) -> f64 {
        self.disturbances.iter().map(|s| s.evidence).reduce(f64::max).unwrap_or(0.0)
    }

    /// The places that these data cannot tell from the best one.
    pub fn group(&self) -> impl Iterator<Item = &Site> {
        let least = self.evidence() - CLEAR;
        self.disturbances.iter().filter(move |s| s.evidence > 0.0 && s.evidence >= least)
    }
}

/// Asks every input and every equation that left something to be found.
pub(super) fn localise(
    model: &Model,
    fitted_runs: &[FittedRun<'_>],
    null_model: &NullModel,
) -> Result<Localisation, DisturbanceError> {
    let (binned_runs, null) = null_model.independent();
    let band = null_model.band;
    let places = places(model);
    let forced_response = ForcedResponse::new(model, &places);
    let knots: Vec<Knots> = binned_runs.iter().map(|s| Knots::new(s, band)).collect();
    let responses = hat_responses(&forced_response, places.len(), fitted_runs, binned_runs, &knots)?;
    let tried: Vec<Tried> = parallel::map(responses.iter(), |own| Tried::best(binned_runs, &knots, own, null, band));
    // noise alone may begin where any disturbance has left it
    let null = tried
        .iter()
        .map(|t| settle(binned_runs, None, &t.settled.spectra))
        .fold(null.clone(), |best, other| if other.score > best.score { other } else { best });
    let mut disturbances: Vec<(Site, f64)> = places
        .into_iter()
        .zip(&tried)
        .map(|(place, tried)| {
            let evidence = tried.settled.score - PENALTY - null.score;
            let site = Site { place, evidence, size: tried.size(&knots), course: tried.course(binned_runs, &knots) };
            (site, tried.settled.profile - PENALTY)
        })
        .collect();
    rank(model, &mut disturbances, |(site, _)| (&site.place, site.evidence));
    let with_disturbance = disturbances.first().filter(|f| f.0.evidence > 0.0).map_or(null.profile, |f| f.1);
    Ok(Localisation {
        with_disturbance: null_model.measured(with_disturbance),
        disturbances: disturbances.into_iter().map(|(site, _)| site).collect(),
        sensors: sensors(model, &null_model.noise),
        noise_alone: null_model.measured(null.profile),
        spectra: null_model.noise.spectra.channels.clone(),
        band,
    })
}

fn sensors(model: &Model, null: &Settled) -> Vec<Site> {
    let outputs = model.definition().outputs.iter().enumerate();
    let mut sensors: Vec<Site> = outputs
        .zip(&null.spectra.coloured)
        .map(|((index, output), evidence)| Site {
            place: Place { kind: PlaceKind::Output, index, name: output.quantity.name.clone() },
            evidence: *evidence,
            size: 0.0,
            course: Vec::new(),
        })
        .collect();
    sensors.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    sensors
}

/// The best disturbance at one place.
struct Tried {
    settled: Settled,
    /// Responses to courses of unit variance.
    responses: Vec<CourseResponses>,
    corner: Option<f64>,
}

impl Tried {
    fn best(
        binned_runs: &[BinnedRun],
        knots: &[Knots],
        responses: &[CourseResponses],
        null: &Settled,
        band: f64,
    ) -> Self {
        let floor = Spectra::floor(binned_runs);
        let mut best: Option<Self> = None;
        for corner in [None, Some(CORNER * band)] {
            let turned: Vec<CourseResponses> = responses
                .iter()
                .zip(knots)
                .map(|(own, knots)| {
                    let root = knots.root(corner);
                    own.iter().map(|channel| channel * &root).collect()
                })
                .collect();
            // noise alone may have taken for noise what a disturbance did, and the floor may be too low
            for start in [&floor, &null.spectra] {
                let settled = settle(binned_runs, Some(&turned), start);
                if best.as_ref().is_none_or(|b| settled.score > b.settled.score) {
                    best = Some(Self { settled, responses: turned.clone(), corner });
                }
            }
        }
        // the first corner always gives one
        best.unwrap_or_else(|| Self { settled: null.clone(), responses: responses.to_vec(), corner: None })
    }

    /// Root mean square of the disturbance that its strength stands for.
    fn size(&self, knots: &[Knots]) -> f64 {
        let variance = |knots: &Knots| {
            let root = knots.root(self.corner);
            root.norm_squared() / root.nrows() as f64
        };
        (self.settled.strength * knots.iter().map(variance).sum::<f64>() / knots.len() as f64).sqrt()
    }

    fn course(&self, binned_runs: &[BinnedRun], knots: &[Knots]) -> Vec<Vec<Ordinate>> {
        if self.settled.strength <= 0.0 {
            return Vec::new();
        }
        let found = course(binned_runs, &self.responses, &self.settled);
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

/// Fewest and most hats of a run.
const FEWEST: usize = 12;
const MOST: usize = 80;

/// The hats of one run.
#[derive(Debug, Clone)]
pub(super) struct Knots {
    /// Times of their tips since the run began, evenly spaced from its first to its last sample.
    pub(super) times: Vec<f64>,
    /// Bins of a response that can hold anything of them.
    low: usize,
    /// Time from tip to tip.
    spacing: f64,
}

impl Knots {
    /// Hats that follow a disturbance up to twice this frequency.
    pub(super) fn new(binned: &BinnedRun, band: f64) -> Self {
        let length = (binned.samples - 1) as f64 * binned.interval;
        let wanted = (length * 4.0 * band).ceil() as usize + 1;
        let count = wanted.clamp(FEWEST, MOST.min(binned.samples / 3).max(FEWEST));
        let spacing = length / (count - 1) as f64;
        let times = (0..count).map(|k| k as f64 * spacing).collect();
        Self { times, low: binned.reached(1.0 / spacing), spacing }
    }

    /// Every hat at the samples.
    fn courses(&self, binned: &BinnedRun) -> Vec<Vec<f64>> {
        let hat = |tip: &f64| {
            let at = |k: usize| (1.0 - (k as f64 * binned.interval - tip).abs() / self.spacing).max(0.0);
            (0..binned.samples).map(at).collect()
        };
        self.times.iter().map(hat).collect()
    }

    /// The courses (K) that a disturbance of a memory has with unit variance each: cosines, the quick ones the smaller, the smaller
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
pub(super) fn hat_responses(
    forced_response: &ForcedResponse,
    places: usize,
    fitted_runs: &[FittedRun<'_>],
    binned_runs: &[BinnedRun],
    knots: &[Knots],
) -> Result<Vec<Vec<CourseResponses>>, DisturbanceError> {
    let runs: Vec<Result<Vec<CourseResponses>, DisturbanceError>> = parallel::map(0..fitted_runs.len(), |run| {
        let (binned, knots) = (&binned_runs[run], &knots[run]);
        let empty = vec![DMatrix::zeros(knots.low, knots.times.len()); binned.channels()];
        let mut own = vec![empty; places];
        let mut cosines = Cosines::new(binned.samples);
        forced_response.respond(run, fitted_runs[run], &knots.courses(binned), &mut |place, hat, response| {
            for (channel, bins) in binned.response(&mut cosines, &response, knots.low).into_iter().enumerate() {
                own[place][channel].column_mut(hat).copy_from_slice(&bins);
            }
        })?;
        Ok(own)
    });
    let mut by_place = vec![Vec::with_capacity(fitted_runs.len()); places];
    for run in runs {
        by_place.iter_mut().zip(run?).for_each(|(list, own)| list.push(own));
    }
    Ok(by_place)
}
