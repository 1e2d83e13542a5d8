//! Many starts: a fit from each, what came out of it, and which of them is the best.
//!
//! Where many starts lie: the given one first, then a scrambled Sobol sequence (Owen scrambling after Burley 2020) over the
//! parameters' ranges.

use super::fallback::completed;
use crate::estimation::{ParameterEstimate, Status};
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::options::{Attempt, Continuation, FitOptions, after};
use crate::problem::Options;
use crate::problem::noise::Degeneracy;
use crate::recovery::fallback::attempt;
use crate::recovery::screening::screened;
use crate::work::Budget;
use crate::work::Termination;
use crate::work::checkpoint::{CheckpointWriter, EstimationStates, SavedStates};
use crate::work::{StartSummary, Work};
use fdm_grammar::model::{Origin, Param};
use fdm_numeric::halt::Halt;
use fdm_numeric::random::mixed;
use fdm_system::model::Model;
use fdm_system::record::Run;
use rayon::prelude::*;
use sobol_burley::{NUM_DIMENSIONS, sample};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Costs that differ by less are those of one minimum: a likelihood ratio that no data can tell from one.
const SAME_COST: f64 = 0.01;
/// Costs that differ by less, relative to their size, are those of one minimum: their rounding.
const SAME_RELATIVE: f64 = 1e-9;
/// Parameters that differ by less, relative to their size, are those of one minimum; without noise, costs are not.
const SAME_PLACE: f64 = 1e-6;
/// Standard errors by which parameters of one minimum differ at most. In the basin of a minimum costs that agree to [`SAME_COST`] lie within
/// `2 sqrt(2 SAME_COST)`, 0.28, of each other; within one no estimate tells two places apart.
const SAME_PLACE_IN_ERRORS: f64 = 1.0;
/// Costs that agree to this are equal but for the ends of their iterations: of such minima the first start's counts.
const EQUAL: f64 = 1e-6;

/// All starts, and the best.
pub(crate) struct Starts {
    /// In the order of their numbers; those that an interruption prevented are missing.
    pub(crate) summaries: Vec<StartSummary>,
    /// Where the best started.
    pub(crate) start: Vec<Vec<f64>>,
    /// Its number.
    pub(crate) number: usize,
    /// The states of its estimations: repeating the attempt with them is quick.
    pub(crate) states: Vec<Vec<u8>>,
    /// Where it ended by the noise that is stated; none where there was no such end.
    pub(crate) reached: Option<Vec<Vec<f64>>>,
}

struct Ended {
    summary: StartSummary,
    /// Where it started; empty when only what came out of it was kept.
    start: Vec<Vec<f64>>,
    states: Vec<Vec<u8>>,
    error: Option<FitError>,
}

/// Attempts a fit from every start, on all threads; the same bits for any number of them. The model has the parameters of its noise held;
/// `whole` is the one that was given.
///
/// # Errors
/// [`FitError`] when no start could be attempted.
pub(crate) fn many_starts(
    attempt: &Attempt<'_>,
    whole: &Model,
    ledger: &CheckpointWriter<'_>,
) -> Result<Starts, FitError> {
    let attempt = &Attempt { options: &of_each(attempt.options), ..*attempt };
    let Attempt { model, starts: given, options, work, .. } = *attempt;
    let count = options.starts.count;
    let spread = Spread::new(model, given, options.starts.seed);
    let done = AtomicUsize::new(0);
    let one = |k: usize| {
        let ended = one_start(attempt, whole, &spread, k, ledger)?;
        work.start_ended(&ended.summary, 1 + done.fetch_add(1, Ordering::Relaxed), count);
        Some(ended)
    };
    let mut ended: Vec<Ended> = (0..count).into_par_iter().with_max_len(1).filter_map(one).collect();
    compare(&mut ended);
    let Some(best) = best(&ended) else {
        // the error of a start that was not possible is not kept with what came out of it
        let impossible = ended.iter_mut().find(|e| e.summary.termination.is_none());
        let again = |number: usize| one_start(attempt, whole, &spread, number - 1, &CheckpointWriter::new(None))?.error;
        let first = impossible.and_then(|e| e.error.take().or_else(|| again(e.summary.number)));
        return match first {
            Some(error) => Err(error),
            // nothing could be simulated from any start: the given one says why
            None => Ok(Starts {
                start: given.to_vec(),
                number: 1,
                states: Vec::new(),
                reached: None,
                summaries: ended.into_iter().map(|e| e.summary).collect(),
            }),
        };
    };
    let (number, states) = (ended[best].summary.number, std::mem::take(&mut ended[best].states));
    let mut start = std::mem::take(&mut ended[best].start);
    let reached = Some(ended[best].summary.reached.clone()).filter(|reached| !reached.is_empty());
    if start.is_empty() {
        start = screened(attempt, &spread, number - 1);
    }
    let summaries = ended.into_iter().map(|e| e.summary).collect();
    Ok(Starts { summaries, start, number, states, reached })
}

