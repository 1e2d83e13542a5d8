//! Many starts: where they lie, a fit from each, what came out of it, and which of them is the best.
//!
//! The given start comes first, then a scrambled Sobol sequence (Owen scrambling after Burley 2020) over the parameters' ranges.

use crate::estimate::{Estimate, Status};
use crate::observer::{Iteration, Observer, StartSummary, Stop};
use crate::output_error::error::FitError;
use crate::output_error::options::{Continuation, FitOptions};
use crate::problem::Options;
use crate::recovery::budget::Budget;
use crate::recovery::checkpoint::{CheckpointObserver, CheckpointWriter};
use crate::recovery::fallback::attempt;
use crate::termination::Termination;
use fdm_grammar::model::{Origin, Param};
use fdm_numeric::random::mixed;
use fdm_system::model::Model;
use fdm_system::record::Run;
use rayon::prelude::*;
use sobol_burley::{NUM_DIMENSIONS, sample};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Costs that differ by less are those of one minimum: a likelihood ratio that no data can tell from one.
const SAME_COST: f64 = 0.01;
/// The same relative to the cost, for its rounding.
const SAME_RELATIVE: f64 = 1e-9;
/// Parameters that differ by less, relative to their size, are those of one minimum; without noise, costs are not.
const SAME_PLACE: f64 = 1e-6;

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
}

struct Ended {
    summary: StartSummary,
    states: Vec<Vec<u8>>,
    error: Option<FitError>,
}

/// Attempts a fit from every start, on all threads; the same bits for any number of them.
///
/// # Errors
/// [`FitError`] when no start could be attempted.
pub(crate) fn many_starts(
    model: &Model,
    runs: &[Run],
    given: &[Vec<f64>],
    options: &FitOptions,
    ledger: &CheckpointWriter<'_>,
    observer: &mut dyn Observer,
) -> Result<Starts, FitError> {
    let count = options.starts.count;
    // colour, finer steps and a rescue are for the best: the starts are each other's rescue
    let continuation = match &options.continuation {
        Continuation::Auto => Continuation::Never,
        asked => asked.clone(),
    };
    // a start that needs more is of use only when it is the best, which goes on with the rest
    let iterations = options.options.iterations.div_ceil(2);
    let inner = Options { colour: false, iterations, ..options.options.clone() };
    let options = &FitOptions {
        options: inner,
        shared_steps: options.shared_steps.provisional(),
        continuation,
        ..options.clone()
    };
    let spread = Spread::new(model, given, options.starts.seed);
    let watch =
        Watch { observer: Mutex::new(observer), stop: AtomicBool::new(false), ended: AtomicUsize::new(0), count };
    let one = |k: usize| one_start(model, runs, &spread.start(k), (k + 1, options), ledger, &watch);
    let mut ended: Vec<Ended> = (0..count).into_par_iter().with_max_len(1).filter_map(one).collect();
    compare(&mut ended);
    let Some(best) = best(&ended) else {
        let first = ended.iter_mut().find_map(|e| e.error.take());
        return match first {
            Some(error) => Err(error),
            // nothing could be simulated from any start: the given one says why
            None => Ok(Starts {
                start: given.to_vec(),
                number: 1,
                states: Vec::new(),
                summaries: ended.into_iter().map(|e| e.summary).collect(),
            }),
        };
    };
    let (number, states) = (ended[best].summary.number, std::mem::take(&mut ended[best].states));
    let summaries = ended.into_iter().map(|e| e.summary).collect();
    Ok(Starts { summaries, start: spread.start(number - 1), number, states })
}

fn one_start(
    model: &Model,
    runs: &[Run],
    start: &[Vec<f64>],
    (number, options): (usize, &FitOptions),
    ledger: &CheckpointWriter<'_>,
    watch: &Watch<'_>,
) -> Option<Ended> {
    if watch.stopped().is_some() {
        return None;
    }
    let name = format!("start-{number}");
    let kept = ledger.find(&name);
    if let Some(summary) = kept.summary {
        watch.ended(&summary);
        return Some(Ended { summary, states: kept.states, error: None });
    }
    let mut observer = OneOfMany { number, watch };
    let mut observer = Budget::new(&mut observer, options.options.total);
    let mut stages = CheckpointObserver::new(&mut observer, ledger, name.clone(), kept.states).remembering();
    let attempted = attempt(model, runs, start, options, &mut stages);
    let states = stages.into_states();
    let (summary, error) = match attempted {
        Ok(fit) => (summary(number, &fit.estimate), None),
        Err(error) => (impossible(number, &error), Some(error)),
    };
    if error.is_none() && !summary.termination.as_ref().is_some_and(Termination::is_stopped) {
        ledger.put(&name, Some(&summary), &states);
    }
    watch.ended(&summary);
    Some(Ended { summary, states, error })
}

