//! A fit repeated: its runs as the estimates have them, with noise of the covariance that was estimated, fitted anew from the estimates
//! (parametric bootstrap). Inputs stay as they were recorded; the mean of a prior counts as one more measurement and is drawn anew.
//!
//! Noise for the repeats of a fit: of the covariance that was estimated, white or of a colour.

use super::series::StudyError;
use crate::experiment::Noise;
use crate::requirement::{Draws, Judge, RequirementError};
use fdm_estimate::{
    Attempt, Changes, Estimate, Fit, FitOptions, Halt, MultiStart, NoiseColour, ParameterEstimate, SharedSteps,
    Symmetric, Work, fit_from, starts,
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

/// Correlation of neighbouring samples under [`Colour::Ar1`].
pub(super) const NEIGHBOURS: f64 = 0.9;

/// The colour at samples `dt` apart, where no fit says it.
pub(super) fn of_experiment(colour: Colour, dt: f64) -> Option<crate::experiment::Colour> {
    match colour {
        Colour::White => Some(crate::experiment::Colour::White),
        Colour::Fitted => None,
        Colour::Ar1 => Some(crate::experiment::Colour::Lag(-dt / NEIGHBOURS.ln())),
        Colour::Pink => Some(crate::experiment::Colour::Pink),
    }
}

/// Noise for all runs of a fit.
#[derive(Debug, Clone)]
pub(super) struct Disturbance {
    outputs: Vec<String>,
    /// By run.
    sources: Vec<Source>,
}

/// The noise of one run.
#[derive(Debug, Clone)]
struct Source {
    /// Lower triangle (q by q) that makes the outputs' noise, or its innovations, of numbers that know nothing of each other.
    mixing: Vec<f64>,
    law: Law,
    /// By how much the noise of every cell (N by q) differs from that; empty where it is of one size.
    sizes: Vec<f64>,
}

#[derive(Debug, Clone)]
enum Law {
    /// Of unit deviation in each output, then mixed.
    Unit(Noise),
    /// Mixed, then filtered by the autoregression of each output.
    Filtered(Vec<Vec<f64>>),
}

impl Disturbance {
    /// As a fit has it.
    pub(super) fn new(fit: &Fit, runs: &[Run], colour: Colour) -> Result<Self, StudyError> {
        let estimate = &fit.estimate;
        let outputs: Vec<String> = estimate.outputs.iter().map(|o| o.name.clone()).collect();
        let mut names: Vec<String> = Vec::new();
        outputs.into_iter().for_each(|o| {
            if !names.contains(&o) {
                names.push(o)
            }
        });
        let noise = estimate.noise.as_ref().ok_or(StudyError::NoNoise)?;
        if (0..noise.size).all(|o| noise.at(o, o) <= 0.0) || estimate.noise_free.len() == names.len() {
            return Err(StudyError::NoNoise);
        }
        let same = |law: Law| Source { mixing: triangle(noise), law, sizes: Vec::new() };
        let mut sources = match of_experiment(colour, 1.0) {
            Some(colour) => vec![same(Law::Unit(Noise { deviation: 1.0, colour, ..Noise::default() })); runs.len()],
            None => {
                if let Some(reason) = &estimate.uncorrected {
                    return Err(StudyError::NoColour { reason: reason.to_string() });
                }
                runs.iter().map(|run| Source::fitted(estimate, &names, &run.name)).collect()
            }
        };
        for (source, own) in sources.iter_mut().zip(&fit.noise_of_samples) {
            // colours are those of residuals over their deviations
            let unit = |o: usize| if matches!(source.law, Law::Filtered(_)) { 1.0 } else { noise.at(o, o).sqrt() };
            let size = |(k, s): (usize, &f64)| if s.is_nan() { 1.0 } else { s / unit(k % names.len()) };
            source.sizes = own.deviations.iter().enumerate().map(size).collect();
        }
        Ok(Self { outputs: names, sources })
    }

    /// Noise of a run (N by q row-major) in a repeat, from streams of its own.
    pub(super) fn drawn(&self, r: usize, run: &Run, seed: u64, repeat: u64) -> Vec<f64> {
        let number = repeat.to_string();
        let stream = |output: &String| Stream::named(seed, &["study", &run.name, output, &number]);
        let mut chances: Vec<Stream> = self.outputs.iter().map(stream).collect();
        let mut noise = self.sources[r].drawn(run.len(), &mut chances);
        noise.iter_mut().zip(&self.sources[r].sizes).for_each(|(v, size)| *v *= size);
        noise
    }
}

impl Source {
    fn fitted(estimate: &Estimate, outputs: &[String], run: &str) -> Self {
        let own = |o: &String| estimate.colours.iter().find(|c| c.output == *o && c.runs.iter().any(|r| r == run));
        let colours: Vec<Option<&NoiseColour>> = outputs.iter().map(own).collect();
        let q = colours.len();
        let coefficients: Vec<Vec<f64>> =
            colours.iter().map(|c| c.map_or(Vec::new(), |c| c.coefficients.clone())).collect();
        let mut sums = vec![0.0; q * q];
        let group = colours.iter().flatten().next().map_or(&[][..], |c| &c.runs[..]);
        for fit in estimate.runs.iter().filter(|fit| group.contains(&fit.run)) {
            let innovations: Vec<Vec<f64>> =
                (0..q).map(|o| innovations(&fit.residuals, q, o, &coefficients[o])).collect();
            for i in 0..fit.residuals.len() / q {
                // only samples with all outputs: the correlations then belong together
                if innovations.iter().all(|e| !e[i].is_nan()) {
                    (0..q * q).for_each(|k| sums[k] += innovations[k / q][i] * innovations[k % q][i]);
                }
            }
        }
        let deviation = |o: usize| colours[o].map_or(0.0, |c| c.innovation);
        let entry = |k: usize| {
            let (a, b) = (k / q, k % q);
            let size = (sums[a * q + a] * sums[b * q + b]).sqrt();
            let correlation = if a == b { 1.0 } else { (sums[k] / size).clamp(-1.0, 1.0) };
            let correlation = if correlation.is_finite() { correlation } else { 0.0 };
            correlation * deviation(a) * deviation(b)
        };
        let covariance = Symmetric { size: q, values: (0..q * q).map(entry).collect() };
        Self { mixing: triangle(&covariance), law: Law::Filtered(coefficients), sizes: Vec::new() }
    }

    fn drawn(&self, samples: usize, chances: &mut [Stream]) -> Vec<f64> {
        let q = chances.len();
        match &self.law {
            Law::Unit(noise) => {
                let series: Vec<Vec<f64>> = chances.iter_mut().map(|c| noise.drawn(samples, 1.0, c)).collect();
                (0..samples).flat_map(|i| self.mixed(series.iter().map(move |s| s[i]))).collect()
            }
            Law::Filtered(coefficients) => {
                // long enough to forget where it began
                let before = 2 * samples + 1000;
                let mut noise: Vec<f64> = Vec::with_capacity((before + samples) * q);
                for i in 0..before + samples {
                    noise.extend(self.mixed(chances.iter_mut().map(Stream::normal)));
                    for (o, coefficients) in coefficients.iter().enumerate() {
                        let past = coefficients.iter().take(i).enumerate();
                        let part: f64 = past.map(|(k, a)| a * noise[(i - 1 - k) * q + o]).sum();
                        noise[i * q + o] += part;
                    }
                }
                noise.split_off(before * q)
            }
        }
    }

    /// The triangle times numbers that know nothing of each other.
    fn mixed(&self, fresh: impl Iterator<Item = f64>) -> Vec<f64> {
        let fresh: Vec<f64> = fresh.collect();
        let q = fresh.len();
        (0..q).map(|a| (0..=a).map(|b| self.mixing[a * q + b] * fresh[b]).sum()).collect()
    }
}

/// The innovations of an output's residuals; NaN where one is missing.
fn innovations(residuals: &[f64], outputs: usize, output: usize, coefficients: &[f64]) -> Vec<f64> {
    let series: Vec<f64> = residuals.iter().skip(output).step_by(outputs).copied().collect();
    let one = |i: usize| {
        let past = coefficients.iter().enumerate();
        if i < coefficients.len() {
            f64::NAN
        } else {
            series[i] - past.map(|(k, a)| a * series[i - 1 - k]).sum::<f64>()
        }
    };
    (0..series.len()).map(one).collect()
}

/// Cholesky's triangle (row-major) of a covariance; what has no variance of its own left gets none.
fn triangle(covariance: &Symmetric) -> Vec<f64> {
    let n = covariance.size;
    let mut l = vec![0.0; n * n];
    for j in 0..n {
        let rest = covariance.at(j, j) - (0..j).map(|k| l[j * n + k] * l[j * n + k]).sum::<f64>();
        if rest <= 1e-14 * covariance.at(j, j) {
            continue;
        }
        l[j * n + j] = rest.sqrt();
        for i in j + 1..n {
            let inner: f64 = (0..j).map(|k| l[i * n + k] * l[j * n + k]).sum();
            l[i * n + j] = (covariance.at(i, j) - inner) / l[j * n + j];
        }
    }
    l
}

#[cfg(test)]
mod disturbance_tests {
    use super::*;

    fn source(mixing: Vec<f64>, law: Law) -> Source {
        Source { mixing, law, sizes: Vec::new() }
    }

    /// Mean of v(i) w(i + lag).
    fn product(noise: &[f64], q: usize, (a, b): (usize, usize), lag: usize) -> f64 {
        let n = noise.len() / q - lag;
        (0..n).map(|i| noise[i * q + a] * noise[(i + lag) * q + b]).sum::<f64>() / n as f64
    }

    #[test]
    fn noise_has_the_covariance_and_the_colour_that_it_is_to_have() {
        let covariance = Symmetric { size: 2, values: vec![4.0, 1.5, 1.5, 1.0] };
        let mut chances = [Stream::named(1, &["a"]), Stream::named(1, &["b"])];
        let mixing = triangle(&covariance);
        for (colour, neighbours) in [(Colour::White, 0.0), (Colour::Ar1, NEIGHBOURS)] {
            let colour = of_experiment(colour, 1.0).expect("of its own");
            let law = Law::Unit(Noise { deviation: 1.0, colour, ..Noise::default() });
            let noise = source(mixing.clone(), law).drawn(60_000, &mut chances);
            for (pair, want) in [((0, 0), 4.0), ((0, 1), 1.5), ((1, 1), 1.0)] {
                let (now, next) = (product(&noise, 2, pair, 0), product(&noise, 2, pair, 1));
                assert!((now / want - 1.0).abs() < 0.08, "{pair:?} {now}");
                assert!((next / now - neighbours).abs() < 0.03, "{pair:?} {next}");
            }
        }
        // v(i) = 1.2 v(i-1) - 0.6 v(i-2) + e
        let filtered = Law::Filtered(vec![vec![1.2, -0.6], Vec::new()]);
        let noise = source(vec![1.0, 0.0, 0.0, 0.5], filtered).drawn(60_000, &mut chances);
        let (a, b): (f64, f64) = (1.2, -0.6);
        let variance = (1.0 - b) / ((1.0 + b) * ((1.0 - b).powi(2) - a * a));
        let found = product(&noise, 2, (0, 0), 0);
        assert!((found / variance - 1.0).abs() < 0.05, "{found} {variance}");
        assert!((product(&noise, 2, (0, 0), 1) / found - a / (1.0 - b)).abs() < 0.01);
        assert!((product(&noise, 2, (1, 1), 0) / 0.25 - 1.0).abs() < 0.03);
    }

    #[test]
    fn what_has_no_noise_gets_none() {
        let covariance = Symmetric { size: 3, values: vec![1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0] };
        let l = triangle(&covariance);
        assert_eq!(l, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    }
}