/// The options of the fit from each start.
fn of_each(options: &FitOptions) -> FitOptions {
    // colour, finer steps and fallback strategies are for the best: each start is the fallback of the others
    let continuation = match &options.continuation {
        Continuation::Auto => Continuation::Never,
        asked => asked.clone(),
    };
    // a start that needs more is of use only when it is the best, which goes on with the rest
    let iterations = options.options.iterations.div_ceil(2);
    let inner = Options { colour: false, iterations, ..options.options.clone() };
    FitOptions { options: inner, shared_steps: options.shared_steps.provisional(), continuation, ..options.clone() }
}

/// The starts of one fit, each to be attempted by itself, on any machine.
pub struct StartSearch {
    model: Model,
    whole: Model,
    runs: Vec<Run>,
    given: Vec<Vec<f64>>,
    options: FitOptions,
}

impl StartSearch {
    /// Of a model with the parameters of its noise held and as it was given, and the steps that all starts have in common among the options.
    pub(crate) fn of((model, whole): (Model, Model), runs: &[Run], given: Vec<Vec<f64>>, options: &FitOptions) -> Self {
        Self { model, whole, runs: runs.to_vec(), given, options: of_each(options) }
    }

    /// How many starts there are.
    pub fn count(&self) -> usize {
        self.options.starts.count
    }

    /// The name under which [`fit()`](crate::fit()) looks for what came out of the start with this number, from 1.
    pub fn name(number: usize) -> String {
        format!("start-{number}")
    }

    /// Attempts the start with this number, from 1; what came out of it, as bytes for [`fit()`](crate::fit()). None where it was
    /// interrupted.
    pub fn once(&self, number: usize, halt: &Halt) -> Option<Vec<u8>> {
        let spread = Spread::new(&self.model, &self.given, self.options.starts.seed);
        let nothing = CheckpointWriter::new(None);
        let Self { model, runs, given: starts, options, .. } = self;
        let attempt = Attempt { model, runs, starts, options, work: &Work::until(halt) };
        let ended = one_start(&attempt, &self.whole, &spread, number - 1, &nothing)?;
        if !halt.goes_on() || ended.summary.termination.as_ref().is_some_and(Termination::is_stopped) {
            return None;
        }
        postcard::to_stdvec(&SavedStates { summary: Some(ended.summary), states: ended.states }).ok()
    }
}

fn one_start(
    given: &Attempt<'_>,
    whole: &Model,
    spread: &Spread<'_>,
    k: usize,
    ledger: &CheckpointWriter<'_>,
) -> Option<Ended> {
    let Attempt { runs, options, work, .. } = *given;
    if !work.goes_on() {
        return None;
    }
    let number = k + 1;
    let name = StartSearch::name(number);
    let kept = ledger.find(&name);
    if let Some(summary) = kept.summary {
        return Some(Ended { summary, start: Vec::new(), states: kept.states, error: None });
    }
    let start = screened(given, spread, k);
    // half a search is no start
    if k > 0 && !work.goes_on() {
        return None;
    }
    let budget = Budget::new(work, options.options.total);
    let states = EstimationStates::new(ledger, name.clone(), kept.states).remembering();
    let own = work.of_start(number).within(&budget);
    let from_here = Attempt { starts: &start, work: &own, ..*given };
    let attempted = attempt(&Attempt { work: &own.with_states(&states), ..from_here });
    let states = states.into_states();
    // the noise that is stated, or another loss, is compared, and not what leads there
    let attempted = attempted.and_then(|fit| completed(&Attempt { model: whole, ..from_here }, None, fit));
    let (summary, error) = match attempted {
        Ok(fit) => (summary(number, &fit, runs, &start), None),
        Err(error) => (impossible(number, &error), Some(error)),
    };
    if error.is_none() && !summary.termination.as_ref().is_some_and(Termination::is_stopped) {
        ledger.put(&name, Some(&summary), &states);
    }
    Some(Ended { summary, start, states, error })
}

