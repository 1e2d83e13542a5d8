//! The road from a problem to its estimate.

use super::{BiasCorrection, Estimate, ParameterEstimate, Symmetric, matches};
use crate::estimation::smoothness::{Chosen, SmoothTables, choose};
use crate::iteration::evaluation::{Evaluator, Failure, RunFailure};
use crate::iteration::likelihood::{LikelihoodCost, of_parameters, space};
use crate::iteration::optimizers::approach;
use crate::iteration::priors::Priors;
use crate::problem::noise::collapsed;
use crate::problem::noise::{Likelihood, Weights};
use crate::problem::unknowns::Unknowns;
use crate::problem::{Numbers, Options, Problem, ProblemError, ProblemRun};
use crate::residuals::NoiseVariation;
use crate::uncertainty::correction::correct;
use crate::uncertainty::cramer_rao::{CramerRao, conclude};
use crate::uncertainty::curvature::{Curvature, Curved, Neighbourhood};
use crate::uncertainty::identifiability::Direction;
use crate::uncertainty::identifiability::{Lost, Pin};
use crate::uncertainty::parameters::Statistics;
use crate::uncertainty::sandwich::{Corrected, Ended, Sandwich, Uncorrected};
use crate::work::Termination;
use crate::work::Work;
use fdm_grammar::model::TableNode;
use fdm_numeric::least_squares::{Fallback, GaussNewton, Iteration, Options as StepOptions, Problem as _, Snapshot};
use fdm_numeric::quadratic::Quadratic;
use std::collections::HashSet;

/// Estimates the free parameters of a problem by maximum likelihood (output error).
///
/// One problem gives the same bits for every number of threads. The start vector is that of the parameters and runs;
/// the problem is not changed and can be solved again with other options.
///
/// # Errors
/// Everything that makes the problem impossible, at once. A start that cannot be simulated is not an error but a
/// [`Termination`], with what is known by then.
pub fn estimate(problem: &mut Problem<'_>, options: &Options, work: &Work<'_>) -> Result<Estimate, Vec<ProblemError>> {
    if let Some(state) = work.resume() {
        match estimate_from(problem, options, Some(&state), work) {
            // beginning anew gives the same result
            Err(refused) if matches!(refused[..], [ProblemError::ForeignState { .. }]) => {}
            ended => return ended,
        }
    }
    estimate_from(problem, options, None, work)
}

/// As [`estimate()`], going on from a state that an estimation of the same problem with the same options has kept; both end with the
/// same bits.
///
/// # Errors
/// As [`estimate()`]; and a state that this problem cannot go on from. That the state belongs to this model, these data and
/// options is the caller's to know.
pub fn estimate_from(
    problem: &mut Problem<'_>,
    options: &Options,
    resume: Option<&[u8]>,
    work: &Work<'_>,
) -> Result<Estimate, Vec<ProblemError>> {
    let free = solve(problem, options, resume, (&[], None), work)?;
    with_undetermined_held(problem, options, free, work)
}

/// What a parameter must gain of the logarithm of the likelihood (Akaike 1974).
const WORTH: f64 = 1.0;

/// The estimate with what the data do not determine held where it began.
///
/// A parameter may be known a little at its start and not at all where a long step takes it: a stall that no run visits moves so far
/// away that the branch before it changes, and with it what all others mean. Such a parameter is held at its start and the others are
/// fitted anew. That is the result unless what moving it had gained is worth a parameter each in the logarithm of the likelihood
/// (Akaike 1974); then it is held where it went, so that the errors of the others are those given it.
///
/// # Errors
/// As the estimation itself.
fn with_undetermined_held(
    problem: &mut Problem<'_>,
    options: &Options,
    free: Solved,
    work: &Work<'_>,
) -> Result<Estimate, Vec<ProblemError>> {
    let mut best = free;
    let mut pins: Vec<Pin> = Vec::new();
    // of a bare estimation nobody reads errors, and one that was stopped has no time
    let worthwhile = |found: &Solved| options.colour && found.estimate.termination.is_good() && work.goes_on();
    // rounds in which what is left may turn out not to be determined either
    'rounds: for _ in 0..3 {
        if !best.lost.iter().any(|l| !l.bound) {
            break;
        }
        // what ran to a bound beside them may have taken their part
        let of =
            |bounds: bool| best.lost.iter().filter(move |l| l.moved() && (bounds || !l.bound)).map(|l| l.at(l.start));
        let mut sets: Vec<Vec<Pin>> = vec![of(true).collect(), of(false).collect()];
        sets.dedup();
        for new in sets.into_iter().filter(|new| !new.is_empty()) {
            if !worthwhile(&best) {
                break 'rounds;
            }
            let with: Vec<Pin> = pins.iter().chain(&new).copied().collect();
            let held = solve(problem, options, None, (&with, None), &work.quiet())?;
            let gained = held.estimate.cost.zip(best.estimate.cost).map_or(f64::INFINITY, |(held, free)| held - free);
            if held.estimate.termination.is_good() && gained <= WORTH * new.len() as f64 {
                (best, pins) = (merged(held, &best), with);
                continue 'rounds;
            }
        }
        break;
    }
    // what only shows beside all others would take part in their errors
    let new: Vec<Pin> = best.lost.iter().filter(|l| l.shows).map(|l| l.at(l.value)).collect();
    if !new.is_empty() && worthwhile(&best) {
        let with: Vec<Pin> = pins.iter().chain(&new).copied().collect();
        let values = best.values.clone();
        let held = solve(problem, options, None, (&with, Some(&values)), &work.quiet())?;
        if held.estimate.termination.is_good() {
            best = merged(held, &best);
        }
    }
    Ok(best.estimate)
}

