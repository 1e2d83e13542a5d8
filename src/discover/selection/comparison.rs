//! The best candidates of a search fitted jointly with the model, all by one noise.
//!
//! What validation runs hold beyond the noise of the training runs.
//!
//! The noise of a comparison is what the best model leaves of the training runs, where the fit has taken
//! what it could: slow motions above all. Another flight has another wind, and its slow bins may hold a hundred times as
//! much, whatever the model; by the first runs' noise they would decide alone which model holds. So a band in which every model that is
//! compared leaves far more than that noise is given what the best of them leaves there.

use super::candidate_model::{CandidateModel, FINE};
use super::error::DiagnosisError;
use super::fitted_model::{records, shared_from};
use super::fitting::{FitProblem, Fitting};
use super::forward_step::{ForwardStep, weigh};
use super::predictor::{Predictor, responses};
use super::projection::{Projection, cosine};
use super::shortlist::UnlikelyNoise;
use super::whitening::{CommonNoise, ExcessNoise};
use crate::bins::{Record, Signals};
use crate::noise::LogSpectrum;
use fdm_estimate::Work;
use fdm_numeric::parallel;
use fdm_system::model::Model;
use fdm_system::record::Run;
use std::ops::{Range, RangeInclusive};

/// Candidates that are refitted, at least.
const FEWEST: usize = 8;
/// And at most.
const MOST: usize = 24;
/// Iterations of the base model's fit.
const ITERATIONS: usize = 25;
/// Candidate models that stay this far behind the best, and below this part of its gain, are not followed to the end.
const BEHIND: f64 = 40.0;
const PART: f64 = 0.25;
/// Candidate models whose score is this near to the best are fitted from other starts too.
const CLOSE: f64 = 10.0;
/// Cosine from which two candidates are alike.
pub(super) const ALIKE: f64 = 0.97;
/// Candidates among which likenesses are looked for, and how many of these are fitted.
const AMONG: usize = 64;
const MOST_ALIKE: usize = 8;
/// Candidate models of which the best is found before a noise is.
const LEADERS: usize = 3;
/// Family-wise chance, by what screening predicts or by how unlikely the residual is as noise, below which the best candidates are fitted,
/// to see what they gain.
const DOUBTFUL: f64 = 0.1;
/// By how much likelier the base model must be elsewhere.
const ELSEWHERE: f64 = 5.0;
/// Gain from which the noise that the model seemed to have is that of its error too, in part.
const LARGE: f64 = 15.0;

/// The fits of a forward-selection step, by one noise.
pub(super) struct Comparison {
    pub(super) noise: CommonNoise,
    /// The base model on the validation runs, by it; none without such runs.
    pub(super) base_validation: Option<Fitting>,
    /// The candidate without which the residual is likelier as noise, where that is doubtful.
    pub(super) unlikely: Option<UnlikelyNoise>,
    /// The best score first.
    pub(super) models: Vec<CandidateModel>,
    /// Those that stayed far behind, by the first noise.
    pub(super) far: Vec<CandidateModel>,
    /// Values (all parameters of each run that is learned from) at which the base model itself is likelier than at its fit; none where
    /// that is where it should be.
    pub(super) elsewhere: Option<Vec<Vec<f64>>>,
}

