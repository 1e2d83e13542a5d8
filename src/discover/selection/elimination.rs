//! Accepted effects, and the last look at each of them beside all others: what the joint fit does not need is taken out.
//!
//! Another look at each of several accepted effects beside the others: what came near it when it was chosen may do better now.
//!
//! Several effects that add terms in one place: what they may be together.
//!
//! A nonlinearity that the catalogue does not have (hysteresis, a friction that falls with the speed, a product of three) is nearly the sum of two or
//! three that it has, so nearly that nothing is left which would tell of it. That they meet in one place is what can be told.

use super::acceptance::{below_null, separating, value_of};
use super::comparison::ALIKE;
use super::error::DiagnosisError;
use super::extended_model::{AttachedEffect, SignalScales, grown, place, written};
use super::fitted_model::{FittedModel, split_fit};
use super::fitting::Fitting;
use super::forward_step::{PENALTY, prior};
use super::runs::Runs;
use super::whitening::CommonNoise;
use crate::diagnosis::{Alternative, Cause, EffectAt, Rejected};
use crate::disturbance::BELIEVED;
use fdm_effects::{Candidate, Choice, NewParam};
use fdm_numeric::parallel;
use fdm_system::model::Model;
use std::collections::BTreeMap;
use std::sync::Arc;

/// An effect that is in the model.
#[derive(Clone)]
pub(super) struct Accepted {
    pub(super) cause: Cause,
    pub(super) candidate: Candidate,
    /// Its parameters in the extended model.
    pub(super) params: Vec<NewParam>,
    /// Their values in the text.
    pub(super) choice: Choice,
    /// What came near it when it was chosen, with the values that were fitted.
    pub(super) near: Vec<(Candidate, Choice)>,
}

impl Accepted {
    pub(super) fn new(
        attached: &AttachedEffect,
        fitting: &Fitting,
        cause: Cause,
        near: Vec<(Candidate, Choice)>,
    ) -> Self {
        let choice = fitting.theta.first().map_or_else(Choice::new, |theta| written(attached, theta));
        Self { cause, candidate: attached.candidate.clone(), params: attached.params().to_vec(), choice, near }
    }

    /// As it stands in the text at the values of a fit of the model that it is a part of.
    pub(super) fn written_at(&self, fitting: &Fitting) -> (Candidate, Choice) {
        (self.candidate.clone(), at(&self.choice, &self.params, fitting))
    }

    /// Parameters that it costs.
    pub(super) fn cost(&self) -> usize {
        cost(&self.params)
    }

    /// What its parameters and its kind cost.
    pub(super) fn penalty(&self) -> f64 {
        penalty(&self.candidate, &self.params)
    }

    /// Takes its values from the last fit.
    pub(super) fn renew(&mut self, fitting: &Fitting) {
        let news = self.params.iter().filter(|p| p.begins_as.is_none());
        self.cause.parameters =
            news.filter_map(|p| fitting.shared(&p.name).map(|estimate| value_of(p, estimate))).collect();
    }
}

/// Takes out, one by one, what the joint fit of several does not need: an effect whose absence costs less in log-likelihood, on all
/// runs, than its parameters; the current model that stays, and what was taken out.
pub(super) fn eliminate(
    mut current: Arc<FittedModel>,
    first: &FittedModel,
    runs: Runs<'_>,
    noise: &CommonNoise,
    accepted: &mut Vec<Accepted>,
) -> Result<(Arc<FittedModel>, Vec<Rejected>), DiagnosisError> {
    let mut dropped = Vec::new();
    while accepted.len() > 1 {
        let fit = split_fit(&current, runs, noise)?;
        let without = |k: usize| {
            let others = accepted.iter().enumerate().filter(|(other, _)| *other != k);
            let effects: Vec<_> = others.map(|(_, a)| a.written_at(&fit.fitting)).collect();
            let (smaller, params) = rebuilt(first, &current, &fit.theta, runs, &effects).ok()?;
            let lost = split_fit(&smaller, runs, noise).ok()?.cost() - fit.cost();
            Some((k, lost, smaller, params))
        };
        let tried: Vec<_> = parallel::filter_map(0..accepted.len(), without);
        let left = |(k, lost): (usize, f64)| lost - accepted[k].penalty();
        let weakest = tried.into_iter().min_by(|a, b| left((a.0, a.1)).total_cmp(&left((b.0, b.1))));
        let Some((k, lost, smaller, params)) = weakest.filter(|w| left((w.0, w.1)) < 0.0) else { break };
        let gone = accepted.remove(k);
        accepted.iter_mut().zip(params).for_each(|(a, params)| a.params = params);
        current = Arc::new(smaller);
        let reason = format!("beside the others it gains {lost:.1}, below its penalty");
        let (gain_training, gain_validation) = (gone.cause.gain_training, gone.cause.gain_validation);
        dropped.push(Rejected { place: gone.cause.place, step: k + 1, gain_training, gain_validation, reason });
    }
    Ok((current, dropped))
}