/// An estimation counts what was done before it.
fn merged(mut held: Solved, before: &Solved) -> Solved {
    held.estimate.evaluations.0 += before.estimate.evaluations.0;
    held.estimate.evaluations.1 += before.estimate.evaluations.1;
    held
}

/// An estimate, and what is needed to hold what it does not determine.
pub(crate) struct Solved {
    pub(crate) estimate: Estimate,
    /// The values of all unknowns.
    pub(crate) values: Vec<f64>,
    /// Unknowns that are not determined by themselves or went to a bound, nodes of smooth tables left out: these follow their neighbours.
    pub(crate) lost: Vec<Lost>,
}

/// One estimation with some unknowns held, from the start values or from others.
///
/// # Errors
/// As [`estimate_from`].
pub(crate) fn solve(
    problem: &mut Problem<'_>,
    options: &Options,
    resume: Option<&[u8]>,
    (pins, from): (&[Pin], Option<&[f64]>),
    work: &Work<'_>,
) -> Result<Solved, Vec<ProblemError>> {
    let mistakes = problem.mistakes(options);
    if !mistakes.is_empty() {
        return Err(mistakes);
    }
    let mut posed = Posed::new(problem, options, (pins, from));
    let resume = resume.map(|bytes| Snapshot::read(bytes, posed.unknowns.len())).transpose();
    let resume = resume.map_err(|reason| vec![ProblemError::ForeignState { reason }])?;
    posed.choose_smoothness(problem, options, work);
    work.begin(&|| posed.unknowns.names(problem));
    let found = posed.iterate(problem, options, resume, work);
    let (corrected, noise_variation) = match posed.corrected(problem, options, &found, work) {
        Ok((corrected, variation)) => (Ok(corrected), variation),
        Err(reason) => (Err(reason), Vec::new()),
    };
    let curved = match options.colour && !problem.bare {
        true => posed.curved(problem, &found, corrected.as_ref().ok(), work),
        false => Vec::new(),
    };
    Ok(posed.told(problem, found, corrected, (noise_variation, curved)))
}

/// What is estimated, and what is known beside the data.
struct Posed {
    unknowns: Unknowns,
    /// Where the unknowns begin as the problem says.
    began: Vec<f64>,
    likelihood: Likelihood,
    priors: Priors,
    /// How smooth tables are, where some are.
    chosen: Option<Chosen>,
}

/// Where an iteration has ended.
struct Iterated {
    end: Result<Termination, RunFailure>,
    /// None where the likelihood says nothing of the values.
    conclusion: Option<CramerRao>,
    /// Whether the cost is one.
    possible: bool,
    values: Vec<f64>,
    weights: Weights,
    responses: Vec<Vec<f64>>,
    history: Vec<Iteration>,
    fallbacks: Vec<Fallback>,
    evaluations: (usize, usize),
}

impl Iterated {
    fn is_good(&self) -> bool {
        self.end.as_ref().is_ok_and(Termination::is_good)
    }
}

