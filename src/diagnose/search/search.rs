//! The road from a model as it stands to a diagnosis.

use super::attached::Attached;
use super::beginning::Beginning;
use super::confirmed::confirmed;
use super::contender::Contender;
use super::contest::Contest;
use super::elimination::{Accepted, eliminate};
use super::evenly::{apart, evenly};
use super::evidence::{Seen, against};
use super::first::first_stages;
use super::following::following;
use super::gains::{biased, output_gains, overlays, responses, run_gains};
use super::judgement::{cause, objection, rejected};
use super::measured::Measured;
use super::metric::Metric;
use super::one_law::one_law;
use super::options::{SearchOptions, Watcher};
use super::revision::revise;
use super::round::{Round, Runs, new_values, place, shared_from};
use super::search_error::SearchError;
use super::stage::Stage;
use super::whole::{Whole, whole_fit};
use crate::diagnose::diagnosis::{Cause, Diagnosis, EffectAt, Rejected, Round as Told, Verdict};
use crate::diagnose::force::{self, Attribution};
use crate::estimate::changed;
use crate::model::Model;
use crate::record::Run;
use fdm_grammar::effect::{Candidate, Catalogue, Choice};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Digits of a fitted value in the extended text.
const DIGITS: usize = 5;
/// Part of the whole gain below which another effect is not looked for.
const MARGINAL: f64 = 0.01;
/// Contenders that are looked at again beside later effects: so many, as long as their score is not both this far behind and by
/// this part.
const NEAR: usize = 5;
const BEHIND: f64 = 15.0;
const APART: f64 = 0.5;
/// Times that a search begins again where the model is likelier.
const MOST_MOVES: usize = 3;
/// So many of them where nothing can be accepted.
const ASKED: usize = 8;

/// Finds what is missing from a model: fits it as it stands, screens every effect of the catalogue at every place, fits the best,
/// and accepts what holds; again, until nothing more is justified.
///
/// `held` are runs that take no part in fits: an effect must gain there too.
///
/// # Errors
/// [`SearchError`]; a search that finds nothing is a [`Diagnosis`].
pub fn search(
    model: &Model,
    runs: &[Run],
    held: &[Run],
    catalogue: &Catalogue,
    options: &SearchOptions,
    watcher: &Watcher<'_>,
) -> Result<Diagnosis, SearchError> {
    apart(runs, held)?;
    let all: Vec<Run> = runs.iter().chain(held).map(evenly).collect::<Result<_, _>>()?;
    let domain = options.domain.settled(&changed(model, &options.fit.changes)?, &all[..runs.len()])?;
    let runs = Runs { all: &all, train: runs.len(), domain: &domain };
    if runs.train().iter().all(|run| run.measured.iter().all(|z| z.is_nan())) {
        return Err(SearchError::NothingMeasured);
    }
    watcher("fitting the model as it stands");
    let own = names(model);
    let mut firsts = first_stages(model, runs, options)?.into_iter();
    let from = |first: Stage| {
        let (accepted, rejected, told) = (Vec::new(), Vec::new(), Vec::new());
        Search { runs, catalogue, options, watcher, own: own.clone(), accepted, rejected, told }.run(first)
    };
    let found = from(firsts.next().ok_or_else(|| SearchError::NoFit("it has no end".into()))?)?;
    if found.verdict == Verdict::UnknownCause && found.family_wise_p < options.alpha {
        // the likeliest fit of a model that lacks much may have bent to it so far that no effect straightens it by a small step
        for first in firsts {
            watcher("nothing could be accepted there: searching from a less likely minimum");
            if let Some(other) = from(first).ok().filter(|other| other.verdict == Verdict::EffectFound) {
                return Ok(other);
            }
        }
    }
    Ok(found)
}

pub(super) struct Search<'a> {
    pub(super) runs: Runs<'a>,
    catalogue: &'a Catalogue,
    pub(super) options: &'a SearchOptions,
    pub(super) watcher: &'a Watcher<'a>,
    /// Everything that the user gave a name.
    own: BTreeSet<String>,
    pub(super) accepted: Vec<Accepted>,
    rejected: Vec<Rejected>,
    told: Vec<Told>,
}

/// What is known when the search ends.
struct End {
    family_wise: f64,
    left_out: Vec<crate::diagnose::diagnosis::LeftOut>,
    detectable: Vec<crate::diagnose::diagnosis::Detectable>,
    metric: Metric,
    knots: Vec<usize>,
    ended: String,
}

