//! Behaviour of whole estimations.

use super::*;
use crate::specimen::{Closed, Normal, Sample, grid, param, problem, run};
use std::sync::Mutex;

fn solve(problem: &mut Problem<'_>, options: &Options) -> Estimate {
    estimate(problem, options, &Work::default()).expect("a possible problem")
}

fn full(noise: Noise) -> Options {
    Options { noise, ..Options::default() }
}

const LINE: Sample = |x, theta, y, d| {
    y[0] = theta[0] + theta[1] * x;
    d.copy_from_slice(&[1.0, x]);
};

/// y = a exp(-b x)
const DECAY: Sample = |x, theta, y, d| {
    let e = (-theta[1] * x).exp();
    y[0] = theta[0] * e;
    d.copy_from_slice(&[e, -theta[0] * x * e]);
};

#[test]
fn a_straight_line_gives_the_textbook_numbers() {
    let x = grid(20, 5.0);
    let mut noise = Normal(7);
    let data = run("r", x.clone(), 1, LINE, &[2.0, -0.5], |_, _| 0.1 * noise.next());
    let z = data.measured.clone();
    let mut problem = problem(vec![param("a", 0.0), param("b", 0.0)], vec![data]);
    let fit = solve(&mut problem, &Options::default());
    assert!(fit.is_good(), "{:?}", fit.termination);

    let n = 20.0;
    let (sx, sz): (f64, f64) = (x.iter().sum(), z.iter().sum());
    let sxx: f64 = x.iter().map(|x| x * x).sum();
    let sxz: f64 = x.iter().zip(&z).map(|(x, z)| x * z).sum();
    let det = n * sxx - sx * sx;
    let (a, b) = ((sxx * sz - sx * sxz) / det, (n * sxz - sx * sz) / det);
    let s2 = x.iter().zip(&z).map(|(x, z)| (z - a - b * x).powi(2)).sum::<f64>() / (n - 2.0);
    let close = |got: f64, want: f64| assert!((got / want - 1.0).abs() < 1e-11, "{got} {want}");
    close(fit.parameters[0].value, a);
    close(fit.parameters[1].value, b);
    close(fit.parameters[0].standard_error.expect("determined"), (s2 * sxx / det).sqrt());
    close(fit.parameters[1].standard_error.expect("determined"), (s2 * n / det).sqrt());
    close(fit.correlations.at(0, 1), -sx / (sxx * n).sqrt());
    close(fit.noise.expect("estimated").at(0, 0), s2);
    // that of the likeliest variance, which is not corrected for degrees of freedom
    let likeliest = s2 * (n - 2.0) / n;
    close(fit.log_likelihood.expect("in time"), -0.5 * n * ((std::f64::consts::TAU * likeliest).ln() + 1.0));
    assert!(fit.iterations <= 2, "linear: one step and a look");
}

#[test]
fn a_decay_without_noise_is_found_to_rounding() {
    let data = run("r", grid(50, 3.0), 1, DECAY, &[2.0, 1.5], |_, _| 0.0);
    let mut problem = problem(vec![param("a", 2.6), param("b", 1.95)], vec![data]);
    let fit = solve(&mut problem, &Options::default());
    assert!(fit.is_good(), "{:?}", fit.termination);
    assert!((fit.parameters[0].value - 2.0).abs() < 1e-12 && (fit.parameters[1].value - 1.5).abs() < 1e-12);
    assert_eq!(fit.noise_free, ["y0"]);
    assert!(fit.evaluations.0 <= 9, "{:?}", fit.evaluations);
}