impl Posed {
    fn new(problem: &Problem<'_>, options: &Options, (pins, from): (&[Pin], Option<&[f64]>)) -> Self {
        let mut unknowns = Unknowns::new(problem);
        let began = unknowns.start.clone();
        if let Some(from) = from {
            unknowns.start.copy_from_slice(from);
        }
        pins.iter().for_each(|pin| unknowns.pin(pin.unknown, pin.value));
        let measured = problem.runs.iter().map(|r| &r.measured[..]);
        let likelihood = Likelihood::new(&options.noise, problem.outputs.len(), measured, problem.worth());
        let priors = Priors::new(problem, &unknowns);
        Self { unknowns, began, likelihood, priors, chosen: None }
    }

    fn choose_smoothness(&mut self, problem: &mut Problem<'_>, options: &Options, work: &Work<'_>) {
        self.chosen = choose(problem, &self.unknowns, &self.likelihood, options, work);
        if let Some(Chosen { weights, values, .. }) = &self.chosen {
            let smooth = SmoothTables::new(&problem.tables, problem, &self.unknowns);
            self.priors = std::mem::take(&mut self.priors).with(smooth.rows(weights));
            self.unknowns.start.clone_from(values);
        }
    }

    fn cost<'c, 'e, 'a>(&'c self, problem: &'e mut Problem<'a>, unknowns: &'e Unknowns) -> LikelihoodCost<'c, 'e, 'a> {
        let evaluator = Evaluator::new(problem, unknowns, self.likelihood.is_full());
        LikelihoodCost { evaluator, unknowns, likelihood: &self.likelihood, priors: &self.priors }
    }

    fn iterate(
        &self,
        problem: &mut Problem<'_>,
        options: &Options,
        resume: Option<Snapshot>,
        work: &Work<'_>,
    ) -> Iterated {
        let logarithmic = self.unknowns.searched(problem);
        let searched = logarithmic.as_ref().unwrap_or(&self.unknowns);
        let Options { iterations, tolerance, gain, optimizer, .. } = *options;
        let step_options = StepOptions { iterations, tolerance, gain, ..StepOptions::default() };
        let mut steps = GaussNewton::new(self.cost(problem, searched), space(searched), step_options);
        let end = steps.run(
            resume,
            |steps, monitor| approach(optimizer, steps, monitor),
            &mut work.monitor(|values| searched.parameters(values)),
        );
        work.estimation_ended(steps.history.len().saturating_sub(1));
        work.doing("standard errors");
        let fallbacks = steps.fallbacks();
        if logarithmic.is_some() {
            steps = of_parameters(steps, &self.unknowns, step_options);
        }
        let conclusion = if end.is_ok() { conclude(&mut steps) } else { None };
        let possible = self.likelihood.admits(steps.weights.cost - steps.weights.beside);
        let conclusion = conclusion.filter(|_| possible);
        let end = end.map(|summary| if possible { work.termination(summary) } else { Termination::Impossible });
        let GaussNewton { problem: cost, values, weights, history, .. } = steps;
        let evaluations = cost.evaluations();
        let responses = cost.evaluator.into_responses();
        Iterated { end, conclusion, possible, values, weights, responses, history, fallbacks, evaluations }
    }

    /// Errors for the noise that there really is, and whether that is of one size.
    fn corrected(
        &self,
        problem: &mut Problem<'_>,
        options: &Options,
        found: &Iterated,
        work: &Work<'_>,
    ) -> Result<(Corrected, Vec<NoiseVariation>), Uncorrected> {
        let bound = found.conclusion.as_ref().ok_or(Uncorrected::NoDegreesOfFreedom)?;
        if !options.colour || found.end.as_ref().is_ok_and(Termination::is_stopped) {
            return Err(Uncorrected::NotAsked);
        }
        work.doing("standard errors for coloured residuals");
        let noise = bound.noise.as_ref().ok_or(Uncorrected::NoDegreesOfFreedom)?;
        let sandwich = Sandwich { unknowns: &self.unknowns, bound };
        let (Iterated { values, responses, .. }, priors) = (found, &self.priors);
        correct(problem, &Ended { sandwich, noise, values, responses, priors, good: found.is_good() }, work)
    }

    /// Intervals that the likelihood contradicts.
    fn curved(
        &self,
        problem: &mut Problem<'_>,
        found: &Iterated,
        corrected: Option<&Corrected>,
        work: &Work<'_>,
    ) -> Vec<Curved> {
        let wanted = found.is_good() && work.goes_on();
        let Some(bound) = found.conclusion.as_ref().filter(|_| wanted) else { return Vec::new() };
        let unknowns = &self.unknowns;
        let logarithmic = |j: usize| problem.params[unknowns.owner(j).1].logarithmic;
        let logarithms: Vec<bool> = (0..unknowns.len()).map(logarithmic).collect();
        let cost = self.cost(problem, unknowns);
        let mut about = Neighbourhood { cost, values: &found.values, least: found.weights.cost, bound, corrected };
        about.curved(|j| logarithms[j], work)
    }