fn summary(number: usize, fit: &Fit, runs: &[Run], start: &[Vec<f64>]) -> StartSummary {
    let estimate = &fit.estimate;
    let open =
        || estimate.parameters.iter().filter(|p| !matches!(p.status, Status::Fixed | Status::Derived | Status::Tied));
    let error = |p: &ParameterEstimate| match p.status {
        Status::AtLowerBound | Status::AtUpperBound => Some(0.0),
        _ => p.standard_error,
    };
    let message = match estimate.degenerate.is_empty() {
        true => estimate.termination.to_string(),
        false => format!("{}; no maximum of the likelihood", estimate.termination),
    };
    StartSummary {
        number,
        cost: estimate.cost.filter(|c| c.is_finite()),
        iterations: estimate.iterations,
        termination: Some(estimate.termination.clone()),
        message,
        minimum: None,
        distance: None,
        values: open().map(|p| p.value).collect(),
        errors: open().map(error).collect(),
        reached: estimate.cost.map_or(Vec::new(), |_| after(&fit.model, runs, estimate, start)),
        degenerate: estimate.degenerate.clone(),
    }
}

fn impossible(number: usize, error: &FitError) -> StartSummary {
    let message = error.to_string();
    StartSummary {
        number,
        cost: None,
        iterations: 0,
        termination: None,
        message,
        minimum: None,
        distance: None,
        values: Vec::new(),
        errors: Vec::new(),
        reached: Vec::new(),
        degenerate: Vec::new(),
    }
}

/// Finds the minima, told apart by cost and by place, and the distance of each start from the best. Places without a maximum of the likelihood have no
/// number as long as there are others.
fn compare(ended: &mut [Ended]) {
    let cost = |ended: &[Ended], k: usize| ended[k].summary.cost.unwrap_or(f64::INFINITY);
    let mut order: Vec<usize> = (0..ended.len()).filter(|k| ended[*k].summary.cost.is_some()).collect();
    order.sort_by(|a, b| cost(ended, *a).total_cmp(&cost(ended, *b)).then(a.cmp(b)));
    let proper: Vec<usize> = order.iter().copied().filter(|k| ended[*k].summary.degenerate.is_empty()).collect();
    let counted = if proper.is_empty() { &order } else { &proper };
    // of each minimum the places in `ended`, the least cost first
    let mut minima: Vec<Vec<usize>> = Vec::new();
    for k in counted {
        let here = cost(ended, *k);
        let is_level = |head: usize| here - cost(ended, head) <= level(cost(ended, head));
        let near = minima.iter().enumerate().rev().take_while(|(m, heads)| is_level(heads[0]) || m + 1 == minima.len());
        let same = near.filter(|(_, heads)| {
            let (a, b) = (&ended[heads[0]].summary, &ended[*k].summary);
            is_level(heads[0]) && in_errors(a, b) <= SAME_PLACE_IN_ERRORS
                || distance(&a.values, &b.values) <= SAME_PLACE
        });
        match same.map(|(m, _)| m).last() {
            Some(m) => minima[m].push(*k),
            None => minima.push(vec![*k]),
        }
    }
    let least = minima.first().map_or(0.0, |heads| cost(ended, heads[0]));
    let equal = minima.iter().take_while(|m| cost(ended, m[0]) - least <= EQUAL * (1.0 + least.abs())).count();
    let first = |m: &Vec<usize>| m.iter().min().copied();
    if let Some(chosen) = (0..equal).min_by_key(|m| first(&minima[*m])) {
        minima[..=chosen].rotate_right(1);
    }
    for (m, members) in minima.iter().enumerate() {
        members.iter().for_each(|k| ended[*k].summary.minimum = Some(m + 1));
    }
    let Some(best) = best(ended) else { return };
    let values = ended[best].summary.values.clone();
    for k in order {
        ended[k].summary.distance = Some(distance(&values, &ended[k].summary.values));
    }
}

/// By how much costs of one minimum may differ.
fn level(cost: f64) -> f64 {
    SAME_COST.max(SAME_RELATIVE * cost.abs())
}

/// Whether a cost is below another one by more than minima of one cost differ.
pub(crate) fn is_likelier(cost: f64, than: f64) -> bool {
    cost < than - level(than)
}

