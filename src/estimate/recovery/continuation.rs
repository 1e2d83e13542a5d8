//! Record-length continuation (Goodman and Sargent 1971, section III): a short record first, then longer ones, each from
//! the result of the one before.
//!
//! What a short record does not determine is pulled weakly towards the start values, so that it does not fly away
//! before the record is long enough; the whole record is fitted without that.
//!
//! Substitution (Goodman and Sargent 1971, end of section II): a first fit with the measured records of states in the place of
//! these states in the equations, whose result starts the fit of the full model.
//!
//! The response then depends on most parameters linearly, so that hardly any start is too poor; but noise enters through the
//! equations, and the estimates of that first fit are biased by it.

use super::segmented_response::FreeResponse;
use crate::methods::output_error::error::{FitError, StrategyError, trouble};
use crate::methods::output_error::fit::{Fit, LengthFit};
use crate::methods::output_error::options::{Attempt, Continuation, FitOptions};
use crate::methods::output_error::single::single_fit;
use crate::problem::Options;
use crate::work::Work;
use fdm_grammar::diagnostic::nearest;
use fdm_grammar::model::{Origin, Prior};
use fdm_numeric::halt::Stop;
use fdm_system::model::Model;
use fdm_system::record::Run;

/// How much of every run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Length {
    /// This part of each.
    Share(f64),
    /// Up to this time since each began.
    Time(f64),
}

impl Length {
    /// The runs up to this length, two samples at least.
    pub(crate) fn cut(self, runs: &[Run]) -> Vec<Run> {
        let one = |run: &Run| {
            let end = match self {
                Self::Share(share) => share * run.time.last().copied().unwrap_or(0.0),
                Self::Time(time) => time,
            };
            // a sample that stands at the end but for rounding belongs to it
            let samples = run.time.partition_point(|t| *t <= end * (1.0 + 1e-12));
            run.part(0..samples.max(2).min(run.len()))
        };
        runs.iter().map(one).collect()
    }
}

impl Continuation {
    /// The lengths that were asked for, the whole record not among them; none when they are to be found or not wanted.
    pub(crate) fn lengths(&self) -> Option<Vec<Length>> {
        match self {
            Self::Auto | Self::Never => None,
            Self::Shares(shares) => Some(shares.iter().filter(|s| **s < 1.0).map(|s| Length::Share(*s)).collect()),
            Self::Times(times) => Some(times.iter().map(|t| Length::Time(*t)).collect()),
        }
    }
}

/// Factor from one length to the next as long as all goes well.
const GROWTH: f64 = 1.6;
/// Growth below which lengthening has failed.
const STANDSTILL: f64 = 1.05;
/// Compared cells for each unknown that the shortest record should have.
const CELLS: usize = 3;
/// Iterations of a record that is not the whole one, and their tolerance: its result is only a start.
const ITERATIONS: usize = 40;
const TOLERANCE: f64 = 1e-4;

/// Fits lengthening records.
pub(crate) struct LengthContinuation<'a> {
    whole: &'a Attempt<'a>,
    /// What was fitted so far.
    stages: Vec<LengthFit>,
}

impl<'a> LengthContinuation<'a> {
    pub(crate) fn new(whole: &'a Attempt<'a>) -> Self {
        Self { whole, stages: Vec::new() }
    }

    /// Fits the given lengths one after the other, then the whole record, whatever becomes of each.
    pub(crate) fn along(mut self, lengths: &[Length]) -> Result<Fit, FitError> {
        let Attempt { runs, work, .. } = *self.whole;
        let mut starts = self.whole.starts.to_vec();
        for length in lengths {
            let short = length.cut(runs);
            if short.iter().zip(runs).all(|(a, b)| a.len() == b.len()) {
                break;
            }
            let fit = self.short(&short, &starts)?;
            starts = self.reached(&fit, &starts);
            if let Some(stop) = work.stop_after(&fit.estimate.termination) {
                return self.whole_from(&starts, &Work::ended(stop));
            }
        }
        self.whole_from(&starts, work)
    }