    /// The estimate.
    fn told(
        &self,
        problem: &mut Problem<'_>,
        found: Iterated,
        corrected: Result<Corrected, Uncorrected>,
        (noise_variation, curved): (Vec<NoiseVariation>, Vec<Curved>),
    ) -> Solved {
        let Self { unknowns, likelihood, priors, .. } = self;
        let (numbers, good) = (problem.numbers(), found.is_good());
        let Iterated { end, conclusion, possible, values, weights, mut responses, .. } = found;
        let in_time = numbers == Numbers::InTime;
        let log_likelihood =
            (in_time && end.is_ok() && possible).then(|| likelihood.logarithm(weights.cost - priors.cost(&values)));
        // the values of an iteration that is not at a minimum are shown as they are
        let unbiased = corrected.as_ref().ok().and_then(|c| c.unbiased.as_ref()).filter(|_| good);
        let (values, likeliest) = match unbiased.and_then(|values| Some((values, answers(problem, unknowns, values)?)))
        {
            Some((unbiased, answered)) => {
                responses = answered;
                (unbiased.clone(), Some(values))
            }
            None => (values, None),
        };
        let statistics = Statistics::new(problem, unknowns, &values, conclusion.as_ref(), corrected.as_ref().ok());
        let (mut parameters, covered, members) = statistics.parameters(problem, unknowns, &values);
        let likeliest = likeliest.map(|values| statistics.parameters(problem, unknowns, &values).0);
        let bias_corrections = likeliest.map_or(Vec::new(), |likeliest| bias_corrections(&parameters, &likeliest));
        parameters.extend(statistics.derived(problem, unknowns, &values));
        let (covariance, correlations, corrected_covariance) = statistics.matrices(&members);
        let responses = if end.is_ok() { responses } else { Vec::new() };
        let measured = problem.runs.iter().map(|run| (run.name.as_str(), &run.measured[..]));
        let (outputs, runs) = matches(&problem.outputs, measured, responses);
        let noise_of = |w: &Weights| Symmetric { size: problem.outputs.len(), values: w.covariance.clone() };
        let noise = match &conclusion {
            Some(conclusion) => conclusion.noise.as_ref().map(noise_of),
            None => end.is_ok().then(|| noise_of(&weights)),
        };
        let smoothing = match (&self.chosen, &conclusion) {
            (Some(chosen), Some(bound)) => SmoothTables::new(&problem.tables, problem, unknowns).told(chosen, bound),
            _ => Vec::new(),
        };
        let leverages = conclusion.as_ref().map_or(Vec::new(), |c| c.leverages.clone());
        let alone = likelihood.counts.iter().filter(|n| **n > 0).count() < 2 && priors.is_empty();
        let degenerate = match numbers != Numbers::KnownNoise && possible {
            true => collapsed(&problem.outputs, likelihood, &leverages, alone),
            false => Vec::new(),
        };
        let exact = problem.outputs.iter().zip(&weights.exact).filter(|(_, exact)| **exact && end.is_ok());
        let lost = statistics.lost(problem, unknowns, (&self.began, &values));
        let estimate = Estimate {
            parameters,
            outputs,
            cost: end.is_ok().then_some(weights.cost).filter(|_| possible),
            log_likelihood,
            iterations: found.history.len().saturating_sub(1),
            fallbacks: found.fallbacks,
            evaluations: found.evaluations,
            history: found.history,
            covered,
            covariance,
            correlations,
            corrected_covariance,
            uncorrected: corrected.as_ref().err().cloned(),
            spectral_colours: corrected.as_ref().map_or(Vec::new(), |c| c.spectral.clone()),
            curvature: curved.iter().map(|c| curvature_of(problem, unknowns, c)).collect(),
            colours: corrected.map_or(Vec::new(), |c| c.colours),
            noise_variation,
            noise,
            noise_free: exact.map(|(name, _)| name.clone()).collect(),
            leverages,
            degenerate,
            bias_corrections,
            undetermined: statistics.directions,
            determined_by_prior: beside_smooth_nodes(problem, statistics.by_prior),
            smoothing,
            tables: Vec::new(),
            condition: conclusion.map(|c| c.inverse.condition),
            runs,
            termination: end.unwrap_or_else(|failure| stopped(problem, failure)),
        };
        Solved { estimate, values, lost }
    }
}

