//! Multiple shooting (Bock 1981): the record cut into segments whose initial states are free, with continuity as a
//! constraint, so that an unstable model cannot run away from the measurement.
//!
//! The constraint is held by the method of multipliers (Powell 1969): the gaps at the cuts are further outputs with a
//! known deviation that shrinks, and what they should be is shifted until they vanish. A fit of the uncut model
//! ends it where that is possible.

use crate::estimation::solve::estimate;
use crate::estimation::{Estimate, RunFit, Status, Symmetric};
use crate::methods::output_error::error::{FitError, StrategyError};
use crate::methods::output_error::fit::IntegrationFault;
use crate::methods::output_error::fit::{Continuity, Fit};
use crate::methods::output_error::options::Attempt;
use crate::methods::output_error::options::{FitOptions, Shooting};
use crate::methods::output_error::single::single_fit;
use crate::problem::noise::Noise;
use crate::problem::response::RunResponse;
use crate::problem::{Options, Problem, ProblemRun};
use crate::recovery::segmented_response::{Segment, SegmentModels, SegmentedResponse, Sizes, initial_state};
use crate::work::Termination;
use crate::work::Work;
use crate::{DerivedQuantities, initial_guess};
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{
    Accuracy, Scheme, Simulator, StepOptions, Steps, UNSOUND, WorstError, choose_steps, integration_error,
    output_range, worst_errors,
};

/// Gaps below this part of the state's size count as none.
const CONTINUOUS: f64 = 1e-9;
/// Deviation of the gaps in the first round, relative to the state's size; then what it shrinks by, and its least.
const LOOSE: f64 = 0.1;
const TIGHTEN: f64 = 0.1;
const TIGHT: f64 = 1e-7;
const MOST_ROUNDS: usize = 25;
/// Iterations of each round.
const ITERATIONS: usize = 60;
const TOLERANCE: f64 = 1e-8;
/// Iterations of the uncut model.
const POLISH: usize = 25;
/// Integration errors above this part of an output's range are worth finer steps, and how often that is looked at.
const COARSE: f64 = 1e-7;
const MOST_LOOKS: usize = 3;
/// Most sensitivities that a run may hold.
const MOST_CELLS: usize = 100_000_000;

impl Shooting {
    /// Samples at which a run is cut.
    fn cuts(self, run: &Run) -> Result<Vec<usize>, StrategyError> {
        let end = run.time.last().copied().unwrap_or(0.0) - run.time.first().copied().unwrap_or(0.0);
        let (count, length) = match self {
            Self::Segments(n) => (n.max(1) as f64, end / n.max(1) as f64),
            Self::Length(length) if length > 0.0 && length.is_finite() => ((end / length).ceil(), length),
            Self::Length(length) => return Err(StrategyError::NotASegmentLength { length }),
        };
        // more segments than samples are as many as samples
        let count = count.min(run.len() as f64) as usize;
        let begin = run.time.first().copied().unwrap_or(0.0);
        let at = |k: usize| run.time.partition_point(|t| *t < begin + k as f64 * length * (1.0 - 1e-12));
        let mut cuts: Vec<usize> = (1..count).map(at).filter(|k| *k > 0 && *k + 1 < run.len()).collect();
        cuts.dedup();
        Ok(cuts)
    }
}

