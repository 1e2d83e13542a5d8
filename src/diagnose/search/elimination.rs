//! Accepted effects, and the last look at each of them beside all others: what the joint fit does not need is taken out.

use super::attached::Attached;
use super::experiment::separating;
use super::judgement::{LEAD, size, value_of};
use super::measured::Measured;
use super::metric::Metric;
use super::refit::Fitting;
use super::round::{PRICE, Runs, place};
use super::search::{grown, whole_fit, written};
use super::search_error::SearchError;
use super::stage::Stage;
use crate::diagnose::diagnosis::{Cause, EffectAt, Rejected, Rival};
use crate::model::Model;
use fdm_grammar::effect::{Candidate, Choice, NewParam};
use rayon::prelude::*;

/// Standard errors that an effect must keep in the joint fit of several.
const KEPT: f64 = 3.5;

/// An effect that is in the model.
pub(super) struct Accepted {
    pub(super) cause: Cause,
    candidate: Candidate,
    /// Its parameters in the extended model.
    params: Vec<NewParam>,
    /// Their values in the text.
    pub(super) choice: Choice,
    /// What came near it when it was chosen, with the values that were fitted.
    near: Vec<(Candidate, Choice)>,
}

impl Accepted {
    pub(super) fn new(attached: &Attached, fitting: &Fitting, cause: Cause, near: Vec<(Candidate, Choice)>) -> Self {
        let choice = fitting.theta.first().map_or_else(Choice::new, |theta| written(attached, theta));
        Self { cause, candidate: attached.candidate.clone(), params: attached.params().to_vec(), choice, near }
    }

    fn written(&self) -> (Candidate, Choice) {
        (self.candidate.clone(), self.choice.clone())
    }

    /// Parameters that it costs.
    pub(super) fn cost(&self) -> usize {
        cost(&self.params)
    }

    /// Takes its values from the last fit.
    pub(super) fn renew(&mut self, fitting: &Fitting) {
        let news = self.params.iter().filter(|p| p.begins_as.is_none());
        self.cause.parameters =
            news.filter_map(|p| fitting.shared(&p.name).map(|estimate| value_of(p, estimate))).collect();
    }

    /// Standard errors between its size and nothing; none where that has no error.
    fn strength(&self, fitting: &Fitting) -> Option<f64> {
        let sizes = self.params.iter().filter(|p| !p.nuisance);
        sizes.filter_map(|p| size(p, fitting.shared(&p.name)?)).max_by(f64::total_cmp)
    }
}

/// Takes out, one by one, what the joint fit of several does not need; the stage that stays, and what was taken out.
pub(super) fn eliminate(
    mut stage: Stage,
    first: &Stage,
    runs: Runs<'_>,
    metric: &Metric,
    accepted: &mut Vec<Accepted>,
) -> Result<(Stage, Vec<Rejected>), SearchError> {
    let mut dropped = Vec::new();
    while accepted.len() > 1 {
        let fit = whole_fit(&stage, runs, metric)?;
        let strengths = accepted.iter().enumerate().filter_map(|(k, a)| Some((k, a.strength(&fit.fitting)?)));
        let Some((weakest, strength)) = strengths.min_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        if strength >= KEPT {
            break;
        }
        let gone = accepted.remove(weakest);
        let effects: Vec<_> = accepted.iter().map(Accepted::written).collect();
        let (smaller, params) = rebuilt(first, &stage, &fit.theta, runs, &effects)?;
        accepted.iter_mut().zip(params).for_each(|(a, params)| a.params = params);
        stage = smaller;
        let reason = format!("beside the others its size is {strength:.1} standard errors, less than {KEPT}");
        let (gain_train, gain_holdout) = (gone.cause.gain_train, gone.cause.gain_holdout);
        dropped.push(Rejected { place: gone.cause.place, round: weakest + 1, gain_train, gain_holdout, reason });
    }
    Ok((stage, dropped))
}

/// What an effect with these parameters costs.
fn cost(params: &[NewParam]) -> usize {
    params.iter().filter(|p| !p.fixed && p.begins_as.is_none()).count()
}