impl ForwardStep<'_> {
    /// Fits the best candidates jointly with the model, all by one noise: first that of the saturated residual, then that of the best
    /// model's.
    ///
    /// # Errors
    /// [`DiagnosisError::Stopped`]: a comparison of some only would name another cause.
    pub(super) fn comparison(&mut self, work: &Work<'_>) -> Result<Comparison, DiagnosisError> {
        self.comparison_of(FEWEST..=MOST, work)
    }

    /// Fits all candidates jointly with the model, whatever screening predicts: where the model is far off, its error
    /// passes for noise and predicted gains say little.
    pub(super) fn comparison_of_all(&mut self, work: &Work<'_>) -> Result<Comparison, DiagnosisError> {
        self.comparison_of(usize::MAX..=usize::MAX, work)
    }

    /// Fits so many candidates, the fewest and the most, jointly with the model.
    pub(super) fn comparison_of(
        &mut self,
        count: RangeInclusive<usize>,
        work: &Work<'_>,
    ) -> Result<Comparison, DiagnosisError> {
        let (noise, base) = self.begun()?;
        let projection =
            Projection::new(&self.records, self.runs.train(), &self.current.predictors, self.current.outputs(), &noise);
        let ranked = self.ranked_by_predicted_gain(&projection);
        let unlikely = self.unlikely_as_noise(&projection, &ranked).filter(|u| u.chance < DOUBTFUL);
        let mut chosen = self.chosen(count, ranked.clone(), (&projection, &noise, &base));
        chosen.extend(unlikely.map(|u| u.candidate).filter(|t| !chosen.contains(t)));
        work.stage(&format!("fitting the best {} of {} candidates", chosen.len(), self.simulated.len()));
        let fitted = |t: &usize| self.may_go_on().ok().and_then(|()| self.candidate(*t, &projection, &noise, &base));
        let mut models: Vec<CandidateModel> = parallel::filter_map(chosen.iter(), fitted);
        self.may_go_on()?;
        sort(&mut models);
        let leaders = models.len().min(LEADERS);
        parallel::each(models[..leaders].iter_mut(), |c| c.finish(self, &noise, &base));
        self.may_go_on()?;
        sort(&mut models);
        let mut alike: Vec<CandidateModel> =
            parallel::filter_map(self.alike(&models, &ranked, &projection).iter(), fitted);
        parallel::each(alike.iter_mut(), |c| c.finish(self, &noise, &base));
        models.extend(alike);
        drop(projection);
        self.may_go_on()?;
        sort(&mut models);
        let likeliest = self.likeliest(&models);
        if let Some(k) = likeliest {
            models[k].finish(self, &noise, &base);
        }
        let Some(best) = models.first() else {
            return Ok(Comparison { noise, base_validation: None, unlikely, models, far: Vec::new(), elsewhere: None });
        };
        // the noise that the best model leaves judges all; that of the one without which the residual is no noise, where gains tell less
        let own =
            unlikely.filter(|u| u.nats > best.gain).and_then(|u| models.iter().find(|c| c.candidate == u.candidate));
        let own = own.or(likeliest.map(|k| &models[k]));
        let renewed = if own.is_some() || best.gain > LARGE { self.renewed(own.unwrap_or(best)) } else { None };
        let noise = renewed.unwrap_or(noise);
        let base = self.base(&noise, &base.theta)?;
        let near = (models[0].gain - BEHIND).min(PART * models[0].gain);
        let (mut models, far): (Vec<_>, Vec<_>) = models.into_iter().partition(|c| c.gain >= near);
        let mut base_validation = self.base_validation(&noise, &base);
        parallel::each(models.iter_mut(), |c| {
            c.finish(self, &noise, &base);
            c.compare(self, &noise, base_validation.as_ref());
        });
        self.may_go_on()?;
        let mut noise = noise;
        if let Some(raised) = self.with_excess(&noise, base_validation.as_ref(), &models) {
            noise = raised;
            base_validation = self.base_validation(&noise, &base);
            parallel::each(models.iter_mut(), |c| c.compare(self, &noise, base_validation.as_ref()));
        }
        sort(&mut models);
        // a name is worth looking for other minima
        let least = models[0].score() - CLOSE;
        parallel::each(models.iter_mut().filter(|c| c.score() > least), |c| {
            if c.again(self, &noise, &base) {
                c.compare(self, &noise, base_validation.as_ref());
            }
        });
        sort(&mut models);
        let elsewhere = self.elsewhere(&models, &noise, &base);
        Ok(Comparison { noise, base_validation, unlikely, models, far, elsewhere })
    }

    /// Candidates that were not chosen to be fitted, though what they add is what one of the good ones adds, and they cost no more: its group is
    /// known only with them.
    /// Where much is missing a finite effect predicts more than its derivative, a dead zone of an input of one sign more than a constant force.
    fn alike(&self, models: &[CandidateModel], ranked: &[(f64, usize)], projection: &Projection) -> Vec<usize> {
        let least = models.first().map_or(0.0, |best| PART * best.gain);
        // where the fit has ended: a width that was tried may be far from it
        let added = |c: &CandidateModel| -> Option<(f64, Vec<f64>)> {
            let answers = responses(&c.model, self.runs.train(), &c.predictors[..self.runs.train], &c.fitting.theta)?;
            let left: Vec<Vec<f64>> = self.left_by(&c.predictors, &answers);
            Some((c.penalty(), projection.explained(&left.iter().map(Vec::as_slice).collect::<Vec<_>>())))
        };
        let good: Vec<(f64, Vec<f64>)> = parallel::filter_map(models.iter().filter(|c| c.gain > least), added);
        let fitted = |t: &usize| models.iter().any(|c| c.candidate == *t);
        let others: Vec<usize> = ranked.iter().map(|(_, t)| *t).filter(|t| !fitted(t)).take(AMONG).collect();
        let is_alike = |t: &usize| {
            let own = self.predictions(*t, projection).into_iter().next();
            let penalty = self.penalty(*t);
            let like =
                |own: &[f64], (cost, added): &(f64, Vec<f64>)| penalty <= *cost && cosine(own, added).abs() > ALIKE;
            own.is_some_and(|own| good.iter().any(|good| like(&own.added.direction, good)))
        };
        let alike = parallel::map(others.iter(), |t| is_alike(t).then_some(*t));
        let mut alike: Vec<usize> = alike.into_iter().flatten().collect();
        // the first of the catalogue are the simplest
        alike.sort_unstable();
        alike.truncate(MOST_ALIKE);
        alike
    }

    /// Whether something may be there: by what screening predicts, or as the residual is likelier as noise without a candidate.
    pub(super) fn is_doubtful(&mut self) -> bool {
        if self.screening.family_wise < DOUBTFUL {
            return true;
        }
        let Ok((noise, _)) = self.begun() else { return false };
        let projection =
            Projection::new(&self.records, self.runs.train(), &self.current.predictors, self.current.outputs(), &noise);
        let ranked = self.ranked_by_predicted_gain(&projection);
        self.unlikely_as_noise(&projection, &ranked).is_some_and(|u| u.chance < DOUBTFUL)
    }

    /// The first noise, and the base model by it.
    fn begun(&mut self) -> Result<(CommonNoise, Fitting), DiagnosisError> {
        let noise =
            CommonNoise::new(&self.screening.spectra, self.options.dropped).growing(&self.growth).within(self.left());
        let base = self.base(&noise, &self.current.theta[..self.runs.train])?;
        Ok((noise, base))
    }

    /// The base model by a noise.
    fn base(&self, noise: &CommonNoise, starts: &[Vec<f64>]) -> Result<Fitting, DiagnosisError> {
        let fitted = self.base_posed(noise).fit(starts, ITERATIONS);
        fitted.ok_or_else(|| DiagnosisError::NoFit("its fit by the noise found has no end".into()))
    }

    fn base_posed<'c>(&'c self, noise: &'c CommonNoise) -> FitProblem<'c> {
        let (current, runs) = (&self.current, self.runs.train());
        let (params, predictors) = (current.params().to_vec(), &current.predictors[..self.runs.train]);
        FitProblem { params, dynamics: current.model.dynamics(), runs, predictors, noise }
    }

    /// Where the base model is likelier than at its fit, begun from what candidate models have found of its parameters: of a delay there may be
    /// several minima, and a fit by another noise may have ended at the wrong one. What effects gain beside that says nothing of them.
    fn elsewhere(&self, models: &[CandidateModel], noise: &CommonNoise, base: &Fitting) -> Option<Vec<Vec<f64>>> {
        models.first().filter(|best| best.gain > LARGE)?;
        let mut prepared = self.base_posed(noise).prepared()?;
        let of = |c: &CandidateModel| -> Vec<Vec<f64>> {
            let attached = &self.simulated[c.candidate].attached;
            c.fitting.theta.iter().map(|theta| attached.base(theta)).collect()
        };
        let starts = models.iter().filter_map(|c| Some((prepared.look(&of(c))?, of(c))));
        let (_, starts) = starts.min_by(|a, b| a.0.total_cmp(&b.0))?;
        drop(prepared);
        let found = self.base(noise, &starts).ok()?;
        (found.cost < base.cost - ELSEWHERE).then_some(found.theta)
    }

    /// The base model on the validation runs.
    fn base_validation(&self, noise: &CommonNoise, base: &Fitting) -> Option<Fitting> {
        let current = &self.current;
        let starts = shared_from(current.params(), base.theta.first()?, &current.theta[self.runs.train..]);
        let (params, predictors) = (current.params().to_vec(), &current.predictors[self.runs.train..]);
        let (runs, noise) = (self.runs.validation(), noise.for_validation());
        FitProblem { params, dynamics: current.model.dynamics(), runs, predictors, noise }
            .validation()
            .fit(&starts, ITERATIONS)
    }

    /// What the base model leaves: noise, and whatever is missing; none where no spectrum can be had.
    fn left(&mut self) -> Vec<LogSpectrum> {
        let directions: Vec<_> = self.records.iter_mut().map(|r| std::mem::take(&mut r.directions)).collect();
        let found = self.current.noise(&self.records, &self.options);
        self.records.iter_mut().zip(directions).for_each(|(record, own)| record.directions = own);
        found.unwrap_or_default()
    }

    /// What responses to the training runs leave of them.
    pub(super) fn left_by(&self, predictors: &[Predictor], answers: &[Signals]) -> Vec<Signals> {
        let left = |((predictor, run), y): ((&Predictor, &Run), &Signals)| predictor.left_by(run, y);
        predictors.iter().zip(self.runs.train()).zip(answers).map(left).collect()
    }

    /// The candidate model that leaves what is likeliest as noise of any smooth spectrum, where that is not the best one, by far: where the model
    /// is far off, its error passes for noise, by which gains say little.
    fn likeliest(&self, models: &[CandidateModel]) -> Option<usize> {
        models.first().filter(|best| best.gain > LARGE)?;
        let train = self.runs.train;
        let of = |c: &CandidateModel| -> Option<f64> {
            let answers = responses(&c.model, self.runs.train(), &c.predictors[..train], &c.fitting.theta)?;
            let left = self.left_by(&c.predictors, &answers);
            Some(self.likelihood(&left) - c.penalty())
        };
        let all: Vec<Option<f64>> = parallel::map(models.iter(), of);
        let first = all[0]?;
        let known = all.iter().enumerate().filter_map(|(k, own)| own.map(|own| (k, own)));
        let (k, most) = known.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))?;
        (most > first + LARGE).then_some(k)
    }

    /// The noise that is left by a candidate model, all directions taken out; where these leave too little to tell, what it leaves itself.
    fn renewed(&mut self, best: &CandidateModel) -> Option<CommonNoise> {
        let mut records = records(&best.model, self.runs.train(), &best.predictors, &best.fitting.theta).ok()?;
        weigh(&mut records, self.runs.train(), &self.growth);
        let left = self.current.noise(&records, &self.options).unwrap_or_default();
        // directions are large: they are lent
        let lend = |a: &mut [Record], b: &mut [Record]| {
            a.iter_mut().zip(b).for_each(|(a, b)| std::mem::swap(&mut a.directions, &mut b.directions));
        };
        lend(&mut records, &mut self.records);
        let found = self.current.noise(&records, &self.options);
        lend(&mut records, &mut self.records);
        Some(CommonNoise::new(&found.ok()?, self.options.dropped).growing(&self.growth).within(left))
    }
}