#[test]
fn a_coarse_simulation_without_noise_converges_too() {
    /// A decay that is computed to 10 digits only, as a long simulation may be.
    const COARSE: Sample = |x, theta, y, d| {
        DECAY(x, theta, y, d);
        y[0] = (y[0] * 1e10).round() / 1e10;
    };
    let data = run("r", grid(50, 3.0), 1, DECAY, &[2.0, 1.5], |_, _| 0.0);
    let response = RunResponse::in_time(Closed { x: grid(50, 3.0), q: 1, sample: COARSE });
    let data = ProblemRun { response, ..data };
    let mut problem = problem(vec![param("a", 2.6), param("b", 1.95)], vec![data]);
    let fit = solve(&mut problem, &Options::default());
    assert!(fit.is_good(), "{:?} {:?}", fit.termination, fit.history);
    assert!((fit.parameters[0].value - 2.0).abs() < 1e-9 && (fit.parameters[1].value - 1.5).abs() < 1e-9);
}

#[test]
fn a_parameter_that_is_zero_without_noise_converges_too() {
    let data = run("r", grid(30, 3.0), 1, LINE, &[0.0, 2.0], |_, _| 0.0);
    let mut problem = problem(vec![param("a", 1.0), param("b", 1.0)], vec![data]);
    let fit = solve(&mut problem, &Options::default());
    assert!(fit.is_good() && fit.parameters[0].value.abs() < 1e-13, "{:?}", fit.parameters);
}

#[test]
fn scatter_over_repeats_agrees_with_the_printed_errors() {
    let repeats = 300;
    let (mut sum, mut square, mut printed) = ([0.0; 2], [0.0; 2], [0.0; 2]);
    for seed in 0..repeats {
        let mut noise = Normal(1000 + 7919 * seed);
        let data = run("r", grid(40, 3.0), 1, DECAY, &[2.0, 1.5], |_, _| 0.05 * noise.next());
        let mut problem = problem(vec![param("a", 1.0), param("b", 1.0)], vec![data]);
        let fit = solve(&mut problem, &Options::default());
        assert!(fit.is_good());
        for k in 0..2 {
            let p = &fit.parameters[k];
            sum[k] += p.value;
            square[k] += p.value * p.value;
            printed[k] += p.standard_error.expect("determined").powi(2);
        }
    }
    let n = repeats as f64;
    for k in 0..2 {
        let scatter = ((square[k] - sum[k] * sum[k] / n) / (n - 1.0)).sqrt();
        let ratio = scatter / (printed[k] / n).sqrt();
        assert!((ratio - 1.0).abs() < 0.1, "parameter {k}: scatter / standard error = {ratio}");
    }
}

#[test]
fn a_bound_holds_and_the_others_adapt_to_it() {
    let mut noise = Normal(3);
    let data = run("r", grid(40, 3.0), 1, DECAY, &[2.0, 1.5], |_, _| 0.01 * noise.next());
    let mut bounded = problem(vec![param("a", 1.0), param("b", 0.5)], vec![data]);
    bounded.params[1].upper = 1.2;
    let fit = solve(&mut bounded, &Options::default());
    assert!(fit.is_good(), "{:?}", fit.termination);
    assert_eq!((fit.parameters[1].value, fit.parameters[1].status), (1.2, Status::AtUpperBound));
    assert_eq!((fit.parameters[1].standard_error, fit.covered.as_slice()), (None, &[0][..]));

    bounded.params[1].fixed = true;
    bounded.params[1].value = 1.2;
    let fixed = solve(&mut bounded, &Options::default());
    assert!((fit.parameters[0].value / fixed.parameters[0].value - 1.0).abs() < 1e-9);
    assert_eq!((fixed.parameters[1].status, fixed.parameters[1].value), (Status::Fixed, 1.2));
    let everything = |p: &mut Problem<'_>| p.params.iter_mut().for_each(|p| p.fixed = true);
    everything(&mut bounded);
    let none = solve(&mut bounded, &Options::default());
    assert_eq!(none.termination, Termination::Converged(Reason::NothingToEstimate));
    assert!(none.outputs[0].rms.is_some());
}