    /// Finds the lengths: begins with the shortest record that determines anything, goes on by a factor that shrinks when
    /// the next record is too long for the values of the one before. None when there is no way on.
    pub(crate) fn adaptive(mut self) -> Result<Option<Fit>, FitError> {
        let Attempt { runs, work, .. } = *self.whole;
        let (mut starts, mut growth, mut matched) = (self.whole.starts.to_vec(), GROWTH, false);
        let (mut reached, mut next) = (0.0, self.shortest());
        if next <= 0.0 {
            // nothing is free: no length helps, and nothing times a growth stays nothing
            return Ok(None);
        }
        while next < 1.0 {
            let fit = self.short(&Length::Share(next).cut(runs), &starts)?;
            if let Some(stop) = work.stop_after(&fit.estimate.termination) {
                // how it fits the short record says nothing about the whole one
                let reached = self.reached(&fit, &starts);
                return self.whole_from(&reached, &Work::ended(stop)).map(Some);
            }
            let poor = trouble(&fit.estimate).is_some_and(|t| t.is_severe());
            if !poor && let Some(found) = self.unstable(&fit, &starts, next) {
                let reached = self.reached(&fit, &starts);
                let mut fit = self.whole_from(&reached, &Work::ended(Stop::Iterations))?;
                fit.estimate.termination = found.termination();
                return Ok(Some(fit));
            }
            // a very short record may be noise only, which no model matches; one that was matched once stays so
            if fit.estimate.cost.is_some() && !(poor && matched) {
                starts = self.reached(&fit, &starts);
                (reached, growth, matched) = (next, growth.max(GROWTH.sqrt()), matched || !poor);
            } else if reached > 0.0 {
                growth = growth.sqrt();
            } else if self.is_shortest(next) {
                return Ok(None);
            } else {
                next *= 0.5;
                continue;
            }
            if growth < STANDSTILL {
                return Ok(None);
            }
            next = reached * growth;
        }
        self.whole_from(&starts, work).map(Some)
    }

    /// The mode by which the response is surely lost over the whole record, at the estimates of this share of it.
    fn unstable(&self, fit: &Fit, starts: &[Vec<f64>], share: f64) -> Option<FreeResponse> {
        let Attempt { model, runs, .. } = *self.whole;
        let found = FreeResponse::of(model, runs, &fit.estimate, self.reached(fit, starts).first()?)?;
        found.is_surely_lost(runs, share).then_some(found)
    }

    /// The share of the record that has some cells for each unknown, and two samples at least.
    fn shortest(&self) -> f64 {
        let Attempt { model, runs, .. } = *self.whole;
        let unknowns = |runs: usize| {
            let params = model.definition().params.iter().filter(|p| !p.fixed);
            params.map(|p| if p.per_run { runs } else { 1 }).sum::<usize>()
        };
        let cells: usize = runs.iter().flat_map(|r| &r.measured).filter(|z| !z.is_nan()).count();
        let longest = runs.iter().map(Run::len).max().unwrap_or(0);
        let enough = (CELLS * unknowns(runs.len())) as f64 / cells.max(1) as f64;
        enough.max(2.0 / longest.max(2) as f64)
    }

    /// Whether nothing shorter than this share is left.
    fn is_shortest(&self, share: f64) -> bool {
        Length::Share(share).cut(self.whole.runs).iter().all(|run| run.len() <= 2)
    }

    /// Fits a record that is not the whole one, weakly pulled towards its start values.
    fn short(&mut self, runs: &[Run], starts: &[Vec<f64>]) -> Result<Fit, FitError> {
        let model = pulled(self.whole.model, starts);
        let given = &self.whole.options.options;
        let options = Options {
            tolerance: TOLERANCE.max(given.tolerance),
            iterations: ITERATIONS.min(given.iterations),
            colour: false,
            ..given.clone()
        };
        let options = FitOptions { options, ..self.whole.options.clone() };
        let fit = single_fit(&Attempt { model: &model, runs, starts, options: &options, work: self.whole.work })?;
        self.stages.push(LengthFit::new(runs, &fit));
        Ok(fit)
    }

