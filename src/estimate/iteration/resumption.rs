//! Behaviour of estimations that are interrupted and go on.

use crate::estimate::specimen::{Normal, Sample, grid, param, problem, run};
use crate::estimate::*;
use std::ops::ControlFlow;

/// Keeps the state after iteration `end` and stops there; after the last one, when there is no such.
#[derive(Default)]
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

/// Interrupts after every iteration in turn; whatever goes on from there must end as if nothing had been.
fn interrupt_everywhere(make: impl Fn() -> Problem<'static>, options: &Options) -> usize {
    let whole = estimate(&mut make(), options, &mut ()).expect("a possible problem");
    for end in 0..whole.iterations {
        let mut stop = Stop { end, states: Vec::new() };
        let part = estimate(&mut make(), options, &mut stop).expect("a possible problem");
        assert_eq!((part.termination, part.iterations, stop.states.len()), (Termination::Interrupted, end, end + 1));
        let state = stop.states.last().map(Vec::as_slice);
        let rest = estimate_from(&mut make(), options, state, &mut ()).expect("a possible problem");
        assert_eq!(whole, rest, "interrupted after iteration {end}");
    }
    whole.iterations
}

/// y = b1 (1 - exp(-b2 x)), and x times the exponential part.
const RISE: Sample = |x, theta, y, d| {
    let e = (-theta[1] * x).exp();
    y.copy_from_slice(&[theta[0] * (1.0 - e), theta[0] * x * e]);
    d.copy_from_slice(&[1.0 - e, theta[0] * x * e, x * e, -theta[0] * x * x * e]);
};

fn rise(start: [f64; 2]) -> Problem<'static> {
    let runs = [("one", 3), ("two", 4)].map(|(name, seed)| {
        let mut noise = Normal(seed);
        run(name, grid(25, 8.0), 2, RISE, &[210.0, 0.55], |_, _| 12.0 * noise.next())
    });
    let mut params = vec![param("b1", start[0]), param("b2", start[1])];
    params[0].per_run = true;
    params[1].upper = 30.0;
    problem(params, runs.into())
}

#[test]
fn an_interrupted_estimation_ends_with_the_same_bits() {
    for noise in [Noise::Diagonal, Noise::Full, Noise::Given(vec![Some(10.0), None])] {
        let options = Options { noise, ..Options::default() };
        let iterations = interrupt_everywhere(|| rise([20.0, 4.0]), &options);
        assert!(iterations > 4, "{iterations}");
    }
}

#[test]
fn an_ill_conditioned_one_too() {
    // sums of two nearly equal exponentials: triangles take the place of products on the way
    let pair: Sample = |x, theta, y, d| {
        let (a, b) = ((-theta[1] * x).exp(), (-theta[3] * x).exp());
        y[0] = theta[0] * a + theta[2] * b;
        d.copy_from_slice(&[a, -theta[0] * x * a, b, -theta[2] * x * b]);
    };
    let make = || {
        let data = run("r", grid(60, 3.0), 1, pair, &[1.0, 1.0, 1.5, 1.01], |k, _| 1e-9 * (k as f64).sin());
        problem([0.5, 0.9, 2.0, 1.2].iter().zip(["a", "b", "c", "d"]).map(|(v, n)| param(n, *v)).collect(), vec![data])
    };
    let options = Options { iterations: 12, ..Options::default() };
    assert_eq!(interrupt_everywhere(make, &options), 12);
}

#[test]
fn states_of_other_problems_are_refused() {
    let mut stop = Stop::default();
    estimate(&mut rise([20.0, 4.0]), &Options::default(), &mut stop).expect("a possible problem");
    let state = &stop.states[0];
    let mut smaller = rise([20.0, 4.0]);
    smaller.params[1].fixed = true;
    for bytes in [&state[..state.len() / 2], &[][..], &[0xff; 40][..]] {
        let refused = estimate_from(&mut rise([20.0, 4.0]), &Options::default(), Some(bytes), &mut ());
        assert!(matches!(refused.expect_err("damaged")[..], [ProblemError::ForeignState { .. }]));
    }
    let refused = estimate_from(&mut smaller, &Options::default(), Some(state), &mut ()).expect_err("another problem");
    assert!(refused[0].to_string().contains("another number of free parameters"), "{}", refused[0]);
}

#[test]
fn a_rescued_one_too() {
    // a constant and two exponentials that have died out at the start
    let pair: Sample = |x, theta, y, d| {
        let (a, b) = ((-theta[3] * x).exp(), (-theta[4] * x).exp());
        y[0] = theta[0] + theta[1] * a + theta[2] * b;
        d.copy_from_slice(&[1.0, a, b, -theta[1] * x * a, -theta[2] * x * b]);
    };
    let make = |start: [f64; 5]| {
        let truth = [0.4, 1.9, -1.5, 0.013, 0.022];
        let data = run("r", grid(33, 320.0), 1, pair, &truth, |k, _| 1e-3 * (7.0 * k as f64).sin());
        let params = start.iter().zip(["a", "b", "c", "d", "e"]).map(|(v, n)| param(n, *v)).collect();
        Problem { affine: vec![0, 1, 2], ..problem(params, vec![data]) }
    };
    for start in [[50.0, 150.0, -100.0, 1.0, 2.0], [0.5, 1.0, -1.0, 0.05, 0.1]] {
        let fit = estimate(&mut make(start), &Options::default(), &mut ()).expect("a possible problem");
        assert!(fit.is_good() && !fit.aids.is_empty(), "{} {:?}", fit.termination, fit.aids);
        assert!((fit.parameters[3].value - 0.013).abs() < 1e-3, "{:?}", fit.parameters[3].value);
        interrupt_everywhere(|| make(start), &Options::default());
    }
}