/// Estimates by multiple shooting from the start values.
///
/// # Errors
/// [`FitError::Strategy`] when the model cannot be cut; else as for [`fit`](crate::fit()).
pub(crate) fn shoot(attempt: &Attempt<'_>, shooting: Shooting) -> Result<Fit, FitError> {
    let Attempt { model, runs, starts, options, work } = *attempt;
    let layout = model.layout();
    let impossible = match () {
        () if layout.states == 0 => Some(StrategyError::NoStates),
        () if !layout.delayed.is_empty() => Some(StrategyError::Delays),
        () => None,
    };
    if let Some(reason) = impossible {
        return Err(FitError::Strategy(reason));
    }
    let models = SegmentModels::new(model);
    let cuts = runs.iter().map(|run| shooting.cuts(run)).collect::<Result<Vec<_>, _>>().map_err(FitError::Strategy)?;
    let pieces: Vec<Vec<Run>> = runs.iter().zip(&cuts).map(|(run, cuts)| pieces(run, cuts, layout.states)).collect();
    let mut shot = Shot::new(model, &models, &cuts, &pieces, starts, options)?;
    let mut estimate = shot.rounds(options, work)?;
    for _ in 1..MOST_LOOKS {
        let over = options.per_interval.is_some() || work.stop_after(&estimate.termination).is_some();
        if over || estimate.runs.is_empty() || !shot.refine()? {
            break;
        }
        estimate = shot.rounds(options, work)?;
    }
    let continuity = shot.continuity();
    let reached = shot.reached();
    let uncut = WithoutCuts { outputs: layout.outputs, params: model.definition() };
    let gaps = shot.cost_of_gaps();
    let cut = uncut.of(estimate, gaps);
    if work.stop_after(&cut.termination).is_some() || cut.cost.is_none() {
        return shot.fitted(model, runs, cut, continuity);
    }
    // from where it is to begin it needs few iterations, or it cannot be done
    let iterations = POLISH.min(options.options.iterations);
    let few = FitOptions { options: Options { iterations, ..options.options.clone() }, ..options.clone() };
    let polished = single_fit(&Attempt { starts: &reached, options: &few, ..*attempt })?;
    if as_good(&polished.estimate, &cut) {
        let continuity = Continuity { largest_gap: 0.0, polished: true, ..continuity };
        return Ok(Fit { shooting: Some(continuity), ..polished });
    }
    if options.options.colour {
        let estimate = shot.with_errors(options, work)?;
        let gaps = shot.cost_of_gaps();
        let cut = uncut.of(estimate, gaps);
        return shot.fitted(model, runs, cut, continuity);
    }
    shot.fitted(model, runs, cut, continuity)
}

/// Part of a unit of the logarithm of the likelihood; below it, estimates differ by a part of their standard errors.
const NEGLIGIBLE: f64 = 0.1;

/// Whether the fit of the uncut model has kept what shooting had found.
fn as_good(polished: &Estimate, cut: &Estimate) -> bool {
    if !polished.termination.is_good() {
        return false;
    }
    let (Some(a), Some(b)) = (polished.cost, cut.cost) else { return false };
    let exact = polished.outputs.iter().all(|o| o.r2.is_none_or(|r2| r2 > 1.0 - 1e-9));
    exact || a <= b + NEGLIGIBLE
}

/// The segments of a run as runs; each ends with the first sample of the next. States are no measurements: their columns
/// are empty.
fn pieces(run: &Run, cuts: &[usize], states: usize) -> Vec<Run> {
    let begins = std::iter::once(0).chain(cuts.iter().copied());
    let ends = cuts.iter().map(|c| c + 1).chain(std::iter::once(run.len()));
    let piece = |(begin, end): (usize, usize)| {
        let part = run.part(begin..end);
        let q = part.measured.len() / part.len().max(1);
        let empty = || std::iter::repeat_n(f64::NAN, states);
        let measured = part.measured.chunks(q.max(1)).flat_map(|row| row.iter().copied().chain(empty())).collect();
        let output_gaps = part.output_gaps.iter().copied().chain(std::iter::repeat_n(part.len(), states)).collect();
        Run { measured, output_gaps, ..part }
    };
    begins.zip(ends).map(piece).collect()
}

/// A problem in segments and where its iteration has got to.
struct Shot<'a> {
    problem: Problem<'a>,
    models: &'a SegmentModels,
    cuts: &'a [Vec<usize>],
    pieces: &'a [Vec<Run>],
    sizes: Sizes,
    /// Size of each state at the cuts.
    scale: Vec<f64>,
    /// Steps between samples in each run.
    steps: Vec<Steps>,
    /// Deviation of the gaps, relative to the state's size.
    deviation: f64,
    /// Gaps of each run at the last estimates, cuts by states.
    gaps: Vec<Vec<f64>>,
}