impl<'a> Search<'a> {
    fn run(mut self, first: Stage) -> Result<Diagnosis, SearchError> {
        let mut first = Arc::new(first);
        let mut stage = Arc::clone(&first);
        let mut moves = 0;
        let mut end: Option<End> = None;
        let mut ahead: Option<(Round<'a>, Option<Contest>)> = None;
        loop {
            let measured = Measured::new(&stage, self.runs);
            let number = self.told.len() + 1;
            let (round, made) = match ahead.take() {
                Some((round, contest)) => (Ok(round), contest),
                None => {
                    let candidates = self.candidates(&stage, None);
                    (self.watcher)(&format!("search {number}: {} candidates", candidates.len()));
                    let round = Round::new(Arc::clone(&stage), self.runs, &candidates, &measured, self.options);
                    (self.watcher)(&format!("search {number}: screened"));
                    (round, None)
                }
            };
            let mut round = match (round, &mut end) {
                // what was accepted stays
                (Err(reason), Some(last)) => {
                    last.ended = match reason {
                        SearchError::NoPlaces => "no other effect can be tried beside those that were accepted".into(),
                        other => format!("it could not go on: {other}"),
                    };
                    break;
                }
                (round, _) => round?,
            };
            let contest = match made {
                None if round.screening.family_wise < self.options.alpha || round.is_doubtful() => {
                    Some(self.contest(&mut round)?)
                }
                made => made,
            };
            if moves < MOST_MOVES
                && let Some(next) = contest.as_ref().and_then(|c| self.elsewhere(&stage, c))
            {
                (self.watcher)("the model is likelier elsewhere: searching from there");
                stage = Arc::new(next);
                if self.accepted.is_empty() {
                    first = Arc::clone(&stage);
                }
                moves += 1;
                continue;
            }
            let p = contest.as_ref().map_or(round.screening.family_wise, |contest| confirmed(&round, contest));
            self.told.push(Told { family_wise_p: p, ranking: round.ranking(), accepted: None });
            let last = self.known(&mut end, &mut round, p);
            if let Some(contest) = &contest {
                last.metric = contest.metric.clone();
            }
            if p >= self.options.alpha {
                last.ended = format!("noise alone would make the best candidate look as good with probability {p:.2}");
                let fitted = contest.iter().flat_map(|contest| contest.contenders.iter().chain(&contest.far));
                let reason = "what it gains in fact is not beyond what noise gives to the best of so many";
                self.rejected.extend(fitted.map(|c| rejected(&round, number, c, reason.into())));
                break;
            }
            if self.accepted.len() >= self.options.most {
                last.ended = format!("{} effects are the most that are looked for", self.options.most);
                break;
            }
            let Some(next) = contest.map(|c| self.accept(&round, &c, &measured, (number, p))).transpose()?.flatten()
            else {
                last.ended = "no candidate that was fitted could be accepted".into();
                break;
            };
            (stage, ahead) = (next.stage, next.ahead);
            let accepted = self.accepted.last().map(|a| (a.cause.gain_train, a.cause.place.clone()));
            if let (Some(told), Some((_, place))) = (self.told.last_mut(), &accepted) {
                told.accepted = Some(place.clone());
            }
            let whole: f64 = self.accepted.iter().map(|a| a.cause.gain_train).sum();
            if let Some((gain, _)) = accepted.filter(|(gain, _)| *gain < MARGINAL * whole) {
                last.ended = format!("the last effect gained {gain:.1}, less than a hundredth of the whole");
                break;
            }
        }
        let Some(end) = end else { return Err(SearchError::NoPlaces) };
        self.conclude(&first, stage, end)
    }

    /// The best candidates fitted: fewer where they are asked only whether anything is there.
    fn contest(&self, round: &mut Round<'a>) -> Result<Contest, SearchError> {
        let alpha = self.options.alpha;
        if round.screening.family_wise >= alpha {
            let few = round.contest_of(ASKED..=ASKED, self.watcher)?;
            if confirmed(round, &few) >= alpha {
                return Ok(few);
            }
        }
        let contest = round.contest(self.watcher)?;
        if confirmed(round, &contest) < alpha {
            return Ok(contest);
        }
        // something is there, and none of those that promise most is it
        round.contest_of_all(self.watcher)
    }

    /// The stage where its model is likelier, where a contest has found that; none where it has not, or there is no response.
    fn elsewhere(&self, stage: &Stage, contest: &Contest) -> Option<Stage> {
        let mut theta = contest.elsewhere.clone()?;
        let held = shared_from(stage.params(), theta.first()?, &stage.theta[self.runs.train..]);
        theta.extend(held);
        Stage::new(stage.model.clone(), self.runs, theta).ok()
    }

    /// Takes down what a search told.
    fn known<'e>(&self, end: &'e mut Option<End>, round: &mut Round<'a>, p: f64) -> &'e mut End {
        let metric = Metric::new(&round.screening.spectra, self.options.screening.dropped);
        let left_out = std::mem::take(&mut round.left_out);
        let last = end.get_or_insert_with(|| End {
            family_wise: p,
            left_out,
            detectable: Vec::new(),
            metric: metric.clone(),
            knots: Vec::new(),
            ended: String::new(),
        });
        last.metric = metric.with_surplus_of(&last.metric);
        last.detectable = round.detectable();
        last.knots = round.screening.spectra.iter().map(|s| s.size()).collect();
        last
    }

    /// Candidates that attach to what the user wrote, and are not in the model yet, nor this one.
    pub(super) fn candidates(&self, stage: &Stage, besides: Option<&EffectAt>) -> Vec<Candidate> {
        let places = self.catalogue.places(&stage.subject);
        let fresh = |c: &Candidate| {
            let own = place(c);
            let there = self.accepted.iter().any(|a| a.cause.place == own) || besides == Some(&own);
            !there && c.targets().iter().all(|t| self.own.contains(t))
        };
        places.candidates.into_iter().filter(fresh).collect()
    }

    /// Takes the best contender that nothing speaks against; the model with it, fitted jointly.
    fn accept(
        &mut self,
        round: &Round<'a>,
        contest: &Contest,
        measured: &Measured,
        (number, p): (usize, f64),
    ) -> Result<Option<Beginning<'a>>, SearchError> {
        let mut fit = Vec::new();
        for (k, contender) in contest.contenders.iter().enumerate() {
            match objection(round, contender) {
                None => fit.push(k),
                Some(reason) => self.rejected.push(rejected(round, number, contender, reason)),
            }
        }
        let Some(next) = self.best_beginning(round, contest, measured, &fit)? else { return Ok(None) };
        let k = next.contender;
        let (contender, cause) = (&contest.contenders[k], cause(round, contest, (k, p)));
        let grouped = |t: usize| {
            let own = place(&round.traces[t].attached.candidate);
            cause.group.iter().any(|rival| rival.place == own)
        };
        let others = fit.iter().map(|o| &contest.contenders[*o]).chain(&contest.far);
        for other in others.filter(|o| !grouped(o.trace)) {
            let behind = contender.score() - other.score();
            let reason = match behind >= 0.0 {
                true => format!("{behind:.1} behind {} in score", cause.place),
                false => format!("with a second effect it stays behind {} with one", cause.place),
            };
            self.rejected.push(rejected(round, number, other, reason));
        }
        let attached = &round.traces[contender.trace].attached;
        (self.watcher)(&format!("accepted {}", cause.place));
        let least = contender.score() - (APART * contender.score()).max(BEHIND);
        let close = |(o, c): &(usize, &Contender)| *o != k && c.score() > least && fit.contains(o);
        let near = contest.contenders.iter().enumerate().filter(close).take(NEAR).map(|(_, c)| {
            let other = &round.traces[c.trace].attached;
            (other.candidate.clone(), written(other, &c.fitting.theta[0]))
        });
        self.accepted.push(Accepted::new(attached, &contender.fitting, cause, near.collect()));
        Ok(Some(next))
    }