#[test]
fn a_bound_that_is_only_passed_by_is_left_again() {
    // from this start the first full step of b overshoots far beyond the bound
    let data = run("r", grid(40, 3.0), 1, DECAY, &[2.0, 0.1], |_, _| 0.0);
    let mut problem = problem(vec![param("a", 2.0), param("b", 2.0)], vec![data]);
    problem.params[1].lower = 0.0;
    let fit = solve(&mut problem, &Options::default());
    assert!(fit.is_good() && (fit.parameters[1].value - 0.1).abs() < 1e-10, "{:?}", fit.parameters);
    assert_eq!(fit.parameters[1].status, Status::Estimated);
}

#[test]
fn what_is_not_determined_is_named() {
    // y = (a + 2.5 b) x + c + 0 d
    let collinear: Sample = |x, theta, y, d| {
        y[0] = (theta[0] + 2.5 * theta[1]) * x + theta[2];
        d.copy_from_slice(&[x, 2.5 * x, 1.0, 0.0]);
    };
    let mut noise = Normal(11);
    let data = run("r", grid(30, 1.0), 1, collinear, &[1.0, 2.0, 3.0, 4.0], |_, _| 0.01 * noise.next());
    let params = ["a", "b", "c", "d"].map(|n| param(n, 1.0)).to_vec();
    let mut problem = problem(params, vec![data]);
    problem.derived = DerivedQuantities {
        names: ["s", "m"].map(|n| DerivedName { name: n.into(), unit: None, per_run: false, tied: false }).to_vec(),
        evaluate: Box::new(|theta, out| {
            out.copy_from_slice(&[theta[0] + 2.5 * theta[1], theta[0] * theta[1]]);
        }),
    };
    let fit = solve(&mut problem, &Options::default());
    assert!(fit.termination.is_good() && !fit.is_good(), "{:?}", fit.termination);
    let status: Vec<Status> = fit.parameters.iter().map(|p| p.status).collect();
    let lost = Status::NotDetermined;
    assert_eq!(status, [lost, lost, Status::Estimated, lost, Status::Derived, Status::Derived]);
    let sentences: Vec<&str> = fit.undetermined.iter().map(|d| d.sentence.as_str()).collect();
    assert_eq!(sentences[0], "`d` has no influence on what was compared");
    let either = [
        "only `b` + 0.4 `a` is determined, not `b` and `a` apart",
        "only `a` + 2.5 `b` is determined, not `a` and `b` apart",
    ];
    assert!(either.contains(&sentences[1]), "{sentences:?}");
    assert_eq!(sentences.len(), 2);
    // the determined combination has its standard error, the other has none
    let (s, m) = (&fit.parameters[4], &fit.parameters[5]);
    let slope = fit.noise.as_ref().expect("estimated").at(0, 0).sqrt() / (30.0f64 * (1.0 / 12.0)).sqrt();
    assert!((s.standard_error.expect("determined") / slope - 1.0).abs() < 0.05, "{:?} {slope}", s.standard_error);
    assert_eq!(m.standard_error, None);
}

#[test]
fn what_is_determined_of_three_parameters_in_one_place_is_said() {
    // y = (a + 2 b + 4 c) x: two directions that share a parameter
    let sum: Sample = |x, theta, y, d| {
        y[0] = (theta[0] + 2.0 * theta[1] + 4.0 * theta[2]) * x;
        d.copy_from_slice(&[x, 2.0 * x, 4.0 * x]);
    };
    let mut noise = Normal(21);
    let data = run("r", grid(30, 1.0), 1, sum, &[1.0, 2.0, 3.0], |_, _| 0.01 * noise.next());
    let fit = solve(&mut problem(["a", "b", "c"].map(|n| param(n, 1.0)).to_vec(), vec![data]), &Options::default());
    assert_eq!(fit.undetermined.len(), 2);
    let factors = [("a", 1.0), ("b", 2.0), ("c", 4.0)];
    let of = |name: &str| factors.iter().find(|(n, _)| name == *n).expect("a parameter").1;
    for direction in &fit.undetermined {
        let sum: f64 = direction.moves.iter().map(|(name, m)| of(name) * m).sum();
        assert!(sum.abs() < 1e-6, "{direction:?}");
        // the one determined combination names all three, in one of its three forms
        let forms = ["`a` + 2 `b` + 4 `c`", "`b` + 0.5 `a` + 2 `c`", "`c` + 0.25 `a` + 0.5 `b`"];
        let swapped = ["`a` + 4 `c` + 2 `b`", "`b` + 2 `c` + 0.5 `a`", "`c` + 0.5 `b` + 0.25 `a`"];
        let said = &direction.sentence;
        assert!(forms.iter().chain(&swapped).any(|f| said.contains(&format!("only {f} is"))), "{said}");
    }
}