impl<'a> Shot<'a> {
    fn new(
        model: &Model,
        models: &'a SegmentModels,
        cuts: &'a [Vec<usize>],
        pieces: &'a [Vec<Run>],
        starts: &[Vec<f64>],
        options: &FitOptions,
    ) -> Result<Self, FitError> {
        let definition = model.definition();
        let (params, states) = (definition.params.len(), definition.states.len());
        let sizes = Sizes { params, states, outputs: definition.outputs.len() };
        let most = cuts.iter().map(Vec::len).max().unwrap_or(0);
        let mut all = definition.params.clone();
        for cut in 0..most {
            let states = definition.states.iter().enumerate();
            all.extend(states.map(|(j, state)| initial_state(&state.quantity, j, cut)));
        }
        if let Some(first) = starts.first() {
            all.iter_mut().zip(first).filter(|(p, _)| !p.per_run).for_each(|(p, v)| p.value = *v);
        }
        let (mut prepared, mut steps) = (Vec::new(), Vec::new());
        for ((pieces, cuts), start) in pieces.iter().zip(cuts).zip(starts) {
            let mut theta = start.clone();
            let guessed = guess(models, pieces, start, sizes);
            theta.extend(guessed);
            let chosen = match options.per_interval {
                Some(per_interval) => Steps::from(per_interval),
                None => chosen_steps(models, pieces, &theta, sizes)?,
            };
            let run = segmented(models, (pieces, cuts), sizes, &chosen)?;
            theta.resize(all.len(), 0.0);
            let cells = run.measured.len().saturating_mul(all.len());
            if cells > MOST_CELLS {
                return Err(FitError::Strategy(StrategyError::TooManySegments { cells, most: MOST_CELLS }));
            }
            prepared.push(ProblemRun { start: theta, ..run });
            steps.push(chosen);
        }
        let scale = scale(&prepared, cuts, sizes);
        let mut problem =
            Problem::new(definition, prepared, DerivedQuantities::of(definition, models.first.dynamics()));
        problem.params = all;
        problem.outputs.extend(definition.states.iter().map(|s| format!("gap of {}", s.quantity.name)));
        let gaps = cuts.iter().map(|c| vec![0.0; c.len() * states]).collect();
        Ok(Self { problem, models, cuts, pieces, sizes, scale, steps, deviation: LOOSE, gaps })
    }

    /// Fits with gaps that are held ever tighter, until there are none.
    fn rounds(&mut self, options: &FitOptions, work: &Work<'_>) -> Result<Estimate, FitError> {
        let mut round = 1;
        loop {
            let options = self.options(options, false);
            let estimate = estimate(&mut self.problem, &options, work).map_err(FitError::Problem)?;
            if estimate.runs.is_empty() {
                self.gaps.iter_mut().flatten().for_each(|g| *g = f64::INFINITY);
                return Ok(estimate);
            }
            self.take(&estimate);
            let stopped = work.stop_after(&estimate.termination).is_some() || round == MOST_ROUNDS;
            if stopped || self.largest_gap() <= CONTINUOUS {
                return Ok(estimate);
            }
            self.shift();
            round += 1;
        }
    }

    /// The last round once more, with the errors that were asked for.
    fn with_errors(&mut self, options: &FitOptions, work: &Work<'_>) -> Result<Estimate, FitError> {
        let options = self.options(options, options.options.colour);
        let estimate = estimate(&mut self.problem, &options, work).map_err(FitError::Problem)?;
        self.take(&estimate);
        Ok(estimate)
    }