    /// The last fits by one noise, and everything that is told of them.
    fn conclude(mut self, first: &Stage, grown: Arc<Stage>, end: End) -> Result<Diagnosis, SearchError> {
        let metric = &end.metric;
        let before = whole_fit(first, self.runs, metric)?;
        let mut last = None;
        if !self.accepted.is_empty() {
            (self.watcher)("fitting the extended model");
            let (stage, dropped) = eliminate(grown, first, self.runs, metric, &mut self.accepted)?;
            self.rejected.extend(dropped);
            last = Some(revise(stage, first, self.runs, metric, &mut self.accepted)?);
        }
        let after = match &last {
            Some(stage) => whole_fit(stage, self.runs, metric)?,
            None => before.clone(),
        };
        let (all, train) = (self.runs.all, self.runs.train);
        let at = |stage: &Stage, fit: &Whole| responses(&stage.model, all, &stage.ways, &fit.theta);
        let old = at(first, &before).unwrap_or_else(|| first.response.clone());
        let mut new = last.as_ref().map_or(Some(old.clone()), |stage| at(stage, &after)).unwrap_or_else(|| old.clone());
        for accepted in &mut self.accepted {
            accepted.renew(&after.fitting);
        }
        (self.watcher)("asking for forces and for what is left");
        let seen = Seen::new(first, self.runs, &before.theta)?;
        let misfit = seen.misfit();
        let heard = seen.heard();
        let explained = match &last {
            Some(stage) => Seen::new(stage, self.runs, &after.theta)?.heard(),
            None => None,
        };
        let cost = self.accepted.iter().map(Accepted::cost).sum();
        let mut attribution = heard.as_ref().map(|h| against(&first.model, h, explained.as_ref().map(|e| (e, cost))));
        let verdict = self.verdict(attribution.as_ref(), end.family_wise);
        if verdict == Verdict::Disturbance {
            self.withdraw();
            (last, new) = (None, old.clone());
        }
        if let Some(told) = &mut attribution {
            told.warnings.extend(one_law(&self.accepted));
        }
        let suggestions = if verdict == Verdict::UnknownCause { seen.suggestions() } else { None };
        let found = !self.accepted.is_empty();
        let following = following(last.as_ref().map_or(first, |stage| stage), self.runs, &end.detectable);
        Ok(Diagnosis {
            verdict,
            family_wise_p: end.family_wise,
            causes: self.accepted.into_iter().map(|a| a.cause).collect(),
            rejected: self.rejected,
            rounds: self.told,
            detectable: end.detectable,
            left_out: end.left_out,
            biased: if found { biased(&before.fitting.estimates, &after.fitting.estimates) } else { Vec::new() },
            // before: as a plain fit of the model has them
            outputs: output_gains(
                &first.model,
                all,
                train,
                &first.ways,
                (&first.response, if found { &new } else { &first.response }),
                metric,
            ),
            overlays: overlays(all, train, &first.ways, (&first.response, if found { &new } else { &first.response })),
            gains: if found { run_gains(all, train, &first.ways, (&old, &new), metric) } else { Vec::new() },
            noise_knots: end.knots,
            extended: last.map(|stage| stage.model.source().text().to_string()),
            ended: end.ended,
            misfit,
            attribution,
            places: heard.map(|h| h.places),
            suggestions,
            following,
            spectral: first.spectral(),
        })
    }

