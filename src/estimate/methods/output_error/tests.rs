//! Noise models and robust losses: gradients against differences, minima against the likelihood written out, intervals against the truth.

use crate::specimen::Normal;
use crate::work::Work;
use crate::{Fit, FitError, FitOptions, Loss, Noise, Optimizer, Options, StrategyError, fit};
use fdm_system::Model;
use fdm_system::record::{Censored, Run};

/// Given the time and the true response the noise.
type MadeNoise<'n> = &'n mut dyn FnMut(f64, f64) -> f64;

/// A decay to a level that an input steps, on n samples; with a second input that runs from 0.5 to 1.5.
fn record(n: usize, noise: MadeNoise<'_>) -> Run {
    let time: Vec<f64> = (0..n).map(|k| 10.0 * k as f64 / n as f64).collect();
    let truth = |t: f64| 4.0 * (-0.6 * t).exp() + 1.0;
    Run {
        name: "r".into(),
        inputs: (0..n).flat_map(|k| [1.0, 0.5 + k as f64 / n as f64]).collect(),
        held: vec![false; 2],
        measured: time.iter().map(|t| truth(*t) + noise(*t, truth(*t))).collect(),
        input_gaps: vec![0; 2],
        stated: Vec::new(),
        output_gaps: vec![0],
        time,
    }
}

fn model(noise: &str) -> Model {
    let own = [("s", "s = 0.05"), ("g", "g = 0.05")];
    let own = own.iter().filter(|(name, _)| noise.split(|c: char| !c.is_alphanumeric()).any(|word| word == *name));
    let own: String = own.map(|(_, declared)| format!("param {declared}; ")).collect();
    let text = format!(
        "model m {{ input u, w; state x = x0; param a = 0.5 in [0.01, 10], x0 = 4; {own}
         der(x) = a*(u - x); output y = x; {noise} }}"
    );
    Model::from_text("m.fdm", text).unwrap_or_else(|e| panic!("{e}"))
}

fn fitted(noise: &str, run: &Run, options: FitOptions) -> Fit {
    fit(&model(noise), std::slice::from_ref(run), &options, &Work::default()).unwrap_or_else(|e| panic!("{e}"))
}

fn value(fit: &Fit, name: &str) -> f64 {
    fit.estimate.parameter(name, None).expect("a parameter").value
}

/// Minus the logarithm of the likelihood of the decay with deviations `s + g |y|`.
fn cost(run: &Run, [a, x0, s, g]: [f64; 4]) -> f64 {
    let one = |(t, z): (&f64, &f64)| {
        let y = (x0 - 1.0) * (-a * t).exp() + 1.0;
        let deviation = s + g * y.abs();
        0.5 * ((z - y) / deviation).powi(2) + deviation.abs().ln()
    };
    run.time.iter().zip(&run.measured).map(one).sum()
}

#[test]
fn a_noise_model_is_estimated_by_maximum_likelihood() {
    let mut normal = Normal(5);
    let run = record(200, &mut |_, y| (0.02 + 0.1 * y) * normal.next());
    let fit = fitted("noise y = s + g*abs(y);", &run, FitOptions::default());
    assert!(fit.estimate.is_good(), "{:?}", fit.estimate.termination);
    // below the cost that noise of deviation 1 can have
    assert!(fit.estimate.cost.is_some_and(|cost| cost < 0.0), "{:?}", fit.estimate.cost);
    let best = ["a", "x0", "s", "g"].map(|name| value(&fit, name));
    let least = cost(&run, best);
    assert!((fit.estimate.cost.expect("a cost") - least).abs() < 1e-6 * least.abs(), "{:?} {least}", fit.estimate.cost);
    for (k, name) in ["a", "x0", "s", "g"].iter().enumerate() {
        let error = fit.estimate.parameter(name, None).and_then(|p| p.standard_error).expect("an error");
        for step in [1e-2 * error, -1e-2 * error] {
            let mut near = best;
            near[k] += step;
            assert!(cost(&run, near) > least - 1e-9, "{name}: {} {least}", cost(&run, near));
        }
    }
    let error = fit.estimate.parameter("g", None).and_then(|p| p.standard_error).expect("an error");
    assert!((best[3] - 0.1).abs() < 3.0 * error, "{best:?} {error}");
    let deviations = &fit.noise_of_samples[0].deviations;
    assert!((deviations[0] - (best[2] + best[3] * best[1].abs())).abs() < 1e-6);
    assert!(!fit.estimate.noise_variation[0].is_significant(), "{:?}", fit.estimate.noise_variation);
}