#[test]
fn a_common_offset_beside_offsets_per_run_is_named_with_its_runs() {
    let offsets: Sample = |x, theta, y, d| {
        y[0] = theta[0] + theta[1] + theta[2] * x;
        d.copy_from_slice(&[1.0, 1.0, x]);
    };
    let make = |name: &str, c: f64, seed: u64| {
        let mut noise = Normal(seed);
        run(name, grid(25, 2.0), 1, offsets, &[1.0, c, 3.0], |_, _| 0.1 * noise.next())
    };
    let mut params = ["a", "c", "k"].map(|n| param(n, 0.0)).to_vec();
    params[1].per_run = true;
    let fit = solve(&mut problem(params, vec![make("one", 0.5, 1), make("two", -0.5, 2)]), &Options::default());
    assert!(fit.termination.is_good() && !fit.is_good());
    assert_eq!(fit.undetermined.len(), 1);
    let sentence = &fit.undetermined[0].sentence;
    assert!(sentence.contains("`c of run one`") && sentence.contains("1 : -1 : -1"), "{sentence}");
    // the offsets of the runs are determined, each as the sum of both
    assert!(sentence.contains("only `c of run one` + `a` and `c of run two` + `a` are"), "{sentence}");
    let k = fit.parameter("k", None).expect("shared");
    assert_eq!(k.status, Status::Estimated);
    // the slope's standard error does not suffer
    let want = (fit.noise.as_ref().expect("estimated").at(0, 0) / (2.0 * 25.0 * (4.0 / 12.0) * (26.0 / 24.0))).sqrt();
    assert!((k.standard_error.expect("determined") / want - 1.0).abs() < 1e-6);
}

#[test]
fn fewer_cells_than_parameters_give_a_fit_but_no_errors() {
    let data = run("r", vec![1.0], 1, LINE, &[2.0, 3.0], |_, _| 0.0);
    let fit = solve(&mut problem(vec![param("a", 0.0), param("b", 0.0)], vec![data]), &Options::default());
    assert!(fit.termination.is_good(), "{:?}", fit.termination);
    assert!(fit.outputs[0].rms.expect("compared") < 1e-12 && fit.noise.is_none());
    assert!(fit.parameters.iter().all(|p| p.standard_error.is_none() && p.status == Status::NotDetermined));
}

#[test]
fn derived_quantities_carry_the_delta_method() {
    let mut noise = Normal(5);
    let data = run("r", grid(40, 3.0), 1, DECAY, &[2.0, 1.5], |_, _| 0.01 * noise.next());
    let mut problem = problem(vec![param("a", 1.0), param("b", 1.0)], vec![data]);
    problem.derived = DerivedQuantities {
        names: vec![DerivedName { name: "half".into(), unit: Some("s".into()), per_run: false, tied: false }],
        evaluate: Box::new(|theta, out| out[0] = 2f64.ln() / theta[1]),
    };
    let fit = solve(&mut problem, &Options::default());
    let (b, half) = (&fit.parameters[1], &fit.parameters[2]);
    let want = 2f64.ln() / (b.value * b.value) * b.standard_error.expect("determined");
    assert!((half.standard_error.expect("determined") / want - 1.0).abs() < 1e-8);
    assert_eq!((half.status, half.unit.as_deref()), (Status::Derived, Some("s")));
}