/// Scores that differ by no more than this are equal: fits end where no step gains more than a fifth of it.
pub(super) const EQUAL: f64 = 5.0 * FINE;

/// The best score first; of equals the simplest, and then the first of the catalogue: |x| x where x is positive is x^2, and a dead zone of an
/// input of one sign is a constant force.
fn sort(models: &mut [CandidateModel]) {
    models.sort_by(|a, b| b.score().total_cmp(&a.score()).then(a.candidate.cmp(&b.candidate)));
    let scores: Vec<f64> = models.iter().map(CandidateModel::score).collect();
    for equals in equals(&scores) {
        models[equals].sort_by(|a, b| a.form.cmp(&b.form).then(a.candidate.cmp(&b.candidate)));
    }
}

/// Falling scores in ranges, each of those that equal its first.
fn equals(scores: &[f64]) -> Vec<Range<usize>> {
    let (mut ranges, mut first) = (Vec::new(), 0);
    for k in 1..=scores.len() {
        // also of two that are no numbers none equals the other
        let equal = k < scores.len() && scores[first] - scores[k] <= EQUAL;
        if !equal {
            ranges.push(first..k);
            first = k;
        }
    }
    ranges
}

/// A model on the validation runs: its predictors to them and all parameters there.
type OnValidation<'m> = (&'m Model, &'m [Predictor], &'m [Vec<f64>]);

