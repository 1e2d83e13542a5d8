//! What a search comes to: the last fits by one noise, what is recommended, and everything that is told of it.

use super::all_samples::AllSamples;
use super::assessment::{ResidualRecords, against, beyond_noise, biased, output_gains, overlays, run_gains};
use super::coefficient_table::TableModel;
use super::elimination::{Accepted, one_law};
use super::error::DiagnosisError;
use super::feedback::feedback;
use super::fitted_model::{FittedModel, SplitFit, split_fit};
use super::forward_selection::{Aside, End, ForwardSelection, Reached};
use super::front::{FrontProblem, SearchPath};
use super::law_curve::{LawModel, law_model};
use super::predictor::responses;
use super::runs::{Domain, Runs};
use super::whitening::CommonNoise;
use super::written_model::WrittenModel;
use crate::bins::Signals;
use crate::diagnosis::{Cause, Diagnosis, FrontModel, Rejected, Verdict};
use crate::disturbance::{Attribution, BELIEVED, NonlinearityCurve, Origin, ResidualEvidence};
use fdm_grammar::syntax::Class;
use fdm_numeric::parallel;
use fdm_system::record::Run;
use std::sync::Arc;

/// Part of the chance at which an effect is accepted, below which something is missing although no effect is.
const UNNAMED: f64 = 1.0 / 3.0;

/// A table of a coefficient for the front.
struct Proposed {
    table: TableModel,
    model: FrontModel,
    /// Whether it stands in the recommended model beside its effects, and not in the model as it was given.
    beside: bool,
}

/// What is recommended when coefficients are tried as tables.
struct Rival<'a> {
    written: &'a WrittenModel,
    /// What it was fitted from.
    current: &'a FittedModel,
    /// Gains on all runs of what is written, less the penalties of its effects; less than anything where it has none.
    score: f64,
}

/// What is recommended so far, and what speaks for it.
struct Conclusion<'c, 'a> {
    search: ForwardSelection<'a>,
    problem: &'c FrontProblem<'c>,
    end: End,
    /// The model as it was given by the common noise, and what is recommended.
    before: &'c SplitFit,
    after: SplitFit,
    /// What is recommended; none where that is the model as it was given.
    last: Option<Arc<FittedModel>>,
    written: Option<WrittenModel>,
    /// The written model over all samples, where the search compares a part of them.
    over_all: Option<WrittenModel>,
    front: Vec<FrontModel>,
    /// Whether runs that were not fitted confirm the effects.
    confirmed: bool,
    /// What the effects gain by the joint fits, less their penalties.
    gained: f64,
    verdict: Verdict,
    attribution: Option<Attribution>,
    told: Vec<String>,
    /// Responses of the model as it was given, and of what is recommended.
    old: Vec<Signals>,
    new: Vec<Signals>,
}

/// The law that explains most of a residual, its odds, and the curve that was fitted for it.
struct Law {
    likeliest: Option<(NonlinearityCurve, f64)>,
    fitted: Option<LawModel>,
    /// Whether something repeats that no effect explains.
    left: bool,
}

