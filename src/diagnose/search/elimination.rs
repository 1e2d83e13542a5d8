//! Accepted effects, and the last look at each of them beside all others: what the joint fit does not need is taken out.

use super::attached::Attached;
use super::judgement::value_of;
use super::measured::Measured;
use super::metric::Metric;
use super::refit::Fitting;
use super::round::{PRICE, Runs};
use super::search::{grown, written};
use super::search_error::SearchError;
use super::stage::Stage;
use super::whole::whole_fit;
use crate::diagnose::diagnosis::{Cause, Rejected};
use crate::model::Model;
use fdm_grammar::effect::{Candidate, Choice, NewParam};
use rayon::prelude::*;
use std::sync::Arc;

/// An effect that is in the model.
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
    pub(super) fn new(attached: &Attached, fitting: &Fitting, cause: Cause, near: Vec<(Candidate, Choice)>) -> Self {
        let choice = fitting.theta.first().map_or_else(Choice::new, |theta| written(attached, theta));
        Self { cause, candidate: attached.candidate.clone(), params: attached.params().to_vec(), choice, near }
    }

    pub(super) fn written(&self) -> (Candidate, Choice) {
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
}

/// Takes out, one by one, what the joint fit of several does not need: an effect whose absence costs less in log-likelihood, on all
/// runs, than its parameters; the stage that stays, and what was taken out.
pub(super) fn eliminate(
    mut stage: Arc<Stage>,
    first: &Stage,
    runs: Runs<'_>,
    metric: &Metric,
    accepted: &mut Vec<Accepted>,
) -> Result<(Arc<Stage>, Vec<Rejected>), SearchError> {
    let mut dropped = Vec::new();
    while accepted.len() > 1 {
        let fit = whole_fit(&stage, runs, metric)?;
        let without = |k: usize| {
            let others = accepted.iter().enumerate().filter(|(other, _)| *other != k);
            let effects: Vec<_> = others.map(|(_, a)| a.written()).collect();
            let (smaller, params) = rebuilt(first, &stage, &fit.theta, runs, &effects).ok()?;
            let lost = whole_fit(&smaller, runs, metric).ok()?.cost() - fit.cost();
            Some((k, lost, smaller, params))
        };
        let tried: Vec<_> = (0..accepted.len()).into_par_iter().filter_map(without).collect();
        let left = |(k, lost): (usize, f64)| lost - PRICE * accepted[k].cost() as f64;
        let weakest = tried.into_iter().min_by(|a, b| left((a.0, a.1)).total_cmp(&left((b.0, b.1))));
        let Some((k, lost, smaller, params)) = weakest.filter(|w| left((w.0, w.1)) < 0.0) else { break };
        let gone = accepted.remove(k);
        accepted.iter_mut().zip(params).for_each(|(a, params)| a.params = params);
        stage = Arc::new(smaller);
        let reason = format!("beside the others it gains {lost:.1}, which does not pay for it (3 for each parameter)");
        let (gain_train, gain_holdout) = (gone.cause.gain_train, gone.cause.gain_holdout);
        dropped.push(Rejected { place: gone.cause.place, round: k + 1, gain_train, gain_holdout, reason });
    }
    Ok((stage, dropped))
}

/// What an effect with these parameters costs.
pub(super) fn cost(params: &[NewParam]) -> usize {
    params.iter().filter(|p| !p.fixed && p.begins_as.is_none()).count()
}

/// The first model with these effects, at the values of a larger or of a like one; the new parameters of each.
pub(super) fn rebuilt(
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
