//! The road from a problem to its estimate.

use crate::estimation::estimate::{BiasCorrection, Estimate, ParameterEstimate, Symmetric, matches};
use crate::estimation::held::with_undetermined_held;
use crate::estimation::smoothness::{Chosen, SmoothTables, choose};
use crate::iteration::evaluation::{Evaluator, Failure, RunFailure};
use crate::iteration::likelihood::{LikelihoodCost, of_parameters, space};
use crate::iteration::optimizers::approach;
use crate::iteration::priors::Priors;
use crate::problem::degenerate::collapsed;
use crate::problem::noise::Likelihood;
use crate::problem::unknowns::Unknowns;
use crate::problem::{Numbers, Options, Problem, ProblemError, ProblemRun};
use crate::uncertainty::correction::{Ended, correct};
use crate::uncertainty::cramer_rao::conclude;
use crate::uncertainty::curvature::{Curvature, Curved, Neighbourhood};
use crate::uncertainty::identifiability::Direction;
use crate::uncertainty::lost_unknowns::{Lost, Pin};
use crate::uncertainty::parameters::Statistics;
use crate::uncertainty::sandwich::{Sandwich, Uncorrected};
use crate::work::Work;
use crate::work::termination::Termination;
use fdm_grammar::model::TableNode;
use fdm_numeric::least_squares::{GaussNewton, Options as StepOptions, Problem as _, Snapshot};
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
    let bare = problem.bare;
    let mut unknowns = Unknowns::new(problem);
    let began = unknowns.start.clone();
    if let Some(from) = from {
        unknowns.start.copy_from_slice(from);
    }
    pins.iter().for_each(|pin| unknowns.pin(pin.unknown, pin.value));
    let resume = resume.map(|bytes| Snapshot::read(bytes, unknowns.len())).transpose();
    let resume = resume.map_err(|reason| vec![ProblemError::ForeignState { reason }])?;
    let q = problem.outputs.len();
    let measured = problem.runs.iter().map(|r| &r.measured[..]);
    let likelihood = Likelihood::new(&options.noise, q, measured, problem.worth());
    let mut priors = Priors::new(problem, &unknowns);
    let chosen = choose(problem, &unknowns, &likelihood, options, work);
    if let Some(Chosen { weights, values, .. }) = &chosen {
        let smooth = SmoothTables::new(&problem.tables, problem, &unknowns);
        priors = priors.with(smooth.rows(weights));
        unknowns.start.clone_from(values);
    }
    work.begin(&|| unknowns.names(problem));
    let logarithmic = unknowns.searched(problem);
    let searched = logarithmic.as_ref().unwrap_or(&unknowns);
    let logarithms: Vec<bool> = (0..unknowns.len()).map(|j| problem.params[unknowns.owner(j).1].logarithmic).collect();
    let evaluator = Evaluator::new(problem, searched, likelihood.is_full());
    let cost = LikelihoodCost { evaluator, unknowns: searched, likelihood: &likelihood, priors: &priors };
    let Options { iterations, tolerance, gain, optimizer, .. } = *options;
    let step_options = StepOptions { iterations, tolerance, gain, ..StepOptions::default() };
    let mut steps = GaussNewton::new(cost, space(searched), step_options);
    let end = steps.run(
        resume,
        |steps, monitor| approach(optimizer, steps, monitor),
        &mut work.monitor(|values| searched.parameters(values)),
    );
    work.estimation_ended(steps.history.len().saturating_sub(1));
    work.doing("standard errors");
    let fallbacks = steps.fallbacks();
    if logarithmic.is_some() {
        steps = of_parameters(steps, &unknowns, step_options);
    }
    let conclusion = if end.is_ok() { conclude(&mut steps) } else { None };
    let possible = likelihood.admits(steps.weights.cost - steps.weights.beside);
    let conclusion = conclusion.filter(|_| possible);
    let end = end.map(|summary| if possible { work.termination(summary) } else { Termination::Impossible });
    let GaussNewton { problem: cost, values, weights, history, .. } = steps;
    let evaluations = cost.evaluations();
    let mut responses = cost.evaluator.into_responses();
    let numbers = problem.numbers();
    let in_time = numbers == Numbers::InTime;
    let log_likelihood =
        (in_time && end.is_ok() && possible).then(|| likelihood.logarithm(weights.cost - priors.cost(&values)));

    let corrected = match &conclusion {
        None => Err(Uncorrected::NoDegreesOfFreedom),
        Some(_) if !options.colour => Err(Uncorrected::NotAsked),
        Some(_) if end.as_ref().is_ok_and(Termination::is_stopped) => Err(Uncorrected::NotAsked),
        Some(bound) => {
            work.doing("standard errors for coloured residuals");
            let good = end.as_ref().is_ok_and(Termination::is_good);
            let ended = Ended { values: &values, responses: &responses, priors: &priors, good };
            correct(problem, &Sandwich { unknowns: &unknowns, bound }, &ended, work)
        }
    };
    let (corrected, noise_variation) = match corrected {
        Ok((corrected, variation)) => (Ok(corrected), variation),
        Err(reason) => (Err(reason), Vec::new()),
    };
    let judged = options.colour && !bare && end.as_ref().is_ok_and(Termination::is_good);
    let curved = match conclusion.as_ref().filter(|_| judged && work.stopped().is_none()) {
        Some(bound) => {
            let evaluator = Evaluator::new(problem, &unknowns, likelihood.is_full());
            let cost = LikelihoodCost { evaluator, unknowns: &unknowns, likelihood: &likelihood, priors: &priors };
            let corrected = corrected.as_ref().ok();
            let mut about = Neighbourhood { cost, values: &values, least: weights.cost, bound, corrected };
            about.curved(|j| logarithms[j], work)
        }
        None => Vec::new(),
    };
    // the values of an iteration that is not at a minimum are shown as they are
    let unbiased = corrected.as_ref().ok().and_then(|c| c.unbiased.as_ref());
    let unbiased = unbiased.filter(|_| end.as_ref().is_ok_and(Termination::is_good));
    let (values, likeliest) = match unbiased.and_then(|values| Some((values, answers(problem, &unknowns, values)?))) {
        Some((unbiased, answered)) => {
            responses = answered;
            (unbiased.clone(), Some(values))
        }
        None => (values, None),
    };
    let statistics = Statistics::new(problem, &unknowns, &values, conclusion.as_ref(), corrected.as_ref().ok());
    let (mut parameters, covered, members) = statistics.parameters(problem, &unknowns, &values);
    let likeliest = likeliest.map(|values| statistics.parameters(problem, &unknowns, &values).0);
    let bias_corrections = likeliest.map_or(Vec::new(), |likeliest| bias_corrections(&parameters, &likeliest));
    parameters.extend(statistics.derived(problem, &unknowns, &values));
    let (covariance, correlations, corrected_covariance) = statistics.matrices(&members);
    let cost = end.is_ok().then_some(weights.cost).filter(|_| possible);
    let responses = if end.is_ok() { responses } else { Vec::new() };
    let measured = problem.runs.iter().map(|run| (run.name.as_str(), &run.measured[..]));
    let (outputs, runs) = matches(&problem.outputs, measured, responses);
    let noise_of = |w: &crate::problem::noise::Weights| Symmetric { size: q, values: w.covariance.clone() };
    let noise = match &conclusion {
        Some(conclusion) => conclusion.noise.as_ref().map(noise_of),
        None => end.is_ok().then(|| noise_of(&weights)),
    };
    let smoothing = match (&chosen, &conclusion) {
        (Some(chosen), Some(bound)) => SmoothTables::new(&problem.tables, problem, &unknowns).told(chosen, bound),
        _ => Vec::new(),
    };
    let leverages = conclusion.as_ref().map_or(Vec::new(), |c| c.leverages.clone());
    let alone = likelihood.counts.iter().filter(|n| **n > 0).count() < 2 && priors.is_empty();
    let degenerate = match numbers != Numbers::KnownNoise && possible {
        true => collapsed(&problem.outputs, &likelihood, &leverages, alone),
        false => Vec::new(),
    };
    let exact = problem.outputs.iter().zip(&weights.exact).filter(|(_, exact)| **exact && end.is_ok());
    let curvature = curved.iter().map(|c| curvature_of(problem, &unknowns, c)).collect();
    let lost = statistics.lost(problem, &unknowns, (&began, &values));
    let estimate = Estimate {
        parameters,
        outputs,
        cost,
        log_likelihood,
        iterations: history.len().saturating_sub(1),
        fallbacks,
        evaluations,
        history,
        covered,
        covariance,
        correlations,
        corrected_covariance,
        uncorrected: corrected.as_ref().err().cloned(),
        spectral_colours: corrected.as_ref().map_or(Vec::new(), |c| c.spectral.clone()),
        curvature,
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
    Ok(Solved { estimate, values, lost })
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

/// The cost at `start` (all parameters of each run), infinite where a response cannot be computed.
pub(crate) fn cost_at(problem: &mut Problem<'_>, options: &Options, start: &[Vec<f64>]) -> f64 {
    if !problem.mistakes(options).is_empty() {
        return f64::INFINITY;
    }
    let unknowns = Unknowns::new(problem);
    let (q, worth) = (problem.outputs.len(), problem.worth());
    let likelihood = Likelihood::new(&options.noise, q, problem.runs.iter().map(|r| &r.measured[..]), worth);
    let priors = Priors::new(problem, &unknowns);
    let evaluator = Evaluator::new(problem, &unknowns, likelihood.is_full());
    let mut cost = LikelihoodCost { evaluator, unknowns: &unknowns, likelihood: &likelihood, priors: &priors };
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
