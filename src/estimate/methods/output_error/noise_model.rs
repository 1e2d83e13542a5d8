//! A fit in which the noise of outputs is an expression (`noise y = 0.02 + 0.1*abs(y);`): the likelihood of everything, its parameters among them, from the
//! estimates of a fit whose noise is of one size.

use super::censored::{Below, limits};
use super::error::{FitError, StrategyError};
use super::fit::{Fit, NoiseOfSamples};
use super::options::FitOptions;
use super::options::{Attempt, after, suited};
use super::single::chosen_steps;
use super::standardised::{Part, Precision, Standardised};
use crate::estimation::solve::estimate;
use crate::estimation::{Estimate, RunFit, Symmetric};
use crate::problem::method::{Domain, Method};
use crate::problem::noise::Noise;
use crate::problem::noise::{Degeneracy, passes_zero, tells_no_variance};
use crate::problem::response::RunResponse;
use crate::problem::unknowns::DerivedQuantities;
use crate::problem::{LimitedNoise, Options, Problem, ProblemRun};
use crate::residuals::noise_variation::{OutputSeries, test};
use crate::residuals::{OutputFit, residuals};
use crate::uncertainty::sandwich::NoiseColour;
use crate::work::Work;
use fdm_grammar::graph::{Leaf, Node, show};
use fdm_numeric::halt::Halt;
use fdm_system::model::Model;
use fdm_system::record::{Censored, Run};
use fdm_system::simulate::{Accuracy, Scheme, Simulator, StepOptions, Steps, choose_steps, integration_error};
use std::f64::consts::TAU;

/// The outputs (q) whose noise is an expression and is not put aside by what was asked for: the place of one over the deviation among the outputs of
/// [`with_precisions`](fdm_grammar::Model::with_precisions). None where there are none, and no sample is known by its limit alone.
pub(crate) fn deviations(model: &Model, noise: &Noise, censored: &[Censored]) -> Option<Vec<Option<usize>>> {
    let outputs = &model.definition().outputs;
    let aside = |o: usize| match noise {
        Noise::Diagonal => false,
        Noise::Full => true,
        Noise::Given(given) => given.iter().all(Option::is_none) || given[o].is_some(),
    };
    let mut next = outputs.len()..;
    let place = |(o, output): (usize, &fdm_grammar::model::Output)| {
        let place = output.noise_model.and_then(|_| next.next());
        place.filter(|_| !aside(o))
    };
    let places: Vec<Option<usize>> = outputs.iter().enumerate().map(place).collect();
    (places.iter().any(Option::is_some) || !censored.is_empty()).then_some(places)
}

/// Why samples that are known by their limit alone cannot be compared, if they cannot.
pub(crate) fn unlimited(model: &Model, options: &FitOptions, deviations: &[Option<usize>]) -> Option<StrategyError> {
    let lacks = |o: &usize| deviations[*o].is_none() && given(options, *o).is_none();
    let output = options.censored.iter().map(|c| c.output).find(lacks)?;
    Some(StrategyError::CensoredNoise { output: model.definition().outputs[output].quantity.name.clone() })
}

/// The deviation of an output that is given as a number.
fn given(options: &FitOptions, output: usize) -> Option<f64> {
    if let Noise::Given(given) = &options.options.noise { given[output] } else { None }
}

/// Integration error, as a part of each output's range, with which most signs are told.
const ROUGH: f64 = 1e-4;

