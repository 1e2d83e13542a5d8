//! The front: the best model with each number of effects, as it is written, fitted plainly and simulated; and which one is recommended.
//!
//! Forward selection counts whitened log-likelihood, by which effects are found. What a user gets is the error of a simulation. So from
//! all accepted effects one after the other is left out, the one of which the written model misses least, and each of these models is
//! fitted as it is written. They are compared by what they predict of runs that they were not fitted to: validation runs; without such
//! runs each run by a fit to the others; of a single run its last third by a fit to the rest.
//!
//! Recommended is the smallest model that predicts as well as the best, within one standard error of the difference of squared errors (the
//! one-standard-error rule, Breiman et al. 1984; Diebold & Mariano 1995). What runs that were not fitted make clearly likelier stays all
//! the same. So does a mechanism or an effect of a sensor which plain errors do not contradict. If its effect d on the prediction is right,
//! the squared error falls by the sum of d^2 on average. Where the fall is within two standard errors of that sum, plain errors cannot say
//! that it is not there, and the likelihood has said that it is. (With a loss of one standard error a small effect that is right would be
//! refused in a sixth of all cases: slow noise of the validation run decides.) But no likelier model is recommended whose prediction has a squared
//! error larger by a tenth: where a single short run is predicted, two standard errors may be all of it.
//!
//! What predicts validation runs worse than the model as it was given is never recommended; nor what predicts parts of the runs, by fits to the
//! others, worse by more than two standard errors. (By one, a delay of 205 nats in resonant noise was refused: fits by plain errors to parts of
//! the runs move about, and the likelihood has said that it is there.)
//!
//! Physics first: a set with a stand-in in it is recommended only where it predicts better than the best set without, by more than one standard
//! error of the difference, and is likelier with all penalties counted; a set with an effect of a sensor beside mechanisms where it is likelier
//! than the best set of mechanisms.

use super::acceptance::below_null;
use super::all_samples::AllSamples;
use super::assessment::LikelihoodGain;
use super::comparison::EQUAL;
use super::elimination::{Accepted, rebuilt, revise};
use super::error::DiagnosisError;
use super::fitted_model::{FittedModel, SplitFit, split_fit, split_fit_within};
use super::fitting::NOTHING;
use super::free_motion::{Repeated, repeated_in_the_end};
use super::initial_fit::{Thoroughness, plain_fit};
use super::law_curve::LawModel;
use super::predictor::Predictor;
use super::runs::{DiagnosisOptions, Domain, Runs};
use super::shortlist::likelihood_as_noise;
use super::whitening::CommonNoise;
use super::written_model::{WrittenModel, larger, squares, written_model};
use crate::bins::Signals;
use crate::diagnosis::{Cause, EffectAt, FrontModel, FrontOutput, Rejected};
use crate::disturbance::BELIEVED;
use fdm_effects::NewParam;
use fdm_estimate::Work;
use fdm_estimate::residuals::{Advantage, advantage};
use fdm_grammar::syntax::Class;
use fdm_numeric::parallel;
use fdm_system::record::Run;
use std::cell::OnceCell;
use std::sync::Arc;

/// Parts into which runs are divided, each predicted by a fit to the others.
const FOLDS: usize = 3;
/// Effects up to which each is left out in turn; of more the weakest goes.
const EACH: usize = 4;
/// Of them those that are fitted plainly, the likeliest by the joint fit; others only where all of these fail.
const FITTED: usize = 2;
/// Most changes of a model of two effects.
const REVISIONS: usize = 4;
/// Part of the squared error below which an improvement by a stand-in is of no use, however significant.
const USELESS: f64 = 0.02;
/// Standard errors beyond which plain errors contradict an effect.
const CONTRADICTED: f64 = 2.0;
/// Part by which the squared error of a prediction may be larger at most, however little is independent in it.
const BEARABLE: f64 = 0.1;
/// Deviations of a gain in log-likelihood on validation runs from which it is clear.
const CLEAR: f64 = 2.0;

/// What all models of a front have in common.
pub(super) struct FrontProblem<'a> {
    pub(super) first: &'a FittedModel,
    pub(super) runs: Runs<'a>,
    pub(super) noise: &'a CommonNoise,
    pub(super) options: &'a DiagnosisOptions,
    pub(super) work: &'a Work<'a>,
    /// All samples, where `runs` are a part of them.
    pub(super) all: Option<AllSamples<'a>>,
}

/// Where a search ended.
pub(super) struct SearchPath {
    pub(super) accepted: Vec<Accepted>,
    pub(super) current: Arc<FittedModel>,
    /// The joint fit of all its effects.
    pub(super) split: SplitFit,
    /// Whether it is another model that a search might have taken, and no search went on from it.
    pub(super) aside: bool,
}

/// A model of the front.
pub(super) struct Level {
    /// The search that it comes from, by its place.
    pub(super) path: usize,
    /// Whether no search went on from it.
    aside: bool,
    pub(super) accepted: Vec<Accepted>,
    pub(super) current: Arc<FittedModel>,
    /// Its joint fit by the noise.
    pub(super) split: SplitFit,
    written: Result<WrittenModel, String>,
    /// The written model over all samples, where the search compares a part of them.
    pub(super) over_all: Option<Result<WrittenModel, String>>,
    /// What a stand-in among its effects says once more of the free motion of the model as it was given.
    repeats: Option<Repeated>,
    /// What it predicts.
    predicted: Option<Predicted>,
    /// Squared error of that over that of the model as it was given; none where nothing was predicted, or a fit to a part of the runs predicts the
    /// others no worse than chance would.
    error: Option<f64>,
}

