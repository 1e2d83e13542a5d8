//! Forward selection of effects, from the base model to a diagnosis.

use super::acceptance::{cause, objection, rejected};
use super::assessment::{ResidualRecords, against, biased, output_gains, overlays, run_gains};
use super::candidate_model::CandidateModel;
use super::comparison::Comparison;
use super::elimination::{Accepted, eliminate, one_law, revise};
use super::error::DiagnosisError;
use super::extended_model::{SignalScales, place, written};
use super::feedback::feedback;
use super::fitted_model::{FittedModel, SplitFit, shared_from, split_fit};
use super::forward_step::ForwardStep;
use super::front::FrontProblem;
use super::initial_fit::initial_fits;
use super::look_ahead::NextStep;
use super::predictor::responses;
use super::runs::{DiagnosisOptions, GoesOn, Progress, Runs, apart, prepared, thinned};
use super::significance::confirmed;
use super::whitening::CommonNoise;
use crate::diagnosis::{Cause, Diagnosis, EffectAt, LeftOut, Rejected, SelectionStep, Verdict};
use crate::disturbance::{Attribution, Origin};
use fdm_estimate::changed;
use fdm_grammar::effect::{Candidate, Catalogue, Subject};
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
/// [`DiagnosisError`]; a search that finds nothing is a [`Diagnosis`].
pub fn diagnose(
    model: &Model,
    runs: &[Run],
    validation: &[Run],
    catalogue: &Catalogue,
    options: &DiagnosisOptions,
    progress: &Progress<'_>,
) -> Result<Diagnosis, DiagnosisError> {
    diagnose_while(model, runs, validation, catalogue, (options, progress), &|| true)
}

/// Whether every one of the `q` outputs has one value wherever it was measured.
fn is_still(run: &Run, q: usize) -> bool {
    (0..q).all(|k| {
        let mut values = run.measured.iter().skip(k).step_by(q).filter(|z| !z.is_nan());
        values.next().is_none_or(|first| values.all(|z| z == first))
    })
}

/// The same, but once `goes_on` says no, nothing is begun any more: what was accepted by then is the result, and it says that it
/// was stopped.
///
/// # Errors
/// As [`diagnose`], and [`DiagnosisError::Stopped`] before the base model is fitted and the candidates are screened.
pub fn diagnose_while(
    model: &Model,
    runs: &[Run],
    validation: &[Run],
    catalogue: &Catalogue,
    (options, progress): (&DiagnosisOptions, &Progress<'_>),
    goes_on: &GoesOn<'_>,
) -> Result<Diagnosis, DiagnosisError> {
    apart(runs, validation)?;
    let of = |run: &Run| prepared(run, &options.domain);
    let found: Vec<(Run, Option<String>)> = runs.iter().chain(validation).map(of).collect::<Result<_, _>>()?;
    let (all, notes): (Vec<Run>, Vec<Option<String>>) = found.into_iter().unzip();
    let mut notes: Vec<String> = notes.into_iter().flatten().collect();
    let subject = Subject::new(model.source(), model.definition()).map_err(DiagnosisError::Text)?;
    let (all, fewer) = thinned(all, model.layout().outputs, catalogue.places(&subject).candidates.len());
    notes.extend(fewer);
    let domain = options.domain.settled(&changed(model, &options.fit.changes)?, &all[..runs.len()])?;
    let runs = Runs { all: &all, train: runs.len(), domain: &domain };
    if runs.train().iter().all(|run| run.measured.iter().all(|z| z.is_nan())) {
        return Err(DiagnosisError::NothingMeasured);
    }
    if runs.train().iter().all(|run| is_still(run, model.layout().outputs)) {
        return Err(DiagnosisError::Still);
    }
    progress("fitting the base model");
    let own = names(model);
    let mut firsts = initial_fits(model, runs, options, goes_on)?.into_iter();
    let from = |first: FittedModel, classes: Option<Class>| {
        let (accepted, rejected, steps) = (Vec::new(), Vec::new(), Vec::new());
        let own = own.clone();
        ForwardSelection { runs, catalogue, options, progress, goes_on, classes, own, accepted, rejected, steps }
            .run(first)
    };
    let likeliest = firsts.next().ok_or_else(|| DiagnosisError::NoFit("it has no end".into()))?;
    let (mut found, reached) = from(likeliest.clone(), None)?;
    if let Some(reached) = reached.filter(|r| r.is_mixed() && goes_on()) {
        // a lag or a stand-in beside mechanisms may have taken the place of another mechanism
        progress("searching among mechanisms alone");
        if let Ok((mut other, Some(mechanisms))) = from(likeliest, Some(Class::Mechanism))
            && !other.stopped
            && other.verdict == Verdict::EffectFound
            && (predicts_as_well(&other, &found) || mechanisms.is_likelier(&reached, runs))
        {
            other.notes.push(
                "the effects are those of a search among mechanisms alone, whose model predicts as well as that of all effects or is likelier"
                    .into(),
            );
            other.left_out = std::mem::take(&mut found.left_out);
            found = other;
        }
    }
    if found.verdict == Verdict::UnknownCause && found.family_wise_p < options.alpha {
        // the best fit of a base model that is badly wrong can be so distorted that no single effect improves it
        for first in firsts.take_while(|_| goes_on()) {
            progress("no candidate could be accepted there: restarting from the next-best local minimum");
            if let Some((other, _)) = from(first, None).ok().filter(|(other, _)| other.verdict == Verdict::EffectFound)
            {
                found = other;
                break;
            }
        }
    }
    found.notes.splice(0..0, notes);
    Ok(found)
}

pub(super) struct ForwardSelection<'a> {
    pub(super) runs: Runs<'a>,
    catalogue: &'a Catalogue,
    pub(super) options: &'a DiagnosisOptions,
    pub(super) progress: &'a Progress<'a>,
    pub(super) goes_on: &'a GoesOn<'a>,
    /// The only class of effects that is searched; all where there is none.
    classes: Option<Class>,
    /// Everything that the user gave a name.
    own: BTreeSet<String>,
    pub(super) accepted: Vec<Accepted>,
    rejected: Vec<Rejected>,
    steps: Vec<SelectionStep>,
}