#[test]
fn empty_cells_are_as_good_as_absent_ones() {
    let mut noise = Normal(9);
    let mut gappy = run("r", grid(40, 3.0), 1, DECAY, &[2.0, 1.5], |_, _| 0.02 * noise.next());
    let x = grid(40, 3.0);
    let keep = |k: &usize| k % 7 != 3;
    let short_x: Vec<f64> = (0..40).filter(keep).map(|k| x[k]).collect();
    let short_z: Vec<f64> = (0..40).filter(keep).map(|k| gappy.measured[k]).collect();
    (0..40).filter(|k| !keep(k)).for_each(|k| gappy.measured[k] = f64::NAN);
    let response = RunResponse::in_time(Closed { x: short_x, q: 1, sample: DECAY });
    let short = ProblemRun { name: "r".into(), response, measured: short_z, start: Vec::new() };
    let params = || vec![param("a", 1.0), param("b", 1.0)];
    let gappy = solve(&mut problem(params(), vec![gappy]), &Options::default());
    let short = solve(&mut problem(params(), vec![short]), &Options::default());
    // the interval is a mean over other pairs
    let close = |a: Option<f64>, b: Option<f64>| a.zip(b).is_some_and(|(a, b)| (a / b - 1.0).abs() < 1e-9);
    for (a, b) in gappy.parameters.iter().zip(&short.parameters) {
        assert_eq!((a.value, a.standard_error, a.status), (b.value, b.standard_error, b.status));
        assert!(close(a.corrected_error, b.corrected_error), "{a:?} {b:?}");
    }
    assert_eq!(gappy.outputs[0].compared, 34);
    assert!(gappy.runs[0].residuals[3].is_nan() && gappy.runs[0].response[3].is_finite());
}

#[test]
fn runs_with_parameters_of_their_own_equal_separate_fits() {
    let make = |name: &str, a: f64, seed: u64| {
        let mut noise = Normal(seed);
        run(name, grid(40, 3.0), 1, DECAY, &[a, 1.5], |_, _| 0.02 * noise.next())
    };
    let params = || vec![param("a", 1.0), param("b", 1.0)];
    // everything per run, noise known: the joint problem falls apart into two
    let options = full(Noise::Given(vec![Some(0.02)]));
    let mut own = params();
    own.iter_mut().for_each(|p| p.per_run = true);
    let joint = solve(&mut problem(own, vec![make("one", 2.0, 1), make("two", 3.0, 2)]), &options);
    assert!(joint.is_good());
    for (name, a, seed) in [("one", 2.0, 1), ("two", 3.0, 2)] {
        let alone = solve(&mut problem(params(), vec![make(name, a, seed)]), &options);
        for p in ["a", "b"] {
            let (j, s) = (joint.parameter(p, Some(name)).expect("own"), alone.parameter(p, None).expect("shared"));
            assert!((j.value / s.value - 1.0).abs() < 1e-9);
            let error = |p: &ParameterEstimate| p.standard_error.expect("determined");
            assert!((error(j) / error(s) - 1.0).abs() < 1e-6);
        }
    }
    // a shared parameter is known better than from either run, and start values of a run are taken
    let mut mixed = params();
    mixed[0].per_run = true;
    let mut runs = vec![make("one", 2.0, 1), make("two", 3.0, 2)];
    runs[1].start = vec![2.5, f64::NAN];
    let both = solve(&mut problem(mixed, runs), &options);
    let shared = both.parameter("b", None).expect("shared").standard_error.expect("determined");
    let single = joint.parameter("b", Some("two")).expect("own").standard_error.expect("determined");
    assert!(both.is_good() && shared < single);
    assert_eq!(both.parameter("a", Some("two")).expect("own").start, Some(2.5));
    assert_eq!(both.parameters.len(), 3);
}