/// The largest difference of a parameter in its standard errors; one that neither determines does not count.
fn in_errors(a: &StartSummary, b: &StartSummary) -> f64 {
    let moves = a.values.iter().zip(&b.values).map(|(x, y)| (x - y).abs());
    let errors = a.errors.iter().zip(&b.errors).map(|(e, f)| [*e, *f].into_iter().flatten().reduce(f64::max));
    let part = |(moved, error): (f64, Option<f64>)| match error {
        Some(error) if moved > 0.0 => moved / error,
        _ => 0.0,
    };
    moves.zip(errors).map(part).fold(0.0, f64::max)
}

/// Why the likelihood has no maximum though a start ended at a minimum: another one ended without, and at a lower cost than this.
pub(crate) fn unbounded(starts: &[StartSummary], cost: Option<f64>) -> Vec<Degeneracy> {
    let below = |s: &&StartSummary| s.cost.zip(cost).is_some_and(|(own, kept)| is_likelier(own, kept));
    let lowest = starts.iter().filter(|s| !s.degenerate.is_empty()).filter(below);
    let lowest = lowest.min_by(|a, b| a.cost.unwrap_or_default().total_cmp(&b.cost.unwrap_or_default()));
    lowest.map_or(Vec::new(), |s| s.degenerate.clone())
}

impl Fit {
    /// Of every other minimum of the starts that is as good as the best one, by its cost, one start that reached it.
    pub fn equal_minima(&self) -> Vec<&StartSummary> {
        let least = self.starts.iter().filter(|s| s.minimum == Some(1)).filter_map(|s| s.cost).reduce(f64::min);
        let Some(least) = least else { return Vec::new() };
        let mut found: Vec<&StartSummary> = Vec::new();
        for start in &self.starts {
            let as_good = start.cost.is_some_and(|cost| cost - least <= level(least));
            let good = start.termination.as_ref().is_some_and(Termination::is_good);
            let other = start.minimum.is_some_and(|m| m > 1) && !found.iter().any(|f| f.minimum == start.minimum);
            if as_good && good && other {
                found.push(start);
            }
        }
        found
    }
}

/// The start with the least cost; among those at the same minimum one that converged.
fn best(ended: &[Ended]) -> Option<usize> {
    let good = |e: &Ended| e.summary.termination.as_ref().is_some_and(Termination::is_good);
    let lowest = ended.iter().enumerate().filter(|(_, e)| e.summary.minimum == Some(1));
    let key = |e: &Ended| (!good(e), e.summary.cost.unwrap_or(f64::INFINITY));
    let order = |a: &Ended, b: &Ended| {
        let ((bad, cost), (worse, more)) = (key(a), key(b));
        bad.cmp(&worse).then(cost.total_cmp(&more))
    };
    lowest.min_by(|(_, a), (_, b)| order(a, b)).map(|(k, _)| k)
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    let part = |(a, b): (&f64, &f64)| if a == b { 0.0 } else { (a - b).abs() / a.abs().max(b.abs()) };
    a.iter().zip(b).map(part).fold(0.0, f64::max)
}

/// A bound this many times further from zero than the start value calls for logarithms.
const WIDE: f64 = 100.0;
/// A positive parameter without an upper bound starts within this factor of its given value.
const FACTOR: f64 = 10.0;
/// Standard deviations of a prior on each side.
const DEVIATIONS: f64 = 2.0;

/// Start vectors, made one by one.
pub(crate) struct Spread<'a> {
    params: &'a [Param],
    /// All parameters of each run as they were given.
    given: &'a [Vec<f64>],
    /// What varies: parameter, run (none when shared), range.
    varied: Vec<(usize, Option<usize>, Range)>,
    seed: u64,
}

/// Where one parameter may start.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Range {
    /// Evenly from the first to the second.
    Even(f64, f64),
    /// `origin + x` where x goes evenly in its logarithm from the first to the second, which have one sign.
    Logarithmic { origin: f64, from: f64, to: f64 },
}