#[test]
fn generated_derivatives_of_the_noise_agree_with_complex_steps() {
    let whole = model("noise y = s*exp(0.1*t) + g*abs(y)*w;");
    let definition = whole.definition().with_precisions().expect("a noise model");
    let whole = whole.altered(definition);
    let nominal = fdm_system::code::Nominal::start(whole.definition());
    let found = fdm_system::code::verify(whole.definition(), whole.schedule(), &nominal);
    assert!(found.passed() && found.compared > 0);
}

/// A noise of one size by an expression is the same as one that is known.
#[test]
fn a_deviation_from_a_column_that_is_constant_is_one_that_is_known() {
    let mut normal = Normal(11);
    let mut run = record(120, &mut |_, _| 0.1 * normal.next());
    run.inputs.chunks_exact_mut(2).for_each(|row| row[1] = 0.1);
    let known = fitted("noise y = 0.1;", &run, FitOptions::default());
    let column = fitted("noise y = w;", &run, FitOptions::default());
    for (a, b) in known.estimate.parameters.iter().zip(&column.estimate.parameters) {
        assert!((a.value - b.value).abs() < 1e-7, "{a:?} {b:?}");
        if let (Some(a), Some(b)) = (a.standard_error, b.standard_error) {
            assert!((a / b - 1.0).abs() < 1e-6);
        }
    }
}

#[test]
fn a_sample_of_infinite_deviation_is_left_out() {
    let mut normal = Normal(12);
    let mut run = record(120, &mut |_, _| 0.1 * normal.next());
    // weights: none for a sample that is far off
    run.inputs.chunks_exact_mut(2).for_each(|row| row[1] = 1.0);
    let mut without = run.clone();
    without.measured[17] = f64::NAN;
    (run.measured[17], run.inputs[2 * 17 + 1]) = (1e3, 0.0);
    let noise = "noise y = s/sqrt(w);";
    let (weighted, without) =
        (fitted(noise, &run, FitOptions::default()), fitted(noise, &without, FitOptions::default()));
    for name in ["a", "x0", "s"] {
        let values = [&weighted, &without].map(|fit| value(fit, name));
        assert!((values[0] - values[1]).abs() < 1e-7, "{name}: {values:?}");
    }
    assert_eq!(weighted.estimate.outputs[0].compared, 119);
}

/// Over an interval of 2000 time constants one explicit step gives finite numbers of the wrong sign; the deviations are above zero all the same.
#[test]
fn deviations_of_a_stiff_model_are_judged_by_steps_that_follow_it() {
    let text = "model fast { state x = 2; param level = 3; der(x) = 1000*(level - x); output y = x; noise y = 0.1*x; }";
    let model = Model::from_text("fast.fdm", text).unwrap_or_else(|e| panic!("{e}"));
    let (time, measured) = (vec![0.0, 2.0, 4.0], vec![2.1, 2.7, 3.2]);
    let (name, inputs, held, input_gaps) = ("r".into(), Vec::new(), Vec::new(), Vec::new());
    let run = Run {
        name,
        inputs,
        held,
        measured: measured.clone(),
        input_gaps,
        stated: Vec::new(),
        output_gaps: vec![0],
        time,
    };
    let options = FitOptions { options: Options { iterations: 0, ..Options::default() }, ..FitOptions::default() };
    let judged = fit(&model, std::slice::from_ref(&run), &options, &Work::default()).unwrap_or_else(|e| panic!("{e}"));
    let density = |(z, y): (&f64, f64)| {
        let deviation = 0.1 * y;
        -0.5 * ((z - y) / deviation).powi(2) - deviation.ln() - 0.5 * std::f64::consts::TAU.ln()
    };
    let expected: f64 = measured.iter().zip([2.0, 3.0, 3.0]).map(density).sum();
    assert!(judged.estimate.log_likelihood.is_some_and(|l| (l - expected).abs() < 1e-6), "{:?}", judged.estimate);
}

#[test]
fn noise_of_one_size_can_be_asked_for_and_other_methods_refuse() {
    let mut normal = Normal(5);
    let run = record(100, &mut |_, y| 0.1 * y * normal.next());
    let plain = Options { noise: Noise::Given(vec![None]), ..Options::default() };
    let fit = fitted("noise y = s + g*abs(y);", &run, FitOptions { options: plain, ..FitOptions::default() });
    assert!(fit.noise_of_samples.is_empty() && fit.estimate.is_good());
    assert_eq!(value(&fit, "g"), 0.05, "held");
    let robust = FitOptions { loss: Loss::Huber(1.345), ..FitOptions::default() };
    let refused = crate::fit(&model("noise y = g*abs(y);"), std::slice::from_ref(&run), &robust, &Work::default())
        .expect_err("both");
    assert_eq!(refused, FitError::Strategy(StrategyError::LossOfNoiseModel));
    // shorter records and other weights are of noise of one size
    let confident = FitOptions { confidence: true, ..FitOptions::default() };
    let reweighted = FitOptions { reweight: true, loss: Loss::Huber(1.345), ..FitOptions::default() };
    for (text, options) in [("noise y = g*abs(y);", confident), ("", reweighted)] {
        let refused =
            crate::fit(&model(text), std::slice::from_ref(&run), &options, &Work::default()).expect_err("refused");
        assert_eq!(refused, FitError::Strategy(StrategyError::ConfidenceOfOwnNoise));
    }
}