#[test]
fn full_noise_knows_more_when_outputs_share_their_noise() {
    // only the first output depends on the parameter; the second tells what the common noise was
    let pair: Sample = |x, theta, y, d| {
        y.copy_from_slice(&[theta[0] * x, 1.0]);
        d.copy_from_slice(&[x, 0.0]);
    };
    let fit = |noise: Noise, seed: u64| {
        let (mut source, mut common) = (Normal(seed), 0.0);
        let data = run("r", grid(60, 1.0), 2, pair, &[2.0], |_, o| {
            common = if o == 0 { 0.1 * source.next() } else { common };
            common + 0.02 * source.next()
        });
        solve(&mut problem(vec![param("a", 1.0)], vec![data]), &full(noise))
    };
    let (mut errors, mut deviations) = ([0.0; 2], [0.0; 2]);
    for seed in 1..=40 {
        for (k, noise) in [Noise::Diagonal, Noise::Full].into_iter().enumerate() {
            let fit = fit(noise, seed * 104_729);
            assert!(fit.is_good(), "{:?}", fit.termination);
            errors[k] += fit.parameters[0].standard_error.expect("determined") / 40.0;
            deviations[k] += (fit.parameters[0].value - 2.0).powi(2) / 40.0;
        }
    }
    assert!(errors[1] < 0.4 * errors[0], "{errors:?}");
    for k in 0..2 {
        let ratio = deviations[k].sqrt() / errors[k];
        assert!((0.7..1.4).contains(&ratio), "printed errors must stand: {ratio}");
    }
    let r = fit(Noise::Full, 1).noise.expect("estimated");
    assert!(r.at(0, 1) / (r.at(0, 0) * r.at(1, 1)).sqrt() > 0.9);
}

#[test]
fn divergence_at_the_start_is_a_termination_and_later_only_damps() {
    let explosive: Sample = |x, theta, y, d| {
        let e = (theta[0] * x).exp();
        y[0] = e;
        d[0] = x * e;
    };
    let data = || run("far", grid(40, 10.0), 1, explosive, &[0.3], |_, _| 0.0);
    let fit = solve(&mut problem(vec![param("a", 100.0)], vec![data()]), &Options::default());
    assert!(matches!(&fit.termination, Termination::Diverged { run, state: Some(0), .. } if run == "far"));
    assert!(!fit.is_good() && fit.runs.is_empty() && fit.cost.is_none());
    assert_eq!((fit.parameters[0].value, fit.parameters[0].status), (100.0, Status::NotEstimated));
    // from below, the first full step goes to where the exponential overflows
    let fit = solve(&mut problem(vec![param("a", -1.0)], vec![data()]), &Options::default());
    assert!(fit.is_good() && (fit.parameters[0].value - 0.3).abs() < 1e-9, "{:?} {:?}", fit.termination, fit.history);
    assert!(fit.history.iter().any(|i| i.refused > 0));
}

#[test]
fn a_partial_that_is_not_finite_is_told() {
    let root: Sample = |x, theta, y, d| {
        y[0] = theta[0].sqrt() + x;
        d[0] = 0.5 / theta[0].sqrt();
    };
    let data = run("r", grid(10, 1.0), 1, root, &[2.0], |_, _| 0.0);
    let fit = solve(&mut problem(vec![param("a", 0.0)], vec![data]), &Options::default());
    assert_eq!(
        fit.termination.to_string(),
        "run `r`, sample 1: the partial of output `y0` by `a` is not a finite number at the start values"
    );
}