/// The first model with these effects, at the values of a larger or of a like one; the new parameters of each.
fn rebuilt(
    first: &Stage,
    like: &Stage,
    theta: &[Vec<f64>],
    runs: Runs<'_>,
    effects: &[(Candidate, Choice)],
) -> Result<(Stage, Vec<Vec<NewParam>>), SearchError> {
    let mut at: Option<Stage> = None;
    let mut params = Vec::new();
    for (candidate, choice) in effects {
        let stage = at.as_ref().unwrap_or(first);
        let measured = Measured::new(stage, runs);
        let text = Attached::new(candidate, stage, &measured, choice).map_err(SearchError::NoFit)?;
        let model: Model = grown(&stage.model, &text, stage)?;
        let names: Vec<(String, f64)> =
            model.definition().params.iter().map(|p| (p.quantity.name.clone(), p.value)).collect();
        let own = |name: &String| text.params().iter().any(|p| p.name == *name && p.begins_as.is_none());
        let known = |run: &Vec<f64>| {
            let of = |(name, value): &(String, f64)| match like.model.definition().param(name) {
                // the values that an effect was fitted with are in its text
                Some(k) if !own(name) => run[k],
                _ => *value,
            };
            names.iter().map(of).collect()
        };
        params.push(text.params().to_vec());
        at = Some(Stage::new(model, runs, theta.iter().map(known).collect())?);
    }
    Ok((at.ok_or_else(|| SearchError::NoFit("no effect is left".into()))?, params))
}

/// Looks again at each of several effects beside the others: what came near it when it was chosen may do better now. Groups are
/// those of the joint fits.
pub(super) fn revise(
    mut stage: Stage,
    first: &Stage,
    runs: Runs<'_>,
    metric: &Metric,
    accepted: &mut [Accepted],
) -> Result<Stage, SearchError> {
    if accepted.len() < 2 {
        return Ok(stage);
    }
    for k in 0..accepted.len() {
        let fit = whole_fit(&stage, runs, metric)?;
        let price = |params: &[NewParam]| PRICE * cost(params) as f64;
        let own = -fit.cost() - price(&accepted[k].params);
        let try_instead = |(candidate, choice): &(Candidate, Choice)| -> Option<Tried> {
            let mut effects: Vec<_> = accepted.iter().map(Accepted::written).collect();
            effects[k] = (candidate.clone(), choice.clone());
            let (stage, params) = rebuilt(first, &stage, &fit.theta, runs, &effects).ok()?;
            let fit = whole_fit(&stage, runs, metric).ok()?;
            let score = -fit.cost() - price(&params[k]);
            Some(Tried {
                candidate: candidate.clone(),
                stage,
                params,
                score,
                gain: -fit.fitting.cost,
                choice: choice.clone(),
            })
        };
        let mut tried: Vec<Tried> = accepted[k].near.par_iter().filter_map(try_instead).collect();
        tried.sort_by(|a, b| b.score.total_cmp(&a.score));
        let best = tried.first().map_or(own, |t| t.score.max(own));
        let rival = |place: EffectAt, score: f64, gain: f64| {
            let cause = &accepted[k].cause;
            let before = cause.group.iter().find(|r| r.place == place);
            Rival {
                gain_train: cause.gain_train + gain + fit.fitting.cost,
                gain_holdout: before.and_then(|r| r.gain_holdout),
                score: cause.score + score - own,
                cosine: before.map_or(0.0, |r| r.cosine),
                place,
            }
        };
        let mut group: Vec<Rival> = Vec::new();
        if own > best - LEAD {
            group.push(rival(accepted[k].cause.place.clone(), own, -fit.fitting.cost));
        }
        let close = tried.iter().filter(|t| t.score > best - LEAD);
        group.extend(close.map(|t| rival(place(&t.candidate), t.score, t.gain)));
        group.sort_by(|a, b| b.score.total_cmp(&a.score));
        if group.is_empty() {
            continue;
        }
        let separating_experiment = group.get(1).map(|other| separating(&group[0].place, &other.place));
        let change = accepted[k].cause.place != group[0].place;
        let cause = &mut accepted[k].cause;
        (cause.gain_train, cause.score) = (group[0].gain_train, group[0].score);
        (cause.group, cause.separating_experiment) = (group, separating_experiment);
        if change && let Some(Tried { candidate, stage: other, params, choice, .. }) = tried.into_iter().next() {
            (cause.place, cause.doc) = (place(&candidate), candidate.doc());
            (accepted[k].candidate, accepted[k].choice) = (candidate, choice);
            accepted.iter_mut().zip(params).for_each(|(a, params)| a.params = params);
            stage = other;
        }
    }
    Ok(stage)
}

/// Another effect in the place of one.
struct Tried {
    candidate: Candidate,
    choice: Choice,
    stage: Stage,
    params: Vec<Vec<NewParam>>,
    score: f64,
    gain: f64,
}