    /// Takes finer steps where the ones in use are too coarse at the estimates; false when they are fine, or none is better.
    fn refine(&mut self) -> Result<bool, FitError> {
        let mut refined = false;
        for (k, accuracy) in self.accuracy()?.into_iter().enumerate() {
            if accuracy.error <= COARSE {
                continue;
            }
            let run = &self.problem.runs[k];
            let chosen = chosen_steps(self.models, &self.pieces[k], &run.start, self.sizes)?;
            let used = &self.steps[k];
            if chosen.most() > used.most() || chosen.are_cut() && !used.are_cut() {
                let (start, measured) = (run.start.clone(), run.measured.clone());
                let finer = segmented(self.models, (&self.pieces[k], &self.cuts[k]), self.sizes, &chosen)?;
                self.problem.runs[k] = ProblemRun { start, measured, ..finer };
                self.steps[k] = chosen;
                refined = true;
            }
        }
        Ok(refined)
    }

    fn options(&self, options: &FitOptions, colour: bool) -> Options {
        let given = &options.options;
        let mut noise = match &given.noise {
            Noise::Given(given) => given.clone(),
            Noise::Diagonal | Noise::Full => vec![None; self.sizes.outputs],
        };
        noise.extend(self.scale.iter().map(|s| Some(self.deviation * s)));
        Options {
            noise: Noise::Given(noise),
            iterations: ITERATIONS.min(given.iterations),
            tolerance: TOLERANCE.max(given.tolerance),
            colour,
            ..given.clone()
        }
    }

    /// Takes over the estimates as start values, and the gaps there.
    fn take(&mut self, estimate: &Estimate) {
        let width = self.sizes.outputs + self.sizes.states;
        let Problem { params, runs, .. } = &mut self.problem;
        for (run, own) in runs.iter_mut().enumerate() {
            for (param, start) in params.iter_mut().zip(&mut own.start) {
                let owner = param.per_run.then_some(own.name.as_str());
                if let Some(found) = estimate.parameter(&param.quantity.name, owner) {
                    *start = found.value;
                    if !param.per_run {
                        param.value = found.value;
                    }
                }
            }
            let response = &estimate.runs[run].response;
            let at = self.cuts[run].iter().flat_map(|c| &response[c * width + self.sizes.outputs..(c + 1) * width]);
            self.gaps[run].iter_mut().zip(at).for_each(|(gap, y)| *gap = *y);
        }
    }

    /// Shifts what the gaps should be by what they are, and holds them tighter: the multipliers stay the same.
    fn shift(&mut self) {
        let tighter = (self.deviation * TIGHTEN).max(TIGHT);
        let factor = (tighter / self.deviation).powi(2);
        let Sizes { states, outputs, .. } = self.sizes;
        for ((run, cuts), gaps) in self.problem.runs.iter_mut().zip(self.cuts).zip(&self.gaps) {
            for (cut, gaps) in cuts.iter().zip(gaps.chunks(states)) {
                let wanted = &mut run.measured[cut * (outputs + states) + outputs..][..states];
                wanted.iter_mut().zip(gaps).for_each(|(m, gap)| *m = (*m - gap) * factor);
            }
        }
        self.deviation = tighter;
    }

    fn largest_gap(&self) -> f64 {
        let relative =
            |gaps: &Vec<f64>| gaps.iter().zip(self.scale.iter().cycle()).map(|(g, s)| g.abs() / s).fold(0.0, f64::max);
        self.gaps.iter().map(relative).fold(0.0, f64::max)
    }

    fn continuity(&self) -> Continuity {
        let segments = self.pieces.iter().map(Vec::len).max().unwrap_or(0);
        Continuity { segments, largest_gap: self.largest_gap(), polished: false }
    }

    /// What the gaps add to the cost.
    fn cost_of_gaps(&self) -> f64 {
        let Sizes { states, outputs, .. } = self.sizes;
        let mut cost = 0.0;
        for ((run, cuts), gaps) in self.problem.runs.iter().zip(self.cuts).zip(&self.gaps) {
            for (cut, gaps) in cuts.iter().zip(gaps.chunks(states)) {
                let wanted = &run.measured[cut * (outputs + states) + outputs..][..states];
                for ((m, gap), scale) in wanted.iter().zip(gaps).zip(&self.scale) {
                    let deviation = self.deviation * scale;
                    cost += 0.5 * ((gap - m) / deviation).powi(2) + deviation.ln();
                }
            }
        }
        cost
    }