impl<'a> Spread<'a> {
    /// Around `given` (all parameters of each run). Shared parameters vary, and per-run ones that are bounded on both sides
    /// or have a prior; free initial values stay where the data put them otherwise, and biases where they were set.
    pub(crate) fn new(model: &'a Model, given: &'a [Vec<f64>], seed: u64) -> Self {
        let params = &model.definition().params[..];
        let mut varied = Vec::new();
        for (k, p) in params.iter().enumerate().filter(|(_, p)| !p.fixed) {
            let known = p.prior.is_some() || (p.lower.is_finite() && p.upper.is_finite());
            if p.per_run && known {
                varied.extend(given.iter().enumerate().map(|(r, theta)| (k, Some(r), Range::of(p, theta[k]))));
            } else if !p.per_run && p.origin == Origin::Declared {
                varied.push((k, None, Range::of(p, given.first().map_or(p.value, |theta| theta[k]))));
            }
        }
        Self { params, given, varied, seed }
    }

    /// The start with a number from 0, which is the given one.
    pub(crate) fn start(&self, number: usize) -> Vec<Vec<f64>> {
        if number == 0 { self.given.to_vec() } else { self.drawn(number, self.seed) }
    }

    /// Another start in place of the one with this number, the `attempt`-th from 1.
    pub(crate) fn instead(&self, number: usize, attempt: usize) -> Vec<Vec<f64>> {
        self.drawn(attempt, mixed(self.seed ^ mixed(!(number as u64))))
    }

    /// How many parameters vary, those of each run counted for every run.
    pub(crate) fn dimensions(&self) -> usize {
        self.varied.len()
    }

    /// Whether the starts of some parameter lie decades apart, so that many of them are far from everything.
    pub(crate) fn is_wide(&self) -> bool {
        self.varied.iter().any(|(k, ..)| self.params[*k].logarithmic || self.params[*k].spans_decades())
    }

    fn drawn(&self, number: usize, seed: u64) -> Vec<Vec<f64>> {
        let mut starts = self.given.to_vec();
        for (d, (k, run, range)) in self.varied.iter().enumerate() {
            let p = &self.params[*k];
            let value = range.at(share(number, d, seed)).clamp(p.lower, p.upper);
            match run {
                Some(run) => starts[*run][*k] = value,
                None => starts.iter_mut().for_each(|theta| theta[*k] = value),
            }
        }
        starts
    }
}

/// A number between 0 and 1, its ends left out.
fn share(number: usize, dimension: usize, seed: u64) -> f64 {
    // the sequence has so many dimensions and 2^16 points; further ones come from other scramblings
    let (block, dimension) = (dimension / NUM_DIMENSIONS as usize, dimension % NUM_DIMENSIONS as usize);
    let (round, number) = (number >> 16, number & 0xffff);
    let seed = mixed(seed ^ mixed((block as u64) << 32 | round as u64)) as u32;
    f64::from(sample(number as u32, dimension as u32, seed)) + f64::from(f32::EPSILON) / 4.0
}

impl Range {
    fn of(p: &Param, value: f64) -> Self {
        let (lower, upper) = (p.lower, p.upper);
        if p.logarithmic {
            return Self::positive(p, value);
        }
        if let Some(prior) = p.prior {
            let reach = DEVIATIONS * prior.deviation;
            return Self::Even((prior.mean - reach).clamp(lower, upper), (prior.mean + reach).clamp(lower, upper));
        }
        match (lower.is_finite(), upper.is_finite()) {
            (true, true) if p.spans_decades() => Self::Logarithmic { origin: 0.0, from: lower, to: upper },
            (true, true) => Self::within(lower, upper, value),
            (true, false) if value > lower => {
                Self::Logarithmic { origin: lower, from: (value - lower) / FACTOR, to: (value - lower) * FACTOR }
            }
            (false, true) if value < upper => {
                Self::Logarithmic { origin: upper, from: (value - upper) / FACTOR, to: (value - upper) * FACTOR }
            }
            // at its only bound nothing tells a size but the bound itself
            (true, false) => Self::Even(lower, lower + size(value)),
            (false, true) => Self::Even(upper - size(value), upper),
            (false, false) => Self::Even(value - 2.0 * size(value), value + 2.0 * size(value)),
        }
    }

    /// Of a parameter that is estimated by its logarithm: between its bounds where they are positive, else around its value.
    fn positive(p: &Param, value: f64) -> Self {
        let reach = p.prior.map(|prior| DEVIATIONS * prior.deviation);
        let around = |center: f64| match reach {
            Some(reach) => ((center - reach).max(center / FACTOR), center + reach),
            None => (center / FACTOR, center * FACTOR),
        };
        let known = reach.is_none() && p.lower > 0.0 && p.upper.is_finite();
        let center = p.prior.map_or(value, |prior| prior.mean.max(f64::MIN_POSITIVE));
        let (from, to) = if known { (p.lower, p.upper) } else { around(center) };
        Self::Logarithmic { origin: 0.0, from: from.max(p.lower), to: to.min(p.upper) }
    }