/// The values of an effect's parameters in a fit; what is not estimated there as it was.
fn at(choice: &Choice, params: &[NewParam], fitting: &Fitting) -> Choice {
    let own = |local: &String| params.iter().find(|p| p.local == *local && !p.fixed);
    let of = |(local, value): (&String, &f64)| {
        let estimate = own(local).and_then(|p| fitting.shared(&p.name));
        (local.clone(), estimate.map_or(*value, |estimate| estimate.value))
    };
    choice.iter().map(of).collect()
}

/// What the parameters and the kind of an effect cost.
fn penalty(candidate: &Candidate, params: &[NewParam]) -> f64 {
    PENALTY * cost(params) as f64 + prior(candidate.effect().class())
}

/// Parameters that an effect with these costs.
pub(super) fn cost(params: &[NewParam]) -> usize {
    params.iter().filter(|p| !p.fixed && p.begins_as.is_none()).count()
}

/// The first model with these effects, at the values of a larger or of a like one; the new parameters of each.
pub(super) fn rebuilt(
    first: &FittedModel,
    like: &FittedModel,
    theta: &[Vec<f64>],
    runs: Runs<'_>,
    effects: &[(Candidate, Choice)],
) -> Result<(FittedModel, Vec<Vec<NewParam>>), DiagnosisError> {
    let mut at: Option<FittedModel> = None;
    let mut params = Vec::new();
    for (candidate, choice) in effects {
        let current = at.as_ref().unwrap_or(first);
        let scales = SignalScales::new(current, runs);
        let text = AttachedEffect::new(candidate, current, &scales, choice).map_err(DiagnosisError::NoFit)?;
        let model: Model = grown(&text, current)?;
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
        at = Some(FittedModel::new(model, runs, theta.iter().map(known).collect())?);
    }
    Ok((at.ok_or_else(|| DiagnosisError::NoFit("no effect is left".into()))?, params))
}