/// With the name of its parameter.
fn curvature_of(problem: &Problem<'_>, unknowns: &Unknowns, curved: &Curved) -> Curvature {
    let (run, param) = unknowns.owner(curved.unknown);
    Curvature {
        parameter: problem.params[param].quantity.name.clone(),
        run: run.map(|r| problem.runs[r].name.clone()),
        holds: curved.holds,
        interval: curved.interval,
    }
}

/// Directions that are not of nodes of smooth tables alone: which of these no run visits is told by itself.
fn beside_smooth_nodes(problem: &Problem<'_>, directions: Vec<Direction>) -> Vec<Direction> {
    let smooth = problem.tables.iter().filter(|t| t.smooth.is_some()).flat_map(|t| &t.nodes);
    let names: HashSet<&str> =
        smooth.filter_map(|n| if let TableNode::Param(name) = n { Some(name.as_str()) } else { None }).collect();
    let others = |d: &Direction| d.moves.iter().any(|(name, _)| !names.contains(name.as_str()));
    directions.into_iter().filter(others).collect()
}

/// Most Gauss-Newton steps to a maximum that is near, and the parts of each that are tried.
const NEAR: usize = 8;
const PARTS: [f64; 4] = [1.0, 0.5, 0.25, 0.125];
/// Damping where the data do not determine all unknowns, as part of their scaled information.
const DAMPING: f64 = 1e-8;

/// A maximum of the likelihood near the start values.
pub(crate) struct NearMaximum {
    pub(crate) cost: f64,
    /// All parameters of each run.
    pub(crate) theta: Vec<Vec<f64>>,
    /// The response of each run (N by q).
    pub(crate) responses: Vec<Vec<f64>>,
}

/// The scaled Gauss-Newton step of what may move; what it would take beyond a bound goes there, and the others follow. Empty where there is none.
fn bounded_step(quadratic: &Quadratic, values: &[f64], unknowns: &Unknowns) -> Vec<f64> {
    let mut step = vec![0.0; values.len()];
    if !quadratic.is_finite() {
        return Vec::new();
    }
    // at a bound what leads away from it
    let free = |j: &usize| {
        let (below, above) = (unknowns.lower[*j] < values[*j], values[*j] < unknowns.upper[*j]);
        (below || quadratic.rhs[*j] > 0.0) && (above || quadratic.rhs[*j] < 0.0)
    };
    let mut chosen: Vec<usize> = (0..values.len()).filter(|j| free(j) && quadratic.scale[*j] > 0.0).collect();
    while !chosen.is_empty() {
        if !quadratic.solve(&chosen, 0.0, &mut step) && !quadratic.solve(&chosen, DAMPING, &mut step) {
            return Vec::new();
        }
        let bounded = |j: usize, step: f64| {
            let value = values[j] + step / quadratic.scale[j];
            (value.clamp(unknowns.lower[j], unknowns.upper[j]) - values[j]) * quadratic.scale[j]
        };
        // part of a step by which rounding may shorten it
        let is_within = |j: &usize| (bounded(*j, step[*j]) - step[*j]).abs() <= 1e-9 * step[*j].abs();
        let (within, beyond): (Vec<usize>, Vec<usize>) = chosen.iter().partition(|j| is_within(j));
        if beyond.is_empty() {
            break;
        }
        for j in beyond {
            step[j] = bounded(j, step[j]);
        }
        chosen = within;
    }
    step
}