/// The model that a search recommends, and the noise that it is judged by.
struct Reached {
    current: Arc<FittedModel>,
    noise: CommonNoise,
    /// What its effects cost.
    penalty: f64,
    classes: Vec<Class>,
}

impl Reached {
    /// Whether it has several effects, not all of them mechanisms.
    fn is_mixed(&self) -> bool {
        self.classes.len() > 1 && self.classes.iter().any(|class| *class != Class::Mechanism)
    }

    /// Whether it is likelier than another one, by the noise of both, with the penalties of all effects.
    fn is_likelier(&self, other: &Self, runs: Runs<'_>) -> bool {
        let total = |model: &Self| -> f64 {
            let by =
                |noise: &CommonNoise| split_fit(&model.current, runs, noise).map_or(f64::INFINITY, |fit| fit.cost());
            by(&self.noise) + by(&other.noise) + 2.0 * model.penalty
        };
        total(self) < total(other)
    }
}

/// Whether the recommended model of one search predicts no worse than that of another: validation runs, or parts that were not fitted.
fn predicts_as_well(one: &Diagnosis, other: &Diagnosis) -> bool {
    let error = |found: &Diagnosis| {
        let recommended = found.front.iter().find(|model| model.recommended)?;
        recommended.error_validation.or(recommended.error_cross_validated)
    };
    error(one).zip(error(other)).is_some_and(|(one, other)| one <= other)
}

/// What is known when the search ends.
struct End {
    family_wise: f64,
    left_out: Vec<LeftOut>,
    detectable: Vec<crate::diagnosis::Detectable>,
    noise: CommonNoise,
    knots: Vec<usize>,
    ended: String,
    stopped: bool,
}

impl End {
    fn stop(&mut self) {
        self.ended = "it was stopped".into();
        self.stopped = true;
    }
}

