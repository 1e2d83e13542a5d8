//! The road from a model as it stands to a diagnosis.

use super::attached::Attached;
use super::beside::cosine;
use super::domain::Domain;
use super::elimination::{Accepted, eliminate, revise};
use super::evenly::{apart, evenly};
use super::evidence::Seen;
use super::gains::{biased, output_gains, responses, run_gains};
use super::judgement::{cause, objection, rejected};
use super::measured::Measured;
use super::metric::Metric;
use super::options::{SearchOptions, Watcher};
use super::refit::{Fitting, Posed};
use super::round::{Contender, Contest, PRICE, Round, Runs, new_values, place};
use super::search_error::SearchError;
use super::stage::Stage;
use crate::diagnose::diagnosis::{Cause, Diagnosis, Rejected, Round as Told, Verdict};
use crate::diagnose::force::{self, Attribution};
use crate::estimate::{Changes, FitOptions, SpectralOptions, changed, fit, fit_spectra, starts};
use crate::model::Model;
use crate::record::Run;
use fdm_grammar::effect::{Candidate, Catalogue, Choice};
use std::collections::BTreeSet;

/// Digits of a fitted value in the extended text.
const DIGITS: usize = 5;
/// Part of the whole gain below which another effect is not looked for.
const MARGINAL: f64 = 0.01;
/// Contenders whose second effects are looked at, where the best one leaves much.
const BEGINNINGS: usize = 3;
/// Part of the best score that such a contender has.
const RIVAL: f64 = 0.25;
/// Contenders that are looked at again beside later effects.
const NEAR: usize = 5;
/// Cosine above which two contenders are one beginning.
const ALIKE: f64 = 0.97;

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
    let first = first_stage(model, runs, options)?;
    let own = names(&first.model);
    let (accepted, rejected, told) = (Vec::new(), Vec::new(), Vec::new());
    Search { runs, catalogue, options, watcher, own, accepted, rejected, told }.run(first)
}

/// The model at its fit.
fn first_stage(model: &Model, runs: Runs<'_>, options: &SearchOptions) -> Result<Stage, SearchError> {
    match runs.domain {
        Domain::Time => first_in_time(model, runs, options),
        Domain::Frequency(spectral) => first_in_lines(model, runs, options, spectral),
    }
}

/// The model at its fit to spectra. Held-out runs have values of their own only where these show them, and are fitted with their own noise.
fn first_in_lines(
    model: &Model,
    runs: Runs<'_>,
    options: &SearchOptions,
    spectral: &SpectralOptions,
) -> Result<Stage, SearchError> {
    let (changes, how) = (options.fit.changes.clone(), options.fit.options.clone());
    let start = starts(model, runs.all, &changes);
    let how = SpectralOptions { changes, options: how, ..spectral.clone() };
    let fitted = fit_spectra(model, runs.train(), &how, &mut ())?;
    if let Some(why) = &fitted.unanswered {
        return Err(SearchError::NoFit(why.to_string()));
    }
    let model = fitted.model.clone();
    let of = |(run, start): (&Run, &Vec<f64>)| {
        let each = model.definition().params.iter().zip(start);
        each.map(|(p, start)| {
            let owner = p.per_run.then_some(run.name.as_str());
            fitted.estimate.parameter(&p.quantity.name, owner).map_or(*start, |e| e.value)
        })
        .collect()
    };
    let theta = runs.all.iter().zip(&start).map(of).collect();
    Stage::new(model, runs, theta)
}