    /// Effect, force, unknown cause or nothing.
    fn verdict(&self, attribution: Option<&Attribution>, family_wise: f64) -> Verdict {
        let (found, clear) = (!self.accepted.is_empty(), family_wise < self.options.alpha);
        match attribution.map(|a| a.verdict) {
            Some(force::Verdict::Disturbance) => Verdict::Disturbance,
            // what an accepted effect leaves is told beside it
            _ if found => Verdict::EffectFound,
            Some(force::Verdict::UnknownCause) => Verdict::UnknownCause,
            _ if clear => Verdict::UnknownCause,
            _ => Verdict::NoEffectFound,
        }
    }

    /// Takes back what was accepted: it was the nearest likeness of a force.
    fn withdraw(&mut self) {
        for (k, accepted) in self.accepted.drain(..).enumerate() {
            let Cause { place, gain_train, gain_holdout, .. } = accepted.cause;
            let reason = "a force that does not repeat from run to run explains more".into();
            self.rejected.push(Rejected { place, round: k + 1, gain_train, gain_holdout, reason });
        }
    }
}

/// The model of a stage with an effect in its text.
pub(super) fn grown(model: &Model, text: &Attached, stage: &Stage) -> Result<Model, SearchError> {
    let extended = model.extended(&text.extension)?;
    let params = text.fitted_params(stage);
    let same = params.len() == extended.definition().params.len();
    Ok(if same { extended.with_params(params) } else { extended })
}

/// Everything that the user gave a name.
fn names(model: &Model) -> BTreeSet<String> {
    let definition = model.definition();
    let inputs = definition.inputs.iter().map(|i| &i.quantity);
    let states = definition.states.iter().map(|s| &s.quantity);
    let outputs = definition.outputs.iter().map(|o| &o.quantity);
    let params = definition.params.iter().map(|p| &p.quantity);
    inputs.chain(states).chain(outputs).chain(params).map(|q| q.name.clone()).collect()
}

/// Values of the new parameters as they are written into the text.
pub(super) fn written(attached: &Attached, theta: &[f64]) -> Choice {
    let short = |v: f64| format!("{v:.*e}", DIGITS - 1).parse().unwrap_or(v);
    let values = attached.params().iter().zip(new_values(attached, theta));
    values.filter(|(p, _)| p.begins_as.is_none()).map(|(p, v)| (p.local.clone(), short(v))).collect()
}