/// Share of the intervals of a and x0 that hold the truth.
fn held(repeats: u64, noise: &str, loss: Loss, made: impl Fn(f64, &mut Normal) -> f64) -> f64 {
    let model = model(noise);
    let (mut held, mut all) = (0, 0);
    for seed in 0..repeats {
        let mut normal = Normal(29 + 7919 * seed);
        let run = record(100, &mut |_, y| made(y, &mut normal));
        let options = FitOptions { loss, per_interval: Some(2), ..FitOptions::default() };
        let fit = fit(&model, std::slice::from_ref(&run), &options, &Work::default()).unwrap_or_else(|e| panic!("{e}"));
        assert!(fit.estimate.is_good(), "{:?}", fit.estimate.termination);
        for (name, truth) in [("a", 0.6), ("x0", 5.0)] {
            let [low, high] = fit.estimate.parameter(name, None).and_then(|p| p.interval()).expect("an interval");
            held += usize::from(low <= truth && truth <= high);
            all += 1;
        }
    }
    held as f64 / all as f64
}

fn heavy(normal: &mut Normal) -> f64 {
    let chi = (0..3).map(|_| normal.next().powi(2)).sum::<f64>() / 3.0;
    0.1 * normal.next() / chi.sqrt()
}

#[test]
fn intervals_by_noise_models_and_robust_losses_hold() {
    let growing = |y: f64, normal: &mut Normal| (0.02 + 0.1 * y) * normal.next();
    let all = [
        held(16, "noise y = s + g*abs(y);", Loss::Squares, growing),
        held(16, "", Loss::Huber(1.345), |_, normal| heavy(normal)),
        held(16, "", Loss::Student(4.0), |_, normal| heavy(normal)),
    ];
    assert!(all.iter().all(|share| (0.8..=1.0).contains(share)), "{all:?}");
}

#[test]
fn the_likelihood_of_students_law_is_at_its_maximum_and_outliers_pull_less() {
    let mut normal = Normal(3);
    let mut run = record(150, &mut |_, _| heavy(&mut normal));
    run.measured[20] += 30.0;
    let squares = fitted("", &run, FitOptions::default());
    for loss in [Loss::Student(4.0), Loss::Huber(1.345)] {
        let fit = fitted("", &run, FitOptions { loss, ..FitOptions::default() });
        assert!(fit.estimate.is_good(), "{:?} {:?}", fit.estimate.termination, fit.estimate.undetermined);
        let off = |fit: &Fit| (value(fit, "a") - 0.6).abs();
        assert!(off(&fit) < 0.02 && off(&fit) < 0.5 * off(&squares), "{} {}", off(&fit), off(&squares));
        let error = |fit: &Fit| fit.estimate.parameter("a", None).and_then(|p| p.error()).expect("an error");
        assert!(error(&fit) < error(&squares));
        assert_eq!(fit.estimate.runs[0].residuals[20], run.measured[20] - fit.estimate.runs[0].response[20]);
    }
    // Student's: no other value of a, x0 or the scale is likelier
    let fit = fitted("", &run, FitOptions { loss: Loss::Student(4.0), ..FitOptions::default() });
    let scale = |v: &[f64]| {
        let mut s: f64 = 0.1;
        (0..500).for_each(|_| {
            s = (v.iter().map(|v| 5.0 * v * v / (4.0 + v * v / (s * s))).sum::<f64>() / v.len() as f64).sqrt()
        });
        s
    };
    let cost = |a: f64, x0: f64| {
        let residuals: Vec<f64> =
            run.time.iter().zip(&run.measured).map(|(t, z)| z - (x0 - 1.0) * (-a * t).exp() - 1.0).collect();
        let s = scale(&residuals);
        residuals.iter().map(|v| 2.5 * (v * v / (4.0 * s * s)).ln_1p() + s.ln()).sum::<f64>()
    };
    let (a, x0) = (value(&fit, "a"), value(&fit, "x0"));
    // Student's density with 4 degrees of freedom is 3/8 (1 + e^2/4)^(-5/2)
    let log_likelihood = fit.estimate.log_likelihood.expect("a law");
    let want = 150.0 * 0.375f64.ln() - cost(a, x0);
    assert!((log_likelihood - want).abs() < 1e-6 * want.abs(), "{log_likelihood} {want}");
    let huber = fitted("", &run, FitOptions { loss: Loss::Huber(1.345), ..FitOptions::default() });
    assert_eq!(huber.estimate.log_likelihood, None, "Huber's loss is that of no law");
    for (da, dx) in [(1e-4, 0.0), (-1e-4, 0.0), (0.0, 1e-4), (0.0, -1e-4)] {
        assert!(cost(a + da, x0 + dx) > cost(a, x0) - 1e-9, "{da} {dx}");
    }
}