    /// Between two finite bounds that are not decades apart.
    fn within(lower: f64, upper: f64, value: f64) -> Self {
        // a start value close to zero, seen from the far bound, tells the size
        if lower == 0.0 && value > 0.0 && upper >= WIDE * value {
            return Self::Logarithmic { origin: 0.0, from: value * (value / upper), to: upper };
        }
        if upper == 0.0 && value < 0.0 && lower <= WIDE * value {
            return Self::Logarithmic { origin: 0.0, from: value * (value / lower), to: lower };
        }
        Self::Even(lower, upper)
    }

    fn at(self, share: f64) -> f64 {
        match self {
            // halves first: bounds may be as far apart as numbers go
            Self::Even(from, to) => from * (1.0 - share) + to * share,
            Self::Logarithmic { origin, from, to } => origin + from * (to / from).powf(share),
        }
    }
}

fn size(value: f64) -> f64 {
    if value == 0.0 { 1.0 } else { value.abs() }
}

#[cfg(test)]
mod spread_tests {
    use super::*;

    const TEXT: &str = "model a {
        state x = free;
        param even = 1 in [-2, 2], wide = 1 in [1e-3, 1e3], small = 0.01 in [0, 100], half = 5 in [1, inf],
              open = -3, zero = 0, known = 7 fixed, bias = 0 per run, own = 0 in [-1, 1] per run;
        der(x) = -even*x - wide - small - half - open - zero - known;
        output y = x + bias + own;
    }";

    fn column(spread: &Spread<'_>, name: &str, run: usize, count: usize) -> Vec<f64> {
        let k = spread.params.iter().position(|p| p.quantity.name == name).unwrap();
        (0..count).map(|n| spread.start(n)[run][k]).collect()
    }

    #[test]
    fn starts_lie_within_bounds_and_fill_them() {
        let model = Model::from_text("a.fdm", TEXT).unwrap();
        let theta = model.definition().start();
        let given = [theta.clone(), theta.clone()];
        let spread = Spread::new(&model, &given, 1);
        assert_eq!(spread.start(0), given);
        let count = 256;
        let inside = |name: &str, from: f64, to: f64| {
            let values = column(&spread, name, 0, count);
            assert!(values.iter().all(|v| (from..=to).contains(v)), "{name}: {values:?}");
            assert_eq!(values, column(&spread, name, 1, count), "{name} is shared");
            values
        };
        let even = inside("even", -2.0, 2.0);
        let quarters = (0..4).map(|q| even.iter().filter(|v| (**v + 2.0).floor() as i32 == q).count());
        assert!(quarters.clone().all(|n| (60..=68).contains(&n)), "{:?}", quarters.collect::<Vec<_>>());
        let decades = inside("wide", 1e-3, 1e3).iter().filter(|v| **v < 1.0).count();
        assert!((120..=136).contains(&decades), "as many below one as above: {decades}");
        let small = inside("small", 1e-6, 100.0);
        assert!(small.iter().filter(|v| **v < 0.01).count() > 100, "around the start value on a logarithmic scale");
        inside("half", 1.0 + 0.4, 41.0);
        inside("open", -9.0, 3.0);
        inside("zero", -2.0, 2.0);
        let own: Vec<f64> = column(&spread, "own", 0, count);
        assert!(own.iter().all(|v| v.abs() <= 1.0) && own != column(&spread, "own", 1, count), "each run its own");
        for name in ["known", "bias", "x(0)"] {
            let values = column(&spread, name, 0, count);
            assert!(values.iter().all(|v| v.to_bits() == values[0].to_bits()), "{name} stays");
        }
    }

    #[test]
    fn seeds_and_numbers_make_different_starts_and_the_same_ones_again() {
        let model = Model::from_text("a.fdm", TEXT).unwrap();
        let given = [model.definition().start()];
        let start = |seed: u64, number: usize| Spread::new(&model, &given, seed).start(number);
        assert_eq!(start(1, 5), start(1, 5));
        assert_ne!(start(1, 5), start(2, 5));
        assert_ne!(start(1, 5), start(1, 6));
        assert_ne!(start(1, 5), start(1, 5 + (1 << 16)), "beyond the length of the sequence");
    }
}
