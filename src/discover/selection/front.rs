//! The front: the best model with each number of effects, as it is written, fitted plainly and simulated; and which one is recommended.
//!
//! Forward selection counts whitened log-likelihood, by which effects are found. What a user gets is the error of a simulation. So from
//! all accepted effects one after the other is left out, the one of which the written model misses least, and each of these models is
//! fitted as it is written. Recommended is the smallest whose squared error on the validation runs is within one standard error of the
//! best (Breiman et al. 1984), unless the likelihood of these runs by the noise found clearly speaks for the larger one.

use super::assessment::run_gains;
use super::elimination::{Accepted, rebuilt};
use super::error::DiagnosisError;
use super::fitted_model::{FittedModel, SplitFit, split_fit};
use super::predictor::responses;
use super::runs::{DiagnosisOptions, GoesOn, Runs};
use super::whitening::CommonNoise;
use super::written_model::{WrittenModel, squares, written_model};
use crate::bins::Signals;
use crate::diagnosis::{Cause, FrontModel, FrontOutput, Rejected};
use rayon::prelude::*;
use std::sync::Arc;

/// Effects up to which each is left out in turn; of more the weakest goes.
const EACH: usize = 4;
/// Parts of a validation run by which errors are compared.
const BLOCKS: usize = 8;
/// Deviations of a gain in log-likelihood on validation runs from which it is clear.
const CLEAR: f64 = 2.0;

/// What all models of a front have in common.
pub(super) struct FrontProblem<'a> {
    pub(super) first: &'a FittedModel,
    pub(super) runs: Runs<'a>,
    pub(super) noise: &'a CommonNoise,
    pub(super) options: &'a DiagnosisOptions,
    pub(super) goes_on: &'a GoesOn<'a>,
}

/// A model of the front.
pub(super) struct Level {
    pub(super) accepted: Vec<Accepted>,
    pub(super) current: Arc<FittedModel>,
    /// Its joint fit by the noise.
    pub(super) split: SplitFit,
    written: Result<WrittenModel, String>,
}

impl Level {
    fn objection(&self) -> Option<String> {
        match &self.written {
            Ok(written) => written.objection(),
            Err(why) => Some(why.clone()),
        }
    }

    fn ratio(&self) -> f64 {
        self.written.as_ref().map_or(f64::INFINITY, WrittenModel::ratio)
    }
}

/// What came of a front.
pub(super) struct Front {
    /// The recommended model with its text; none where none can be recommended.
    pub(super) recommended: Option<(Level, WrittenModel)>,
    /// All of them, for the table.
    pub(super) models: Vec<FrontModel>,
    /// Effects that are not recommended, and why.
    pub(super) rejected: Vec<Rejected>,
}