    /// The model's own parameters of each run.
    fn reached(&self) -> Vec<Vec<f64>> {
        let own = |run: &ProblemRun<'_>| {
            let params = self.problem.params[..self.sizes.params].iter().zip(&run.start);
            params.map(|(p, start)| if p.per_run { *start } else { p.value }).collect()
        };
        self.problem.runs.iter().map(own).collect()
    }

    /// What was reached in segments, with the integration errors within them.
    fn fitted(&self, model: &Model, runs: &[Run], cut: Estimate, continuity: Continuity) -> Result<Fit, FitError> {
        let mut fit = Fit { shooting: Some(continuity), ..Fit::new(model.clone(), cut, self.accuracy()?) };
        for (r, run) in runs.iter().enumerate() {
            let worst = self.worst(r, fit.estimate.runs.get(r).map_or(&[][..], |fitted| &fitted.response))?;
            let faults = IntegrationFault::of(&fit, run, &worst);
            fit.integration_faults.extend(faults);
        }
        Ok(fit)
    }

    /// Steps and integration error within the segments.
    fn accuracy(&self) -> Result<Vec<Accuracy>, FitError> {
        let mut found = Vec::new();
        for (r, steps) in self.steps.iter().enumerate() {
            let mut error = 0.0_f64;
            for (k, piece) in self.pieces[r].iter().enumerate() {
                let one = integration_error(self.models.of(k).dynamics(), piece, &self.theta(r, k), steps.clone());
                error = error.max(one.map_err(|e| FitError::unsuited(piece, e))?);
            }
            found.push(Accuracy { steps: steps.clone(), error });
        }
        Ok(found)
    }

    /// Where the segments of a run are integrated worst, output by output: beside the range of its whole response (N by q).
    fn worst(&self, run: usize, response: &[f64]) -> Result<Vec<WorstError>, FitError> {
        let (q, steps) = (self.sizes.outputs, &self.steps[run]);
        let mut found: Vec<WorstError> = Vec::new();
        for (k, piece) in self.pieces[run].iter().enumerate() {
            let begin = if k == 0 { 0 } else { self.cuts[run][k - 1] };
            let worst = worst_errors(self.models.of(k).dynamics(), piece, &self.theta(run, k), steps, UNSOUND);
            for own in worst.map_err(|e| FitError::unsuited(piece, e))?.into_iter().filter(|own| own.output < q) {
                let part = own.error / output_range(response.iter().skip(own.output).step_by(q));
                if part > UNSOUND {
                    found.push(WorstError { sample: begin + own.sample, part, ..own });
                }
            }
        }
        found.sort_by(|a, b| a.output.cmp(&b.output).then(b.part.total_cmp(&a.part)));
        found.dedup_by_key(|worst| worst.output);
        Ok(found)
    }

    /// The parameters of a segment at the values of its run.
    fn theta(&self, run: usize, segment: usize) -> Vec<f64> {
        let mut theta = self.problem.runs[run].start.clone();
        let shared = theta.iter_mut().zip(&self.problem.params[..self.sizes.params]).filter(|(_, p)| !p.per_run);
        shared.for_each(|(value, p)| *value = p.value);
        local(&theta, segment, self.sizes)
    }
}

/// The parameters of a segment out of those of the run.
fn local(theta: &[f64], segment: usize, sizes: Sizes) -> Vec<f64> {
    let Sizes { params, states, .. } = sizes;
    let mut own = theta[..params].to_vec();
    if segment > 0 {
        own.extend(&theta[params + (segment - 1) * states..][..states]);
    }
    own
}