/// The runs without the samples whose deviation is infinite: these say nothing, whatever they are.
///
/// # Errors
/// [`FitError::Unsuited`] for a run that the model cannot be simulated on, [`FitError::Deviation`] for a sample whose deviation is not
/// above zero.
pub(crate) fn without_infinite(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    deviations: &[Option<usize>],
    work: &Work<'_>,
) -> Result<Vec<Run>, FitError> {
    let Some(definition) = model.definition().with_precisions() else { return Ok(runs.to_vec()) };
    let (whole, q) = (model.sketched(definition), deviations.len());
    let simulated = whole.definition().outputs.len();
    let mut kept = runs.to_vec();
    for (run, theta) in kept.iter_mut().zip(starts) {
        let mut y = vec![f64::NAN; run.len() * simulated];
        let simulate = |run: &Run, steps: Steps, y: &mut [f64]| {
            let simulator = Simulator::new(whole.dynamics(), run, steps);
            simulator.map(|mut s| s.simulate(theta, y).is_ok()).map_err(|e| FitError::unsuited(run, e))
        };
        // rough steps are enough where nothing is to be decided; with a stiff model, or over a long interval, they may give any number
        let mut decided =
            simulate(run, Steps::equal(Scheme::default(), 1), &mut y)? && are_ordinary(run, deviations, &y);
        for accuracy in [Some(ROUGH), None] {
            if decided {
                break;
            }
            y.fill(f64::NAN);
            let halt = work.halt_from_here();
            let rough = StepOptions { halt, ..StepOptions::default() }.to(accuracy);
            let chosen = choose_steps(whole.dynamics(), run, theta, &rough);
            if !halt.is_none_or(Halt::goes_on) {
                // such steps say nothing of the start
                return Ok(runs.to_vec());
            }
            // where the start diverges all the same, what comes before is judged
            let finite = simulate(run, chosen.map_err(|e| FitError::unsuited(run, e))?.steps, &mut y)?;
            decided = finite && are_ordinary(run, deviations, &y);
        }
        if let Some(wrong) = not_positive(model, run, deviations, &y) {
            return Err(wrong);
        }
        for (z, y) in run.measured.chunks_exact_mut(q).zip(y.chunks_exact(simulated)) {
            let infinite = |s: &Option<usize>| s.is_some_and(|s| y[s] == 0.0);
            z.iter_mut().zip(deviations).filter(|(_, s)| infinite(s)).for_each(|(z, _)| *z = f64::NAN);
        }
    }
    Ok(kept)
}

/// Whether the deviations of all measured samples are above zero and finite; `y` holds the outputs and one over the deviations.
fn are_ordinary(run: &Run, deviations: &[Option<usize>], y: &[f64]) -> bool {
    let mut rows = y.chunks_exact(y.len() / run.len().max(1)).zip(run.measured.chunks_exact(deviations.len()));
    rows.all(|(y, z)| {
        let ordinary = |s: &Option<usize>| s.is_none_or(|s| y[s] > 0.0 && y[s].is_finite());
        z.iter().zip(deviations).all(|(z, s)| z.is_nan() || ordinary(s))
    })
}

/// The first measured sample of a run whose deviation is not above zero; `y` holds the outputs and one over the deviations.
fn not_positive(model: &Model, run: &Run, deviations: &[Option<usize>], y: &[f64]) -> Option<FitError> {
    let (definition, q) = (model.definition(), deviations.len());
    let rows = y.chunks_exact(y.len() / run.len().max(1)).zip(run.measured.chunks_exact(q)).enumerate();
    for (sample, (y, z)) in rows {
        let positive = |s: &Option<usize>| s.is_none_or(|s| y[s] >= 0.0 && y[s].is_finite());
        let is_wrong = |o: &usize| !z[*o].is_nan() && !positive(&deviations[*o]);
        let wrong = (0..q).filter(|_| y[..q].iter().all(|v| v.is_finite())).find(is_wrong);
        let Some((o, s)) = wrong.and_then(|o| Some((o, deviations[o]?))) else { continue };
        let output = &definition.outputs[o];
        return Some(FitError::Deviation {
            output: output.quantity.name.clone(),
            expression: stated(model, o),
            run: run.name.clone(),
            time: run.time[sample],
            // what is simulated is one over it
            value: 1.0 / y[s],
        });
    }
    None
}

/// What is stated for the deviation of an output, as text.
fn stated(model: &Model, output: usize) -> String {
    let definition = model.definition();
    definition.outputs[output].noise_model.map_or_else(String::new, |e| show(&definition.graph, e, definition))
}

/// Why a method that knows noise of one size only cannot estimate a model, if it cannot.
pub(crate) fn refused(model: &Model, noise: &Noise, method: Method, domain: Domain) -> Option<StrategyError> {
    deviations(model, noise, &[]).map(|_| StrategyError::NoiseModel { method, domain })
}

/// The model with the parameters held that stand in the noise of outputs alone.
pub(crate) fn without_output_noise(model: &Model) -> Model {
    let only = model.definition().only_in_output_noise();
    if !only.contains(&true) {
        return model.clone();
    }
    let mut params = model.definition().params.clone();
    params.iter_mut().zip(only).filter(|(_, only)| *only).for_each(|(p, _)| p.fixed = true);
    model.with_params(params)
}

