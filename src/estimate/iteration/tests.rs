//! Behaviour of the iteration: where it ends, what argmin begins, and interruptions.

use crate::specimen::{Normal, Sample, grid, param, problem, run};
use crate::work::checkpoint::{CheckpointWriter, EstimationStates};
use crate::*;

/// y = a exp(-b x)
const DECAY: Sample = |x, theta, y, d| {
    let e = (-theta[1] * x).exp();
    y[0] = theta[0] * e;
    d.copy_from_slice(&[e, -theta[0] * x * e]);
};

fn by(optimizer: Optimizer) -> Options {
    Options { optimizer, ..Options::default() }
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
        let corrected =
            estimate(&mut decay(bounds), &by(Optimizer::GaussNewton), &Work::default()).expect("a possible problem");
        for method in [Optimizer::NelderMead, Optimizer::Lbfgs] {
            let fit = estimate(&mut decay(bounds), &by(method), &Work::default()).expect("a possible problem");
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
    let corrected = estimate(&mut make(), &by(Optimizer::GaussNewton), &Work::default()).expect("a possible problem");
    assert!((corrected.parameters[1].value - 6.0).abs() > 0.5, "{:?}", corrected.parameters[1].value);
    let fit = estimate(&mut make(), &by(Optimizer::NelderMead), &Work::default()).expect("a possible problem");
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
    for method in [Optimizer::NelderMead, Optimizer::Lbfgs] {
        let data = run("far", grid(40, 10.0), 1, explosive, &[0.3, 0.5], |k, _| 0.01 * (k as f64).sin());
        let mut problem = problem(vec![param("a", 30.0), param("b", 0.01)], vec![data]);
        let fit = estimate(&mut problem, &by(method), &Work::default()).expect("a possible problem");
        assert!(fit.is_good(), "{method:?} {}", fit.termination);
        assert!((fit.parameters[0].value - 0.3).abs() < 0.01, "{method:?}");
    }
}

#[test]
fn a_search_is_watched_can_be_ended_and_begins_again_with_the_same_bits() {
    let free = [(0.0, 10.0), (f64::NEG_INFINITY, f64::INFINITY)];
    for method in [Optimizer::NelderMead, Optimizer::Lbfgs] {
        let whole = estimate(&mut decay(free), &by(method), &Work::default()).expect("a possible problem");
        assert!(whole.history.windows(2).all(|w| w[1].cost <= w[0].cost + 1e-9));
        for end in [0, 1, 3, whole.iterations - 1] {
            let (part, state) = interrupted(&mut decay(free), &by(method), end);
            assert_eq!((&part.termination, part.iterations), (&Termination::Interrupted, end), "{method:?}");
            assert_eq!(part.history[..], whole.history[..=end]);
            let rest = estimate_from(&mut decay(free), &by(method), state.as_deref(), &Work::default());
            let rest = rest.expect("a possible problem");
            assert_eq!(whole, rest, "{method:?} interrupted after iteration {end}");
        }
    }
}

/// What an estimation that is interrupted after iteration `end` gives, and the state from which it goes on.
fn interrupted(problem: &mut Problem<'_>, options: &Options, end: usize) -> (Estimate, Option<Vec<u8>>) {
    let halt = Halt::default();
    let ending = |iteration: &Iteration| {
        if iteration.number >= end {
            halt.interrupt();
        }
    };
    let writer = CheckpointWriter::new(None);
    let states = EstimationStates::new(&writer, String::new(), Vec::new()).remembering();
    let work = Work::until(&halt).telling(&ending);
    let part = estimate(problem, options, &work.with_states(&states)).expect("a possible problem");
    (part, states.into_states().pop())
}

/// Interrupts after every iteration in turn; whatever goes on from there must end as if nothing had been.
fn interrupt_everywhere(make: impl Fn() -> Problem<'static>, options: &Options) -> usize {
    let whole = estimate(&mut make(), options, &Work::default()).expect("a possible problem");
    for end in 0..whole.iterations {
        let (part, state) = interrupted(&mut make(), options, end);
        assert_eq!((part.termination, part.iterations), (Termination::Interrupted, end));
        let rest = estimate_from(&mut make(), options, state.as_deref(), &Work::default()).expect("a possible problem");
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
    let (_, state) = interrupted(&mut rise([20.0, 4.0]), &Options::default(), 0);
    let state = &state.expect("a state")[..];
    let mut smaller = rise([20.0, 4.0]);
    smaller.params[1].fixed = true;
    for bytes in [&state[..state.len() / 2], &[][..], &[0xff; 40][..]] {
        let refused = estimate_from(&mut rise([20.0, 4.0]), &Options::default(), Some(bytes), &Work::default());
        assert!(matches!(refused.expect_err("damaged")[..], [ProblemError::ForeignState { .. }]));
    }
    let refused =
        estimate_from(&mut smaller, &Options::default(), Some(state), &Work::default()).expect_err("another problem");
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
        let fit = estimate(&mut make(start), &Options::default(), &Work::default()).expect("a possible problem");
        assert!(fit.is_good() && !fit.fallbacks.is_empty(), "{} {:?}", fit.termination, fit.fallbacks);
        assert!((fit.parameters[3].value - 0.013).abs() < 1e-3, "{:?}", fit.parameters[3].value);
        interrupt_everywhere(|| make(start), &Options::default());
    }
}

/// y = a exp(-b x) + c
const FALLING: Sample = |x, theta, y, d| {
    let e = (-theta[1] * x).exp();
    y[0] = theta[0] * e + theta[2];
    d.copy_from_slice(&[e, -theta[0] * x * e, 1.0]);
};

/// Far from the minimum the gradient changes for other reasons; the stated size of the noise alone does not make a place
/// near.
#[test]
fn noise_that_is_stated_too_large_costs_no_corrections() {
    for starts in [[3.0, 2.5, 0.5], [1.5, 1.0, 0.3], [4.0, 3.0, 0.1]] {
        let evaluations = [1e-3, 1.0].map(|deviation| {
            let mut noise = Normal(7);
            let data = run("r", grid(40, 3.0), 1, FALLING, &[2.0, 1.5, 0.1], |_, _| 1e-3 * noise.next());
            let params = ["a", "b", "c"].iter().zip(starts).map(|(n, v)| param(n, v)).collect();
            let options = Options { noise: Noise::Given(vec![Some(deviation)]), ..Options::default() };
            let fit =
                estimate(&mut problem(params, vec![data]), &options, &Work::default()).expect("a possible problem");
            assert!(fit.termination.is_good() && (fit.parameters[1].value - 1.5).abs() < 0.02);
            fit.evaluations.0
        });
        assert!(evaluations[1] <= evaluations[0], "{evaluations:?}");
    }
}

const STARTS: [f64; 6] = [0.0, 1e-14, 1e-4, 0.7, 8.0, 20.0];

fn fits(mut judge: impl FnMut(&Estimate, &[f64])) {
    for k in 0..6 * 6 * 6 {
        let mut noise = Normal(k as u64);
        let data = run("r", grid(40, 3.0), 1, FALLING, &[2.0, 1.5, 0.1], |_, _| 0.05 * noise.next());
        let measured = data.measured.clone();
        let starts = [STARTS[k % 6], STARTS[k / 6 % 6], STARTS[k / 36]];
        let mut params: Vec<_> = ["a", "b", "c"].iter().zip(starts).map(|(n, v)| param(n, v)).collect();
        params.iter_mut().for_each(|p| (p.lower, p.upper) = (0.0, 20.0));
        let fit = estimate(&mut problem(params, vec![data]), &Options::default(), &Work::default());
        judge(&fit.expect("a possible problem"), &measured);
    }
}

/// Minus the logarithm of the likelihood.
fn cost(theta: &[f64], measured: &[f64]) -> f64 {
    let square = |(x, z): (f64, &f64)| (z - theta[0] * (-theta[1] * x).exp() - theta[2]).powi(2);
    let sum: f64 = grid(40, 3.0).into_iter().zip(measured).map(square).sum();
    0.5 * measured.len() as f64 * sum.ln()
}

/// No parameter by itself, moved inside its bounds by a part of its size or of its influence, lowers the cost.
fn flat(fit: &Estimate, measured: &[f64]) -> bool {
    let values: Vec<f64> = fit.parameters.iter().map(|p| p.value).collect();
    let least = cost(&values, measured);
    let moves = [1e-3, 1e-4, 1e-5].into_iter().flat_map(|h| [h, -h]);
    moves.flat_map(|h| (0..3).map(move |j| (j, h))).all(|(j, h)| {
        let mut near = values.clone();
        near[j] = (near[j] + h).clamp(0.0, 20.0);
        cost(&near, measured) >= least - 1e-4
    })
}

#[test]
fn what_converged_is_a_minimum_wherever_it_started() {
    let mut good = 0;
    fits(|fit, measured| {
        if fit.termination.is_good() {
            good += 1;
            assert!(flat(fit, measured), "{:?} at {:?}", fit.termination, fit.parameters);
        }
    });
    assert!(good > 200, "{good} of 216");
}

/// The decay with logarithms for unknowns, from these values.
fn by_logarithms(start: [f64; 2]) -> Problem<'static> {
    let mut problem = decay([(1e-6, 1e4); 2]);
    for (p, value) in problem.params.iter_mut().zip(start) {
        (p.value, p.logarithmic) = (value, true);
    }
    problem
}