/// The model at its fit by plain output error.
fn first_in_time(model: &Model, runs: Runs<'_>, options: &SearchOptions) -> Result<Stage, SearchError> {
    let mut how = options.fit.clone();
    how.options.colour = false;
    let fitted = fit(model, runs.train(), &how, &mut ())?;
    if fitted.estimate.runs.is_empty() {
        return Err(SearchError::NoFit(fitted.estimate.termination.to_string()));
    }
    let model = fitted.model.clone();
    let reached = |run: &Run, start: &[f64], estimate: &crate::estimate::Estimate| -> Vec<f64> {
        let each = model.definition().params.iter().zip(start);
        each.map(|(p, start)| {
            let owner = p.per_run.then_some(run.name.as_str());
            estimate.parameter(&p.quantity.name, owner).map_or(*start, |e| e.value)
        })
        .collect()
    };
    let start = starts(&model, runs.all, &how.changes);
    let mut theta: Vec<Vec<f64>> =
        runs.train().iter().zip(&start).map(|(run, start)| reached(run, start, &fitted.estimate)).collect();
    if !runs.held().is_empty() {
        let shared: Vec<(String, f64)> = model
            .definition()
            .params
            .iter()
            .zip(&theta[0])
            .filter(|(p, _)| !p.per_run && !p.is_recorded())
            .map(|(p, v)| (p.quantity.name.clone(), v.max(p.lower).min(p.upper)))
            .collect();
        let names = shared.iter().map(|(name, _)| name.clone()).collect();
        let changes = Changes { set: shared, fix: names, free: Vec::new() };
        let held = fit(&model, runs.held(), &FitOptions { changes, ..how.clone() }, &mut ())?;
        for (run, start) in runs.held().iter().zip(&start[runs.train..]) {
            let mut own = reached(run, start, &held.estimate);
            let each = model.definition().params.iter().zip(own.iter_mut().zip(&theta[0]));
            each.filter(|(p, _)| !p.per_run).for_each(|(_, (own, shared))| *own = *shared);
            theta.push(own);
        }
    }
    Stage::new(model, runs, theta)
}

struct Search<'a> {
    runs: Runs<'a>,
    catalogue: &'a Catalogue,
    options: &'a SearchOptions,
    watcher: &'a Watcher<'a>,
    /// Everything that the user gave a name.
    own: BTreeSet<String>,
    accepted: Vec<Accepted>,
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