/// Equal steps for all segments of a run, cut at kinks where that is worth it in any.
fn chosen_steps(models: &SegmentModels, pieces: &[Run], theta: &[f64], sizes: Sizes) -> Result<Steps, FitError> {
    let explicit = StepOptions { scheme: Some(Scheme::RungeKutta), ..StepOptions::default() };
    let (mut most, mut cut) = (1, false);
    for (k, piece) in pieces.iter().enumerate() {
        let chosen = choose_steps(models.of(k).dynamics(), piece, &local(theta, k, sizes), &explicit);
        let steps = chosen.map_err(|e| FitError::unsuited(piece, e))?.steps;
        (most, cut) = (most.max(steps.most()), cut || steps.are_cut());
    }
    let steps = Steps::from(most);
    Ok(if cut { steps.cut_at_kinks() } else { steps })
}

/// A run as a response in segments; what the gaps should be is zero.
fn segmented<'a>(
    models: &'a SegmentModels,
    (pieces, cuts): (&'a [Run], &[usize]),
    sizes: Sizes,
    steps: &Steps,
) -> Result<ProblemRun<'a>, FitError> {
    let width = sizes.outputs + sizes.states;
    let (mut segments, mut measured) = (Vec::new(), Vec::new());
    for (k, piece) in pieces.iter().enumerate() {
        let simulator = Simulator::new(models.of(k).dynamics(), piece, steps.clone());
        let simulator = simulator.map_err(|e| FitError::unsuited(piece, e))?;
        segments.push(Segment { simulator, begin: measured.len() / width });
        let last = k + 1 == pieces.len();
        measured.extend(&piece.measured[..piece.measured.len() - if last { 0 } else { width }]);
    }
    for cut in cuts {
        measured[cut * width + sizes.outputs..][..sizes.states].fill(0.0);
    }
    let (name, samples) = (pieces.first().map_or_else(String::new, |p| p.name.clone()), measured.len() / width);
    let response = RunResponse::in_time(SegmentedResponse::new(segments, sizes, samples));
    Ok(ProblemRun { name, response, measured, start: Vec::new() })
}

/// First values of the states behind each cut: from the data where an output shows the state, else from the end of the
/// segment before.
fn guess(models: &SegmentModels, pieces: &[Run], start: &[f64], sizes: Sizes) -> Vec<f64> {
    let Sizes { params, states, outputs } = sizes;
    let mut all = Vec::new();
    let mut end = end_of(&models.first, &pieces[0], start, outputs, states);
    for (k, piece) in pieces.iter().enumerate().skip(1) {
        let mut free = models.later.definition().params.clone();
        free.iter_mut().zip(start).for_each(|(p, v)| p.value = *v);
        let mut theta = initial_guess(&free, models.later.dynamics(), piece);
        theta[..params].copy_from_slice(start);
        for (state, before) in theta[params..].iter_mut().zip(&end).filter(|(s, _)| !s.is_finite()) {
            *state = if before.is_finite() { *before } else { 0.0 };
        }
        all.extend_from_slice(&theta[params..]);
        if k + 1 < pieces.len() {
            end = end_of(&models.later, piece, &theta, outputs, states);
        }
    }
    all
}

/// The states at the end of a segment; NaN when it cannot be simulated.
fn end_of(model: &Model, piece: &Run, theta: &[f64], outputs: usize, states: usize) -> Vec<f64> {
    let nothing = || vec![f64::NAN; states];
    let Ok(mut simulator) = Simulator::new(model.dynamics(), piece, 1) else { return nothing() };
    let mut y = vec![0.0; piece.measured.len()];
    if simulator.simulate(theta, &mut y).is_err() {
        return nothing();
    }
    y[y.len() - (outputs + states)..][outputs..].to_vec()
}

