//! Behaviour of estimations that argmin begins.

use crate::estimate::specimen::{Normal, Sample, grid, param, problem, run};
use crate::estimate::*;
use std::ops::ControlFlow;

/// y = a exp(-b x)
const DECAY: Sample = |x, theta, y, d| {
    let e = (-theta[1] * x).exp();
    y[0] = theta[0] * e;
    d.copy_from_slice(&[e, -theta[0] * x * e]);
};

fn by(method: Method) -> Options {
    Options { method, ..Options::default() }
}

fn decay(bounds: [(f64, f64); 2]) -> Problem<'static> {
    let mut noise = Normal(17);
    let data = run("r", grid(40, 3.0), 1, DECAY, &[2.0, 1.5], |_, _| 0.02 * noise.next());
    let mut problem = problem(vec![param("a", 0.7), param("b", 0.4)], vec![data]);
    for (p, (lower, upper)) in problem.params.iter_mut().zip(bounds) {
        (p.lower, p.upper) = (lower, upper);
    }
    problem
}

#[test]
fn every_method_ends_at_the_same_estimates_within_all_kinds_of_bounds() {
    const INFINITY: f64 = f64::INFINITY;
    for bounds in
        [[(-INFINITY, INFINITY), (-INFINITY, INFINITY)], [(0.0, INFINITY), (-INFINITY, 4.0)], [(0.7, 5.0), (0.0, 0.9)]]
    {
        let corrected = estimate(&mut decay(bounds), &by(Method::Correction), &mut ()).expect("a possible problem");
        for method in [Method::NelderMead, Method::Lbfgs] {
            let fit = estimate(&mut decay(bounds), &by(method), &mut ()).expect("a possible problem");
            assert!(fit.termination.is_good(), "{method:?} {}", fit.termination);
            let after = fit.history.iter().filter(|i| i.step > 0.0).count();
            assert!(after <= 5, "{method:?} comes near: {after} corrections were left");
            for (a, b) in fit.parameters.iter().zip(&corrected.parameters) {
                assert!((a.value / b.value - 1.0).abs() < 1e-8, "{method:?} {bounds:?}: {a:?} {b:?}");
                assert_eq!(a.status, b.status);
                match (a.standard_error, b.standard_error) {
                    (Some(a), Some(b)) => assert!((a / b - 1.0).abs() < 1e-6),
                    (a, b) => assert_eq!(a, b),
                }
            }
        }
    }
}

#[test]
fn the_simplex_finds_a_jump_that_no_derivative_shows() {
    // a ramp that begins anew at b: the partial by b is zero wherever it exists
    let jump: Sample = |x, theta, y, d| {
        y[0] = theta[0] * if x < theta[1] { x } else { x - theta[1] };
        d.copy_from_slice(&[y[0] / theta[0], 0.0]);
    };
    let make = || {
        let data = run("r", grid(101, 10.0), 1, jump, &[2.0, 6.0], |k, _| 0.01 * (k as f64 * 1.7).sin());
        problem(vec![param("a", 1.0), param("b", 4.0)], vec![data])
    };
    let corrected = estimate(&mut make(), &by(Method::Correction), &mut ()).expect("a possible problem");
    assert!((corrected.parameters[1].value - 6.0).abs() > 0.5, "{:?}", corrected.parameters[1].value);
    let fit = estimate(&mut make(), &by(Method::NelderMead), &mut ()).expect("a possible problem");
    let (a, b) = (&fit.parameters[0], &fit.parameters[1]);
    assert!((a.value - 2.0).abs() < 0.01 && (b.value - 6.0).abs() < 0.1, "{} {}", a.value, b.value);
    assert!(a.standard_error.is_some() && b.standard_error.is_none());
}

#[test]
fn points_that_cannot_be_simulated_are_passed_by() {
    let explosive: Sample = |x, theta, y, d| {
        y[0] = (theta[0] * x).exp() * theta[1].sqrt();
        d.copy_from_slice(&[x * y[0], 0.5 * y[0] / theta[1]]);
    };
    for method in [Method::NelderMead, Method::Lbfgs] {
        let data = run("far", grid(40, 10.0), 1, explosive, &[0.3, 0.5], |k, _| 0.01 * (k as f64).sin());
        let mut problem = problem(vec![param("a", 30.0), param("b", 0.01)], vec![data]);
        let fit = estimate(&mut problem, &by(method), &mut ()).expect("a possible problem");
        assert!(fit.is_good(), "{method:?} {}", fit.termination);
        assert!((fit.parameters[0].value - 0.3).abs() < 0.01, "{method:?}");
    }
}

/// Keeps all states, and stops at an iteration.
struct Stop {
    end: usize,
    states: Vec<Vec<u8>>,
}

impl Observer for Stop {
    fn iteration(&mut self, iteration: &Iteration) -> ControlFlow<()> {
        if iteration.number >= self.end { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn state(&mut self, bytes: &dyn Fn() -> Vec<u8>) {
        self.states.push(bytes());
    }
}

#[test]
fn a_search_is_watched_can_be_ended_and_begins_again_with_the_same_bits() {
    let free = [(0.0, 10.0), (f64::NEG_INFINITY, f64::INFINITY)];
    for method in [Method::NelderMead, Method::Lbfgs] {
        let whole = estimate(&mut decay(free), &by(method), &mut ()).expect("a possible problem");
        assert!(whole.history.windows(2).all(|w| w[1].cost <= w[0].cost + 1e-9));
        for end in [0, 1, 3, whole.iterations - 1] {
            let mut stop = Stop { end, states: Vec::new() };
            let part = estimate(&mut decay(free), &by(method), &mut stop).expect("a possible problem");
            assert_eq!((&part.termination, part.iterations), (&Termination::Interrupted, end), "{method:?}");
            assert_eq!(part.history[..], whole.history[..=end]);
            let state = stop.states.last().map(Vec::as_slice);
            let rest = estimate_from(&mut decay(free), &by(method), state, &mut ()).expect("a possible problem");
            assert_eq!(whole, rest, "{method:?} interrupted after iteration {end}");
        }
    }
}