impl<'a> ForwardSelection<'a> {
    fn run(mut self, first: FittedModel) -> Result<(Diagnosis, Option<Reached>), DiagnosisError> {
        let mut first = Arc::new(first);
        let mut current = Arc::clone(&first);
        let mut moves = 0;
        let mut end: Option<End> = None;
        loop {
            if let Some(last) = end.as_mut().filter(|_| !(self.goes_on)()) {
                last.stop();
                break;
            }
            let scales = SignalScales::new(&current, self.runs);
            let number = self.steps.len() + 1;
            let candidates = self.candidates(&current);
            (self.progress)(&format!("search {number}: {} candidates", candidates.len()));
            let step = self.step(&current, &candidates, &scales);
            (self.progress)(&format!("search {number}: screened"));
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
            let comparison = match asked {
                true => {
                    match self.comparison(&mut step) {
                        // what screening tells is a result
                        Err(DiagnosisError::Stopped) => {
                            let p = step.screening.family_wise;
                            if end.is_none() {
                                self.steps.push(SelectionStep {
                                    family_wise_p: p,
                                    ranking: step.ranking(),
                                    accepted: None,
                                });
                                self.known(&mut end, &mut step, p);
                            }
                            end.iter_mut().for_each(End::stop);
                            break;
                        }
                        comparison => Some(comparison?),
                    }
                }
                false => None,
            };
            if moves < MOST_MOVES
                && let Some(next) = comparison.as_ref().and_then(|c| self.elsewhere(&current, c))
            {
                (self.progress)("the base model has a better minimum: restarting from there");
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
        self.conclude(&first, current, end)
    }

    /// A search for one more effect beside these.
    fn step(
        &self,
        current: &Arc<FittedModel>,
        candidates: &[Candidate],
        scales: &SignalScales,
    ) -> Result<ForwardStep<'a>, DiagnosisError> {
        ForwardStep::new(Arc::clone(current), self.runs, candidates, scales, (self.options, self.goes_on))
    }

    /// The best candidates fitted: fewer where they are asked only whether anything is there.
    fn comparison(&self, step: &mut ForwardStep<'a>) -> Result<Comparison, DiagnosisError> {
        let alpha = self.options.alpha;
        if step.screening.family_wise >= alpha {
            let few = step.comparison_of(ASKED..=ASKED, self.progress)?;
            if confirmed(step, &few) >= alpha {
                return Ok(few);
            }
        }
        let comparison = step.comparison(self.progress)?;
        if confirmed(step, &comparison) < alpha {
            return Ok(comparison);
        }
        // something is there, and none of those that predicted gain most is it
        step.comparison_of_all(self.progress)
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
        let noise = CommonNoise::new(&step.screening.spectra, self.options.screening.dropped);
        let mut left_out = std::mem::take(&mut step.left_out);
        left_out.extend(self.catalogue.places(&step.current.subject).crowded.iter().map(|c| LeftOut {
            place: EffectAt { effect: c.effect.clone(), targets: Vec::new() },
            reason: c.to_string(),
        }));
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
        let places = self.catalogue.places(&current.subject);
        let fresh = |c: &Candidate| {
            let own = place(c);
            let there = self.accepted.iter().any(|a| a.cause.place == own);
            let wanted = self.classes.is_none_or(|class| c.effect().class() == class);
            wanted && !there && c.targets().iter().all(|t| self.own.contains(t))
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
        let Some(next) = self.best_next_step(step, comparison, scales, &fit)? else { return Ok(None) };
        let k = next.candidate;
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
        (self.progress)(&format!("accepted {}", cause.place));
        let least = candidate.score() - (APART * candidate.score()).max(BEHIND);
        let close = |(o, c): &(usize, &CandidateModel)| *o != k && c.score() > least && fit.contains(o);
        let near = comparison.models.iter().enumerate().filter(close).take(NEAR).map(|(_, c)| {
            let other = &step.simulated[c.candidate].attached;
            (other.candidate.clone(), written(other, &c.fitting.theta[0]))
        });
        self.accepted.push(Accepted::new(attached, &candidate.fitting, cause, near.collect()));
        Ok(Some(next))
    }

    /// The last fits by one noise, and everything that is told of them.
    fn conclude(
        mut self,
        first: &FittedModel,
        grown: Arc<FittedModel>,
        mut end: End,
    ) -> Result<(Diagnosis, Option<Reached>), DiagnosisError> {
        let noise = &end.noise.clone();
        let before = split_fit(first, self.runs, noise)?;
        let mut last = None;
        if !self.accepted.is_empty() {
            (self.progress)("fitting the extended model");
            let (current, dropped) = eliminate(grown, first, self.runs, noise, &mut self.accepted)?;
            self.rejected.extend(dropped);
            last = Some(revise(current, first, self.runs, noise, &mut self.accepted)?);
        }
        let mut after = match &last {
            Some(current) => split_fit(current, self.runs, noise)?,
            None => before.clone(),
        };
        let problem = FrontProblem { first, runs: self.runs, noise, options: self.options, goes_on: self.goes_on };
        let (mut written, mut front, mut confirmed) = (None, Vec::new(), false);
        if let Some(current) = last.take() {
            (self.progress)("fitting the written models plainly");
            let found = problem.front(std::mem::take(&mut self.accepted), current, after)?;
            (front, after, confirmed) = (found.models, before.clone(), found.confirmed);
            self.rejected.extend(found.rejected);
            if let Some((level, text)) = found.recommended {
                (self.accepted, last, after, written) = (level.accepted, Some(level.current), level.split, Some(text));
            }
            if written.is_some() && !(self.goes_on)() {
                end.stop();
            }
        }
        let (all, train) = (self.runs.all, self.runs.train);
        let at =
            |current: &FittedModel, fit: &SplitFit| responses(&current.model, all, &current.predictors, &fit.theta);
        let old = at(first, &before).unwrap_or_else(|| first.response.clone());
        let mut new =
            last.as_ref().map_or(Some(old.clone()), |current| at(current, &after)).unwrap_or_else(|| old.clone());
        for accepted in &mut self.accepted {
            accepted.renew(&after.fitting);
        }
        (self.progress)("looking for disturbances, residual analysis");
        let residuals = ResidualRecords::new(first, self.runs, &before.theta)?;
        let lack_of_fit = residuals.lack_of_fit();
        let evidence = residuals.evidence();
        let explained = match &last {
            Some(current) => ResidualRecords::new(current, self.runs, &after.theta)?.evidence(),
            None => None,
        };
        let cost = self.accepted.iter().map(Accepted::cost).sum();
        let mut attribution =
            evidence.as_ref().map(|h| against(&first.model, h, explained.as_ref().map(|e| (e, cost))));
        let verdict = self.verdict(attribution.as_ref(), end.family_wise, confirmed);
        if verdict == Verdict::Disturbance {
            self.withdraw();
            front.iter_mut().for_each(|model| model.recommended = false);
            (last, new, written) = (None, old.clone(), None);
        }
        // as a plain fit of the model has them, and as a simulation of what is written
        let plain = (&first.response[..], written.as_ref().map_or(&first.response[..], |w| &w.fitted.response[..]));
        if let Some(attribution) = &mut attribution {
            attribution.warnings.extend(one_law(&self.accepted));
            if attribution.verdict == Origin::Disturbance && verdict == Verdict::EffectFound {
                attribution.warnings.push(
                    "a disturbance would explain more of the fitted runs; what the effects gain on runs that were not fitted it would not"
                        .into(),
                );
            }
        }
        let suggestions = if verdict == Verdict::UnknownCause { residuals.suggestions() } else { None };
        let found = !self.accepted.is_empty();
        let reached = last.clone().map(|current| Reached {
            current,
            noise: noise.clone(),
            penalty: self.accepted.iter().map(Accepted::penalty).sum(),
            classes: self.accepted.iter().map(|a| a.candidate.effect().class()).collect(),
        });
        let feedback = feedback(last.as_ref().map_or(first, |current| current), self.runs, &end.detectable);
        let diagnosis = Diagnosis {
            verdict,
            family_wise_p: end.family_wise,
            causes: self.accepted.into_iter().map(|a| a.cause).collect(),
            front,
            rejected: self.rejected,
            steps: self.steps,
            detectable: end.detectable,
            left_out: end.left_out,
            biased: if found { biased(&before.fitting.estimates, &after.fitting.estimates) } else { Vec::new() },
            outputs: output_gains(&first.model, all, train, &first.predictors, plain, noise),
            overlays: overlays(all, train, &first.predictors, plain),
            gains: if found { run_gains(all, train, &first.predictors, (&old, &new), noise) } else { Vec::new() },
            noise_knots: end.knots,
            extended: written.map(|written| written.text),
            ended: end.ended,
            stopped: end.stopped,
            lack_of_fit,
            attribution,
            places: evidence.map(|h| h.places),
            suggestions,
            feedback,
            notes: Vec::new(),
            spectral: first.spectral(),
        };
        Ok((diagnosis, reached))
    }

    /// Effect, disturbance, unknown cause or nothing.
    ///
    /// A disturbance has another course in every run: it does not overrule effects that are confirmed by runs that were not fitted.
    fn verdict(&self, attribution: Option<&Attribution>, family_wise: f64, confirmed: bool) -> Verdict {
        let (found, clear) = (!self.accepted.is_empty(), family_wise < self.options.alpha);
        match attribution.map(|a| a.verdict) {
            Some(Origin::Disturbance) if confirmed => Verdict::EffectFound,
            Some(Origin::Disturbance) => Verdict::Disturbance,
            // what an accepted effect leaves is told beside it
            _ if found => Verdict::EffectFound,
            Some(Origin::UnknownCause) => Verdict::UnknownCause,
            _ if clear => Verdict::UnknownCause,
            _ => Verdict::NoEffectFound,
        }
    }

    /// Takes back what was accepted: it was the nearest likeness of a disturbance.
    fn withdraw(&mut self) {
        for (k, accepted) in self.accepted.drain(..).enumerate() {
            let Cause { place, gain_training, gain_validation, .. } = accepted.cause;
            let reason = "a disturbance (process noise) explains more".into();
            self.rejected.push(Rejected { place, step: k + 1, gain_training, gain_validation, reason });
        }
    }
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
