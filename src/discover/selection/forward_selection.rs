//! Forward selection of effects, from the base model to a diagnosis.

use super::acceptance::{cause, has_the_other_sign, objection, rejected, separating};
use super::candidate_model::CandidateModel;
use super::comparison::Comparison;
use super::elimination::{Accepted, eliminate, revise};
use super::error::DiagnosisError;
use super::extended_model::{SignalScales, place, written};
use super::fitted_model::{FittedModel, shared_from};
use super::forward_step::ForwardStep;
use super::initial_fit::initial_fits;
use super::look_ahead::{Acceptable, NextStep};
use super::runs::{DiagnosisOptions, Domain, Runs, apart, prepared, thinned};
use super::significance::confirmed;
use super::whitening::CommonNoise;
use crate::diagnosis::{Diagnosis, EffectAt, LeftOut, Rejected, SelectionStep, Verdict};
use crate::disturbance::BELIEVED;
use fdm_effects::{Candidate, Catalogue, Choice, Subject};
use fdm_estimate::{Work, changed};
use fdm_grammar::syntax::Class;
use fdm_system::model::Model;
use fdm_system::record::Run;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Part of the whole gain below which another effect is not looked for.
const MARGINAL: f64 = 0.01;
/// Candidate models that are looked at again beside later effects: so many, as long as their score is not both this far behind and by
/// this part.
const NEAR: usize = 5;
const BEHIND: f64 = 15.0;
const APART: f64 = 0.5;
/// Mechanisms that are kept for the front beside the one that is taken in a step, and part of its score that they have.
const MOST_ASIDE: usize = 2;
const ASIDE: f64 = 0.5;
/// Times that a search begins again where the model is likelier.
const MOST_MOVES: usize = 3;
/// So many of them where nothing can be accepted.
const ASKED: usize = 8;

/// Finds what is missing from a model: fits it as it stands, screens every effect of the catalogue at every place, fits the best,
/// and accepts what holds; again, until nothing more is justified.
///
/// `validation` are runs that take no part in fits: an effect must gain there too. Work that is to end begins nothing any more: what was
/// accepted by then is the result, and it says that it was stopped.
///
/// # Errors
/// [`DiagnosisError`]; a search that finds nothing is a [`Diagnosis`]. [`DiagnosisError::Stopped`] before the base model is fitted and
/// the candidates are screened.
pub fn diagnose(
    model: &Model,
    runs: &[Run],
    validation: &[Run],
    catalogue: &Catalogue,
    options: &DiagnosisOptions,
    work: &Work<'_>,
) -> Result<Diagnosis, DiagnosisError> {
    apart(runs, validation)?;
    let of = |run: &Run| prepared(run, &options.domain);
    let found: Vec<(Run, Option<String>)> = runs.iter().chain(validation).map(of).collect::<Result<_, _>>()?;
    let (all, notes): (Vec<Run>, Vec<Option<String>>) = found.into_iter().unzip();
    let mut notes: Vec<String> = notes.into_iter().flatten().collect();
    let subject = Subject::new(model.source(), model.definition()).map_err(DiagnosisError::Text)?;
    let whole = all.clone();
    let candidates = catalogue.places(&subject).candidates.len();
    let (all, fewer) = thinned(all, model.layout().outputs, candidates, &options.domain);
    let whole = if fewer.is_some() && options.domain == Domain::Time { whole } else { Vec::new() };
    notes.extend(fewer);
    let domain = options.domain.settled(&changed(model, &options.fit.changes)?, &all[..runs.len()])?;
    let runs = Runs { all: &all, train: runs.len(), domain: &domain };
    if runs.train().iter().all(|run| run.measured.iter().all(|z| z.is_nan())) {
        return Err(DiagnosisError::NothingMeasured);
    }
    if runs.train().iter().all(|run| is_still(run, model.layout().outputs)) {
        return Err(DiagnosisError::Still);
    }
    let own = names(model);
    if std::env::var_os("FDM_INFER").is_some() {
        let mut found = super::infer::diagnose(model, runs, catalogue, (options, work), &own)?;
        found.notes.splice(0..0, notes);
        return Ok(found);
    }
    work.stage("fitting the base model");
    let mut firsts = initial_fits(model, runs, options, work)?.into_iter();
    let from = |first: FittedModel| {
        let whole = Some(Runs { all: &whole, ..runs }).filter(|whole| !whole.all.is_empty());
        let shared = Shared { runs, whole, catalogue, options, work, own: &own };
        ForwardSelection::new(&shared, None).run(first)
    };
    let likeliest = firsts.next().ok_or_else(|| DiagnosisError::NoFit("it has no end".into()))?;
    let mut found = from(likeliest)?;
    if found.verdict == Verdict::UnknownCause && found.family_wise_p < options.alpha {
        // the best fit of a base model that is badly wrong can be so distorted that no single effect improves it
        for first in firsts.take_while(|_| work.goes_on()) {
            work.stage("no candidate could be accepted there: restarting from the next-best local minimum");
            if let Some(other) = from(first).ok().filter(|other| other.verdict == Verdict::EffectFound) {
                found = other;
                break;
            }
        }
    }
    found.notes.splice(0..0, notes);
    Ok(found)
}

