//! Behaviour of estimations with priors.

use crate::specimen::{Normal, Sample, grid, param, problem, run};
use crate::*;
use fdm_grammar::model::{Param, Prior};

const LINE: Sample = |x, theta, y, d| {
    y[0] = theta[0] + theta[1] * x;
    d.copy_from_slice(&[1.0, x]);
};

fn with_prior(name: &str, value: f64, mean: f64, deviation: f64) -> Param {
    Param { prior: Some(Prior { mean, deviation }), ..param(name, value) }
}

fn solve(problem: &mut Problem<'_>, noise: Noise) -> Estimate {
    estimate(problem, &Options { noise, ..Options::default() }, &Work::default()).expect("a possible problem")
}

fn close(got: f64, want: f64, tolerance: f64) {
    assert!((got / want - 1.0).abs() < tolerance, "{got} {want}");
}

#[test]
fn a_linear_model_with_known_noise_has_the_textbook_posterior() {
    let (x, s) = (grid(12, 2.0), 0.3);
    let mut noise = Normal(21);
    let data = run("r", x.clone(), 1, LINE, &[1.0, -2.0], |_, _| s * noise.next());
    let z = data.measured.clone();
    let priors = [(0.5, 0.2), (-1.0, 0.4)];
    let params = vec![with_prior("a", 0.0, priors[0].0, priors[0].1), with_prior("b", 0.0, priors[1].0, priors[1].1)];
    let fit = solve(&mut problem(params, vec![data]), Noise::Given(vec![Some(s)]));
    assert!(fit.is_good() && fit.determined_by_prior.is_empty(), "{:?}", fit.termination);

    let w = 1.0 / (s * s);
    let information = |k: usize| 1.0 / (priors[k].1 * priors[k].1);
    let sums =
        x.iter().zip(&z).fold([0.0; 5], |m, (x, z)| [m[0] + 1.0, m[1] + x, m[2] + x * x, m[3] + z, m[4] + x * z]);
    let (h00, h01, h11) = (w * sums[0] + information(0), w * sums[1], w * sums[2] + information(1));
    let (r0, r1) = (w * sums[3] + information(0) * priors[0].0, w * sums[4] + information(1) * priors[1].0);
    let det = h00 * h11 - h01 * h01;
    let (a, b) = ((h11 * r0 - h01 * r1) / det, (h00 * r1 - h01 * r0) / det);
    close(fit.parameters[0].value, a, 1e-12);
    close(fit.parameters[1].value, b, 1e-12);
    close(fit.parameters[0].standard_error.expect("determined"), (h11 / det).sqrt(), 1e-12);
    close(fit.parameters[1].standard_error.expect("determined"), (h00 / det).sqrt(), 1e-12);
    close(fit.correlations.at(0, 1), -h01 / (h00 * h11).sqrt(), 1e-12);
    let residuals: f64 = x.iter().zip(&z).map(|(x, z)| (z - a - b * x).powi(2)).sum();
    let known = [a, b].iter().zip(priors).map(|(v, (mean, sd))| ((v - mean) / sd).powi(2)).sum::<f64>();
    close(fit.cost.expect("a cost"), 0.5 * (w * residuals + known) + 12.0 * s.ln(), 1e-12);
}

#[test]
fn every_run_has_the_prior_of_its_own_copy() {
    let make = |name: &str, seed: u64| {
        let mut noise = Normal(seed);
        run(name, grid(8, 1.0), 1, LINE, &[1.0, 2.0], |_, _| 0.5 * noise.next())
    };
    let noise = || Noise::Given(vec![Some(0.5)]);
    let mut params = vec![with_prior("a", 0.0, 1.0, 0.1), with_prior("b", 0.0, 2.0, 0.2)];
    params.iter_mut().for_each(|p| p.per_run = true);
    let both = solve(&mut problem(params.clone(), vec![make("one", 1), make("two", 2)]), noise());
    for (name, seed) in [("one", 1), ("two", 2)] {
        let alone = solve(&mut problem(params.clone(), vec![make(name, seed)]), noise());
        for p in ["a", "b"] {
            let (j, s) = (both.parameter(p, Some(name)).expect("own"), alone.parameter(p, Some(name)).expect("own"));
            close(j.value, s.value, 1e-9);
            close(j.standard_error.expect("determined"), s.standard_error.expect("determined"), 1e-9);
        }
    }
}