/// Root mean square of each state behind the cuts; 1 where it is 0.
fn scale(runs: &[ProblemRun<'_>], cuts: &[Vec<usize>], sizes: Sizes) -> Vec<f64> {
    let Sizes { params, states, .. } = sizes;
    let (mut squares, mut count) = (vec![0.0; states], 0);
    for (run, cuts) in runs.iter().zip(cuts) {
        for at in run.start[params..].chunks(states).take(cuts.len()) {
            squares.iter_mut().zip(at).for_each(|(sum, x)| *sum += x * x);
            count += 1;
        }
    }
    let size = |sum: f64| (sum / f64::from(count.max(1))).sqrt();
    squares.into_iter().map(|s| if size(s) > 0.0 && size(s).is_finite() { size(s) } else { 1.0 }).collect()
}

/// The model without cuts.
pub(crate) struct WithoutCuts<'a> {
    pub(crate) outputs: usize,
    pub(crate) params: &'a fdm_grammar::Model,
}

impl WithoutCuts<'_> {
    /// Leaves out the states behind the cuts and the gaps, which have added `gaps` to the cost. Standard errors stay: those of
    /// parameters under the constraint that there are no gaps.
    pub(crate) fn of(&self, estimate: Estimate, gaps: f64) -> Estimate {
        // beside gaps this large the rest is rounding: a cost of -4.6e18 was one
        // rounding of a cost that is summed over many cells, as a part of it
        let lost = estimate.cost.is_some() && gaps.abs() * (64.0 * f64::EPSILON) > NEGLIGIBLE;
        let cost = estimate.cost.map(|c| c - gaps).filter(|_| !lost);
        let own = |name: &str| self.params.param(name).is_some();
        let kept: Vec<usize> = (0..estimate.parameters.len())
            .filter(|k| {
                matches!(estimate.parameters[*k].status, Status::Derived | Status::Tied)
                    || own(&estimate.parameters[*k].name)
            })
            .collect();
        let rows: Vec<usize> = (0..estimate.covered.len()).filter(|i| kept.contains(&estimate.covered[*i])).collect();
        let covered = rows.iter().filter_map(|i| kept.iter().position(|k| *k == estimate.covered[*i])).collect();
        let shown = |name: &str| self.params.outputs.iter().any(|o| o.quantity.name == name);
        Estimate {
            parameters: kept.iter().map(|k| estimate.parameters[*k].clone()).collect(),
            covered,
            covariance: part(&estimate.covariance, &rows),
            corrected_covariance: match estimate.corrected_covariance.size {
                0 => estimate.corrected_covariance,
                _ => part(&estimate.corrected_covariance, &rows),
            },
            correlations: part(&estimate.correlations, &rows),
            outputs: estimate.outputs.into_iter().filter(|o| shown(&o.name)).collect(),
            cost,
            log_likelihood: None,
            termination: if lost { Termination::Impossible } else { estimate.termination },
            noise: estimate.noise.map(|n| part(&n, &(0..self.outputs).collect::<Vec<_>>())),
            noise_variation: estimate.noise_variation.into_iter().filter(|v| shown(&v.output)).collect(),
            noise_free: estimate.noise_free.into_iter().filter(|n| shown(n)).collect(),
            leverages: Vec::new(),
            degenerate: Vec::new(),
            undetermined: estimate
                .undetermined
                .into_iter()
                .filter(|d| d.moves.iter().all(|(name, _)| !name.contains(" behind cut ")))
                .collect(),
            runs: estimate.runs.iter().map(|r| self.run(r)).collect(),
            ..estimate
        }
    }

    fn run(&self, run: &RunFit) -> RunFit {
        let width = self.outputs + self.params.states.len();
        let columns = |v: &[f64]| v.chunks(width).flat_map(|row| row[..self.outputs].iter().copied()).collect();
        RunFit { run: run.run.clone(), response: columns(&run.response), residuals: columns(&run.residuals) }
    }
}

fn part(matrix: &Symmetric, rows: &[usize]) -> Symmetric {
    let entries = rows.iter().flat_map(|i| rows.iter().map(move |j| (*i, *j)));
    Symmetric { size: rows.len(), values: entries.map(|(i, j)| matrix.at(i, j)).collect() }
}