/// Whether every one of the `q` outputs has one value wherever it was measured.
fn is_still(run: &Run, q: usize) -> bool {
    (0..q).all(|k| {
        let mut values = run.measured.iter().skip(k).step_by(q).filter(|z| !z.is_nan());
        values.next().is_none_or(|first| values.all(|z| z == first))
    })
}

/// What all searches of a diagnosis have in common.
#[derive(Clone, Copy)]
pub(super) struct Shared<'a> {
    runs: Runs<'a>,
    /// All samples, where `runs` are a part of them.
    pub(super) whole: Option<Runs<'a>>,
    catalogue: &'a Catalogue,
    options: &'a DiagnosisOptions,
    work: &'a Work<'a>,
    /// Everything that the user gave a name.
    own: &'a BTreeSet<String>,
}

pub(super) struct ForwardSelection<'a> {
    pub(super) shared: Shared<'a>,
    pub(super) runs: Runs<'a>,
    pub(super) options: &'a DiagnosisOptions,
    pub(super) work: &'a Work<'a>,
    /// The only class of effects that is searched; all where there is none.
    classes: Option<Class>,
    pub(super) accepted: Vec<Accepted>,
    pub(super) rejected: Vec<Rejected>,
    pub(super) steps: Vec<SelectionStep>,
    /// Other models that might have been taken.
    pub(super) aside: Vec<Aside>,
    /// Where a search among mechanisms would go on: at the first effect that is none.
    fork: Option<Box<Fork<'a>>>,
}

/// A model that might have been taken in a step, as good as the one that was or nearly.
pub(super) struct Aside {
    pub(super) accepted: Vec<Accepted>,
    pub(super) current: Arc<FittedModel>,
}

/// A search, and the model that it has come to.
struct Fork<'a> {
    search: ForwardSelection<'a>,
    current: Arc<FittedModel>,
}

/// Where a search has got to.
pub(super) struct Reached {
    pub(super) first: Arc<FittedModel>,
    pub(super) current: Arc<FittedModel>,
    pub(super) end: End,
}

/// What is known when the search ends.
#[derive(Clone)]
pub(super) struct End {
    pub(super) family_wise: f64,
    pub(super) left_out: Vec<LeftOut>,
    pub(super) detectable: Vec<crate::diagnosis::Detectable>,
    pub(super) noise: CommonNoise,
    pub(super) knots: Vec<usize>,
    pub(super) ended: String,
    pub(super) stopped: bool,
}

impl End {
    pub(super) fn stop(&mut self) {
        self.ended = "it was stopped".into();
        self.stopped = true;
    }
}

impl<'a> ForwardSelection<'a> {
    fn new(shared: &Shared<'a>, classes: Option<Class>) -> Self {
        let Shared { runs, options, work, .. } = *shared;
        let (accepted, rejected, steps) = (Vec::new(), Vec::new(), Vec::new());
        let aside = Vec::new();
        Self { shared: *shared, runs, options, work, classes, accepted, rejected, steps, aside, fork: None }
    }