impl Search<'_> {
    fn run(mut self, first: Stage) -> Result<Diagnosis, SearchError> {
        let mut grown: Option<Stage> = None;
        let mut end: Option<End> = None;
        loop {
            let stage = grown.as_ref().unwrap_or(&first);
            let measured = Measured::new(stage, self.runs);
            let candidates = self.candidates(stage);
            let number = self.told.len() + 1;
            (self.watcher)(&format!("search {number}: {} candidates", candidates.len()));
            let mut round = match (Round::new(stage, self.runs, &candidates, &measured, self.options), &mut end) {
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
            let (ranking, detectable) = (round.ranking(), round.detectable());
            let (p, knots) = (round.screening.family_wise, round.screening.spectra.iter().map(|s| s.size()).collect());
            self.told.push(Told { family_wise_p: p, ranking, accepted: None });
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
            (last.detectable, last.metric, last.knots) = (detectable, metric, knots);
            if p >= self.options.alpha {
                last.ended = format!("noise alone would make the best candidate look as good with probability {p:.2}");
                break;
            }
            if self.accepted.len() >= self.options.most {
                last.ended = format!("{} effects are the most that are looked for", self.options.most);
                break;
            }
            let contest = round.contest(self.watcher)?;
            last.metric = contest.metric.clone();
            let Some(next) = self.accept(&round, &contest, &measured, number)? else {
                last.ended = "no candidate that was fitted could be accepted".into();
                break;
            };
            let accepted = self.accepted.last().map(|a| (a.cause.gain_train, a.cause.place.clone()));
            if let (Some(told), Some((_, place))) = (self.told.last_mut(), &accepted) {
                told.accepted = Some(place.clone());
            }
            drop(round);
            grown = Some(next);
            let whole: f64 = self.accepted.iter().map(|a| a.cause.gain_train).sum();
            if let Some((gain, _)) = accepted.filter(|(gain, _)| *gain < MARGINAL * whole) {
                last.ended = format!("the last effect gained {gain:.1}, less than a hundredth of the whole");
                break;
            }
        }
        let Some(end) = end else { return Err(SearchError::NoPlaces) };
        self.conclude(first, grown, end)
    }

    /// Candidates that attach to what the user wrote, and are not in the model yet.
    fn candidates(&self, stage: &Stage) -> Vec<Candidate> {
        let places = self.catalogue.places(&stage.subject);
        let fresh = |c: &Candidate| {
            let there = self.accepted.iter().any(|a| a.cause.place == place(c));
            !there && c.targets().iter().all(|t| self.own.contains(t))
        };
        places.candidates.into_iter().filter(fresh).collect()
    }

    /// Takes the best contender that nothing speaks against; the model with it, fitted jointly.
    fn accept(
        &mut self,
        round: &Round<'_>,
        contest: &Contest,
        measured: &Measured,
        number: usize,
    ) -> Result<Option<Stage>, SearchError> {
        let mut fit = Vec::new();
        for (k, contender) in contest.contenders.iter().enumerate() {
            match objection(round, contender) {
                None => fit.push(k),
                Some(reason) => self.rejected.push(rejected(round, number, contender, reason)),
            }
        }
        let Some((k, stage)) = self.best_beginning(round, contest, measured, &fit)? else { return Ok(None) };
        let (contender, cause) = (&contest.contenders[k], cause(round, contest, k));
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
        let near = contest.contenders.iter().enumerate().filter(|(o, _)| *o != k).take(NEAR).map(|(_, c)| {
            let other = &round.traces[c.trace].attached;
            (other.candidate.clone(), written(other, &c.fitting.theta[0]))
        });
        self.accepted.push(Accepted::new(attached, &contender.fitting, cause, near.collect()));
        Ok(Some(stage))
    }

    /// The contender to go on with: the best one, unless it leaves much and another one leads further with a second effect.
    fn best_beginning(
        &self,
        round: &Round<'_>,
        contest: &Contest,
        measured: &Measured,
        fit: &[usize],
    ) -> Result<Option<(usize, Stage)>, SearchError> {
        let Some(best) = fit.first().copied() else { return Ok(None) };
        let stage = self.stage_with(round, &contest.contenders[best], measured)?;
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
        if others.is_empty() || self.accepted.len() + 2 > self.options.most {
            return Ok(Some((best, stage)));
        }
        let costs = |k: usize| PRICE * contest.contenders[k].cost as f64;
        let Some(first) = self.second_effect(&stage, &contest.metric)? else { return Ok(Some((best, stage))) };
        (self.watcher)(&format!("the best one leaves much: trying {} other beginnings", others.len()));
        let mut found = (first + costs(best), best, stage);
        for k in others {
            let Ok(stage) = self.stage_with(round, &contest.contenders[k], measured) else { continue };
            if let Ok(Some(total)) = self.second_effect(&stage, &contest.metric)
                && total + costs(k) < found.0
            {
                found = (total + costs(k), k, stage);
            }
        }
        Ok(Some((found.1, found.2)))
    }

    /// The cost of the best second effect beside a first one, by a common noise, with the price of its parameters; none where
    /// nothing is left to be found.
    fn second_effect(&self, stage: &Stage, metric: &Metric) -> Result<Option<f64>, SearchError> {
        let measured = Measured::new(stage, self.runs);
        let mut round = Round::new(stage, self.runs, &self.candidates(stage), &measured, self.options)?;
        if round.screening.family_wise >= self.options.alpha {
            return Ok(None);
        }
        let contest = round.contest(&|_| ())?;
        let Some(best) = contest.contenders.first() else { return Ok(None) };
        let posed = Posed {
            params: best.model.definition().params.clone(),
            dynamics: best.model.dynamics(),
            runs: self.runs.train(),
            ways: &best.ways[..self.runs.train],
            metric,
        };
        let price = PRICE * best.cost as f64;
        Ok(posed.fit(&best.fitting.theta, 60).map(|fitting| fitting.cost + price))
    }

    /// The model with a contender in its text, fitted jointly.
    fn stage_with(&self, round: &Round<'_>, contender: &Contender, measured: &Measured) -> Result<Stage, SearchError> {
        let attached = &round.traces[contender.trace].attached;
        let choice = written(attached, &contender.fitting.theta[0]);
        let text = Attached::new(&attached.candidate, round.stage, measured, &choice).map_err(SearchError::NoFit)?;
        let model = grown(&round.stage.model, &text, round.stage)?;
        let mut theta = contender.fitting.theta.clone();
        match &contender.held {
            Some((_, held)) => theta.extend(held.theta.iter().cloned()),
            None => {
                let values = new_values(attached, &contender.fitting.theta[0]);
                theta.extend((self.runs.train..self.runs.all.len()).map(|r| attached.theta(round.stage, r, &values)));
            }
        }
        Stage::new(model, self.runs, theta)
    }

    /// The last fits by one noise, and everything that is told of them.
    fn conclude(mut self, first: Stage, grown: Option<Stage>, end: End) -> Result<Diagnosis, SearchError> {
        let metric = &end.metric;
        let before = whole_fit(&first, self.runs, metric)?;
        let mut last = grown;
        if let Some(stage) = last.take() {
            (self.watcher)("fitting the extended model");
            let (stage, dropped) = eliminate(stage, &first, self.runs, metric, &mut self.accepted)?;
            self.rejected.extend(dropped);
            let stage = revise(stage, &first, self.runs, metric, &mut self.accepted)?;
            last = (!self.accepted.is_empty()).then_some(stage);
        }
        let after = match &last {
            Some(stage) => whole_fit(stage, self.runs, metric)?,
            None => before.clone(),
        };
        let (all, train) = (self.runs.all, self.runs.train);
        let at = |stage: &Stage, fit: &Whole| responses(&stage.model, all, &stage.ways, &fit.theta);
        let old = at(&first, &before).unwrap_or_else(|| first.response.clone());
        let mut new = last.as_ref().map_or(Some(old.clone()), |stage| at(stage, &after)).unwrap_or_else(|| old.clone());
        for accepted in &mut self.accepted {
            accepted.renew(&after.fitting);
        }
        (self.watcher)("asking for forces and for what is left");
        let seen = Seen::new(&first, self.runs, &before.theta)?;
        let misfit = seen.misfit();
        let heard = seen.heard();
        let explained = match &last {
            Some(stage) => Seen::new(stage, self.runs, &after.theta)?.heard(),
            None => None,
        };
        let cost = self.accepted.iter().map(Accepted::cost).sum();
        let attribution = heard.as_ref().map(|h| h.against(explained.as_ref().map(|e| (e, cost))));
        let verdict = self.verdict(attribution.as_ref(), end.family_wise);
        if verdict == Verdict::Disturbance {
            self.withdraw();
            (last, new) = (None, old.clone());
        }
        let suggestions = if verdict == Verdict::UnknownCause { seen.suggestions() } else { None };
        let found = !self.accepted.is_empty();
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
            gains: if found { run_gains(all, train, &first.ways, (&old, &new), metric) } else { Vec::new() },
            noise_knots: end.knots,
            extended: last.map(|stage| stage.model.source().text().to_string()),
            ended: end.ended,
            misfit,
            attribution,
            places: heard.map(|h| h.places),
            suggestions,
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

/// A model fitted to the runs that are learned from, and what belongs to each held-out run.
#[derive(Clone)]
pub(super) struct Whole {
    pub(super) fitting: Fitting,
    /// All runs.
    pub(super) theta: Vec<Vec<f64>>,
    /// Cost on the held-out runs; 0 without any.
    held: f64,
}

impl Whole {
    /// Cost of all runs.
    pub(super) fn cost(&self) -> f64 {
        self.fitting.cost + self.held
    }
}

/// Fits a stage by a noise.
pub(super) fn whole_fit(stage: &Stage, runs: Runs<'_>, metric: &Metric) -> Result<Whole, SearchError> {
    const CORRECTIONS: usize = 60;
    let (params, dynamics) = (stage.params().to_vec(), stage.model.dynamics());
    let (train, held) = stage.ways.split_at(runs.train);
    let posed = Posed { params: params.clone(), dynamics, runs: runs.train(), ways: train, metric };
    let none = || SearchError::NoFit("it has no fit by the noise found".into());
    let fitting = posed.fit(&stage.theta[..runs.train], CORRECTIONS).ok_or_else(none)?;
    let mut theta = fitting.theta.clone();
    let mut cost = 0.0;
    if !held.is_empty() {
        let starts = super::round::shared_from(&params, &theta[0], &stage.theta[runs.train..]);
        let posed = Posed { params, dynamics, runs: runs.held(), ways: held, metric }.held();
        let found = posed.fit(&starts, CORRECTIONS);
        cost = found.as_ref().map_or(f64::INFINITY, |f| f.cost);
        theta.extend(found.map_or(starts, |f| f.theta));
    }
    Ok(Whole { fitting, theta, held: cost })
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