#[test]
fn robust_losses_of_normal_noise_lose_little() {
    let mut normal = Normal(8);
    let run = record(300, &mut |_, _| 0.1 * normal.next());
    let squares = fitted("", &run, FitOptions::default());
    let huber = fitted("", &run, FitOptions { loss: Loss::Huber(1.345), ..FitOptions::default() });
    let error = |fit: &Fit| fit.estimate.parameter("a", None).and_then(|p| p.standard_error).expect("an error");
    let ratio = error(&huber) / error(&squares);
    assert!((0.95..1.12).contains(&ratio), "{ratio}");
    let nearly = fitted("", &run, FitOptions { loss: Loss::Huber(100.0), ..FitOptions::default() });
    assert!((value(&nearly, "a") - value(&squares, "a")).abs() < 1e-8);
    assert!((error(&nearly) / error(&squares) - 1.0).abs() < 1e-6);
    let other = Options { optimizer: Optimizer::Lbfgs, ..Options::default() };
    assert!(
        fitted("", &run, FitOptions { options: other, loss: Loss::Huber(2.0), ..FitOptions::default() })
            .estimate
            .is_good()
    );
}

#[test]
fn samples_below_their_limit_leave_estimates_unbiased_and_errors_right() {
    let text = "model m { state x = x0; param k = 0.3 in [0, 5], x0 = 8 in [0, 100], s = 1 in [0, inf]; der(x) = -k*x; output y = x; noise y = s; }";
    let model = Model::from_text("m.fdm", text).unwrap_or_else(|e| panic!("{e}"));
    const REPEATS: usize = 200;
    let (k, x0, s, limit) = (0.5, 10.0, 0.5, 1.0);
    let mut normal = Normal(11);
    // of each of k, x0 and s: the estimate less the truth, and its standard error
    let mut found = [Vec::new(), Vec::new()];
    for _ in 0..REPEATS {
        let mut run = record(20, &mut |_, _| 0.0);
        (run.held, run.inputs, run.input_gaps) = Default::default();
        let mut censored = Vec::new();
        for (t, z) in run.time.iter().zip(&mut run.measured) {
            *z = x0 * (-k * t).exp() + s * normal.next();
            if *z < limit {
                *z = f64::NAN;
                censored.push(Censored { run: "r".into(), output: 0, time: *t, limit });
            }
        }
        assert!((6..16).contains(&censored.len()));
        for (found, censored) in found.iter_mut().zip([censored, Vec::new()]) {
            let options = FitOptions { censored, ..FitOptions::default() };
            let fit = fit(&model, &[run.clone()], &options, &Work::default()).unwrap_or_else(|e| panic!("{e}"));
            assert!(fit.is_good(), "{:?}", fit.estimate.termination);
            let one = |(name, truth): (&str, f64)| {
                let parameter = fit.estimate.parameter(name, None).expect("a parameter");
                (parameter.value - truth, parameter.corrected_error.expect("an error"))
            };
            found.push([("k", k), ("x0", x0), ("s", s)].map(one));
        }
    }
    let told = |found: &[[(f64, f64); 3]], p: usize| {
        let n = found.len() as f64;
        let mean = found.iter().map(|f| f[p].0).sum::<f64>() / n;
        let scatter = (found.iter().map(|f| (f[p].0 - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        (mean, scatter, found.iter().map(|f| f[p].1).sum::<f64>() / n)
    };
    let chance = (REPEATS as f64).sqrt();
    for p in 0..2 {
        let (mean, scatter, error) = told(&found[0], p);
        assert!(mean.abs() < 3.0 * scatter / chance, "{p}: {mean} of {scatter}");
        assert!((error / scatter - 1.0).abs() < 0.15, "{p}: {error} for {scatter}");
    }
    let (mean, ..) = told(&found[0], 2);
    // as of every deviation by maximum likelihood: short by about a part in the number of values for each param
    assert!(mean < 0.0 && mean > -0.15 * s, "{mean}");
    let (mean, scatter, _) = told(&found[1], 0);
    assert!(mean < -6.0 * scatter / chance, "left out, the decay is too slow: {mean} of {scatter}");
}
