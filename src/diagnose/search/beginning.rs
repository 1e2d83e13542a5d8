//! With which contender a search goes on: the best one, unless it leaves much and another one leads further with a second effect.

use super::attached::Attached;
use super::beside::cosine;
use super::contender::Contender;
use super::contest::Contest;
use super::measured::Measured;
use super::metric::Metric;
use super::round::{PRICE, Round, new_values, place};
use super::search::{Search, grown, written};
use super::search_error::SearchError;
use super::stage::Stage;
use crate::diagnose::diagnosis::EffectAt;
use std::sync::Arc;

/// Contenders whose second effects are looked at, where the best one leaves much.
const BEGINNINGS: usize = 3;
/// Part of the best score that such a contender has.
const RIVAL: f64 = 0.25;
/// Cosine above which two contenders are one beginning.
const ALIKE: f64 = 0.97;
/// Candidates that are fitted beside another beginning.
const SECONDS: usize = 6;
/// Corrections of the fit by which beginnings are compared.
const CORRECTIONS: usize = 25;

/// The model with a contender in it, and the next search where that has been made.
pub(super) struct Beginning<'a> {
    /// The contender.
    pub(super) contender: usize,
    pub(super) stage: Arc<Stage>,
    pub(super) ahead: Option<(Round<'a>, Option<Contest>)>,
}

impl<'a> Search<'a> {
    /// The contender to go on with, of those (`fit`, the best first) that nothing speaks against.
    pub(super) fn best_beginning(
        &self,
        round: &Round<'a>,
        contest: &Contest,
        measured: &Measured,
        fit: &[usize],
    ) -> Result<Option<Beginning<'a>>, SearchError> {
        let Some(best) = fit.first().copied() else { return Ok(None) };
        let stage = Arc::new(self.stage_with(round, &contest.contenders[best], measured)?);
        let mut found = Beginning { contender: best, stage, ahead: None };
        let others = rivals(contest, fit);
        if others.is_empty() || self.accepted.len() + 2 > self.options.most {
            return Ok(Some(found));
        }
        let costs = |k: usize| PRICE * contest.contenders[k].cost as f64;
        let named = |k: usize| place(&round.traces[contest.contenders[k].trace].attached.candidate);
        // where no search can be made beside it, the next one says so
        let Ok((mut ahead, left)) = self.ahead(&found.stage, &named(best)) else { return Ok(Some(found)) };
        if !left {
            found.ahead = Some((ahead, None));
            return Ok(Some(found));
        }
        let next = ahead.contest(&|_| ())?;
        let least = self.total(&ahead, &next, &contest.metric);
        found.ahead = Some((ahead, Some(next)));
        let Some(mut least) = least.map(|total| total + costs(best)) else { return Ok(Some(found)) };
        (self.watcher)(&format!("the best one leaves much: trying {} other beginnings", others.len()));
        for k in others {
            let Ok(stage) = self.stage_with(round, &contest.contenders[k], measured) else { continue };
            let stage = Arc::new(stage);
            let Ok((mut ahead, _)) = self.ahead(&stage, &named(k)) else { continue };
            let Ok(next) = ahead.contest_of(SECONDS..=SECONDS, &|_| ()) else { continue };
            if let Some(total) = self.total(&ahead, &next, &contest.metric)
                && total + costs(k) < least
            {
                least = total + costs(k);
                found = Beginning { contender: k, stage, ahead: Some((ahead, None)) };
            }
        }
        Ok(Some(found))
    }

    /// The search beside a first effect, and whether anything is left to be found.
    fn ahead(&self, stage: &Arc<Stage>, first: &EffectAt) -> Result<(Round<'a>, bool), SearchError> {
        let measured = Measured::new(stage, self.runs);
        let candidates = self.candidates(stage, Some(first));
        let round = Round::new(Arc::clone(stage), self.runs, &candidates, &measured, self.options)?;
        let left = round.screening.family_wise < self.options.alpha;
        Ok((round, left))
    }

    /// The cost of the best second effect by a common noise, with the price of its parameters.
    fn total(&self, round: &Round<'_>, contest: &Contest, metric: &Metric) -> Option<f64> {
        let best = contest.contenders.first()?;
        let fitting = best.posed(round, metric).fit(&best.fitting.theta, CORRECTIONS)?;
        Some(fitting.cost + PRICE * best.cost as f64)
    }

    /// The model with a contender in its text, fitted jointly.
    fn stage_with(&self, round: &Round<'_>, contender: &Contender, measured: &Measured) -> Result<Stage, SearchError> {
        let attached = &round.traces[contender.trace].attached;
        let choice = written(attached, &contender.fitting.theta[0]);
        let text = Attached::new(&attached.candidate, &round.stage, measured, &choice).map_err(SearchError::NoFit)?;
        let model = grown(&round.stage.model, &text, &round.stage)?;
        let mut theta = contender.fitting.theta.clone();
        match &contender.held {
            Some((_, held)) => theta.extend(held.theta.iter().cloned()),
            None => {
                let values = new_values(attached, &contender.fitting.theta[0]);
                theta.extend((self.runs.train..self.runs.all.len()).map(|r| attached.theta(&round.stage, r, &values)));
            }
        }
        Stage::new(model, self.runs, theta)
    }
}

/// Contenders that are no likeness of the best or of each other, and good enough to begin with.
fn rivals(contest: &Contest, fit: &[usize]) -> Vec<usize> {
    let Some(best) = fit.first().copied() else { return Vec::new() };
    let score = contest.contenders[best].score();
    let mut others: Vec<usize> = Vec::new();
    for k in fit.iter().skip(1).copied() {
        let own = &contest.contenders[k];
        let alike = |o: &usize| cosine(&own.direction, &contest.contenders[*o].direction).abs() > ALIKE;
        let enough = own.score() > RIVAL * score && others.len() + 1 < BEGINNINGS;
        if enough && !alike(&best) && !others.iter().any(alike) {
            others.push(k);
        }
    }
    others
}