fn summary(number: usize, estimate: &Estimate) -> StartSummary {
    let open =
        estimate.parameters.iter().filter(|p| !matches!(p.status, Status::Fixed | Status::Derived | Status::Tied));
    StartSummary {
        number,
        cost: estimate.cost.filter(|c| c.is_finite()),
        iterations: estimate.iterations,
        termination: Some(estimate.termination.clone()),
        message: estimate.termination.to_string(),
        minimum: None,
        distance: None,
        values: open.map(|p| p.value).collect(),
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
    }
}

/// Finds the minima among the costs, and the distance of each start from the best.
fn compare(ended: &mut [Ended]) {
    let mut order: Vec<usize> = (0..ended.len()).filter(|k| ended[*k].summary.cost.is_some()).collect();
    let cost = |ended: &[Ended], k: usize| ended[k].summary.cost.unwrap_or(f64::INFINITY);
    order.sort_by(|a, b| cost(ended, *a).total_cmp(&cost(ended, *b)).then(a.cmp(b)));
    let (mut minimum, mut head) = (0, None::<usize>);
    for k in &order {
        let here = cost(ended, *k);
        let same = head.is_some_and(|h| {
            let least = cost(ended, h);
            let level = SAME_COST.max(SAME_RELATIVE * least.abs());
            here - least <= level || distance(&ended[h].summary.values, &ended[*k].summary.values) <= SAME_PLACE
        });
        if !same {
            (minimum, head) = (minimum + 1, Some(*k));
        }
        ended[*k].summary.minimum = Some(minimum);
    }
    let Some(best) = best(ended) else { return };
    let values = ended[best].summary.values.clone();
    for k in order {
        ended[k].summary.distance = Some(distance(&values, &ended[k].summary.values));
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

/// One observer for all starts.
struct Watch<'o> {
    observer: Mutex<&'o mut dyn Observer>,
    stop: AtomicBool,
    ended: AtomicUsize,
    count: usize,
}

impl Watch<'_> {
    fn tell(&self, tell: impl FnOnce(&mut dyn Observer) -> ControlFlow<()>) -> ControlFlow<()> {
        let flow = tell(&mut **self.observer.lock().unwrap_or_else(PoisonError::into_inner));
        if flow.is_break() {
            self.stop.store(true, Ordering::Relaxed);
        }
        if self.stop.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn stopped(&self) -> Option<Stop> {
        let why = self.observer.lock().unwrap_or_else(PoisonError::into_inner).stopped();
        why.or(self.stop.load(Ordering::Relaxed).then_some(Stop::Interrupt))
    }

    fn ended(&self, summary: &StartSummary) {
        let ended = 1 + self.ended.fetch_add(1, Ordering::Relaxed);
        let _ = self.tell(|o| o.start_ended(summary, ended, self.count));
    }
}

struct OneOfMany<'w, 'o> {
    number: usize,
    watch: &'w Watch<'o>,
}

impl Observer for OneOfMany<'_, '_> {
    fn iteration(&mut self, iteration: &Iteration) -> ControlFlow<()> {
        self.watch.tell(|o| o.start_iteration(self.number, iteration))
    }

    fn stopped(&mut self) -> Option<Stop> {
        self.watch.stopped()
    }
}

/// A bound this many times further from zero than the start value, or than the other bound, calls for logarithms.
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
        let mut starts = self.given.to_vec();
        if number == 0 {
            return starts;
        }
        for (d, (k, run, range)) in self.varied.iter().enumerate() {
            let p = &self.params[*k];
            let value = range.at(self.share(number, d)).clamp(p.lower, p.upper);
            match run {
                Some(run) => starts[*run][*k] = value,
                None => starts.iter_mut().for_each(|theta| theta[*k] = value),
            }
        }
        starts
    }

    /// A number between 0 and 1, its ends left out.
    fn share(&self, number: usize, dimension: usize) -> f64 {
        // the sequence has so many dimensions and 2^16 points; further ones come from other scramblings
        let (block, dimension) = (dimension / NUM_DIMENSIONS as usize, dimension % NUM_DIMENSIONS as usize);
        let (round, number) = (number >> 16, number & 0xffff);
        let seed = mixed(self.seed ^ mixed((block as u64) << 32 | round as u64)) as u32;
        f64::from(sample(number as u32, dimension as u32, seed)) + f64::from(f32::EPSILON) / 4.0
    }
}

impl Range {
    fn of(p: &Param, value: f64) -> Self {
        let (lower, upper) = (p.lower, p.upper);
        if let Some(prior) = p.prior {
            let reach = DEVIATIONS * prior.deviation;
            return Self::Even((prior.mean - reach).clamp(lower, upper), (prior.mean + reach).clamp(lower, upper));
        }
        match (lower.is_finite(), upper.is_finite()) {
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

    /// Between two finite bounds.
    fn within(lower: f64, upper: f64, value: f64) -> Self {
        if lower > 0.0 && upper >= WIDE * lower || upper < 0.0 && lower <= WIDE * upper {
            return Self::Logarithmic { origin: 0.0, from: lower, to: upper };
        }
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
mod tests {
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