impl ForwardStep<'_> {
    /// The noise with what the validation runs hold beyond it, whichever of these models is right; none where they hold no more.
    pub(super) fn with_excess(
        &self,
        noise: &CommonNoise,
        base: Option<&Fitting>,
        models: &[CandidateModel],
    ) -> Option<CommonNoise> {
        let train = self.runs.train;
        let mut compared: Vec<OnValidation<'_>> = Vec::new();
        compared.push((&self.current.model, &self.current.predictors[train..], &base?.theta));
        for candidate in models {
            if let Some((gain, fitting)) = &candidate.validation
                && gain.is_finite()
            {
                compared.push((&candidate.model, &candidate.predictors[train..], &fitting.theta));
            }
        }
        let raised = excess(noise, self.runs.validation(), self.current.outputs(), &compared);
        raised.iter().any(|s| !s.is_none()).then(|| noise.with_excess(raised))
    }
}

/// By output, what is beyond a noise in all models.
fn excess(noise: &CommonNoise, validation: &[Run], outputs: usize, models: &[OnValidation<'_>]) -> Vec<ExcessNoise> {
    let squares = |(model, predictors, theta): &OnValidation<'_>| -> Option<Vec<Vec<(f64, f64)>>> {
        let mut all = vec![Vec::new(); outputs];
        for (run, (predictor, theta)) in validation.iter().zip(predictors.iter().zip(*theta)) {
            let response = predictor.answer(model.dynamics(), run, theta).ok()?;
            let residual = predictor.left_by(run, &response);
            let mut whitener = predictor.whitener(run, outputs, noise);
            all.iter_mut().enumerate().for_each(|(o, all)| all.extend(whitener.squares(o, &residual)));
        }
        Some(all)
    };
    let found: Vec<Vec<Vec<(f64, f64)>>> = models.iter().filter_map(squares).collect();
    let of = |o: usize| ExcessNoise::of(&found.iter().map(|model| model[o].clone()).collect::<Vec<_>>());
    (0..outputs).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bins(power: impl Fn(usize) -> f64) -> Vec<(f64, f64)> {
        (1..200).map(|k| ((k as f64).ln(), power(k))).collect()
    }

    #[test]
    fn equals_are_those_of_the_best_of_them() {
        let scores = [9.0, 9.0 - 0.9 * EQUAL, 9.0 - 1.8 * EQUAL, 4.0, f64::NEG_INFINITY, f64::NEG_INFINITY];
        assert_eq!(equals(&scores), [0..2, 2..3, 3..4, 4..5, 5..6]);
        assert_eq!(equals(&[]), []);
    }

    #[test]
    fn only_what_every_model_leaves_is_more_noise() {
        let (slow, right) = (|k: usize| if k < 8 { 300.0 } else { 1.0 }, bins(|_| 1.1));
        let found = ExcessNoise::of(&[bins(slow), bins(|k| 2.0 * slow(k))]);
        assert!((found.at(2.0_f64.ln()) - 300.0).abs() < 1e-9 && found.at(0.0 - 3.0) > 200.0, "{found:?}");
        assert_eq!((found.at(100.0_f64.ln()), found.at(1e3)), (1.0, 1.0));
        assert!(ExcessNoise::of(&[bins(slow), right]).is_none() && ExcessNoise::of(&[]).is_none());
    }
}