impl FrontProblem<'_> {
    fn level(&self, accepted: Vec<Accepted>, current: Arc<FittedModel>, split: SplitFit) -> Level {
        let written =
            written_model(&current, &split.theta, &self.first.response, (self.runs, self.options, self.goes_on));
        Level { accepted, current, split, written }
    }

    /// From the model with all accepted effects down to that with one.
    pub(super) fn front(
        &self,
        accepted: Vec<Accepted>,
        current: Arc<FittedModel>,
        split: SplitFit,
    ) -> Result<Front, DiagnosisError> {
        let mut levels = vec![self.level(accepted, current, split)];
        while let Some(last) = levels.last().filter(|l| l.accepted.len() > 1 && (self.goes_on)()) {
            let Some(next) = self.smaller(last) else { break };
            levels.push(next);
        }
        let chosen = self.chosen(&levels);
        let mut models = vec![self.described(None, None)];
        models.extend(levels.iter().enumerate().rev().map(|(k, level)| self.described(Some(level), Some(Some(k) == chosen))));
        let rejected = self.rejected(&levels, chosen);
        let recommended = chosen.map(|k| levels.swap_remove(k)).and_then(|mut level| {
            let written = std::mem::replace(&mut level.written, Err(String::new()));
            Some((level, written.ok()?))
        });
        Ok(Front { recommended, models, rejected })
    }

    /// The best model with one effect less.
    fn smaller(&self, level: &Level) -> Option<Level> {
        let count = level.accepted.len();
        let score = |k: &usize| level.accepted[*k].cause.score;
        let weakest = (0..count).min_by(|a, b| score(a).total_cmp(&score(b)))?;
        let tried: Vec<usize> = if count <= EACH { (0..count).collect() } else { vec![weakest] };
        let without = |k: &usize| -> Option<Level> {
            let mut accepted = level.accepted.clone();
            accepted.remove(*k);
            let effects: Vec<_> = accepted.iter().map(Accepted::written).collect();
            let (smaller, params) =
                rebuilt(self.first, &level.current, &level.split.theta, self.runs, &effects).ok()?;
            accepted.iter_mut().zip(params).for_each(|(a, params)| a.params = params);
            let split = split_fit(&smaller, self.runs, self.noise).ok()?;
            Some(self.level(accepted, Arc::new(smaller), split))
        };
        let found: Vec<Level> = tried.par_iter().filter_map(without).collect();
        found.into_iter().min_by(|a, b| {
            a.ratio().total_cmp(&b.ratio()).then(a.split.cost().total_cmp(&b.split.cost()))
        })
    }

    /// Which of them is recommended: they come with falling numbers of effects.
    fn chosen(&self, levels: &[Level]) -> Option<usize> {
        let sound = |k: &usize| levels[*k].objection().is_none();
        if self.runs.validation().is_empty() {
            // by likelihood every effect was worth its parameters
            return (0..levels.len()).find(sound);
        }
        let best = (0..levels.len()).filter(sound).min_by(|a, b| levels[*a].ratio().total_cmp(&levels[*b].ratio()))?;
        let as_good = |k: &usize| *k == best || (*k > best && self.is_as_good(&levels[*k], &levels[best]));
        (0..levels.len()).rev().filter(sound).find(as_good)
    }

    /// Whether a smaller model predicts validation runs as well as the best one.
    fn is_as_good(&self, smaller: &Level, best: &Level) -> bool {
        let (Ok(small), Ok(large)) = (&smaller.written, &best.written) else { return false };
        let (more, error) = self.difference(small, large);
        more <= error && !self.clearly_likelier(smaller, best)
    }

    /// By how much the squared error of one model is larger than that of another on validation runs, in units of the first model's, and
    /// the standard error of that, by blocks.
    fn difference(&self, one: &WrittenModel, other: &WrittenModel) -> (f64, f64) {
        let (runs, q) = (self.runs, self.first.outputs());
        let scale: Vec<f64> = squares(self.first, &self.first.response, runs, runs.train..runs.all.len())
            .into_iter()
            .map(|(sum, count)| (sum / count.max(1) as f64).max(f64::MIN_POSITIVE))
            .collect();
        let mut blocks = Vec::new();
        for r in runs.train..runs.all.len() {
            let measured = self.first.predictors[r].measured(&runs.all[r]);
            let (a, b) = (&one.fitted.response[r], &other.fitted.response[r]);
            let samples = measured.len() / q.max(1);
            let mut sums = vec![(0.0, 0); BLOCKS];
            for (k, z) in measured.iter().enumerate().filter(|(_, z)| !z.is_nan()) {
                let block = &mut sums[(k / q) * BLOCKS / samples.max(1)];
                block.0 += ((z - a[k]).powi(2) - (z - b[k]).powi(2)) / scale[k % q];
                block.1 += 1;
            }
            blocks.extend(sums.into_iter().filter(|b| b.1 > 0).map(|(sum, count)| sum / f64::from(count)));
        }
        let count = blocks.len().max(2) as f64;
        let mean = blocks.iter().sum::<f64>() / count;
        let variance = blocks.iter().map(|b| (b - mean).powi(2)).sum::<f64>() / (count - 1.0);
        (mean, (variance / count).sqrt())
    }

    /// Whether validation runs are clearly likelier by the larger model, by the noise found.
    fn clearly_likelier(&self, smaller: &Level, best: &Level) -> bool {
        let of = |l: &Level| responses(&l.current.model, self.runs.all, &l.current.predictors, &l.split.theta);
        let (Some(small), Some(large)) = (of(smaller), of(best)) else { return false };
        self.gains_on_validation((&small, &large)).is_some_and(|(gain, deviation)| gain > CLEAR * deviation)
    }

    /// Gain in log-likelihood on all validation runs from one response to another, with its deviation; none without such runs.
    fn gains_on_validation(&self, responses: (&[Signals], &[Signals])) -> Option<(f64, f64)> {
        let gains = run_gains(self.runs.all, self.runs.train, &self.first.predictors, responses, self.noise);
        let validation = gains.iter().filter(|g| g.validation);
        let (gain, square) = validation.fold((0.0, 0.0), |(gain, square), g| (gain + g.gain, square + g.deviation.powi(2)));
        (!self.runs.validation().is_empty()).then_some((gain, square.sqrt()))
    }

    /// Whether accepted effects clearly gain on validation runs: no disturbance explains that, as it has another course in every run.
    pub(super) fn is_confirmed(&self, old: &[Signals], new: &[Signals]) -> bool {
        self.gains_on_validation((old, new)).is_some_and(|(gain, deviation)| gain > CLEAR * deviation)
    }

    /// For the table: a level, or the model as it was given.
    fn described(&self, level: Option<&Level>, recommended: Option<bool>) -> FrontModel {
        let written = level.map(|l| l.written.as_ref().ok());
        // a model that has no response has no errors either
        let fitted = match written {
            None => Some((self.first, 1.0, Some(1.0))),
            Some(written) => written.map(|w| (&w.fitted, w.training, w.validation)),
        };
        let (train, all) = (self.runs.train, self.runs.all.len());
        let rms = |sums: Option<&Vec<(f64, usize)>>, o: usize| {
            sums.map(|s| s[o]).filter(|(_, count)| *count > 0).map(|(sum, count)| (sum / count as f64).sqrt())
        };
        let of = |judged: std::ops::Range<usize>| {
            let own = fitted.as_ref().filter(|_| !judged.is_empty())?;
            Some(squares(own.0, &own.0.response, self.runs, judged))
        };
        let (training, validation) = (of(0..train), of(train..all));
        let outputs = self.first.model.definition().outputs.iter().enumerate();
        let outputs = outputs.map(|(o, output)| FrontOutput {
            output: output.quantity.name.clone(),
            unit: output.quantity.unit.as_ref().map(ToString::to_string),
            rms_training: rms(training.as_ref(), o),
            rms_validation: rms(validation.as_ref(), o),
        });
        FrontModel {
            effects: level.map_or(Vec::new(), |l| l.accepted.iter().map(|a| a.cause.place.clone()).collect()),
            parameters: level.map_or(0, |l| l.accepted.iter().map(Accepted::cost).sum()),
            error_training: fitted.as_ref().map_or(f64::NAN, |f| f.1.sqrt()),
            error_validation: fitted.as_ref().and_then(|f| f.2).filter(|_| train < all).map(f64::sqrt),
            outputs: outputs.collect(),
            recommended: recommended.unwrap_or(false),
            objection: level.and_then(Level::objection),
        }
    }

    /// Every effect that a larger model has and the recommended one has not.
    fn rejected(&self, levels: &[Level], chosen: Option<usize>) -> Vec<Rejected> {
        let kept = |a: &Accepted| chosen.is_some_and(|k| levels[k].accepted.iter().any(|b| b.cause.place == a.cause.place));
        let mut list = Vec::new();
        for (k, a) in levels[0].accepted.iter().enumerate().filter(|(_, a)| !kept(a)) {
            // the smallest model that still had it says why
            let last = levels.iter().rev().find(|l| l.accepted.iter().any(|b| b.cause.place == a.cause.place));
            let reason = last.and_then(Level::objection).unwrap_or_else(|| {
                "without it the written model predicts validation runs as well, within one standard error".into()
            });
            let Cause { place, gain_training, gain_validation, .. } = a.cause.clone();
            list.push(Rejected { place, step: k + 1, gain_training, gain_validation, reason });
        }
        list
    }
}
