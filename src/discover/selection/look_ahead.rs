//! With which candidate model a search goes on: the best one, unless it leaves much and another one leads further with a second effect.

use super::candidate_model::CandidateModel;
use super::comparison::Comparison;
use super::error::DiagnosisError;
use super::extended_model::{AttachedEffect, SignalScales, grown, new_values, place, written};
use super::fitted_model::FittedModel;
use super::forward_selection::ForwardSelection;
use super::forward_step::ForwardStep;
use super::projection::cosine;
use super::whitening::CommonNoise;
use crate::diagnosis::EffectAt;
use fdm_grammar::syntax::Class;
use std::sync::Arc;

/// Candidate models whose second effects are looked at, where the best one leaves much.
const BEGINNINGS: usize = 3;
/// Part of the best score that such a candidate model has.
const ALTERNATIVE: f64 = 0.25;
/// Cosine above which two candidate models are one beginning.
const ALIKE: f64 = 0.97;
/// Candidates that are fitted beside another beginning.
const SECONDS: usize = 6;
/// Iterations of the fit by which beginnings are compared.
const ITERATIONS: usize = 25;

/// The model with a candidate model in it, and the next search where that has been made.
pub(super) struct NextStep<'a> {
    /// The candidate model.
    pub(super) candidate: usize,
    pub(super) current: Arc<FittedModel>,
    pub(super) ahead: Option<(ForwardStep<'a>, Option<Comparison>)>,
}

impl<'a> ForwardSelection<'a> {
    /// The candidate model to go on with, of those (`fit`, the best first) that nothing speaks against.
    pub(super) fn best_next_step(
        &self,
        step: &ForwardStep<'a>,
        comparison: &Comparison,
        scales: &SignalScales,
        fit: &[usize],
    ) -> Result<Option<NextStep<'a>>, DiagnosisError> {
        let Some(best) = fit.first().copied() else { return Ok(None) };
        let current = Arc::new(self.with_candidate(step, &comparison.models[best], scales)?);
        let mut found = NextStep { candidate: best, current, ahead: None };
        // a stand-in must be better than the best pair of mechanisms
        let stand_in = comparison.models[best].class == Class::StandIn;
        let others = if stand_in { mechanisms(comparison) } else { alternatives(comparison, fit) };
        if others.is_empty() || self.accepted.len() + 2 > self.options.most {
            return Ok(Some(found));
        }
        let costs = |k: usize| comparison.models[k].penalty();
        let named = |k: usize| place(&step.simulated[comparison.models[k].candidate].attached.candidate);
        // where no search can be made beside it, the next one says so
        let Ok((mut ahead, left)) = self.ahead(&found.current, &named(best)) else { return Ok(Some(found)) };
        let least = if left {
            let next = match ahead.comparison(&|_| ()) {
                Err(DiagnosisError::Stopped) => return Ok(Some(found)),
                next => next?,
            };
            let least = self.total(&ahead, &next, &comparison.noise);
            found.ahead = Some((ahead, Some(next)));
            least
        } else {
            found.ahead = Some((ahead, None));
            stand_in.then(|| comparison.models[best].fitting.cost)
        };
        let Some(mut least) = least.map(|total| total + costs(best)) else { return Ok(Some(found)) };
        let why = if left { "the best one leaves much" } else { "the best one is a stand-in" };
        (self.progress)(&format!("{why}: trying {} other beginnings", others.len()));
        for k in others {
            let Ok(current) = self.with_candidate(step, &comparison.models[k], scales) else { continue };
            let current = Arc::new(current);
            let Ok((mut ahead, _)) = self.ahead(&current, &named(k)) else { continue };
            let Ok(next) = ahead.comparison_of(SECONDS..=SECONDS, &|_| ()) else { continue };
            if let Some(total) = self.total(&ahead, &next, &comparison.noise)
                && total + costs(k) < least
            {
                least = total + costs(k);
                found = NextStep { candidate: k, current, ahead: Some((ahead, None)) };
            }
        }
        Ok(Some(found))
    }

    /// The search beside a first effect, and whether anything is left to be found.
    fn ahead(&self, current: &Arc<FittedModel>, first: &EffectAt) -> Result<(ForwardStep<'a>, bool), DiagnosisError> {
        let scales = SignalScales::new(current, self.runs);
        let candidates = self.candidates(current, Some(first));
        let step = self.step(current, &candidates, &scales)?;
        let left = step.screening.family_wise < self.options.alpha;
        Ok((step, left))
    }

    /// The cost of the best second effect by a common noise, with the penalty of its parameters.
    fn total(&self, step: &ForwardStep<'_>, comparison: &Comparison, noise: &CommonNoise) -> Option<f64> {
        let best = comparison.models.first()?;
        let fitting = best.posed(step, noise).fit(&best.fitting.theta, ITERATIONS)?;
        Some(fitting.cost + best.penalty())
    }

    /// The model with a candidate model in its text, fitted jointly.
    fn with_candidate(
        &self,
        step: &ForwardStep<'_>,
        candidate: &CandidateModel,
        scales: &SignalScales,
    ) -> Result<FittedModel, DiagnosisError> {
        let attached = &step.simulated[candidate.candidate].attached;
        let choice = written(attached, &candidate.fitting.theta[0]);
        let text =
            AttachedEffect::new(&attached.candidate, &step.current, scales, &choice).map_err(DiagnosisError::NoFit)?;
        let model = grown(&step.current.model, &text, &step.current)?;
        let mut theta = candidate.fitting.theta.clone();
        match &candidate.validation {
            Some((_, validation)) => theta.extend(validation.theta.iter().cloned()),
            None => {
                let values = new_values(attached, &candidate.fitting.theta[0]);
                theta.extend((self.runs.train..self.runs.all.len()).map(|r| attached.theta(&step.current, r, &values)));
            }
        }
        FittedModel::new(model, self.runs, theta)
    }
}

/// The best mechanisms that are no likeness of each other, whatever they gain alone: as long as its partner is missing, a friction may
/// even seem to be negative.
fn mechanisms(comparison: &Comparison) -> Vec<usize> {
    let mut chosen: Vec<usize> = Vec::new();
    let all = 0..comparison.models.len();
    for k in all.filter(|k| comparison.models[*k].class == Class::Mechanism && comparison.models[*k].gain > 0.0) {
        let own = &comparison.models[k];
        let alike = |o: &usize| cosine(&own.direction, &comparison.models[*o].direction).abs() > ALIKE;
        if chosen.len() < BEGINNINGS && !chosen.iter().any(alike) {
            chosen.push(k);
        }
    }
    chosen
}

/// Candidate models that are no likeness of the best or of each other, and good enough to begin with.
fn alternatives(comparison: &Comparison, fit: &[usize]) -> Vec<usize> {
    let Some(best) = fit.first().copied() else { return Vec::new() };
    let score = comparison.models[best].score();
    let mut others: Vec<usize> = Vec::new();
    for k in fit.iter().skip(1).copied() {
        let own = &comparison.models[k];
        let alike = |o: &usize| cosine(&own.direction, &comparison.models[*o].direction).abs() > ALIKE;
        let enough = own.score() > ALTERNATIVE * score && others.len() + 1 < BEGINNINGS;
        if enough && !alike(&best) && !others.iter().any(alike) {
            others.push(k);
        }
    }
    others
}