    /// Searches from the base model on, and again among mechanisms from where the first effect was taken that is none, if such are left in the
    /// end: a lag or a stand-in may have taken the place of a mechanism, or of several.
    fn run(mut self, first: FittedModel) -> Result<Diagnosis, DiagnosisError> {
        let first = Arc::new(first);
        let mut reached = self.search((Arc::clone(&first), first), None)?;
        let noise = reached.end.noise.clone();
        if !self.accepted.is_empty() {
            self.work.stage("fitting the extended model");
            reached.current = self.settled(&reached, &noise)?;
        }
        let class = |class: Class| self.accepted.iter().any(|a| a.candidate.effect().class() == class);
        let mixed = class(Class::StandIn) || (class(Class::Sensor) && class(Class::Mechanism));
        let fork = self.fork.take().filter(|_| mixed && !reached.end.stopped && self.work.goes_on());
        let other = fork.and_then(|fork| {
            self.work.stage("searching among mechanisms alone");
            let Fork { mut search, current } = *fork;
            let start = (Arc::clone(&reached.first), current);
            let mut mechanisms = search.search(start, Some(reached.end.clone())).ok()?;
            mechanisms.current = search.settled(&mechanisms, &mechanisms.end.noise.clone()).ok()?;
            (!search.accepted.is_empty() && !mechanisms.end.stopped).then_some((search, mechanisms))
        });
        self.conclude(reached, other)
    }

    /// The model that was reached without what its joint fit does not need.
    fn settled(&mut self, reached: &Reached, noise: &CommonNoise) -> Result<Arc<FittedModel>, DiagnosisError> {
        let (current, first) = (Arc::clone(&reached.current), &reached.first);
        if self.accepted.is_empty() {
            return Ok(current);
        }
        let (current, dropped) = eliminate(current, first, self.runs, noise, &mut self.accepted)?;
        self.rejected.extend(dropped);
        revise(current, first, self.runs, noise, &mut self.accepted)
    }

