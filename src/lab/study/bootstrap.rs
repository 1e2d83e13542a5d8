//! A fit repeated: its runs as the estimates have them, with noise of the covariance that was estimated, fitted anew from the estimates
//! (parametric bootstrap). Inputs stay as they were recorded; the mean of a prior counts as one more measurement and is drawn anew.

use super::disturbance::Disturbance;
use super::study_error::StudyError;
use crate::requirement::{Draws, Judge, RequirementError};
use fdm_estimate::{
    Attempt, Changes, Estimate, Fit, FitOptions, Halt, MultiStart, ParameterEstimate, SharedSteps, Work, fit_from,
    starts,
};
use fdm_numeric::random::Stream;
use fdm_results::documents::study::{Colour, Goal, Repeat, Study, Subject, is_estimated};
use fdm_results::documents::{FitDocument, ResultDocument};
use fdm_system::Model;
use fdm_system::record::Run;

/// A fit that can be repeated.
pub struct Bootstrap {
    model: Model,
    /// What the estimates say would have been measured without noise.
    clean: Vec<Run>,
    starts: Vec<Vec<f64>>,
    options: FitOptions,
    noise: Disturbance,
    subjects: Vec<Subject>,
    /// Judges the requirements of the text; or why they are not judged.
    judge: Result<Option<Judge>, RequirementError>,
    colour: Colour,
    seed: u64,
}

impl Bootstrap {
    /// Of a fit of these runs with these options.
    ///
    /// # Errors
    /// [`StudyError`], when the fit has no minimum, nothing estimated, or no noise.
    pub fn new(
        fit: &Fit,
        runs: &[Run],
        options: &FitOptions,
        (colour, seed): (Colour, u64),
    ) -> Result<Self, StudyError> {
        let estimate = &fit.estimate;
        if !estimate.termination.is_good() {
            return Err(StudyError::Astray { reason: estimate.termination.to_string() });
        }
        let subjects = subjects(estimate);
        if subjects.is_empty() {
            return Err(StudyError::NothingEstimated);
        }
        let noise = Disturbance::new(fit, runs, colour)?;
        let measured = |run: &Run, response: &[f64]| {
            let cells = run.measured.iter().zip(response);
            cells.map(|(z, y)| if z.is_nan() { f64::NAN } else { *y }).collect()
        };
        let responses = runs.iter().zip(&estimate.runs);
        let clean = responses.map(|(run, fit)| Run { measured: measured(run, &fit.response), ..run.clone() }).collect();
        let cut = fit.shooting.as_ref().is_some_and(|c| !c.polished);
        let options = FitOptions {
            changes: Changes::default(),
            shared_steps: SharedSteps::of(fit.integration.clone()),
            starts: MultiStart::default(),
            substitute: Vec::new(),
            shooting: options.shooting.filter(|_| cut),
            confidence: false,
            reweight: false,
            bare: true,
            ..options.clone()
        };
        let options = options.with_declared_noise(&fit.model);
        let starts = reached(&fit.model, runs, estimate);
        Ok(Self { model: fit.model.clone(), clean, starts, options, noise, subjects, judge: Ok(None), colour, seed })
    }

    /// With the requirements of the text judged in every repeat, as `fdm margins` judges those of the fit.
    #[must_use]
    pub fn judging(mut self, fit: &Fit, draws: Draws) -> Self {
        let runs: Vec<String> = self.clean.iter().map(|run| run.name.clone()).collect();
        self.judge = Judge::new(&self.model, &ResultDocument::from(FitDocument::of(fit)), &runs, draws);
        self
    }

    /// The colour of the noise.
    pub fn colour(&self) -> Colour {
        self.colour
    }

    /// The requirements that are judged.
    ///
    /// # Errors
    /// Why those of the text are not.
    pub fn goals(&self) -> Result<&[Goal], &RequirementError> {
        self.judge.as_ref().map(|judge| judge.as_ref().map_or(&[][..], Judge::goals))
    }

    /// The study that repeats make.
    pub fn study(&self, repeats: &[Option<Repeat>]) -> Study {
        let study = Study::of(self.model.name(), (Some(self.colour), self.seed), &self.subjects, repeats);
        match self.goals() {
            Ok(goals) => study.with_requirements(goals, repeats),
            Err(why) => study.without_requirements(why),
        }
    }

    /// The parameters that are studied.
    pub fn subjects(&self) -> &[Subject] {
        &self.subjects
    }

    /// The repeat of this number; none when it was interrupted.
    pub fn once(&self, number: u64, halt: &Halt) -> Option<Repeat> {
        let runs: Vec<Run> = self.clean.iter().enumerate().map(|(r, run)| self.disturbed(r, run, number)).collect();
        let model = self.with_priors(number);
        let Self { starts, options, .. } = self;
        match fit_from(&Attempt { model: &model, runs: &runs, starts, options, work: &Work::until(halt) }) {
            _ if !halt.goes_on() => None,
            Ok(found) => {
                let mut repeat = Repeat::of(&found.estimate, &self.subjects);
                if let Ok(Some(judge)) = &self.judge
                    && repeat.is_good()
                {
                    repeat.requirements = judge.judged(&ResultDocument::from(FitDocument::of(&found)));
                }
                Some(repeat)
            }
            Err(e) => Some(Repeat::gone(e, self.subjects.len())),
        }
    }

    fn disturbed(&self, r: usize, run: &Run, number: u64) -> Run {
        let noise = self.noise.drawn(r, run, self.seed, number);
        Run { measured: run.measured.iter().zip(noise).map(|(y, v)| y + v).collect(), ..run.clone() }
    }

    /// Means of priors as another measurement would have given them.
    fn with_priors(&self, number: u64) -> Model {
        let definition = self.model.definition();
        if definition.params.iter().all(|p| p.prior.is_none()) {
            return self.model.clone();
        }
        let mut params = definition.params.clone();
        for (k, param) in params.iter_mut().enumerate() {
            let Some(prior) = &mut param.prior else { continue };
            let names = ["study", "prior", &param.quantity.name, &number.to_string()];
            let centre = self.starts.first().map_or(prior.mean, |theta| theta[k]);
            prior.mean = centre + prior.deviation * Stream::named(self.seed, &names).normal();
        }
        self.model.with_params(params)
    }
}

fn subjects(estimate: &Estimate) -> Vec<Subject> {
    let estimated = estimate.parameters.iter().filter(|p| is_estimated(p));
    let subject = |p: &ParameterEstimate| Subject {
        step: String::new(),
        name: p.name.clone(),
        run: p.run.clone(),
        unit: p.unit.clone(),
        truth: p.value,
    };
    estimated.map(subject).collect()
}

/// All parameters of each run at the estimates.
pub(crate) fn reached(model: &Model, runs: &[Run], estimate: &Estimate) -> Vec<Vec<f64>> {
    let mut all = starts(model, runs, &Changes::default());
    for (theta, run) in all.iter_mut().zip(runs) {
        for (value, param) in theta.iter_mut().zip(&model.definition().params) {
            let owner = param.per_run.then_some(run.name.as_str());
            *value = estimate.parameter(&param.quantity.name, owner).map_or(*value, |p| p.value);
        }
    }
    all
}