#[test]
fn a_prior_heals_what_the_data_do_not_determine_and_this_is_said() {
    // y = (a + 2.5 b) x + c + 0 d
    let collinear: Sample = |x, theta, y, d| {
        y[0] = (theta[0] + 2.5 * theta[1]) * x + theta[2];
        d.copy_from_slice(&[x, 2.5 * x, 1.0, 0.0]);
    };
    for noise in [Noise::Diagonal, Noise::Full, Noise::Given(vec![Some(0.01)])] {
        let mut source = Normal(11);
        let data = run("r", grid(30, 1.0), 1, collinear, &[1.0, 2.0, 3.0, 4.0], |_, _| 0.01 * source.next());
        let params =
            vec![with_prior("a", 5.0, 0.8, 0.25), param("b", 1.0), param("c", 1.0), with_prior("d", 0.0, -3.0, 0.5)];
        let fit = solve(&mut problem(params, vec![data]), noise);
        assert!(fit.is_good(), "{} {:?}", fit.termination, fit.undetermined);
        let (a, b, d) = (&fit.parameters[0], &fit.parameters[1], &fit.parameters[3]);
        // the data say nothing about a and d: they are their priors
        close(a.value, 0.8, 1e-7);
        close(a.standard_error.expect("determined"), 0.25, 1e-6);
        close(d.value, -3.0, 1e-9);
        close(d.standard_error.expect("determined"), 0.5, 1e-9);
        close(b.value, (6.0 - 0.8) / 2.5, 0.01);
        assert_eq!([a, b, d].map(|p| p.status), [Status::Estimated; 3]);
        let said: Vec<&str> = fit.determined_by_prior.iter().map(|d| d.sentence.as_str()).collect();
        assert_eq!(said.len(), 2, "{said:?}");
        assert_eq!(said[0], "`d` has no influence on what was compared");
        assert!(said[1].starts_with("only `"), "{said:?}");
    }
}

#[test]
fn a_prior_takes_its_share_of_the_degrees_of_freedom() {
    let data = || {
        let mut source = Normal(5);
        run("r", grid(10, 1.0), 1, LINE, &[1.0, 2.0], move |_, _| 0.1 * source.next())
    };
    let residual = |fit: &Estimate| fit.runs[0].residuals.iter().map(|v| v * v).sum::<f64>();
    let variance = |fit: &Estimate| fit.noise.as_ref().expect("estimated").at(0, 0);
    // so weak that it says nothing; so strong that the parameter is as good as fixed
    for (deviation, freedom) in [(1e4, 8.0), (1e-5, 9.0)] {
        let params = vec![param("a", 0.0), with_prior("b", 0.0, 2.0, deviation)];
        let fit = solve(&mut problem(params, vec![data()]), Noise::Diagonal);
        assert!(fit.is_good(), "{:?}", fit.termination);
        close(variance(&fit), residual(&fit) / freedom, 1e-5);
    }
}

#[test]
fn a_prior_beyond_a_bound_pulls_to_the_bound() {
    let data = run("r", grid(10, 1.0), 1, LINE, &[1.0, 2.0], |k, _| 0.1 * (k as f64).cos());
    let mut params = vec![param("a", 0.0), with_prior("b", 0.5, 50.0, 0.01)];
    params[1].upper = 3.0;
    let fit = solve(&mut problem(params, vec![data]), Noise::Diagonal);
    assert!(fit.termination.is_good(), "{:?}", fit.termination);
    assert_eq!((fit.parameters[1].value, fit.parameters[1].status), (3.0, Status::AtUpperBound));
}

#[test]
fn impossible_priors_are_refused() {
    let data = || run("r", grid(10, 1.0), 1, LINE, &[1.0, 2.0], |_, _| 0.0);
    for (mean, deviation) in [(f64::NAN, 1.0), (1.0, 0.0), (1.0, -1.0), (1.0, f64::INFINITY)] {
        let params = vec![param("a", 0.0), with_prior("b", 0.0, mean, deviation)];
        let refused = estimate(&mut problem(params, vec![data()]), &Options::default(), &Work::default())
            .expect_err("impossible");
        assert!(matches!(&refused[..], [ProblemError::BadPrior { parameter, .. }] if parameter == "b"), "{refused:?}");
    }
}