/// A fit by the likelihood with `deviations` (q) from each of `places` (all parameters of each run) in place of the start values, of which
/// the likeliest is kept. One place is where the fit by noise of one size has ended, `first`: that noise says nothing of where the likelihood of the
/// stated one is greatest, and a deviation that may vanish stands between the two as a wall. The last place is told of where none leads anywhere.
///
/// # Errors
/// [`FitError`], as any fit, where no place is possible.
pub(crate) fn fit_noise_model(
    attempt: &Attempt<'_>,
    places: &[Vec<Vec<f64>>],
    (first, deviations): (Fit, &[Option<usize>]),
) -> Result<Fit, FitError> {
    let Attempt { model, work, .. } = *attempt;
    let whole = model.definition().with_precisions().map_or_else(|| model.clone(), |whole| model.altered(whole));
    let (mut best, mut refused) = (None::<Fit>, None);
    for (k, place) in places.iter().enumerate() {
        let found = from_place(&Attempt { starts: place, ..*attempt }, (&whole, deviations), &first);
        let ended = found.is_err() || matches!(&found, Ok(Some(fit)) if !fit.estimate.termination.is_stopped());
        match found {
            Ok(Some(fit)) => {
                let kept = best.as_ref().is_some_and(|b| b.estimate.cost.is_some() && !fit.is_better_than(b));
                best = if kept { best } else { Some(fit) };
            }
            Ok(None) => {}
            Err(error) => refused = Some(error),
        }
        let Some(stop) = work.halted() else { continue };
        // places are left that may be better, this one too, or there is no better estimate than the first
        let unfinished = !ended || k + 1 < places.len() || best.is_none();
        let mut so_far = best.unwrap_or(first);
        if unfinished {
            so_far.estimate.termination = stop.into();
        }
        return Ok(so_far);
    }
    match (best, refused) {
        (Some(fit), _) => Ok(fit),
        (None, Some(error)) => Err(error),
        (None, None) => Ok(first),
    }
}

/// The fit from one place; none where its steps were not chosen in time.
fn from_place(
    place: &Attempt<'_>,
    (whole, deviations): (&Model, &[Option<usize>]),
    first: &Fit,
) -> Result<Option<Fit>, FitError> {
    let Attempt { model, runs, options, work, .. } = *place;
    let mut starts = place.starts.to_vec();
    let was_stopped = work.halted().is_some();
    let integration = steps(&Attempt { model: whole, ..*place })?;
    if work.halted().is_some() && !was_stopped {
        return Ok(None);
    }
    let q = deviations.len();
    let limits = runs.iter().map(|run| limits(&options.censored, run, q)).collect();
    let precision = |(o, place): (usize, &Option<usize>)| match place {
        Some(s) => Some(Precision::Simulated(*s)),
        None => given(options, o).map(|s| Precision::Known(1.0 / s)),
    };
    let precisions: Vec<Option<Precision>> = deviations.iter().enumerate().map(precision).collect();
    let parts = Part::of_outputs(&precisions, |o| options.censored.iter().any(|c| c.output == o));
    let fitting = Fitting { model, whole, runs, deviations, limits, parts, integration: &integration, options };
    // what stands in the noise alone first: its start values know nothing of the residuals
    let only = model.definition().only_in_output_noise();
    if only.iter().zip(&model.definition().params).any(|(only, p)| *only && !p.fixed) {
        let noise = fitting.estimate(&starts, |k| only[k], work)?;
        starts = after(model, runs, &noise, &starts);
    }
    let found = fitting.estimate(&starts, |_| true, work)?;
    let reached = after(model, runs, &found, &starts);
    let (mut estimate, samples) = fitting.told(found, &reached)?;
    estimate.degenerate = fitting.degenerate(&estimate, &reached)?;
    Ok(Some(Fit { model: model.clone(), estimate, integration, noise_of_samples: samples, ..first.clone() }))
}

/// Parts of an interval between samples in which a deviation is looked at.
const PARTS: usize = 16;
/// Numbers of a run that is looked at so finely; of a longer one, as it was sampled.
const MOST_NUMBERS: usize = 1 << 22;