#[test]
fn logarithms_lead_to_the_same_estimates_from_decades_away() {
    let near =
        estimate(&mut decay([(1e-6, 1e4); 2]), &Options::default(), &Work::default()).expect("a possible problem");
    for optimizer in [Optimizer::GaussNewton, Optimizer::Lbfgs] {
        let far =
            estimate(&mut by_logarithms([1e-5, 1e-5]), &by(optimizer), &Work::default()).expect("a possible problem");
        assert!(far.termination.is_good(), "{}", far.termination);
        for (a, b) in far.parameters.iter().zip(&near.parameters) {
            assert!((a.value / b.value - 1.0).abs() < 1e-8, "{a:?} {b:?}");
            let errors = a.standard_error.expect("determined") / b.standard_error.expect("determined");
            assert!((errors - 1.0).abs() < 1e-6, "the error is that of the parameter, by the delta method: {errors}");
            assert_eq!((a.start, a.lower, a.upper, a.logarithmic), (Some(1e-5), Some(1e-6), Some(1e4), true));
            let [low, high] = a.interval().expect("known");
            assert!((low * high / a.value.powi(2) - 1.0).abs() < 1e-12 && low > 0.0, "even in the logarithm");
            assert!(
                ((high - low) / (2.0 * quantile(a.degrees_of_freedom) * a.error().expect("known")) - 1.0).abs() < 0.01,
                "as wide as the error says"
            );
        }
        let costs = (far.cost.expect("simulated"), near.cost.expect("simulated"));
        assert!((costs.0 - costs.1).abs() < 1e-9, "{costs:?}");
    }
}