    /// Accepts one effect after the other, from the base model and one that holds what was accepted before.
    fn search(
        &mut self,
        (mut first, mut current): (Arc<FittedModel>, Arc<FittedModel>),
        mut end: Option<End>,
    ) -> Result<Reached, DiagnosisError> {
        let mut moves = 0;
        loop {
            if let Some(last) = end.as_mut().filter(|_| !self.work.goes_on()) {
                last.stop();
                break;
            }
            let scales = SignalScales::new(&current, self.runs);
            let number = self.steps.len() + 1;
            let candidates = self.candidates(&current);
            self.work.stage(&format!("search {number}: {} candidates", candidates.len()));
            let step = self.step(&current, &candidates, &scales);
            self.work.stage(&format!("search {number}: screened"));
            let mut step = match (step, &mut end) {
                // what was accepted stays
                (Err(DiagnosisError::Stopped), Some(last)) => {
                    last.stop();
                    break;
                }
                (Err(reason), Some(last)) => {
                    last.ended = match reason {
                        DiagnosisError::NoPlaces => "no other effect can be tried beside the accepted ones".into(),
                        other => format!("it could not go on: {other}"),
                    };
                    break;
                }
                (step, _) => step?,
            };
            let asked = step.screening.family_wise < self.options.alpha || step.is_doubtful();
            let comparison = match asked.then(|| self.comparison(&mut step)) {
                // what screening tells is a result
                Some(Err(DiagnosisError::Stopped)) => {
                    let p = step.screening.family_wise;
                    if end.is_none() {
                        self.steps.push(SelectionStep { family_wise_p: p, ranking: step.ranking(), accepted: None });
                        self.known(&mut end, &mut step, p);
                    }
                    end.iter_mut().for_each(End::stop);
                    break;
                }
                comparison => comparison.transpose()?,
            };
            if moves < MOST_MOVES
                && let Some(next) = comparison.as_ref().and_then(|c| self.elsewhere(&current, c))
            {
                self.work.stage("the base model has a better minimum: restarting from there");
                current = Arc::new(next);
                if self.accepted.is_empty() {
                    first = Arc::clone(&current);
                }
                moves += 1;
                continue;
            }
            let p = comparison.as_ref().map_or(step.screening.family_wise, |comparison| confirmed(&step, comparison));
            self.steps.push(SelectionStep { family_wise_p: p, ranking: step.ranking(), accepted: None });
            let last = self.known(&mut end, &mut step, p);
            if let Some(comparison) = &comparison {
                last.noise = comparison.noise.clone();
            }
            if p >= self.options.alpha {
                last.ended = format!("no further effect detected (family-wise p = {p:.2})");
                let fitted = comparison.iter().flat_map(|comparison| comparison.models.iter().chain(&comparison.far));
                let reason = "its gain is not significant among so many candidates";
                self.rejected.extend(fitted.map(|c| rejected(&step, number, c, reason.into())));
                break;
            }
            if self.accepted.len() >= self.options.most {
                last.ended = format!("the limit of {} effects is reached", self.options.most);
                break;
            }
            let Some(next) = comparison.map(|c| self.accept(&step, &c, &scales, (number, p))).transpose()?.flatten()
            else {
                last.ended = "no candidate that was fitted could be accepted".into();
                break;
            };
            current = next.current;
            let accepted = self.accepted.last().map(|a| (a.cause.gain_training, a.cause.place.clone()));
            if let (Some(step), Some((_, place))) = (self.steps.last_mut(), &accepted) {
                step.accepted = Some(place.clone());
            }
            let whole: f64 = self.accepted.iter().map(|a| a.cause.gain_training).sum();
            if let Some((gain, _)) = accepted.filter(|(gain, _)| *gain < MARGINAL * whole) {
                last.ended = format!("the last effect gained {gain:.1}, less than 1 % of the total gain");
                break;
            }
        }
        let Some(end) = end else { return Err(DiagnosisError::NoPlaces) };
        Ok(Reached { first, current, end })
    }