/// What a model leaves of runs that it was not fitted to.
type Predicted = Vec<Piece>;

/// A run, or the end of one.
struct Piece {
    run: usize,
    /// Its first sample.
    from: usize,
    /// What is left, N by q.
    residual: Vec<f64>,
}

/// How a model is fitted to a part of the runs.
#[derive(Clone, Copy)]
enum FoldFit {
    /// As `fit` would, by output error.
    Plain(Thoroughness),
    /// Jointly, by the noise found.
    ByNoise,
}

/// What models are compared by.
struct Prediction {
    /// Of the model as it was given.
    naive: Predicted,
    /// Whether it is no prediction, but what is left of the runs that were fitted.
    fitted: bool,
}

impl Level {
    fn objection(&self) -> Option<String> {
        if let Some(Err(why)) = &self.over_all {
            return Some(why.clone());
        }
        match self.shown() {
            Ok(written) => written.objection().or_else(|| {
                let repeats = || self.repeats.map(Repeated::sentence);
                written.against_physics(&self.accepted).or_else(repeats).or_else(|| worse(self.error))
            }),
            Err(why) => Some(why.clone()),
        }
    }

    /// What is told of it: over all samples where it is known there.
    fn shown(&self) -> &Result<WrittenModel, String> {
        match &self.over_all {
            Some(over_all @ Ok(_)) => over_all,
            _ => &self.written,
        }
    }

    /// Whether one of its effects is of a class.
    fn has(&self, class: Class) -> bool {
        self.accepted.iter().any(|a| a.candidate.effect().class() == class)
    }

    fn holds(&self, effect: &Accepted) -> bool {
        self.accepted.iter().any(|own| own.cause.place == effect.cause.place)
    }

    /// Whether it is another one with mechanisms or effects of sensors beside what that has.
    fn has_more_physics_than(&self, other: &Self) -> bool {
        let more = |own: &&Accepted| !other.holds(own);
        self.size() > other.size()
            && other.accepted.iter().all(|effect| self.holds(effect))
            && self.accepted.iter().filter(more).all(|own| own.candidate.effect().class() != Class::StandIn)
    }

    /// Parameters that its effects bring.
    fn size(&self) -> usize {
        self.accepted.iter().map(Accepted::cost).sum()
    }

    /// Minus the log-likelihood on all runs, with the penalties of its effects.
    fn total(&self) -> f64 {
        self.split.cost() + self.accepted.iter().map(Accepted::penalty).sum::<f64>()
    }

    /// Its effects, in an order that is that of any search.
    fn places(&self) -> Vec<&EffectAt> {
        let mut places: Vec<&EffectAt> = self.accepted.iter().map(|a| &a.cause.place).collect();
        places.sort();
        places
    }

    fn ratio(&self) -> f64 {
        self.written.as_ref().map_or(f64::INFINITY, WrittenModel::ratio)
    }
}

/// That a model predicts worse than the one that was given, by its squared error as a part of that one's; none where it does not.
fn worse(error: Option<f64>) -> Option<String> {
    let percent = larger(error?)?;
    Some(format!("its prediction of runs that it was not fitted to is {percent:.1} % worse than without it"))
}

/// A model of the front as the table tells of it.
struct Told<'a> {
    effects: Vec<EffectAt>,
    parameters: usize,
    fitted: Option<Shown<'a>>,
    /// Squared error of the prediction of runs that were not fitted, the same part; without validation runs.
    predicted: Option<f64>,
    recommended: bool,
    objection: Option<String>,
}

/// A model and the runs it is told of.
struct Shown<'a> {
    fitted: &'a FittedModel,
    runs: Runs<'a>,
    /// Its squared errors on training and on validation runs, as parts of those of the model as it was given.
    training: f64,
    validation: Option<f64>,
}

/// What came of a front.
pub(super) struct Front {
    /// The recommended model with its text; none where none can be recommended.
    pub(super) recommended: Option<(Level, WrittenModel)>,
    /// All of them, for the table.
    pub(super) models: Vec<FrontModel>,
    /// Effects that are not recommended, and why.
    pub(super) rejected: Vec<Rejected>,
    /// Whether runs that were not fitted are clearly likelier with the recommended effects. No disturbance does that: it has another course
    /// in every run.
    pub(super) confirmed: bool,
}