#[test]
fn what_stands_at_a_bound_of_its_logarithm_stands_on_it_to_the_bit() {
    let mut problem = by_logarithms([0.1, 0.1]);
    problem.params[1].upper = 0.9;
    let fit = estimate(&mut problem, &Options::default(), &Work::default()).expect("a possible problem");
    assert!(fit.termination.is_good(), "{}", fit.termination);
    assert_eq!((fit.parameters[1].value, fit.parameters[1].status), (0.9, Status::AtUpperBound));
    assert_eq!(fit.parameters[0].status, Status::Estimated);
}

#[test]
fn slopes_by_logarithms_are_those_of_differences() {
    use crate::iteration::evaluation::Evaluator;
    use crate::iteration::likelihood::LikelihoodCost;
    use crate::iteration::priors::Priors;
    use crate::problem::noise::Likelihood;
    use crate::problem::unknowns::Unknowns;
    use fdm_numeric::least_squares::{GaussNewton, Problem as _, Space};
    let mut problem = by_logarithms([0.7, 0.4]);
    problem.params[0].prior = Some(fdm_grammar::model::Prior { mean: 1.0, deviation: 0.3 });
    problem.params[1].logarithmic = false;
    let unknowns = Unknowns::new(&problem).searched(&problem).expect("one is a logarithm");
    let likelihood =
        Likelihood::new(&Noise::Given(vec![Some(0.02)]), 1, [&problem.runs[0].measured[..]].into_iter(), 1.0);
    let priors = Priors::new(&problem, &unknowns);
    let evaluator = Evaluator::new(&mut problem, &unknowns, false);
    let cost = LikelihoodCost { evaluator, unknowns: &unknowns, likelihood: &likelihood, priors: &priors };
    let Unknowns { start, lower, upper, affine, .. } = &unknowns;
    let space = Space { start, lower, upper, affine, reach: &[] };
    let mut steps = GaussNewton::new(cost, space, fdm_numeric::least_squares::Options::default());
    let at = [0.7f64.ln(), 0.4];
    for precise in [false, true] {
        if precise {
            assert!(steps.problem.make_precise());
        }
        let weights = steps.linearise(&at, None).expect("finite");
        let gradient = steps.gradient(&at, &weights).expect("finite");
        for (j, slope) in gradient.iter().enumerate() {
            let mut cost = |h: f64| {
                let mut values = at;
                values[j] += h;
                steps.problem.evaluate(&values).expect("finite").cost
            };
            let difference = (cost(1e-5) - cost(-1e-5)) / 2e-5;
            assert!((slope / difference - 1.0).abs() < 1e-7, "{j}: {slope} {difference}");
        }
    }
}