    fn whole_from(mut self, starts: &[Vec<f64>], work: &Work<'_>) -> Result<Fit, FitError> {
        let fit = single_fit(&Attempt { starts, work, ..*self.whole })?;
        self.stages.push(LengthFit::new(self.whole.runs, &fit));
        Ok(Fit { by_length: self.stages, ..fit })
    }

    fn reached(&self, fit: &Fit, starts: &[Vec<f64>]) -> Vec<Vec<f64>> {
        Attempt { starts, ..*self.whole }.reached(&fit.estimate)
    }
}

/// The model with every shared free parameter expected within its own size of its start value, unless more is known.
fn pulled(model: &Model, starts: &[Vec<f64>]) -> Model {
    let mut params = model.definition().params.clone();
    let Some(first) = starts.first() else { return model.clone() };
    for (param, start) in params.iter_mut().zip(first) {
        let open = !param.fixed && !param.per_run && param.prior.is_none() && param.origin == Origin::Declared;
        if open && start.is_finite() && *start != 0.0 {
            param.prior = Some(Prior { mean: *start, deviation: start.abs() });
        }
    }
    model.with_params(params)
}

/// A model driven by records in the place of some of its states, and the runs that drive it.
pub(crate) struct Substitution {
    /// Names of the states.
    pub(crate) states: Vec<String>,
    model: Model,
    runs: Vec<Run>,
}

impl Substitution {
    /// Records in the place of the states that are named; `all` stands for every state that is measured.
    ///
    /// # Errors
    /// A state that the model does not have, that no output shows or that was not measured in some run.
    pub(crate) fn new(model: &Model, runs: &[Run], names: &[String]) -> Result<Self, StrategyError> {
        let states = &model.definition().states;
        if names.iter().any(|n| n == "all") {
            return Self::all(model, runs).ok_or(StrategyError::NothingMeasured);
        }
        let mut chosen = Vec::new();
        for name in names {
            let Some(k) = states.iter().position(|s| s.quantity.name == *name) else {
                let hint = nearest(name, states.iter().map(|s| s.quantity.name.as_str())).map(String::from);
                return Err(StrategyError::UnknownState { name: name.clone(), nearest: hint });
            };
            chosen.push(k);
        }
        chosen.sort_unstable();
        chosen.dedup();
        Self::of(model, runs, &chosen)
    }

    /// Records in the place of every state that is measured in all runs; none when there is no such state.
    pub(crate) fn all(model: &Model, runs: &[Run]) -> Option<Self> {
        let alone = |k: &usize| Self::of(model, runs, &[*k]).is_ok();
        let chosen: Vec<usize> = (0..model.layout().states).filter(alone).collect();
        if chosen.is_empty() { None } else { Self::of(model, runs, &chosen).ok() }
    }

    fn of(model: &Model, runs: &[Run], chosen: &[usize]) -> Result<Self, StrategyError> {
        let refused = |reason: String| StrategyError::NotMeasured { reason };
        let states = chosen.iter().map(|k| model.definition().states[*k].quantity.name.clone()).collect();
        let model = model.substituted(chosen).map_err(|e| refused(e.to_string()))?;
        let completed = runs.iter().map(|run| run.with_measured(model.definition()));
        let runs = completed.collect::<Result<_, _>>().map_err(|e| refused(e.to_string()))?;
        Ok(Self { states, model, runs })
    }

    /// Fits the substituted model and gives it with the start values of the full one that follow.
    ///
    /// # Errors
    /// As for [`fit`](crate::fit()).
    pub(crate) fn first_fit(&self, full: &Attempt<'_>) -> Result<(Fit, Vec<Vec<f64>>), FitError> {
        let inner = Options { colour: false, ..full.options.options.clone() };
        let options = FitOptions { options: inner, ..full.options.clone() };
        let first = Attempt { model: &self.model, runs: &self.runs, options: &options, ..*full };
        let fit = single_fit(&first)?;
        let starts = first.reached(&fit.estimate);
        Ok((fit, starts))
    }
}