impl FrontProblem<'_> {
    fn level(&self, path: usize, accepted: Vec<Accepted>, current: Arc<FittedModel>, split: SplitFit) -> Level {
        let (aside, written) = (false, Err(String::new()));
        let (over_all, repeats, predicted, error) = (None, None, None, None);
        let mut level = Level { path, aside, accepted, current, split, written, over_all, repeats, predicted, error };
        level.written = self.written(&level, Thoroughness::Near);
        if let Some(split) = self.likelier_at_the_plain_fit(&level) {
            level.split = split;
        }
        if let Some(split) = self.with_the_sign_of_physics(&level) {
            level.split = split;
        }
        if level.has(Class::StandIn) {
            level.repeats = repeated_in_the_end(
                self.runs.train(),
                (&self.first.model, self.first.theta.first().map_or(&[], |theta| &theta[..])),
                (&level.current.model, level.split.theta.first().map_or(&[], |theta| &theta[..])),
            );
        }
        level
    }

    /// The joint fit from the values of the plain one, where these are likelier than where it had ended: in another minimum.
    fn likelier_at_the_plain_fit(&self, level: &Level) -> Option<SplitFit> {
        let plain = &level.written.as_ref().ok().filter(|_| *self.runs.domain == Domain::Time)?.fitted;
        let there = split_fit_within(plain, self.runs, self.noise, (0, NOTHING)).ok()?;
        let likelier = there.cost() < level.split.cost();
        likelier.then(|| split_fit(plain, self.runs, self.noise).ok()).flatten()
    }

    /// A model at the values of its plain fit, where these have the sign that physics has and the joint ones have not: the error of the model as it
    /// was given may be told as noise.
    fn with_the_sign_of_physics(&self, level: &Level) -> Option<SplitFit> {
        let written = level.written.as_ref().ok()?;
        let opposite = |model: &FittedModel, theta: &[f64]| {
            let value = |p: &NewParam| model.model.definition().param(&p.name).map(|k| theta[k]);
            level.accepted.iter().any(|a| below_null(&a.params, value).is_some())
        };
        let plain = &written.fitted;
        let joint = opposite(&level.current, level.split.theta.first()?) && !opposite(plain, plain.theta.first()?);
        let at = joint.then(|| split_fit_within(plain, self.runs, self.noise, (0, NOTHING)))?;
        at.ok()
    }

    fn written(&self, level: &Level, thoroughness: Thoroughness) -> Result<WrittenModel, String> {
        let asked = (self.runs, self.options, self.work);
        written_model(&level.current, &level.split.theta, &self.first.response, asked, thoroughness)
    }

    /// From the models with all effects that searches accepted down to those with one.
    pub(super) fn front(&self, paths: Vec<SearchPath>) -> Result<Front, DiagnosisError> {
        let mut levels: Vec<Level> = Vec::new();
        for (k, path) in paths.into_iter().enumerate() {
            let mut next = Some(self.level(k, path.accepted, path.current, path.split));
            next.iter_mut().for_each(|level| level.aside = path.aside);
            while let Some(level) = next {
                if levels.iter().any(|l| l.places() == level.places()) {
                    // another search has come to the same effects
                    break;
                }
                next = if level.accepted.len() > 1 && !level.aside && self.work.goes_on() {
                    self.smaller(&level)
                } else {
                    None
                };
                levels.push(level);
            }
        }
        levels.sort_by(|a, b| b.size().cmp(&a.size()).then(a.path.cmp(&b.path)));
        // where no step from the joint estimates helps, whatever a fit would do
        for level in levels.iter_mut().filter(|l| l.written.is_err()) {
            level.written = self.written(level, Thoroughness::Whole);
        }
        let naive = self.predictions(&mut levels);
        let mut chosen = self.chosen(&levels, &naive.naive);
        // what is recommended can be fitted as it is written
        while let Some(k) = chosen.filter(|_| *self.runs.domain == Domain::Time && self.work.goes_on()) {
            let from = levels[k].written.as_ref().map_or(Vec::new(), |written| written.fitted.theta.clone());
            let asked = (self.runs, self.options, self.work);
            let again = written_model(&levels[k].current, &from, &self.first.response, asked, Thoroughness::Once);
            let again = again.or_else(|_| self.written(&levels[k], Thoroughness::Whole));
            levels[k].written = again;
            if let Some(all) = self.all.as_ref().filter(|_| levels[k].objection().is_none()) {
                levels[k].over_all = levels[k].written.as_ref().ok().map(|written| all.fitted_to(written));
            }
            if levels[k].objection().is_none() {
                break;
            }
            chosen = self.chosen(&levels, &naive.naive);
        }
        if let Some(all) = self.all.as_ref() {
            let open = levels.iter_mut().filter(|level| level.over_all.is_none());
            parallel::each(open, |level| {
                if self.work.goes_on() {
                    level.over_all = level.written.as_ref().ok().map(|written| all.told_of(written));
                }
            });
        }
        let told_of = Some(&naive).filter(|n| !n.fitted).map(|n| &n.naive);
        let mut models = vec![self.described(None, false, told_of)];
        let told = levels.iter().enumerate().rev().filter(|(k, level)| {
            let error = |l: &Level| l.predicted.as_ref().map_or(f64::INFINITY, |p| self.relative(p, &naive.naive));
            // what no search went on from is told where it is the best of its size
            let better = |other: &Level| !other.aside && other.size() == level.size() && error(other) <= error(level);
            Some(*k) == chosen || !level.aside || (level.objection().is_none() && !levels.iter().any(better))
        });
        models.extend(told.map(|(k, level)| self.described(Some(level), Some(k) == chosen, told_of)));
        let rejected = self.rejected(&levels, chosen, &naive.naive);
        let predicted = chosen.and_then(|k| levels[k].predicted.as_ref()).filter(|_| !naive.fitted);
        let confirmed = predicted.is_some_and(|large| self.clearly_likelier(large, &naive.naive));
        let recommended = chosen.map(|k| levels.swap_remove(k)).and_then(|mut level| {
            let written = std::mem::replace(&mut level.written, Err(String::new()));
            Some((level, written.ok()?))
        });
        Ok(Front { recommended, models, rejected, confirmed })
    }

    /// What each of them predicts, and the model as it was given: without any run or part that could be predicted, what they leave of
    /// the runs that they were fitted to.
    fn predictions(&self, levels: &mut [Level]) -> Prediction {
        let of = |l: &Level| match &l.written {
            Ok(written) => {
                let fitted = &written.fitted;
                self.predicted(&l.current, (fitted, &fitted.theta), FoldFit::Plain(Thoroughness::Near))
            }
            Err(_) => None,
        };
        if let Some(naive) = self.predicted_as_given() {
            let found: Vec<Option<Predicted>> = levels.iter().map(of).collect();
            if levels.iter().zip(&found).all(|(level, found)| found.is_some() || level.objection().is_some()) {
                let validated = !self.runs.validation().is_empty();
                let jointly = OnceCell::new();
                for (level, found) in levels.iter_mut().zip(found) {
                    // a fit to a part of the runs predicts the rest by chance a little better or worse
                    let clearly = |found: &&Predicted| {
                        self.is_clearly_worse(found, &naive) && self.is_worse_by_joint_fits(level, &jointly)
                    };
                    let told = found.as_ref().filter(|found| validated || clearly(found));
                    level.error = told.map(|found| self.relative(found, &naive));
                    level.predicted = found;
                }
                return Prediction { naive, fitted: false };
            }
        }
        let left = |model: &FittedModel| -> Predicted {
            (0..self.runs.train).map(|r| self.piece(model, self.runs.all, (r, r), 0)).collect()
        };
        for level in levels {
            level.predicted = level.written.as_ref().ok().map(|written| left(&written.fitted));
        }
        Prediction { naive: left(self.first), fitted: true }
    }

    /// Whether something predicts worse than the model as it was given, by so many standard errors that it is contradicted; also where too little
    /// is independent to tell.
    fn is_clearly_worse(&self, predicted: &Predicted, naive: &Predicted) -> bool {
        self.advantage(predicted, naive, naive).is_none_or(|gained| gained.reduction < -CONTRADICTED * gained.error)
    }

    /// Whether joint fits to parts of the runs predict worse than the model as it was given, the errors as plain: in a
    /// noise of narrow bands plain fits to parts move about, and by so much that a delay of 15 nats seems to be
    /// contradicted by three standard errors. Yes where there are no such fits. The second holds what the model as it
    /// was given predicts so.
    fn is_worse_by_joint_fits(&self, level: &Level, given: &OnceCell<Option<Predicted>>) -> bool {
        let of = |model: &FittedModel, theta: &[Vec<f64>]| self.predicted(model, (model, theta), FoldFit::ByNoise);
        let Some(naive) = given.get_or_init(|| of(self.first, &self.first.theta)) else { return true };
        let own = of(&level.current, &level.split.theta);
        own.is_none_or(|own| self.is_clearly_worse(&own, naive))
    }

    /// The best model with one effect less.
    fn smaller(&self, level: &Level) -> Option<Level> {
        let count = level.accepted.len();
        let score = |k: &usize| level.accepted[*k].cause.score;
        let weakest = (0..count).min_by(|a, b| score(a).total_cmp(&score(b)))?;
        let tried: Vec<usize> = if count <= EACH { (0..count).collect() } else { vec![weakest] };
        let without = |k: &usize| -> Option<(Vec<Accepted>, FittedModel, SplitFit)> {
            let mut accepted = level.accepted.clone();
            accepted.remove(*k);
            self.rebuilt_with(level, accepted)
        };
        let mut found: Vec<_> = parallel::filter_map(tried.iter(), without);
        found.sort_by(|a, b| a.2.cost().total_cmp(&b.2.cost()));
        // a plain fit of a model that lacks what matters most may wander for long
        let mut best: Option<Level> = None;
        while best.as_ref().is_none_or(|level| level.written.is_err()) && !found.is_empty() {
            let some: Vec<_> = found.drain(..found.len().min(FITTED)).collect();
            let path = level.path;
            let levels = parallel::map(some, |(a, current, split)| self.level(path, a, Arc::new(current), split));
            let order =
                |a: &Level, b: &Level| a.ratio().total_cmp(&b.ratio()).then(a.split.cost().total_cmp(&b.split.cost()));
            best = best.into_iter().chain(levels).min_by(order);
        }
        best.map(|level| self.revised(level))
    }

    /// A model of two effects, each revised beside the other until neither changes: among more effects others had shared its part.
    fn revised(&self, level: Level) -> Level {
        let mut level = level;
        for _ in 0..REVISIONS {
            let Some(other) = self.first_revised(&level) else { break };
            level = self.turned(&other).unwrap_or(other);
        }
        level
    }

    /// The model with another effect in the place of the first of two, where that is likelier beside the second and leaves less.
    fn first_revised(&self, level: &Level) -> Option<Level> {
        if level.accepted.len() != 2 {
            return None;
        }
        let mut accepted = level.accepted.clone();
        let current = revise(Arc::clone(&level.current), self.first, self.runs, self.noise, &mut accepted).ok()?;
        if accepted[0].cause.place == level.accepted[0].cause.place {
            return None;
        }
        let split = split_fit(&current, self.runs, self.noise).ok()?;
        let other = self.level(level.path, accepted, current, split);
        Some(other).filter(|other| other.ratio() < level.ratio())
    }

    /// A model with its effects in the other order.
    fn turned(&self, level: &Level) -> Option<Level> {
        let mut accepted = level.accepted.clone();
        accepted.reverse();
        let (accepted, current, split) = self.rebuilt_with(level, accepted)?;
        Some(self.level(level.path, accepted, Arc::new(current), split))
    }

    /// Some of the effects of a model, fitted jointly from its values.
    fn rebuilt_with(
        &self,
        level: &Level,
        mut accepted: Vec<Accepted>,
    ) -> Option<(Vec<Accepted>, FittedModel, SplitFit)> {
        let effects: Vec<_> = accepted.iter().map(|a| a.written_at(&level.split.fitting)).collect();
        let (model, params) = rebuilt(self.first, &level.current, &level.split.theta, self.runs, &effects).ok()?;
        accepted.iter_mut().zip(params).for_each(|(a, params)| a.params = params);
        let split = split_fit(&model, self.runs, self.noise).ok()?;
        Some((accepted, model, split))
    }

    /// Which of them is recommended: they come with falling numbers of parameters.
    fn chosen(&self, levels: &[Level], naive: &Predicted) -> Option<usize> {
        let Some(any) = self.chosen_of(levels, naive, |level| !level.aside) else {
            return self.chosen_of(levels, naive, |level| level.aside);
        };
        let stands_in = |level: &Level| level.has(Class::StandIn);
        let physical = |level: &Level| !stands_in(level) && !level.aside;
        let mechanisms = |level: &Level| physical(level) && !level.has(Class::Sensor);
        let mut chosen = any;
        if stands_in(&levels[any])
            && let Some(other) = self.chosen_of(levels, naive, physical)
            && !self.is_better_physics(&levels[any], &levels[other], naive)
        {
            chosen = other;
        }
        if levels[chosen].has(Class::Sensor)
            && levels[chosen].has(Class::Mechanism)
            && let Some(other) = self.chosen_of(levels, naive, mechanisms)
            && levels[other].total() < levels[chosen].total()
        {
            chosen = other;
        }
        // what a search passed over is a smaller model that predicts as well, one that predicts clearly better, or one of the same size that
        // leaves less, predicts better, and leaves what is likelier as noise: the noise found may be what the other one leaves
        for k in (0..levels.len()).rev().filter(|k| levels[*k].aside && levels[*k].objection().is_none()) {
            let (own, other) = (&levels[k], &levels[chosen]);
            let (Some(a), Some(b)) = (&own.predicted, &other.predicted) else { continue };
            let smaller = own.size() < other.size() && self.is_as_good(own, other, naive);
            let clear = |gained: Advantage| gained.reduction > (CLEAR * gained.error).max(USELESS);
            let better = own.size() <= other.size() && self.advantage(a, b, naive).is_some_and(clear);
            let less = |own: f64, other: f64| own < (1.0 - USELESS) * other;
            let leaves_less = own.size() == other.size()
                && less(own.ratio(), other.ratio())
                && less(self.relative(a, naive), self.relative(b, naive))
                && self.likelihood_as_noise(own) > self.likelihood_as_noise(other) + BELIEVED;
            if smaller || better || leaves_less {
                chosen = k;
            }
        }
        // a set may have chosen what begins it, and come to nothing: alone the likeliest is named, of equals the first, unless plain errors
        // contradict it
        let likelier = |k: &usize| {
            let (own, other) = (&levels[*k], &levels[chosen]);
            let (Some(a), Some(b)) = (&own.predicted, &other.predicted) else { return false };
            own.aside
                && own.objection().is_none()
                && own.size() <= other.size()
                && own.total() < other.total() - BELIEVED
                && !self.contradicted(a, b, naive)
        };
        let likelier: Vec<usize> = (0..levels.len()).filter(likelier).collect();
        let least = likelier.iter().map(|k| levels[*k].total()).fold(f64::INFINITY, f64::min);
        Some(likelier.into_iter().find(|k| levels[*k].total() <= least + EQUAL).unwrap_or(chosen))
    }

    /// How likely it is that what a written model leaves is noise, of any smooth spectrum.
    fn likelihood_as_noise(&self, level: &Level) -> f64 {
        let Ok(WrittenModel { fitted, .. }) = &level.written else { return f64::NEG_INFINITY };
        let of = |((run, predictor), y): ((&Run, &Predictor), &Signals)| predictor.left_by(run, y);
        let runs = self.runs.train();
        let left: Vec<Signals> = runs.iter().zip(&fitted.predictors).zip(&fitted.response).map(of).collect();
        likelihood_as_noise(fitted, runs, self.noise.growths(), &left)
    }

    /// The model that is chosen among those that are of a kind.
    fn chosen_of(&self, levels: &[Level], naive: &Predicted, is: impl Fn(&Level) -> bool) -> Option<usize> {
        let sound = |k: &usize| is(&levels[*k]) && levels[*k].objection().is_none();
        let error = |k: &usize| levels[*k].predicted.as_ref().map_or(f64::INFINITY, |p| self.relative(p, naive));
        let best = (0..levels.len()).filter(sound).min_by(|a, b| error(a).total_cmp(&error(b)))?;
        // the likeliest of those that hold more of what a search accepted, where plain errors do not contradict it
        let more = |k: &usize| {
            let (own, least) = (&levels[*k], &levels[best]);
            own.has_more_physics_than(least)
                && own.total() < least.total() - BELIEVED
                && !self.is_as_good(least, own, naive)
        };
        let likeliest = (0..levels.len()).filter(sound).filter(more);
        let best = likeliest.min_by(|a, b| levels[*a].total().total_cmp(&levels[*b].total())).unwrap_or(best);
        let as_good = |k: &usize| {
            let smaller = levels[*k].size() < levels[best].size();
            *k == best || (smaller && self.is_as_good(&levels[*k], &levels[best], naive))
        };
        (0..levels.len()).rev().filter(sound).find(as_good)
    }

    /// Whether a set with a stand-in is more than a likeness of one without: it predicts better by more than one standard error, and is
    /// likelier, penalties included.
    fn is_better_physics(&self, stand_in: &Level, other: &Level, naive: &Predicted) -> bool {
        let (Some(own), Some(others)) = (&stand_in.predicted, &other.predicted) else { return false };
        self.is_clearly_better(own, others, naive) && stand_in.total() < other.total()
    }

    /// Whether a prediction with a stand-in is better than one without by more than one standard error of the difference.
    fn is_clearly_better(&self, own: &Predicted, others: &Predicted, naive: &Predicted) -> bool {
        match self.advantage(own, others, naive) {
            Some(gained) => gained.reduction > gained.error.max(USELESS),
            // too little is independent to tell
            None => self.relative(own, naive) < self.relative(others, naive),
        }
    }

    /// Whether one of two written models, each with what it was fitted from, predicts better by more than one standard
    /// error of the difference.
    pub(super) fn predicts_better(
        &self,
        own: (&FittedModel, &FittedModel),
        other: (&FittedModel, &FittedModel),
    ) -> bool {
        let of = |(current, written): (&FittedModel, &FittedModel)| {
            self.predicted(current, (written, &written.theta), FoldFit::Plain(Thoroughness::Once))
        };
        let (own, other) = (of(own), of(other));
        let (Some(own), Some(other), Some(naive)) = (own, other, self.predicted_as_given()) else { return false };
        self.is_clearly_better(&own, &other, &naive)
    }

    /// Whether a prediction speaks against a likelier model: it is worse than another by two standard errors or by a tenth.
    fn contradicted(&self, own: &Predicted, other: &Predicted, naive: &Predicted) -> bool {
        let worse = self.relative(own, naive) > (1.0 + BEARABLE) * self.relative(other, naive);
        let clearly = |gained: Advantage| gained.reduction < -CONTRADICTED * gained.error;
        worse || self.advantage(own, other, naive).is_some_and(clearly)
    }

    /// Whether a smaller model predicts as well as the best one.
    fn is_as_good(&self, smaller: &Level, best: &Level, naive: &Predicted) -> bool {
        let (Some(small), Some(large)) = (&smaller.predicted, &best.predicted) else { return false };
        let Some(gained) = self.advantage(large, small, naive) else { return self.contradicted(large, small, naive) };
        let mut without = best.accepted.iter().filter(|a| !smaller.holds(a));
        let physical = without.any(|a| a.candidate.effect().class() != Class::StandIn);
        let least = if physical { gained.error } else { gained.error.max(USELESS) };
        if gained.reduction > least || self.clearly_likelier(large, small) {
            return false;
        }
        let expected = self.expected(large, small, naive);
        let missing = gained.reduction < expected - CONTRADICTED * gained.error;
        missing || !physical || self.contradicted(large, small, naive)
    }

    /// By how much the squared error of a larger model's prediction would be less if what it adds were right: the mean square of that, in
    /// the part of the smaller model's error.
    fn expected(&self, large: &Predicted, small: &Predicted, naive: &Predicted) -> f64 {
        let scale = self.mean_squares(naive);
        let q = self.first.outputs();
        let (mut added, mut whole) = (0.0, 0.0);
        for large in large {
            let Some(small) = small.iter().find(|p| p.run == large.run) else { continue };
            for (k, (l, s)) in large.residual.iter().zip(&small.residual).enumerate() {
                if scale[k % q] > 0.0 && !l.is_nan() && !s.is_nan() {
                    added += (s - l).powi(2) / scale[k % q];
                    whole += s * s / scale[k % q];
                }
            }
        }
        if whole > 0.0 { added / whole } else { 0.0 }
    }

    /// Whether runs that were not fitted are clearly likelier by the larger model, by the noise found. A part of a run that was fitted is no
    /// such run.
    fn clearly_likelier(&self, large: &Predicted, small: &Predicted) -> bool {
        let whole = |piece: &&Piece| piece.from == 0 && self.runs.all.len() > 1;
        let (mut gain, mut variance) = (0.0, 0.0);
        for large in large.iter().filter(whole) {
            let Some(small) = small.iter().find(|p| p.run == large.run) else { continue };
            let noise = if large.run < self.runs.train { self.noise } else { self.noise.for_validation() };
            let (run, q) = (&self.runs.all[large.run], self.first.outputs());
            let mut whitener = self.first.predictors[large.run].whitener(run, q, noise);
            let (a, b) = (whitener.whitened(&small.residual), whitener.whitened(&large.residual));
            let own = LikelihoodGain::new(&a, &b);
            gain += own.gain;
            variance += own.variance;
        }
        gain > CLEAR * variance.sqrt()
    }

    /// The curve of a law in the text of the model as it was given, for the table.
    pub(super) fn law(&self, law: &LawModel) -> FrontModel {
        let (fitted, asked) = (&law.written.fitted, FoldFit::Plain(Thoroughness::Once));
        let predicted = self.predicted(&law.current, (fitted, &fitted.theta), asked);
        let error = self.predicted_as_given().zip(predicted).map(|(naive, own)| self.relative(&own, &naive));
        let over_all = self.all.as_ref().and_then(|all| all.told_of(&law.written).ok());
        let written = over_all.as_ref().unwrap_or(&law.written);
        let objection = written.objection().or_else(|| worse(error));
        self.told(Told {
            effects: vec![law.place.clone()],
            parameters: law.parameters,
            fitted: Some(self.shown(written, over_all.is_some())),
            predicted: error.filter(|_| self.runs.validation().is_empty()),
            recommended: false,
            objection,
        })
    }

    /// The model as it was given, for the table.
    pub(super) fn given(&self) -> FrontModel {
        self.described(None, false, None)
    }

    /// What the model as it was given predicts of runs that it was not fitted to; none where that cannot be had.
    fn predicted_as_given(&self) -> Option<Predicted> {
        self.predicted(self.first, (self.first, &self.first.theta), FoldFit::Plain(Thoroughness::Near))
    }

    /// What a model predicts of runs that it was not fitted to; the second is it at its values. None where that cannot be had.
    fn predicted(
        &self,
        current: &FittedModel,
        (written, theta): (&FittedModel, &[Vec<f64>]),
        by: FoldFit,
    ) -> Option<Predicted> {
        let (train, all) = (self.runs.train, self.runs.all.len());
        if train < all {
            return Some((train..all).map(|r| self.piece(written, self.runs.all, (r, r), 0)).collect());
        }
        if *self.runs.domain != Domain::Time || !self.work.goes_on() {
            return None;
        }
        let refitted = |all: &[Run], train: usize, theta: Vec<Vec<f64>>| {
            let runs = Runs { all, train, domain: self.runs.domain };
            let current = FittedModel::new(current.model.clone(), runs, theta.clone()).ok()?;
            let FoldFit::Plain(thoroughness) = by else {
                let split = split_fit(&current, runs, self.noise).ok()?;
                return FittedModel::new(current.model.clone(), runs, split.theta).ok();
            };
            plain_fit(&current, &theta, runs, (self.options, self.work), thoroughness).ok()
        };
        if let [run] = self.runs.all {
            let from = run.len() * 2 / 3;
            let part = refitted(&[run.part(0..from)], 1, theta.to_vec())?;
            let whole = FittedModel::new(current.model.clone(), self.runs, part.theta).ok()?;
            return Some(vec![self.piece(&whole, self.runs.all, (0, 0), from)]);
        }
        let folds = all.min(FOLDS);
        let of = |fold: usize| -> Option<Predicted> {
            let (own, others): (Vec<usize>, Vec<usize>) = (0..all).partition(|r| r % folds == fold);
            let order: Vec<usize> = others.iter().chain(&own).copied().collect();
            let runs: Vec<Run> = order.iter().map(|r| self.runs.all[*r].clone()).collect();
            let fitted = refitted(&runs, others.len(), order.iter().map(|r| theta[*r].clone()).collect())?;
            Some((others.len()..all).map(|r| self.piece(&fitted, &runs, (r, order[r]), 0)).collect())
        };
        let found: Option<Vec<Predicted>> = parallel::map(0..folds, of).into_iter().collect();
        Some(found?.into_iter().flatten().collect())
    }

    /// What a model leaves of a run from a sample on: its place among these runs, and among all.
    fn piece(&self, fitted: &FittedModel, runs: &[Run], (place, run): (usize, usize), from: usize) -> Piece {
        let mut residual = fitted.predictors[place].left_by(&runs[place], &fitted.response[place]);
        residual.drain(..from * self.first.outputs());
        Piece { run, from, residual }
    }

    /// Mean square of each output; NaN where nothing was measured.
    fn mean_squares(&self, predicted: &Predicted) -> Vec<f64> {
        let q = self.first.outputs();
        let of = |o: usize| {
            let values = predicted.iter().flat_map(|p| p.residual.iter().skip(o).step_by(q)).filter(|v| !v.is_nan());
            let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v| (sum + v * v, count + 1.0));
            sum / count
        };
        (0..q).map(of).collect()
    }

    /// Squared error over that of the model as it was given, the mean over outputs.
    fn relative(&self, predicted: &Predicted, naive: &Predicted) -> f64 {
        let (own, naive) = (self.mean_squares(predicted), self.mean_squares(naive));
        let ratios: Vec<f64> =
            own.iter().zip(&naive).filter(|(_, n)| **n > 0.0).map(|(own, naive)| own / naive).collect();
        if ratios.is_empty() { 1.0 } else { ratios.iter().sum::<f64>() / ratios.len() as f64 }
    }

    /// By how much the squared error of a larger model's prediction is less, outputs in units of the naive model's error; none where too
    /// little is independent to tell.
    fn advantage(&self, large: &Predicted, small: &Predicted, naive: &Predicted) -> Option<Advantage> {
        let q = self.first.outputs();
        let scale: Vec<f64> = self.mean_squares(naive).into_iter().map(f64::sqrt).collect();
        let column = |piece: &Piece, o: usize| {
            piece.residual.iter().skip(o).step_by(q).map(|v| v / scale[o]).collect::<Vec<f64>>()
        };
        let mut pairs = Vec::new();
        for large in large {
            let Some(small) = small.iter().find(|p| p.run == large.run) else { continue };
            let outputs = (0..q).filter(|o| scale[*o] > 0.0);
            pairs.extend(outputs.map(|o| (column(large, o), column(small, o))));
        }
        advantage(&pairs)
    }

    /// For the table: a level, or the model as it was given.
    fn described(&self, level: Option<&Level>, recommended: bool, naive: Option<&Predicted>) -> FrontModel {
        let written = level.map(|l| l.shown().as_ref().ok().map(|w| self.shown(w, matches!(l.over_all, Some(Ok(_))))));
        let (train, all) = (self.runs.train, self.runs.all.len());
        self.told(Told {
            effects: level.map_or(Vec::new(), |l| l.accepted.iter().map(|a| a.cause.place.clone()).collect()),
            parameters: level.map_or(0, Level::size),
            // a model that has no response has no errors either
            fitted: match written {
                None => {
                    let (fitted, runs) =
                        self.all.as_ref().map_or((self.first, self.runs), |all| (&all.first, all.runs));
                    Some(Shown { fitted, runs, training: 1.0, validation: Some(1.0) })
                }
                Some(written) => written,
            },
            predicted: naive.filter(|_| train == all).and_then(|naive| match level {
                None => Some(1.0),
                Some(level) => level.predicted.as_ref().map(|p| self.relative(p, naive)),
            }),
            recommended,
            objection: level.and_then(Level::objection),
        })
    }

    /// A written model with the runs it is told of.
    fn shown<'s>(&'s self, written: &'s WrittenModel, over_all: bool) -> Shown<'s> {
        let runs = self.all.as_ref().filter(|_| over_all).map_or(self.runs, |all| all.runs);
        Shown { fitted: &written.fitted, runs, training: written.training, validation: written.validation }
    }

    /// A line of the table.
    fn told(&self, told: Told<'_>) -> FrontModel {
        let Told { effects, parameters, fitted, predicted, recommended, objection } = told;
        let (train, all) = (self.runs.train, self.runs.all.len());
        let rms = |sums: Option<&Vec<(f64, usize)>>, o: usize| {
            sums.map(|s| s[o]).filter(|(_, count)| *count > 0).map(|(sum, count)| (sum / count as f64).sqrt())
        };
        let of = |judged: std::ops::Range<usize>| {
            let Shown { fitted, runs, .. } = fitted.as_ref().filter(|_| !judged.is_empty())?;
            Some(squares(fitted, &fitted.response, *runs, judged))
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
            effects,
            parameters,
            error_training: fitted.as_ref().map_or(f64::NAN, |f| f.training.sqrt()),
            error_validation: fitted.as_ref().and_then(|f| f.validation).filter(|_| train < all).map(f64::sqrt),
            outputs: outputs.collect(),
            error_cross_validated: predicted.map(f64::sqrt),
            recommended,
            objection,
            table: None,
        }
    }

    /// Every effect that another model has and the recommended one has not.
    fn rejected(&self, levels: &[Level], chosen: Option<usize>, naive: &Predicted) -> Vec<Rejected> {
        let kept = |a: &Accepted| chosen.is_some_and(|k| levels[k].holds(a));
        let predicts_better = |level: &Level| {
            let error = |l: &Level| l.predicted.as_ref().map_or(f64::INFINITY, |p| self.relative(p, naive));
            chosen.is_some_and(|k| level.has(Class::StandIn) && error(level) < error(&levels[k]))
        };
        let mut list: Vec<Rejected> = Vec::new();
        for (k, a) in levels.iter().flat_map(|l| l.accepted.iter().enumerate()).filter(|(_, a)| !kept(a)) {
            if list.iter().any(|r| r.place == a.cause.place) {
                continue;
            }
            // the smallest model that still had it says why
            let last = levels.iter().rev().find(|l| l.accepted.iter().any(|b| b.cause.place == a.cause.place));
            let reason = last.and_then(Level::objection).unwrap_or_else(|| match last.is_some_and(predicts_better) {
                true => "what is no stand-in predicts as well, within one standard error, or is likelier".into(),
                false => "without it the written model predicts as well".into(),
            });
            let Cause { place, gain_training, gain_validation, .. } = a.cause.clone();
            list.push(Rejected { place, step: k + 1, gain_training, gain_validation, reason });
        }
        list
    }
}
