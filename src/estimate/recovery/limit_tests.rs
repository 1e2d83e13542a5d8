//! Limits bind every estimation that a fit makes, and what was reached by then is whole.

use crate::methods::output_error::options::{Continuation, FitOptions, MultiStart};
use crate::methods::time_domain::fit;
use crate::problem::Options;
use crate::work::Termination;
use crate::work::{Observer, Work};
use fdm_numeric::halt::{Halt, Stop};
use fdm_numeric::least_squares::Iteration;
use fdm_system::model::Model;
use fdm_system::record::Run;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Begins so far off that every fallback strategy has its turn.
const TEXT: &str = "model m { input u; state x = 0; state v = 0; param w = 3; \
                    der(x) = v; der(v) = u - w*w*x; output y = x; }";

fn model() -> Model {
    Model::from_text("m.fdm", TEXT).unwrap()
}

/// A step onto w = 1.
fn run() -> Run {
    let time: Vec<f64> = (0..160).map(|k| 0.25 * f64::from(k)).collect();
    Run {
        name: "r".into(),
        inputs: vec![1.0; time.len()],
        held: vec![false],
        measured: time.iter().enumerate().map(|(k, t)| 1.0 - t.cos() + 1e-3 * (k * k % 7) as f64).collect(),
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0],
        time,
    }
}

/// Counts.
#[derive(Default)]
struct Counting {
    estimations: AtomicUsize,
    iterations: Arc<AtomicUsize>,
}

impl Counting {
    fn counts(&self) -> (usize, usize) {
        (self.estimations.load(Ordering::Relaxed), self.iterations.load(Ordering::Relaxed))
    }

    /// A halt for the time when so many iterations have been counted.
    fn after(&self, most: usize) -> Halt {
        let iterations = Arc::clone(&self.iterations);
        Halt::asking(move || (iterations.load(Ordering::Relaxed) >= most).then_some(Stop::TimeLimit))
    }
}

impl Observer for Counting {
    fn iteration(&self, iteration: &Iteration) {
        let first = iteration.number == 0;
        self.estimations.fetch_add(usize::from(first), Ordering::Relaxed);
        self.iterations.fetch_add(usize::from(!first), Ordering::Relaxed);
    }
}

fn limited(total: Option<usize>, options: FitOptions) -> (crate::Fit, (usize, usize)) {
    let seen = Counting::default();
    let iterations = total.unwrap_or(100);
    let inner = Options { iterations, total, ..options.options.clone() };
    let options = FitOptions { options: inner, ..options };
    let fit = fit(&model(), &[run()], &options, &Work::default().telling(&seen)).unwrap();
    (fit, seen.counts())
}

#[test]
fn without_a_limit_fallbacks_reach_what_the_start_does_not() {
    let (fit, (estimations, _)) = limited(None, FitOptions::default());
    assert!(fit.fallback.is_some() && estimations > 1, "{estimations} estimations");
    assert!((fit.estimate.parameter("w", None).unwrap().value - 1.0).abs() < 1e-2);
}

#[test]
fn noise_that_hides_most_of_the_response_calls_for_no_other_way() {
    let mut normal = fdm_numeric::random::Normal(11);
    let mut noisy = run();
    noisy.measured.iter_mut().for_each(|y| *y += 1.5 * normal.next());
    let text = TEXT.replace("w = 3", "w = 1.02");
    let near = Model::from_text("m.fdm", text).unwrap();
    let found = fit(&near, &[noisy.clone()], &FitOptions::default(), &Work::default()).unwrap();
    let r2 = found.estimate.outputs[0].r2.unwrap();
    assert!(r2 < 0.4 && found.fallback.is_none() && found.is_good(), "{r2} {:?}", found.fallback);
    // a wrong minimum leaves a swing in such noise, and is left for the right one
    let far = fit(&model(), &[noisy], &FitOptions::default(), &Work::default()).unwrap();
    assert!((far.estimate.parameter("w", None).unwrap().value - 1.0).abs() < 0.05, "{:?}", far.fallback);
}

#[test]
fn no_iterations_are_no_fallbacks_either() {
    let (fit, seen) = limited(Some(0), FitOptions::default());
    assert_eq!(seen, (1, 0));
    assert_eq!(fit.estimate.parameter("w", None).unwrap().value, 3.0);
    assert_eq!(fit.estimate.termination, Termination::IterationLimit);
    assert!(fit.fallback.is_none() && fit.estimate.runs[0].response.len() == run().len());
}