/// The maximum of the likelihood that a few Gauss-Newton steps lead to from start values near it, as far as a step promises to gain more than `least`
/// (nats): one step and one response, where the gain is what it promised. Smooth tables have the weights of the problem. None where there is no response.
pub(crate) fn near_maximum(problem: &mut Problem<'_>, options: &Options, least: f64) -> Option<NearMaximum> {
    if !problem.mistakes(options).is_empty() {
        return None;
    }
    let mut posed = Posed::new(problem, options, (&[], None));
    if !problem.smoothness.is_empty() {
        let rows = SmoothTables::new(&problem.tables, problem, &posed.unknowns).rows(&problem.smoothness);
        posed.priors = std::mem::take(&mut posed.priors).with(rows);
    }
    let unknowns = &posed.unknowns;
    let mut likelihood = posed.cost(problem, unknowns);
    let mut values = unknowns.start.clone();
    let (mut weights, mut quadratic) = (Weights::default(), Quadratic::default());
    for _ in 0..NEAR {
        weights = likelihood.linearise(&values, None).ok()?;
        likelihood.keep();
        likelihood.gather(&values, &weights, &mut quadratic);
        let step = bounded_step(&quadratic, &values, unknowns);
        let promised = if step.is_empty() { 0.0 } else { quadratic.reduction(&step) };
        if promised.is_nan() || promised <= least {
            break;
        }
        let before = likelihood.cost(&weights);
        // a step that is too long is halved
        let mut taken = None;
        for part in PARTS {
            let part = |j: usize| if step[j] == 0.0 { 0.0 } else { part * step[j] / quadratic.scale[j] };
            let moved: Vec<f64> =
                (0..values.len()).map(|j| (values[j] + part(j)).clamp(unknowns.lower[j], unknowns.upper[j])).collect();
            let Ok(after) = likelihood.evaluate(&moved) else { continue };
            let gained = before - likelihood.cost(&after);
            if gained > 0.0 {
                taken = Some((moved, after, gained));
                break;
            }
        }
        let Some((moved, after, gained)) = taken else { break };
        likelihood.keep();
        (values, weights) = (moved, after);
        if (gained - promised).abs() <= least {
            break;
        }
    }
    let cost = likelihood.cost(&weights);
    let responses = likelihood.evaluator.into_responses();
    let theta = (0..responses.len()).map(|r| unknowns.assembled(r, &values)).collect();
    cost.is_finite().then_some(NearMaximum { cost, theta, responses })
}

/// The cost at `start` (all parameters of each run), infinite where a response cannot be computed.
pub(crate) fn cost_at(problem: &mut Problem<'_>, options: &Options, start: &[Vec<f64>]) -> f64 {
    if !problem.mistakes(options).is_empty() {
        return f64::INFINITY;
    }
    let posed = Posed::new(problem, options, (&[], None));
    let unknowns = &posed.unknowns;
    let mut cost = posed.cost(problem, unknowns);
    let value = |g: usize| {
        let (run, k) = unknowns.owner(g);
        start[run.unwrap_or(0)][k]
    };
    let values: Vec<f64> = (0..unknowns.len()).map(value).collect();
    let cost = cost.evaluate(&values).map_or(f64::INFINITY, |weights| weights.cost);
    if cost.is_nan() { f64::INFINITY } else { cost }
}

/// The responses of all runs to other values; none where one cannot be simulated.
fn answers(problem: &mut Problem<'_>, unknowns: &Unknowns, values: &[f64]) -> Option<Vec<Vec<f64>>> {
    let answer = |(r, run): (usize, &mut ProblemRun<'_>)| {
        let mut y = vec![0.0; run.measured.len()];
        run.response.simulate(&unknowns.assembled(r, values), &mut y).ok().map(|()| y)
    };
    problem.runs.iter_mut().enumerate().map(answer).collect()
}

/// Parameters that are not at their maximum-likelihood values.
fn bias_corrections(reported: &[ParameterEstimate], likeliest: &[ParameterEstimate]) -> Vec<BiasCorrection> {
    let moved = |(now, then): (&ParameterEstimate, &ParameterEstimate)| {
        let standard_errors = (now.value - then.value) / now.corrected_error.filter(|error| *error > 0.0)?;
        let (name, run) = (now.name.clone(), now.run.clone());
        (standard_errors != 0.0).then_some(BiasCorrection {
            name,
            run,
            maximum_likelihood: then.value,
            standard_errors,
        })
    };
    reported.iter().zip(likeliest).filter_map(moved).collect()
}

/// Why the start values could not be compared.
fn stopped(problem: &Problem<'_>, failure: RunFailure) -> Termination {
    let run = problem.runs[failure.run].name.clone();
    let response = &problem.runs[failure.run].response;
    match failure.failure {
        Failure::Diverged(d) if response.frequency(d.sample).is_some() => Termination::Unanswered { run },
        Failure::Diverged(d) => {
            Termination::Diverged { run, time: d.time, state: d.state, sample: d.sample, event: d.event }
        }
        Failure::NotFinite { output, sample, param } => Termination::NotFinite {
            run,
            output: problem.outputs[output].clone(),
            sample,
            frequency: response.frequency(sample),
            parameter: param.map(|k| problem.params[k].quantity.name.clone()),
        },
    }
}
