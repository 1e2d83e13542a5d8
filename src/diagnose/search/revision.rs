//! Another look at each of several accepted effects beside the others: what came near it when it was chosen may do better now.

use super::elimination::{Accepted, cost, rebuilt};
use super::experiment::separating;
use super::judgement::LEAD;
use super::metric::Metric;
use super::round::{PRICE, Runs, place};
use super::search_error::SearchError;
use super::stage::Stage;
use super::whole::whole_fit;
use crate::diagnose::diagnosis::{EffectAt, Rival};
use fdm_grammar::effect::{Candidate, Choice, NewParam};
use rayon::prelude::*;
use std::sync::Arc;

/// Looks again at each of several effects beside the others: what came near it when it was chosen may do better now. Groups are
/// those of the joint fits.
pub(super) fn revise(
    mut stage: Arc<Stage>,
    first: &Stage,
    runs: Runs<'_>,
    metric: &Metric,
    accepted: &mut [Accepted],
) -> Result<Arc<Stage>, SearchError> {
    if accepted.len() < 2 {
        return Ok(stage);
    }
    // the last one was chosen beside all others
    for k in 0..accepted.len() - 1 {
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
            stage = Arc::new(other);
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