#[test]
fn strategies_that_were_asked_for_are_bound_too_and_end_with_the_whole_record() {
    let asked = [
        FitOptions { continuation: Continuation::Shares(vec![0.25, 0.5, 1.0]), ..FitOptions::default() },
        FitOptions { starts: MultiStart { count: 3, seed: 1 }, ..FitOptions::default() },
        FitOptions { confidence: true, reweight: true, ..FitOptions::default() },
    ];
    for (k, options) in asked.into_iter().enumerate() {
        for total in [0, 4] {
            let (fit, (_, iterations)) = limited(Some(total), options.clone());
            let starts = options.starts.count;
            assert!(iterations <= total * starts.max(1) + total, "{k}: {iterations} of {total}");
            assert_eq!(fit.estimate.runs[0].response.len(), run().len(), "{k}");
        }
    }
}

#[test]
fn what_was_reached_at_a_time_limit_is_that_of_the_whole_record() {
    for most in [0, 1, 3, 6, 12] {
        let seen = Counting::default();
        let work = Work::until(&seen.after(most)).telling(&seen);
        let options = FitOptions { continuation: Continuation::Shares(vec![0.2, 1.0]), ..FitOptions::default() };
        for options in [options, FitOptions::default()] {
            let fit = fit(&model(), &[run()], &options, &work).unwrap();
            assert_eq!(fit.estimate.termination, Termination::TimeLimit, "{most}");
            assert_eq!(fit.estimate.runs[0].response.len(), run().len(), "{most}");
            assert!(fit.estimate.cost.is_some() && !fit.is_good(), "{most}");
        }
    }
}

#[test]
fn an_interrupted_search_gives_the_best_start_that_it_knows() {
    let continuation = Continuation::Shares(vec![0.1, 0.2, 0.4, 1.0]);
    let (mut told, mut by) = (0, Vec::new());
    for most in (5..90).step_by(7) {
        let seen = Counting::default();
        let work = Work::until(&seen.after(most)).telling(&seen);
        let starts = MultiStart { count: 5, seed: 1 };
        let options = FitOptions { continuation: continuation.clone(), starts, ..FitOptions::default() };
        let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let fit = one_thread.install(|| fit(&model(), &[run()], &options, &work)).unwrap();
        let best = fit.starts.iter().filter_map(|s| s.cost).min_by(f64::total_cmp);
        let (Some(best), Some(cost)) = (best, fit.estimate.cost) else { continue };
        assert!(cost <= best + 1e-9 * best.abs(), "{most}: {cost} of {:?}", fit.starts);
        told += 1;
        by.push(cost);
    }
    assert!(told > 5 && by.iter().any(|c| *c != by[0]), "{by:?}");
}

/// Robertson's kinetics: the choice of its steps takes most of the time, and one step per interval cannot follow it.
#[test]
fn the_choice_of_steps_is_ended_too() {
    let text = "model kinetics { state a = 1; state b = 0; state c = 0; param k = 0.05, s = 0.02; der(a) = 1e4*b*c - k*a; \
                der(b) = k*a - 1e4*b*c - 3e7*b*b; der(c) = 3e7*b*b; output y = a; noise y = s*(1 + a); }";
    let model = Model::from_text("kinetics.fdm", text).unwrap();
    let time: Vec<f64> = (0..15).map(|k| if k == 0 { 0.0 } else { 0.01 * 3_f64.powi(k - 1) }).collect();
    // of k = 0.04, up to a hundredth off
    let measured = vec![
        1.0084, 0.992, 1.003, 0.9992, 0.9803, 0.9775, 0.9402, 0.8625, 0.7667, 0.6582, 0.5348, 0.4003, 0.2679, 0.1558,
        0.0776,
    ];
    let (name, inputs, held, input_gaps) = ("r".into(), Vec::new(), Vec::new(), Vec::new());
    let run = Run { name, inputs, held, measured, input_gaps, stated: Vec::new(), output_gaps: vec![0], time };
    let fitted = |patience: usize| {
        let asked = Arc::new(AtomicUsize::new(0));
        let count = Arc::clone(&asked);
        let over = move || (1 + count.fetch_add(1, Ordering::Relaxed) >= patience).then_some(Stop::TimeLimit);
        let work = Work::until(&Halt::asking(over));
        let found = fit(&model, std::slice::from_ref(&run), &FitOptions::default(), &work).unwrap();
        (found, asked.load(Ordering::Relaxed))
    };
    let (whole, asked) = fitted(usize::MAX);
    assert!(whole.is_good(), "{:?}", whole.estimate.termination);
    assert!(asked > 200, "{asked}");
    let k = |fit: &crate::Fit| fit.estimate.parameter("k", None).unwrap().value;
    let mut unmoved = 0;
    for patience in [2, 10, 50, asked / 4, asked / 2, asked / 4 * 3] {
        let (cut, _) = fitted(patience);
        assert_eq!(cut.estimate.termination, Termination::TimeLimit, "{patience} of {asked}");
        assert!(k(&cut).is_finite() && !cut.is_good(), "{patience}");
        unmoved += usize::from(k(&cut) == 0.05);
    }
    assert!(unmoved >= 3 && (k(&whole) - 0.04).abs() < 2e-3, "{unmoved} {}", k(&whole));
}