/// Looks again at each of several effects beside the others: what came near it when it was chosen may do better now. Groups are
/// those of the joint fits.
pub(super) fn revise(
    mut current: Arc<FittedModel>,
    first: &FittedModel,
    runs: Runs<'_>,
    noise: &CommonNoise,
    accepted: &mut [Accepted],
) -> Result<Arc<FittedModel>, DiagnosisError> {
    if accepted.len() < 2 {
        return Ok(current);
    }
    // the last one was chosen beside all others
    for k in 0..accepted.len() - 1 {
        let fit = split_fit(&current, runs, noise)?;
        let own = -fit.cost() - accepted[k].penalty();
        let written: Vec<(Candidate, Choice)> = accepted.iter().map(|a| a.written_at(&fit.fitting)).collect();
        let fitted = |effects: &[(Candidate, Choice)], like: &FittedModel, theta: &[Vec<f64>]| -> Option<Tried> {
            let (candidate, choice) = effects[k].clone();
            let (current, params) = rebuilt(first, like, theta, runs, effects).ok()?;
            let fit = split_fit(&current, runs, noise).ok()?;
            let value = |p: &NewParam| fit.fitting.shared(&p.name).map(|e| e.value);
            if params.iter().any(|params| below_null(params, value).is_some()) {
                return None;
            }
            let score = -fit.cost() - penalty(&candidate, &params[k]);
            Some(Tried { candidate, current, params, score, gain: -fit.fitting.cost, choice })
        };
        // alone in the place of another an effect may begin periods away: beside it, it takes over its part
        let begun_beside = |(candidate, choice): &(Candidate, Choice)| -> Option<Tried> {
            let mut effects = written.clone();
            effects.push((candidate.clone(), choice.clone()));
            let (both, params) = rebuilt(first, &current, &fit.theta, runs, &effects).ok()?;
            let joint = split_fit(&both, runs, noise).ok()?;
            for ((_, choice), params) in effects.iter_mut().zip(&params) {
                *choice = at(choice, params, &joint.fitting);
            }
            effects.swap_remove(k);
            fitted(&effects, &both, &joint.theta)
        };
        let try_instead = |near: &(Candidate, Choice)| -> Option<Tried> {
            let mut effects = written.clone();
            effects[k] = near.clone();
            let tried = [fitted(&effects, &current, &fit.theta), begun_beside(near)];
            tried.into_iter().flatten().max_by(|a, b| a.score.total_cmp(&b.score))
        };
        // what is in the model already is no alternative
        let there = |near: &&(Candidate, Choice)| accepted.iter().any(|a| a.cause.place == place(&near.0));
        let near = accepted[k].near.iter().filter(|near| !there(near));
        let mut tried: Vec<Tried> = parallel::filter_map(near, try_instead);
        tried.sort_by(|a, b| b.score.total_cmp(&a.score));
        let best = tried.first().map_or(own, |t| t.score.max(own));
        let alternative = |place: EffectAt, score: f64, gain: f64| {
            let cause = &accepted[k].cause;
            let before = cause.group.iter().find(|r| r.place == place);
            Alternative {
                gain_training: cause.gain_training + gain + fit.fitting.cost,
                gain_validation: before.and_then(|r| r.gain_validation),
                score: cause.score + score - own,
                cosine: before.map_or(0.0, |r| r.cosine),
                place,
            }
        };
        let mut group: Vec<Alternative> = Vec::new();
        if own > best - BELIEVED {
            group.push(alternative(accepted[k].cause.place.clone(), own, -fit.fitting.cost));
        }
        let close = tried.iter().filter(|t| t.score > best - BELIEVED);
        group.extend(close.map(|t| alternative(place(&t.candidate), t.score, t.gain)));
        group.sort_by(|a, b| b.score.total_cmp(&a.score));
        let Some(most) = group.first().map(|first| first.score) else { continue };
        // a likeness that was not tried again is one beside the others as well
        let asked = |other: &EffectAt| {
            let near = accepted[k].near.iter().any(|near| place(&near.0) == *other);
            near || accepted.iter().any(|a| a.cause.place == *other)
        };
        let likenesses = accepted[k].cause.group.iter().filter(|r| r.cosine > ALIKE && r.score > most - BELIEVED);
        let likenesses = likenesses.filter(|r| !asked(&r.place)).cloned();
        group.extend(likenesses.map(|r| Alternative { score: r.score.min(most), ..r }));
        group[1..].sort_by(|a, b| b.score.total_cmp(&a.score));
        let separating_experiment = group.get(1).map(|other| separating(&group[0].place, &other.place));
        let change = accepted[k].cause.place != group[0].place;
        let cause = &mut accepted[k].cause;
        (cause.gain_training, cause.score) = (group[0].gain_training, group[0].score);
        (cause.group, cause.separating_experiment) = (group, separating_experiment);
        if change && let Some(Tried { candidate, current: other, params, choice, .. }) = tried.into_iter().next() {
            (cause.place, cause.doc) = (place(&candidate), candidate.doc());
            (accepted[k].candidate, accepted[k].choice) = (candidate, choice);
            accepted.iter_mut().zip(params).for_each(|(a, params)| a.params = params);
            current = Arc::new(other);
        }
    }
    Ok(current)
}

/// Another effect in the place of one.
struct Tried {
    candidate: Candidate,
    choice: Choice,
    current: FittedModel,
    params: Vec<Vec<NewParam>>,
    score: f64,
    gain: f64,
}

/// A sentence for each equation or output to which more than one accepted effect adds a term.
pub(super) fn one_law(accepted: &[Accepted]) -> Vec<String> {
    let terms: Vec<(String, String)> =
        accepted.iter().filter_map(|a| Some((a.candidate.adds_to()?, a.cause.place.to_string()))).collect();
    said(&terms)
}

/// A sentence for each of these places to which more than one effect adds a term.
fn said(terms: &[(String, String)]) -> Vec<String> {
    let mut places: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    terms.iter().for_each(|(place, effect)| places.entry(place).or_default().push(effect));
    let sentence = |(place, here): (&str, Vec<&str>)| {
        let here = here.join(" and ");
        format!("{here} add to {place}: together they may stand for one nonlinearity that the catalogue does not have")
    };
    places.into_iter().filter(|(_, here)| here.len() > 1).map(sentence).collect()
}

#[cfg(test)]
mod tests {
    use super::said;

    #[test]
    fn effects_that_meet_are_told() {
        let term = |place: &str, effect: &str| (place.to_string(), effect.to_string());
        let mut terms = vec![term("der(v)", "drag"), term("der(u)", "friction"), term("y", "drift")];
        assert_eq!(said(&terms), Vec::<String>::new());
        terms.push(term("der(u)", "stiffness"));
        let told = said(&terms);
        assert!(told.len() == 1 && told[0].starts_with("friction and stiffness add to der(u)"), "{told:?}");
    }
}
