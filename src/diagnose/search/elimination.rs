//! Accepted effects, and the last look at each of them beside all others: what the joint fit does not need is taken out.

use super::attached::Attached;
use super::judgement::{size, value_of};
use super::measured::Measured;
use super::metric::Metric;
use super::refit::Fitting;
use super::round::Runs;
use super::search::{grown, whole_fit, written};
use super::search_error::SearchError;
use super::stage::Stage;
use crate::diagnose::diagnosis::{Cause, Rejected};
use crate::model::Model;
use fdm_grammar::effect::{Candidate, Choice, NewParam};

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
}

impl Accepted {
    pub(super) fn new(attached: &Attached, fitting: &Fitting, cause: Cause) -> Self {
        let choice = fitting.theta.first().map_or_else(Choice::new, |theta| written(attached, theta));
        Self { cause, candidate: attached.candidate.clone(), params: attached.params().to_vec(), choice }
    }

    /// Parameters that it costs.
    pub(super) fn cost(&self) -> usize {
        self.params.iter().filter(|p| !p.fixed && p.begins_as.is_none()).count()
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
        stage = rebuilt(first, &stage, &fit.theta, runs, accepted)?;
        let reason = format!("beside the others its size is {strength:.1} standard errors, less than {KEPT}");
        let (gain_train, gain_holdout) = (gone.cause.gain_train, gone.cause.gain_holdout);
        dropped.push(Rejected { place: gone.cause.place, round: weakest + 1, gain_train, gain_holdout, reason });
    }
    Ok((stage, dropped))
}

/// The first model with these effects, at the values of a larger one.
fn rebuilt(
    first: &Stage,
    larger: &Stage,
    theta: &[Vec<f64>],
    runs: Runs<'_>,
    accepted: &mut [Accepted],
) -> Result<Stage, SearchError> {
    let mut model: Model = first.model.clone();
    let mut at: Option<Stage> = None;
    for accepted in accepted {
        let stage = at.as_ref().unwrap_or(first);
        let measured = Measured::new(stage, runs.all);
        let text = Attached::new(&accepted.candidate, stage, &measured, &accepted.choice).map_err(SearchError::NoFit)?;
        model = grown(&model, &text, stage)?;
        accepted.params = text.params().to_vec();
        let values = model.definition().params.iter();
        let names: Vec<(String, f64)> = values.map(|p| (p.quantity.name.clone(), p.value)).collect();
        let known = |run: &Vec<f64>| {
            let of = |(name, value): &(String, f64)| {
                let place = larger.model.definition().param(name);
                place.map_or(*value, |k| run[k])
            };
            names.iter().map(of).collect()
        };
        at = Some(Stage::new(model.clone(), runs.all, theta.iter().map(known).collect())?);
    }
    at.ok_or_else(|| SearchError::NoFit("no effect is left".into()))
}