    /// A search for one more effect beside these.
    fn step(
        &self,
        current: &Arc<FittedModel>,
        candidates: &[Candidate],
        scales: &SignalScales,
    ) -> Result<ForwardStep<'a>, DiagnosisError> {
        ForwardStep::new(Arc::clone(current), self.runs, candidates, scales, (self.options, self.work))
    }

    /// The best candidates fitted: fewer where they are asked only whether anything is there.
    fn comparison(&self, step: &mut ForwardStep<'a>) -> Result<Comparison, DiagnosisError> {
        let alpha = self.options.alpha;
        if step.screening.family_wise >= alpha {
            let few = step.comparison_of(ASKED..=ASKED, self.work)?;
            if confirmed(step, &few) >= alpha {
                return Ok(few);
            }
        }
        let comparison = step.comparison(self.work)?;
        if confirmed(step, &comparison) < alpha {
            return Ok(comparison);
        }
        // something is there, and none of those that were predicted to gain most is it
        step.comparison_of_all(self.work)
    }

    /// The stage where its model is likelier, where a comparison has found that; none where it has not, or there is no response.
    fn elsewhere(&self, current: &FittedModel, comparison: &Comparison) -> Option<FittedModel> {
        let mut theta = comparison.elsewhere.clone()?;
        let validation = shared_from(current.params(), theta.first()?, &current.theta[self.runs.train..]);
        theta.extend(validation);
        FittedModel::new(current.model.clone(), self.runs, theta).ok()
    }

    /// Takes down what a search told.
    fn known<'e>(&self, end: &'e mut Option<End>, step: &mut ForwardStep<'a>, p: f64) -> &'e mut End {
        let noise = CommonNoise::new(&step.screening.spectra, self.options.screening.dropped).growing(&step.growth);
        let mut left_out = std::mem::take(&mut step.left_out);
        let places = self.shared.catalogue.places(&step.current.subject);
        let crowded =
            places.crowded.iter().map(|c| (EffectAt { effect: c.effect.clone(), targets: Vec::new() }, c.to_string()));
        let any = |name: &String| EffectAt { effect: "any effect".into(), targets: vec![name.clone()] };
        let untried = places.untried.iter().map(|u| (any(&u.name), u.reason.clone()));
        left_out.extend(crowded.chain(untried).map(|(place, reason)| LeftOut { place, reason }));
        let last = end.get_or_insert_with(|| End {
            family_wise: p,
            left_out,
            detectable: Vec::new(),
            noise: noise.clone(),
            knots: Vec::new(),
            ended: String::new(),
            stopped: false,
        });
        last.noise = noise.with_excess_of(&last.noise);
        last.detectable = step.detectable();
        last.knots = step.screening.spectra.iter().map(|s| s.size()).collect();
        last
    }

    /// Candidates that attach to what the user wrote, and are not in the model yet.
    fn candidates(&self, current: &FittedModel) -> Vec<Candidate> {
        let places = self.shared.catalogue.places(&current.subject);
        let fresh = |c: &Candidate| {
            let own = place(c);
            let there = self.accepted.iter().any(|a| a.cause.place == own);
            let wanted = self.classes.is_none_or(|class| c.effect().class() == class);
            wanted && !there && c.targets().iter().all(|t| self.shared.own.contains(t))
        };
        places.candidates.into_iter().filter(fresh).collect()
    }

    /// Takes the best candidate model that nothing speaks against; the model with it, fitted jointly.
    fn accept(
        &mut self,
        step: &ForwardStep<'a>,
        comparison: &Comparison,
        scales: &SignalScales,
        (number, p): (usize, f64),
    ) -> Result<Option<NextStep>, DiagnosisError> {
        let mut fit = Vec::new();
        for (k, candidate) in comparison.models.iter().enumerate() {
            match objection(step, candidate) {
                None => fit.push(k),
                Some(reason) => self.rejected.push(rejected(step, number, candidate, reason)),
            }
        }
        let mut can = Acceptable { alone: fit, in_sets: Vec::new() };
        if *self.runs.domain == Domain::Time {
            let models = &comparison.models;
            let best = models.iter().map(CandidateModel::score).fold(0.0, f64::max);
            let near = |k: &usize| models[*k].score() > ASIDE * best && has_the_other_sign(step, &models[*k]);
            can.in_sets = (0..models.len()).filter(near).collect();
            self.put_aside(step, comparison, scales, (&can.in_sets, p));
        }
        let Some(next) = self.best_next_step(step, comparison, scales, &can)? else { return Ok(None) };
        let begin = can.beginnings();
        let fit = can.alone;
        let k = next.candidate;
        self.set_aside(step, comparison, scales, (k, &fit, p));
        if self.classes.is_none() && self.fork.is_none() && comparison.models[k].class != Class::Mechanism {
            self.fork = self.forked(step, comparison, scales, (next.mechanism, &begin, p)).ok().map(Box::new);
        }
        let (candidate, cause) = (&comparison.models[k], cause(step, comparison, (k, p)));
        let grouped = |t: usize| {
            let own = place(&step.simulated[t].attached.candidate);
            cause.group.iter().any(|alternative| alternative.place == own)
        };
        let others = fit.iter().map(|o| &comparison.models[*o]).chain(&comparison.far);
        for other in others.filter(|o| !grouped(o.candidate)) {
            let behind = candidate.score() - other.score();
            let reason = match behind >= 0.0 {
                true => format!("its score is {behind:.1} below that of {}", cause.place),
                false => format!("together with a second effect it scores below {} with one", cause.place),
            };
            self.rejected.push(rejected(step, number, other, reason));
        }
        let attached = &step.simulated[candidate.candidate].attached;
        self.work.stage(&format!("accepted {}", cause.place));
        let near = near(step, comparison, k, &begin);
        self.accepted.push(Accepted::new(attached, &candidate.fitting, cause, near));
        Ok(Some(next))
    }

    /// Keeps the best mechanisms that might be taken in the place of a candidate model, for the front.
    fn set_aside(
        &mut self,
        step: &ForwardStep<'a>,
        comparison: &Comparison,
        scales: &SignalScales,
        (chosen, fit, p): (usize, &[usize], f64),
    ) {
        let models = &comparison.models;
        let near = |k: &&usize| {
            let score = models[**k].score();
            **k != chosen && models[**k].class == Class::Mechanism && score > ASIDE * models[chosen].score()
        };
        let near: Vec<usize> = fit.iter().filter(near).copied().collect();
        self.put_aside(step, comparison, scales, (&near, p));
    }

    /// Keeps the first of these candidate models for the front.
    fn put_aside(
        &mut self,
        step: &ForwardStep<'a>,
        comparison: &Comparison,
        scales: &SignalScales,
        (chosen, p): (&[usize], f64),
    ) {
        let models = &comparison.models;
        for k in chosen.iter().take(MOST_ASIDE) {
            let attached = &step.simulated[models[*k].candidate].attached;
            let Ok(current) = self.with_candidate(step, &models[*k], scales) else { continue };
            let mut accepted = self.accepted.clone();
            let mut cause = cause(step, comparison, (*k, p));
            // what is clearly likelier alone can be told from it
            let most = cause.score + BELIEVED;
            cause.group.retain(|member| member.score < most);
            cause.separating_experiment = cause.group.get(1).map(|other| separating(&cause.place, &other.place));
            accepted.push(Accepted::new(attached, &models[*k].fitting, cause, Vec::new()));
            self.aside.push(Aside { accepted, current: Arc::new(current) });
        }
    }

    /// The search among mechanisms from here on, with this one of the candidate models; without any where there is none.
    fn forked(
        &self,
        step: &ForwardStep<'a>,
        comparison: &Comparison,
        scales: &SignalScales,
        (mechanism, can, p): (Option<usize>, &[usize], f64),
    ) -> Result<Fork<'a>, DiagnosisError> {
        let mut search = ForwardSelection::new(&self.shared, Some(Class::Mechanism));
        search.accepted.clone_from(&self.accepted);
        search.steps.clone_from(&self.steps);
        search.rejected.clone_from(&self.rejected);
        let mut current = Arc::clone(&step.current);
        if let Some(k) = mechanism {
            let candidate = &comparison.models[k];
            let cause = cause(step, comparison, (k, p));
            let attached = &step.simulated[candidate.candidate].attached;
            current = Arc::new(self.with_candidate(step, candidate, scales)?);
            if let Some(step) = search.steps.last_mut() {
                step.accepted = Some(cause.place.clone());
            }
            let near = near(step, comparison, k, can);
            search.accepted.push(Accepted::new(attached, &candidate.fitting, cause, near));
        }
        let mechanism = |(candidate, _): &(Candidate, Choice)| candidate.effect().class() == Class::Mechanism;
        search.accepted.iter_mut().for_each(|a| a.near.retain(mechanism));
        Ok(Fork { search, current })
    }
}

/// Candidate models (of those that may be accepted) that come near to one, with the values that were fitted; what has another sign than
/// physics alone begins on the other side.
fn near(step: &ForwardStep<'_>, comparison: &Comparison, k: usize, can: &[usize]) -> Vec<(Candidate, Choice)> {
    let score = comparison.models[k].score();
    let least = score - (APART * score).max(BEHIND);
    let close = |(o, c): &(usize, &CandidateModel)| *o != k && c.score() > least && can.contains(o);
    let of = |(_, c): (usize, &CandidateModel)| {
        let attached = &step.simulated[c.candidate].attached;
        let mut choice = written(attached, &c.fitting.theta[0]);
        for (local, value) in &mut choice {
            let bound = attached.params().iter().find(|p| p.positive && p.local == *local);
            *value = bound.map_or(*value, |p| p.null + (*value - p.null).abs());
        }
        (attached.candidate.clone(), choice)
    };
    comparison.models.iter().enumerate().filter(close).take(NEAR).map(of).collect()
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