#[test]
fn threads_do_not_change_a_bit() {
    let fit = |threads: usize| {
        let runs = (0..5).map(|k| {
            let mut noise = Normal(k);
            run(&format!("r{k}"), grid(30 + k as usize, 3.0), 1, DECAY, &[2.0, 1.5], |_, _| 0.02 * noise.next())
        });
        let mut params = vec![param("a", 1.0), param("b", 1.0)];
        params[0].per_run = true;
        let mut problem = problem(params, runs.collect());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| solve(&mut problem, &Options::default()))
    };
    let (one, two) = (fit(1), fit(2));
    assert!(one.is_good());
    assert_eq!(one, two);
}

#[test]
fn the_observer_sees_every_iteration_and_can_stop() {
    let data = run("r", grid(50, 3.0), 1, DECAY, &[2.0, 1.5], |_, _| 0.0);
    let mut problem = problem(vec![param("a", 2.6), param("b", 1.95)], vec![data]);
    let (seen, halt) = (Mutex::new(Vec::new()), Halt::default());
    let stop = |i: &Iteration| {
        seen.lock().expect("no poison").push(*i);
        if i.number == 2 {
            halt.interrupt();
        }
    };
    let work = Work::until(&halt).telling(&stop);
    let fit = estimate(&mut problem, &Options::default(), &work).expect("a possible problem");
    let seen = seen.into_inner().expect("no poison");
    assert_eq!((fit.termination, fit.iterations), (Termination::Interrupted, 2));
    assert_eq!(seen, fit.history);
    assert!(seen[1].change < 0.0 && seen[1].step > 0.0);
    let short = solve(&mut problem, &Options { iterations: 1, ..Options::default() });
    assert_eq!((short.termination, short.iterations), (Termination::IterationLimit, 1));
}

#[test]
fn wrong_partials_are_no_convergence() {
    let wrong: Sample = |x, theta, y, d| {
        y[0] = theta[0] * x;
        d[0] = -x;
    };
    let data = run("r", grid(20, 1.0), 1, wrong, &[2.0], |k, _| 0.01 * (k % 3) as f64);
    let fit = solve(&mut problem(vec![param("a", 1.0)], vec![data]), &Options::default());
    assert_eq!(fit.termination, Termination::NoProgress);
    assert!(!fit.is_good());
}

#[test]
fn a_smaller_gain_reaches_the_same_estimates() {
    let data = run("r", grid(50, 3.0), 1, DECAY, &[2.0, 1.5], |k, _| 0.01 * (k % 3) as f64);
    let mut problem = problem(vec![param("a", 2.6), param("b", 1.95)], vec![data]);
    let one = solve(&mut problem, &Options::default());
    let half = solve(&mut problem, &Options { gain: 0.5, ..Options::default() });
    assert!(half.is_good() && half.iterations > one.iterations);
    assert!((one.parameters[0].value / half.parameters[0].value - 1.0).abs() < 1e-8);
}

#[test]
fn impossible_problems_are_refused_with_all_reasons() {
    let mut data = run("r", grid(10, 1.0), 1, LINE, &[1.0, 1.0], |_, _| 0.0);
    data.measured.pop();
    let mut wrong = problem(vec![param("a", f64::NAN), param("b", 5.0)], vec![data]);
    wrong.params[1].upper = 2.0;
    let options = Options { gain: 0.0, noise: Noise::Given(vec![Some(-1.0)]), ..Options::default() };
    let mistakes = estimate(&mut wrong, &options, &Work::default()).expect_err("impossible");
    assert_eq!(mistakes.len(), 5, "{mistakes:?}");
    let mut torn = run("r", grid(10, 1.0), 2, |_, _, _, _| (), &[1.0], |_, _| 0.0);
    torn.measured[7] = f64::NAN;
    let mistakes = estimate(&mut problem(vec![param("a", 1.0)], vec![torn]), &full(Noise::Full), &Work::default())
        .expect_err("impossible");
    assert!(matches!(&mistakes[..], [ProblemError::FullWithGaps { sample: 3, .. }]), "{mistakes:?}");
}