/// Steps of each run for outputs and deviations.
fn steps(whole: &Attempt<'_>) -> Result<Vec<Accuracy>, FitError> {
    let Attempt { model, runs, starts, options, .. } = *whole;
    let Some(per_interval) = options.per_interval else { return chosen_steps(whole) };
    let steps = Steps::equal(options.scheme.unwrap_or_default(), per_interval);
    let one = |(run, theta): (&Run, &Vec<f64>)| {
        let error = integration_error(model.dynamics(), run, theta, steps.clone());
        Ok(Accuracy { steps: steps.clone(), error: error.map_err(|e| FitError::unsuited(run, e))? })
    };
    runs.iter().zip(starts).map(one).collect()
}

struct Fitting<'f> {
    model: &'f Model,
    /// The model with one over its deviations as outputs.
    whole: &'f Model,
    runs: &'f [Run],
    deviations: &'f [Option<usize>],
    /// Limits of the samples of each run (N by q, or nothing).
    limits: Vec<Vec<f64>>,
    /// The standardised outputs.
    parts: Vec<Part>,
    integration: &'f [Accuracy],
    options: &'f FitOptions,
}

impl Fitting<'_> {
    fn simulator(&self, r: usize, theta: &[f64]) -> Result<Simulator<'_>, FitError> {
        suited(self.whole, &self.runs[r], theta, self.integration[r].steps.clone())
    }

    /// Estimates the parameters that `open` says, from these values.
    fn estimate(
        &self,
        starts: &[Vec<f64>],
        open: impl Fn(usize) -> bool,
        work: &Work<'_>,
    ) -> Result<Estimate, FitError> {
        let mut prepared = Vec::with_capacity(self.runs.len());
        for (r, theta) in starts.iter().enumerate() {
            let run = &self.runs[r];
            let known = (run.measured.clone(), self.limits[r].clone());
            let response = Standardised::new(self.simulator(r, theta)?, known, self.parts.clone());
            let (name, start, measured) = (run.name.clone(), theta.clone(), response.targets());
            prepared.push(ProblemRun {
                name,
                response: RunResponse::Standardised(Box::new(response)),
                measured,
                start,
            });
        }
        let definition = self.model.definition();
        let derived = DerivedQuantities::of(self.whole.definition(), self.whole.dynamics());
        let mut problem = Problem::new(definition, prepared, derived);
        problem.affine = Vec::new();
        problem.limited = self.limited(&open);
        problem.outputs = self.names();
        for (k, param) in problem.params.iter_mut().enumerate() {
            param.fixed |= !open(k);
            if let Some(first) = starts.first().filter(|_| !param.per_run) {
                param.value = first[k];
            }
        }
        let unit = |part: &Part| if let Part::Plain(o) = part { given(self.options, *o) } else { Some(1.0) };
        let noise = Noise::Given(self.parts.iter().map(unit).collect());
        let options = Options { noise, ..self.options.options.clone() };
        estimate(&mut problem, &options, work).map_err(FitError::Problem)
    }

    /// What determines the deviations of outputs with samples below a limit, where these are estimated with what `open` says.
    fn limited(&self, open: impl Fn(usize) -> bool) -> Option<LimitedNoise> {
        self.limits.iter().any(|limits| !limits.is_empty()).then_some(())?;
        let definition = self.model.definition();
        let only = definition.only_in_output_noise();
        let params = (0..only.len()).filter(|k| only[*k] && open(*k) && !definition.params[*k].fixed).count();
        let q = self.deviations.len();
        let told = |(k, z): (usize, &f64)| !z.is_nan() && self.deviations[k % q].is_some();
        let values = self.runs.iter().map(|run| run.measured.iter().enumerate().filter(|k| told(*k)).count()).sum();
        Some(LimitedNoise { values, params })
    }

    /// Why the likelihood has no maximum at an estimate, if it has none.
    fn degenerate(&self, estimate: &Estimate, reached: &[Vec<f64>]) -> Result<Vec<Degeneracy>, FitError> {
        let mut found = estimate.degenerate.clone();
        if estimate.runs.is_empty() {
            return Ok(found);
        }
        found.extend(self.without_freedom(estimate));
        for (o, place) in self.deviations.iter().enumerate().filter_map(|(o, place)| Some((o, (*place)?))) {
            for (run, theta) in self.runs.iter().zip(reached) {
                let Some(time) = self.vanishes(run, theta, place)? else { continue };
                found.push(Degeneracy::Deviation {
                    output: self.model.definition().outputs[o].quantity.name.clone(),
                    expression: stated(self.model, o),
                    run: run.name.clone(),
                    time,
                });
                break;
            }
        }
        Ok(found)
    }

    /// Outputs whose noise is told by parameters that stand in it alone, and which leave no degrees of freedom for these.
    fn without_freedom(&self, estimate: &Estimate) -> Option<Degeneracy> {
        let definition = self.model.definition();
        let only = definition.only_in_output_noise();
        let followed = |o: usize| {
            let part = self.parts.iter().position(|part| part.is_shown() && part.output() == o)?;
            estimate.leverages.get(part).copied()
        };
        let compared = |o: usize| {
            let own = self.runs.iter().flat_map(|run| run.measured.iter().skip(o).step_by(self.deviations.len()));
            own.filter(|z| !z.is_nan()).count()
        };
        let all = (0..self.deviations.len()).filter(|o| compared(*o) > 0).count();
        (0..only.len()).filter(|k| only[*k] && !definition.params[*k].fixed).find_map(|k| {
            let stands = |o: &usize| {
                let noise = definition.outputs[*o].noise_model.filter(|_| self.deviations[*o].is_some());
                let mut inner = definition.graph.reachable(noise.into_iter().collect::<Vec<_>>()).into_iter();
                compared(*o) > 0 && inner.any(|e| definition.graph.node(e) == Node::Leaf(Leaf::Param(k as u32)))
            };
            let outputs: Vec<usize> = (0..self.deviations.len()).filter(stands).collect();
            let samples: usize = outputs.iter().map(|o| compared(*o)).sum();
            let followed = outputs.iter().map(|o| followed(*o)).sum::<Option<f64>>()?;
            let freedom = samples as f64 - followed;
            // of a noise that all outputs have in common no weight is told
            let told = if outputs.len() == all {
                freedom < 1e-6 * samples as f64
            } else {
                tells_no_variance(freedom, followed)
            };
            told.then(|| Degeneracy::Variance {
                outputs: outputs.iter().map(|o| definition.outputs[*o].quantity.name.clone()).collect(),
                samples,
                freedom,
            })
        })
    }

    /// When within a run the deviation passes zero whose reciprocal is this simulated output; none where it does not.
    fn vanishes(&self, run: &Run, theta: &[f64], place: usize) -> Result<Option<f64>, FitError> {
        let simulated = self.whole.definition().outputs.len();
        let few = run.len().saturating_mul(PARTS * simulated) <= MOST_NUMBERS;
        let fine = run.with_parts(if few { PARTS } else { 1 });
        let chosen = choose_steps(
            self.whole.dynamics(),
            &fine,
            theta,
            &StepOptions { accuracy: ROUGH, ..StepOptions::default() },
        );
        let steps = chosen.map_err(|e| FitError::unsuited(run, e))?.steps;
        let mut simulator =
            Simulator::new(self.whole.dynamics(), &fine, steps).map_err(|e| FitError::unsuited(run, e))?;
        let mut y = vec![f64::NAN; fine.len() * simulated];
        // where a sample of its own time is exact, the response ends
        let _ = simulator.simulate(theta, &mut y);
        let deviations: Vec<f64> = y.iter().skip(place).step_by(simulated).map(|p| 1.0 / p.abs()).collect();
        Ok(passes_zero(&deviations).map(|at| fine.time[at]))
    }

    /// Names of the standardised outputs.
    fn names(&self) -> Vec<String> {
        let outputs = &self.model.definition().outputs;
        let name = |part: &Part| {
            let own = &outputs[part.output()].quantity.name;
            if part.is_shown() { own.clone() } else { format!("noise of {own}") }
        };
        self.parts.iter().map(name).collect()
    }

    /// The estimate in the model's own outputs, and the noise of every sample.
    fn told(&self, found: Estimate, reached: &[Vec<f64>]) -> Result<(Estimate, Vec<NoiseOfSamples>), FitError> {
        if found.runs.is_empty() {
            return Ok((found, Vec::new()));
        }
        let (q, names) = (self.deviations.len(), self.model.definition().outputs.iter());
        let names: Vec<String> = names.map(|o| o.quantity.name.clone()).collect();
        let (mut outputs, mut runs, mut samples) = (Vec::new(), Vec::new(), Vec::new());
        let mut series: Vec<(String, Vec<OutputSeries>)> = names.iter().map(|n| (n.clone(), Vec::new())).collect();
        let mut squares = vec![(0.0, 0usize); q];
        let given = |o: usize| given(self.options, o);
        // of each output: squares over variances with the logarithms of these, for the likelihood
        let mut misfits = vec![0.0; q];
        let mut below = 0.0;
        for (r, theta) in reached.iter().enumerate() {
            let mut simulator = self.simulator(r, theta)?;
            let simulated = simulator.outputs();
            let mut y = vec![0.0; simulator.samples() * simulated];
            // the estimate was reached by simulating it
            let _ = simulator.simulate(theta, &mut y);
            let response: Vec<f64> = y.chunks_exact(simulated).flat_map(|y| y[..q].iter().copied()).collect();
            let run = &self.runs[r];
            let measured = &run.measured;
            let residuals = residuals(measured, &response);
            let deviation = |(k, v): (usize, &f64)| {
                let place = self.deviations[k % q].filter(|_| !v.is_nan())?;
                Some(1.0 / y[k / q * simulated + place].abs())
            };
            let deviations: Vec<f64> = residuals.iter().enumerate().map(|k| deviation(k).unwrap_or(f64::NAN)).collect();
            let standardised: Vec<f64> = residuals.iter().zip(&deviations).map(|(v, s)| v / s).collect();
            for (k, limit) in self.limits[r].iter().enumerate().filter(|(_, limit)| !limit.is_nan()) {
                let precision = self.deviations[k % q].map(|s| y[k / q * simulated + s].abs());
                let precision = precision.or_else(|| given(k % q).map(|s| 1.0 / s)).unwrap_or_default();
                below += Below::new((limit - response[k]) * precision).logarithm;
            }
            for (o, name) in names.iter().enumerate() {
                outputs.push(OutputFit::new(name, &run.name, measured, &response, o, q));
                let cells = || residuals.iter().zip(&deviations).skip(o).step_by(q);
                for (v, s) in cells().filter(|(v, _)| !v.is_nan()) {
                    let square = if self.deviations[o].is_some() { s * s } else { v * v };
                    squares[o] = (squares[o].0 + square, squares[o].1 + 1);
                    let known = if self.deviations[o].is_some() { Some(*s) } else { given(o) };
                    misfits[o] += known.map_or(0.0, |s| (v / s).powi(2) + 2.0 * s.ln());
                }
                if self.deviations[o].is_some() {
                    series[o].1.push(OutputSeries::of_run(&run.time, &response, &standardised, (o, q)));
                }
            }
            samples.push(NoiseOfSamples { run: run.name.clone(), deviations });
            runs.push(RunFit { run: run.name.clone(), response, residuals });
        }
        // a variance that is estimated is the mean square, at which squares over variances are the number of samples
        let twice = |(o, (sum, count)): (usize, &(f64, usize))| {
            let count = *count as f64;
            let is_known = self.deviations[o].is_some() || given(o).is_some() || count == 0.0;
            count * TAU.ln() + if is_known { misfits[o] } else { count * (1.0 + (sum / count).ln()) }
        };
        let log_likelihood = below - 0.5 * squares.iter().enumerate().map(twice).sum::<f64>();
        let variances = squares.iter().map(|(sum, count)| sum / (*count).max(1) as f64);
        let mut noise = Symmetric { size: q, values: vec![0.0; q * q] };
        variances.enumerate().for_each(|(o, v)| noise.values[o * q + o] = v);
        let shown = |c: &NoiseColour| names.contains(&c.output);
        let estimate = Estimate {
            outputs,
            runs,
            log_likelihood: found.cost.map(|_| log_likelihood).filter(|l| l.is_finite()),
            noise: found.noise.as_ref().map(|_| noise),
            colours: found.colours.iter().filter(|c| shown(c)).cloned().collect(),
            noise_free: Vec::new(),
            noise_variation: test(&series),
            ..found
        };
        Ok((estimate, samples))
    }
}