impl<'a> ForwardSelection<'a> {
    /// The last fits by one noise, and everything that is told of them; also of another search that began where this one did.
    pub(super) fn conclude(
        self,
        reached: Reached,
        other: Option<(ForwardSelection<'a>, Reached)>,
    ) -> Result<Diagnosis, DiagnosisError> {
        let Reached { first, current: grown, mut end } = reached;
        if let Some((search, reached)) = &other {
            // all by the noise of the likelier model, by both noises
            let total = |current: &Arc<FittedModel>, accepted: &[Accepted]| -> f64 {
                let by =
                    |noise: &CommonNoise| split_fit(current, self.runs, noise).map_or(f64::INFINITY, |fit| fit.cost());
                by(&end.noise) + by(&reached.end.noise) + 2.0 * accepted.iter().map(Accepted::penalty).sum::<f64>()
            };
            if total(&reached.current, &search.accepted) < total(&grown, &self.accepted) {
                end.noise = reached.end.noise.clone();
            }
        }
        let noise = &end.noise.clone();
        let (first, before) = (&*first, split_fit(&first, self.runs, noise)?);
        let (runs, options, work) = (self.runs, self.options, self.work);
        let all = self.shared.whole.and_then(|whole| {
            self.work.stage("fitting the model as it was given to all samples");
            AllSamples::new(first, whole, (options, work))
        });
        let problem = FrontProblem { first, runs, noise, options, work, all };
        let mut conclusion = Conclusion {
            search: self,
            problem: &problem,
            end,
            after: before.clone(),
            before: &before,
            last: None,
            written: None,
            over_all: None,
            front: Vec::new(),
            confirmed: false,
            gained: 0.0,
            verdict: Verdict::NoEffectFound,
            attribution: None,
            told: Vec::new(),
            old: Vec::new(),
            new: Vec::new(),
        };
        conclusion.write_models(grown, other)?;
        conclusion.answer();
        conclusion.search.work.stage("looking for disturbances, residual analysis");
        let residuals = ResidualRecords::new(first, runs, &before.theta, noise)?;
        let lack_of_fit = residuals.lack_of_fit();
        let evidence = residuals.evidence();
        let law = conclusion.judge(evidence.as_ref())?;
        conclusion.overrule();
        let left = law.left;
        let curve = conclusion.show_law(law);
        conclusion.try_tables(curve.as_ref(), left);
        let mut diagnosis = conclusion.diagnosis();
        diagnosis.lack_of_fit = lack_of_fit;
        diagnosis.places = evidence.map(|h| h.places);
        diagnosis.suggestions = if diagnosis.verdict == Verdict::UnknownCause { residuals.suggestions() } else { None };
        Ok(diagnosis)
    }
}

impl<'c, 'a> Conclusion<'c, 'a> {
    /// Fits what the searches have come to plainly, as texts, and recommends one of them.
    fn write_models(
        &mut self,
        grown: Arc<FittedModel>,
        other: Option<(ForwardSelection<'a>, Reached)>,
    ) -> Result<(), DiagnosisError> {
        let (search, problem) = (&mut self.search, self.problem);
        if search.accepted.is_empty() && search.aside.is_empty() {
            return Ok(());
        }
        search.work.stage("fitting the written models plainly");
        let path = |accepted: &mut Vec<Accepted>, current: Arc<FittedModel>| -> Result<SearchPath, DiagnosisError> {
            let split = split_fit(&current, problem.runs, problem.noise)?;
            Ok(SearchPath { accepted: std::mem::take(accepted), current, split, aside: false })
        };
        let mut paths = match search.accepted.is_empty() {
            true => Vec::new(),
            false => vec![path(&mut search.accepted, grown)?],
        };
        let (mut other, reached) = other.unzip();
        if let (Some(search), Some(reached)) = (&mut other, reached) {
            paths.extend(path(&mut search.accepted, reached.current).ok());
        }
        let asides = parallel::map(std::mem::take(&mut search.aside), |Aside { accepted, current }| {
            let split = split_fit(&current, problem.runs, problem.noise).ok()?;
            Some(SearchPath { accepted, current, split, aside: true })
        });
        let searches = paths.len();
        paths.extend(asides.into_iter().flatten());
        let found = problem.front(paths)?;
        (self.front, self.confirmed) = (found.models, found.confirmed);
        if let Some((level, text)) = found.recommended {
            if let Some(other) = other.filter(|_| (1..searches).contains(&level.path)) {
                (search.steps, search.rejected) = (other.steps, other.rejected);
            }
            self.over_all = level.over_all.and_then(Result::ok);
            (search.accepted, self.last) = (level.accepted, Some(level.current));
            (self.after, self.written) = (level.split, Some(text));
        }
        search.rejected.extend(found.rejected);
        let accepted = &search.accepted;
        search.rejected.retain(|r| accepted.iter().all(|a| a.cause.place != r.place));
        if self.written.is_some() && !search.work.goes_on() {
            self.end.stop();
        }
        Ok(())
    }

    /// The responses of the model as it was given, and of what is recommended.
    fn answer(&mut self) {
        let (first, all) = (self.problem.first, self.problem.runs.all);
        let at =
            |current: &FittedModel, fit: &SplitFit| responses(&current.model, all, &current.predictors, &fit.theta);
        self.old = at(first, self.before).unwrap_or_else(|| first.response.clone());
        let new = self.last.as_ref().map_or(Some(self.old.clone()), |current| at(current, &self.after));
        self.new = new.unwrap_or_else(|| self.old.clone());
        for accepted in &mut self.search.accepted {
            accepted.renew(&self.after.fitting);
        }
    }

    /// What the residuals of the model as it was given, and of what is recommended, say of causes.
    fn judge(&mut self, evidence: Option<&ResidualEvidence>) -> Result<Law, DiagnosisError> {
        let FrontProblem { first, runs, noise, work, .. } = *self.problem;
        let explained = match &self.last {
            Some(current) => ResidualRecords::new(current, runs, &self.after.theta, noise)?.evidence(),
            None => None,
        };
        let accepted = &self.search.accepted;
        let cost = accepted.iter().map(Accepted::cost).sum();
        self.attribution = evidence.map(|h| against(&first.model, h, explained.as_ref().map(|e| (e, cost))));
        // by the joint fits, means included: where disturbances are looked for there are none
        self.gained = self.before.cost() - self.after.cost() - accepted.iter().map(Accepted::penalty).sum::<f64>();
        self.verdict = self.verdict_by(self.end.family_wise);
        let in_time = *runs.domain == Domain::Time;
        let left = explained.as_ref().is_some_and(ResidualEvidence::repeats);
        let likeliest = evidence.filter(|_| in_time && work.goes_on()).and_then(|e| e.nonlinearities.curve());
        let mut fitted = None;
        if let (Verdict::UnknownCause, Some((law, _)), Some(current), Some(own)) =
            (self.verdict, &likeliest, &self.last, &self.written)
            && explained.as_ref().is_some_and(|explained| !explained.repeats())
        {
            // effects that leave nothing of a law and predict better than its curve are what it is
            fitted = self.curve_of(law);
            let better = |law: &LawModel| self.problem.predicts_better((current, &own.fitted), law.fits());
            if fitted.as_ref().is_none_or(better) {
                self.verdict = Verdict::EffectFound;
            }
        }
        Ok(Law { likeliest, fitted, left })
    }

    fn curve_of(&self, law: &NonlinearityCurve) -> Option<LawModel> {
        self.search.work.stage("fitting the curve of an unmodelled law");
        let FrontProblem { first, runs, options, work, .. } = *self.problem;
        law_model(first, &self.before.theta, law, (runs, options, work)).ok()
    }

    /// What is left beyond the noise although nothing was found; effects that are the likeness of something else are taken back.
    fn overrule(&mut self) {
        if self.verdict == Verdict::NoEffectFound && !self.end.stopped {
            self.told = self.beyond_noise();
        }
        if !self.told.is_empty() {
            self.verdict = Verdict::UnknownCause;
            if let Some(attribution) = &mut self.attribution {
                attribution.warnings.append(&mut self.told);
            }
        }
        let overruled = match self.verdict {
            Verdict::Disturbance => "a disturbance (process noise) explains more",
            Verdict::UnknownCause => "one function of a state or input, the same in every run, explains more",
            _ => return,
        };
        self.withdraw(overruled);
        self.front.iter_mut().for_each(|model| model.recommended = false);
        (self.last, self.written, self.over_all) = (None, None, None);
        self.new.clone_from(&self.old);
    }

    /// A law without a name, as a table in the text; recommended where nothing else is. Beside effects it is fitted where it is likelier.
    fn show_law(&mut self, Law { likeliest, fitted, left }: Law) -> Option<FittedModel> {
        let effects = self.attribution.as_ref().and_then(|a| a.by_effect).unwrap_or(0.0).max(0.0);
        let unnamed = |odds: f64| self.verdict == Verdict::UnknownCause || (left && odds > effects + BELIEVED);
        let (law, _) = likeliest.filter(|(_, odds)| unnamed(*odds) && self.problem.work.goes_on())?;
        let law = fitted.or_else(|| self.curve_of(&law))?;
        let mut told = self.problem.law(&law);
        if let Some(attribution) = self.attribution.as_mut().filter(|_| told.objection.is_none()) {
            let stand_in = "that law as a table in the text, a stand-in for what has no name";
            attribution.warnings.push(format!("{}: {stand_in}", law.place));
        }
        told.recommended = self.verdict == Verdict::UnknownCause && told.objection.is_none();
        let recommended = told.recommended;
        self.show(told);
        recommended.then(|| {
            self.write(law.written);
            law.current
        })
    }

    /// Adds a model to the front, which begins with the model as it was given.
    fn show(&mut self, model: FrontModel) {
        if self.front.is_empty() {
            self.front.push(self.problem.given());
        }
        self.front.push(model);
    }

    /// Recommends a text.
    fn write(&mut self, written: WrittenModel) {
        self.new.clone_from(&written.fitted.response);
        self.over_all = self.problem.all.as_ref().and_then(|all| all.fitted_to(&written).ok());
        self.written = Some(written);
    }

    /// Coefficients as tables; `curve` is the model of a law that is recommended.
    fn try_tables(&mut self, curve: Option<&FittedModel>, left: bool) {
        let FrontProblem { first, runs, noise, options, work, .. } = *self.problem;
        let in_time = *runs.domain == Domain::Time;
        if !(options.tables && in_time && self.may_be_curved(left) && work.goes_on()) {
            return;
        }
        self.search.work.stage("trying coefficients as tables");
        let accepted = &self.search.accepted;
        let score = |written: &WrittenModel| {
            let responses = (&first.response[..], &written.fitted.response[..]);
            let gains = run_gains(runs.all, runs.train, &first.predictors, responses, noise);
            let penalties: f64 = accepted.iter().map(Accepted::penalty).sum();
            let named = !accepted.is_empty();
            if named { gains.iter().map(|g| g.gain).sum::<f64>() - penalties } else { f64::NEG_INFINITY }
        };
        let rival = self.written.as_ref().zip(self.last.as_deref().or(curve));
        let rival = rival.map(|(written, current)| Rival { written, current, score: score(written) });
        let Some(Proposed { table, model, beside }) = self.proposed(rival.as_ref()) else { return };
        if model.recommended {
            self.front.iter_mut().for_each(|model| model.recommended = false);
            if !beside {
                self.withdraw("a coefficient that depends on a signal explains more");
                (self.verdict, self.last) = (Verdict::UnknownCause, None);
            }
            let sentences = model.table.iter().map(|t| t.sentence.clone());
            match &mut self.attribution {
                Some(attribution) => attribution.warnings.extend(sentences),
                None => self.told.extend(sentences),
            }
            self.write(table.curve.written);
        }
        self.show(model);
    }

    /// The result, but for what the residuals alone say.
    fn diagnosis(self) -> Diagnosis {
        let FrontProblem { first, runs: searched, noise, .. } = *self.problem;
        let (all, train) = (searched.all, searched.train);
        // as a plain fit of the model has them, and as a simulation of what is written
        let whole = self.problem.all.as_ref().filter(|_| self.over_all.is_some() || self.written.is_none());
        let (given, runs) = whole.map_or((first, searched), |whole| (&whole.first, whole.runs));
        let printed = self.over_all.as_ref().or(self.written.as_ref());
        let plain = (&given.response[..], printed.map_or(&given.response[..], |w| &w.fitted.response[..]));
        let outputs = output_gains(&first.model, (runs.all, train), &given.predictors, plain, (noise, all));
        let drawn = whole.map(|whole| (whole.at_times_of(all, plain.0), whole.at_times_of(all, plain.1)));
        let drawn = drawn.as_ref().map_or(plain, |(before, after)| (before, after));
        let overlays = overlays(all, train, &first.predictors, drawn);
        let extended = printed.map(|written| written.text.clone());
        let mut attribution = self.attribution;
        if let Some(attribution) = &mut attribution {
            attribution.warnings.extend(one_law(&self.search.accepted));
            let explains_more = attribution.by_disturbance > self.gained;
            if attribution.verdict == Origin::Disturbance && self.verdict == Verdict::EffectFound && explains_more {
                attribution.warnings.push(
                    "a disturbance would explain more of the fitted runs; what the effects gain on runs that were not fitted it would not"
                        .into(),
                );
            }
        }
        let found = !self.search.accepted.is_empty();
        let current = self.last.as_ref().map_or(first, |current| current);
        let feedback = match current.where_measured(searched) {
            Some((rows, current)) => feedback(&current, Runs { all: &rows, ..searched }, &self.end.detectable),
            None => feedback(current, searched, &self.end.detectable),
        };
        let responses = (&self.old[..], &self.new[..]);
        Diagnosis {
            verdict: self.verdict,
            family_wise_p: self.end.family_wise,
            causes: self.search.accepted.into_iter().map(|a| a.cause).collect(),
            front: self.front,
            rejected: self.search.rejected,
            steps: self.search.steps,
            detectable: self.end.detectable,
            left_out: self.end.left_out,
            biased: if found {
                biased(&self.before.fitting.estimates, &self.after.fitting.estimates)
            } else {
                Vec::new()
            },
            outputs,
            overlays,
            gains: if found { run_gains(all, train, &first.predictors, responses, noise) } else { Vec::new() },
            noise_knots: self.end.knots,
            extended,
            ended: self.end.ended,
            stopped: self.end.stopped,
            lack_of_fit: Default::default(),
            attribution,
            places: None,
            suggestions: None,
            feedback,
            notes: self.told,
            spectral: first.spectral(),
        }
    }

    /// Whether a coefficient may be a curve: something repeats that no effect explains, or what explains it may stand for a curve.
    fn may_be_curved(&self, left: bool) -> bool {
        let stands_in = || self.search.accepted.iter().any(|a| a.candidate.effect().class() == Class::StandIn);
        match self.verdict {
            Verdict::UnknownCause => true,
            Verdict::EffectFound => left || stands_in() || !one_law(&self.search.accepted).is_empty(),
            Verdict::Disturbance | Verdict::NoEffectFound => false,
        }
    }

    /// The likeliest table of a coefficient: in the recommended model beside its effects where that predicts better, else in the model as it was
    /// given. It is recommended where nothing else is, or where it predicts better than what is.
    fn proposed(&self, rival: Option<&Rival<'_>>) -> Option<Proposed> {
        let problem = self.problem;
        let told = |table: &TableModel, beside: bool| {
            let mut model = problem.law(&table.curve);
            if beside {
                let own = self.search.accepted.iter().map(|a| a.cause.place.clone());
                model.effects.splice(0..0, own);
                model.parameters += self.search.accepted.iter().map(Accepted::cost).sum::<usize>();
            }
            model.table = Some(table.found.clone());
            model
        };
        if let Some(Rival { written, current, .. }) = rival.filter(|_| !self.search.accepted.is_empty())
            && let Some(table) = problem.table_in(&written.fitted)
            && problem.predicts_better(table.curve.fits(), (current, &written.fitted))
        {
            let mut model = told(&table, true);
            let accepted = &self.search.accepted;
            let superseded = || accepted.iter().find_map(|effect| table.superseded(effect));
            model.objection =
                model.objection.or_else(|| table.curve.written.against_physics(accepted)).or_else(superseded);
            model.recommended = model.objection.is_none();
            let beside = Proposed { table, model, beside: true };
            if beside.model.recommended {
                return Some(beside);
            }
            // what speaks against it may be an effect that has stood in for it
            let alone = self.proposed_alone(rival, told);
            return alone.filter(|alone| alone.model.recommended).or(Some(beside));
        }
        self.proposed_alone(rival, told)
    }

    /// A table in the model as it was given, in the place of all effects: a stand-in, recommended where it predicts better and is likelier with all
    /// penalties counted.
    fn proposed_alone(
        &self,
        rival: Option<&Rival<'_>>,
        told: impl Fn(&TableModel, bool) -> FrontModel,
    ) -> Option<Proposed> {
        let problem = self.problem;
        let table = problem.table_in(problem.first)?;
        let mut model = told(&table, false);
        let better = rival.is_none_or(|Rival { written, current, score }| {
            table.score > *score && problem.predicts_better(table.curve.fits(), (current, &written.fitted))
        });
        if !better && model.objection.is_none() {
            model.objection =
                Some("what is recommended predicts as well, within one standard error, or is likelier".into());
        }
        model.recommended = model.objection.is_none();
        Some(Proposed { table, model, beside: false })
    }

    /// Outputs of which the model as it was given leaves more than their noise, in sentences; none in the frequency domain, where no mean is
    /// compared.
    fn beyond_noise(&self) -> Vec<String> {
        let FrontProblem { first, runs, noise, .. } = *self.problem;
        if *runs.domain != Domain::Time {
            return Vec::new();
        }
        let (runs, train, q) = (runs.train(), runs.train, first.outputs());
        let plain = (&first.response[..train], &first.response[..train]);
        let outputs = output_gains(&first.model, (runs, train), &first.predictors[..train], plain, (noise, runs));
        let left = |(r, run): (usize, &Run)| first.predictors[r].left_by(run, &first.response[r]);
        let left: Vec<Vec<f64>> = runs.iter().enumerate().map(left).collect();
        beyond_noise(&outputs, (&left, q))
    }

    /// Effect, disturbance, unknown cause or nothing.
    ///
    /// A disturbance has another course in every run: it does not overrule effects that are confirmed by runs that were not fitted, and that
    /// explain something beside it. (An effect of 2.7 nats that gained 2.8 +- 1.2 there stood against a disturbance of 157 nats, beside which
    /// it added 1.7.)
    fn verdict_by(&self, family_wise: f64) -> Verdict {
        let (attribution, confirmed) = (self.attribution.as_ref(), self.confirmed);
        let (found, clear) = (!self.search.accepted.is_empty(), family_wise < UNNAMED * self.search.options.alpha);
        match attribution.map(|a| a.verdict) {
            Some(Origin::Disturbance) if confirmed && attribution.is_some_and(|a| a.believes_beside(self.gained)) => {
                Verdict::EffectFound
            }
            Some(Origin::Disturbance) => Verdict::Disturbance,
            // effects that are the nearest likeness of a law, which is far likelier. A law repeats, and so does its likeness: that other runs confirm an effect
            // which explains nothing of the residual as a whole says nothing against a law
            Some(Origin::UnknownCause)
                if attribution.is_some_and(|a| is_law(a) && !(confirmed && a.by_effect.is_some_and(|e| e > 0.0))) =>
            {
                Verdict::UnknownCause
            }
            // what an accepted effect leaves is told beside it
            _ if found => Verdict::EffectFound,
            Some(Origin::UnknownCause) => Verdict::UnknownCause,
            _ if clear => Verdict::UnknownCause,
            _ => Verdict::NoEffectFound,
        }
    }

    /// Takes back what was accepted: it was the nearest likeness of something else.
    fn withdraw(&mut self, reason: &str) {
        for (k, accepted) in self.search.accepted.drain(..).enumerate() {
            let Cause { place, gain_training, gain_validation, .. } = accepted.cause;
            let reason = reason.to_string();
            self.search.rejected.push(Rejected { place, step: k + 1, gain_training, gain_validation, reason });
        }
    }
}

/// Whether a curve over one variable is likelier than the effects, by odds of 100 : 1.
fn is_law(attribution: &Attribution) -> bool {
    attribution.nonlinearity.is_some()
        && attribution.by_nonlinearity > attribution.by_effect.unwrap_or(0.0).max(0.0) + BELIEVED
}
