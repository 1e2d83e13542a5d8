//! The sampler against laws that are known in closed form, its gradients against differences.

use super::{CorrectedErrors, Given, Posterior, Samples, Sampling, sample};
use fdm_estimate::{FitOptions, Halt, Noise, Work, fit};
use fdm_numeric::random::Stream;
use fdm_results::documents::FitDocument;
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::Steps;

const SAMPLING: Sampling = Sampling { chains: 4, draws: 1000, warmup: 400, seed: 3, target: 0.8, most_depth: 10 };

fn line_run(model: &Model, name: &str, count: usize, seed: u64) -> Run {
    let mut stream = Stream::seeded(seed);
    let u: Vec<f64> = (0..count).map(|k| (k % 10) as f64 / 3.0 - 1.5).collect();
    let y: Vec<f64> = u.iter().map(|u| 1.5 * u + 0.7 + 0.4 * stream.normal()).collect();
    let time: Vec<f64> = (0..count).map(|k| 0.1 * k as f64).collect();
    model.run(name).times(time).samples("u", u).samples("y", y).build().unwrap()
}

fn posterior(model: &Model, runs: Vec<Run>, theta: &[f64], noise: (f64, bool)) -> Posterior {
    let steps = runs.iter().map(|_| Steps::from(1)).collect();
    let theta = runs.iter().map(|_| theta.to_vec()).collect();
    let noise = vec![noise; model.layout().outputs];
    Posterior::new(Given { model, runs, steps, theta, noise }).unwrap()
}

fn drawn(posterior: &Posterior) -> Samples {
    sample(posterior, &SAMPLING, &Halt::default()).unwrap()
}

#[test]
fn gradients_are_those_of_the_density() {
    let model = Model::from_text(
        "m",
        "model m { input u; state x = free; param a = 0.8 in [0, inf], k = 1.2 in [0.1, 5] log, b = 0.1 per run, s = 0.3 in [-1, 4], c = -0.5 in [-inf, 2];
        der(x) = -a*x + k*u + c*x*abs(x)*0.1; output y = x + b, z = a*x; noise z = 0.1 + s*abs(x); prior a ~ normal(1, 0.5), b ~ normal(0, 1); }",
    )
    .unwrap();
    let mut stream = Stream::seeded(5);
    let runs: Vec<Run> = (0..2)
        .map(|r| {
            let time: Vec<f64> = (0..40).map(|k| 0.2 * f64::from(k)).collect();
            let u: Vec<f64> = time.iter().map(|t| (t + f64::from(r)).sin()).collect();
            let mut noisy =
                |scale: f64| time.iter().map(|t| scale * t.cos() + 0.3 * stream.normal()).collect::<Vec<f64>>();
            let (mut y, z) = (noisy(1.0), noisy(0.5));
            y[7] = f64::NAN;
            model
                .run(format!("r{r}"))
                .times(time.clone())
                .samples("u", u)
                .samples("y", y)
                .samples("z", z)
                .build()
                .unwrap()
        })
        .collect();
    let theta = model.definition().start();
    let steps = vec![Steps::from(4); 2];
    let noise = vec![(0.4, false), (f64::NAN, false)];
    let posterior = Posterior::new(Given { model: &model, runs, steps, theta: vec![theta; 2], noise }).unwrap();
    // a, k, s, c; x(0) and b of two runs; the noise of y
    assert_eq!(posterior.unknowns(), 9, "{:?}", posterior.names());
    gradients_are_right(&posterior);
    // so too where the likelihood is widened, in some directions more than in others
    let names = [("a", None), ("k", None), ("s", None), ("b", Some("r1"))];
    let unit = [0.4, 0.3, 0.5, 0.6];
    let correlated = |i: usize, j: usize| if i == j { 1.0 } else { 0.3 - 0.2 * (i + j) as f64 / 6.0 };
    let errors = CorrectedErrors {
        parameters: names.map(|(name, run)| (name.to_string(), run.map(str::to_string))).to_vec(),
        covariance: (0..16).map(|k| correlated(k / 4, k % 4) * unit[k / 4] * unit[k % 4]).collect(),
        squares: vec![("y".into(), 7.0)],
    };
    let widened = posterior.corrected(&errors).unwrap();
    let [least, most] = widened.widened().unwrap();
    assert!(least > 0.0 && most > 1.5 * least, "{least} {most}");
    gradients_are_right(&widened);
}

fn gradients_are_right(posterior: &Posterior) {
    let n = posterior.unknowns();
    let mut evaluator = posterior.evaluator().unwrap();
    let mut u = posterior.start().to_vec();
    u.iter_mut().enumerate().for_each(|(k, u)| *u += 0.05 * (k as f64 - 4.0));
    let (mut gradient, mut rest) = (vec![0.0; n], vec![0.0; n]);
    assert!(evaluator.log_density(&u, &mut gradient).is_finite());
    for k in 0..n {
        let step = 1e-5;
        let mut side = |sign: f64| {
            let mut moved = u.clone();
            moved[k] += sign * step;
            evaluator.log_density(&moved, &mut rest)
        };
        let difference = (side(1.0) - side(-1.0)) / (2.0 * step);
        assert!(
            (gradient[k] - difference).abs() < 1e-5 * difference.abs().max(1.0),
            "{k}: {} {difference}",
            gradient[k]
        );
    }
    let information = evaluator.information().unwrap();
    assert!((0..n).all(|k| information[k * n + k] > 0.0));
}

#[test]
fn a_line_with_known_noise_has_the_normal_posterior_of_its_regression() {
    let model =
        Model::from_text("m", "model m { input u; param a = 1, b = 0; output y = a*u + b; prior a ~ normal(1, 0.1); }")
            .unwrap();
    let run = line_run(&model, "r", 30, 7);
    let (mut m, mut side) = ([[1.0 / 0.01, 0.0], [0.0, 0.0]], [1.0 / 0.01, 0.0]);
    for (u, y) in run.inputs.iter().zip(&run.measured) {
        let w = 1.0 / 0.16;
        m[0][0] += w * u * u;
        m[0][1] += w * u;
        m[1][1] += w;
        side[0] += w * u * y;
        side[1] += w * y;
    }
    m[1][0] = m[0][1];
    let determinant = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    let mean =
        [(m[1][1] * side[0] - m[0][1] * side[1]) / determinant, (m[0][0] * side[1] - m[1][0] * side[0]) / determinant];
    let deviation = [(m[1][1] / determinant).sqrt(), (m[0][0] / determinant).sqrt()];
    let posterior = posterior(&model, vec![run], &[1.0, 0.0], (0.4, true));
    let samples = drawn(&posterior);
    for (k, p) in samples.parameters().iter().enumerate() {
        let error = p.error_of_mean.unwrap();
        assert!((p.mean - mean[k]).abs() < 4.0 * error, "{}: {} +- {error}, not {}", p.name, p.mean, mean[k]);
        assert!((p.deviation / deviation[k] - 1.0).abs() < 0.06, "{}: {}, not {}", p.name, p.deviation, deviation[k]);
        assert!(p.r_hat.unwrap() < 1.01 && p.bulk.unwrap() > 1000.0 && p.tail.unwrap() > 1000.0, "{p:?}");
    }
    assert!(samples.chains(10).iter().all(|c| c.divergent == 0 && (0.6..0.99).contains(&c.accepted)));
    // the same bits, whoever asks
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(pool.install(|| drawn(&posterior)), samples);
    assert_ne!(sample(&posterior, &Sampling { seed: 4, ..SAMPLING }, &Halt::default()).unwrap(), samples);
}

#[test]
fn unknown_noise_has_the_inverse_chi_squared_law_and_a_bound_cuts_off() {
    let model =
        Model::from_text("m", "model m { input u; param a = 1.6 in [1.55, inf]; output y = a*u + 0.7; }").unwrap();
    let run = line_run(&model, "r", 12, 21);
    let pairs: Vec<(f64, f64)> = run.inputs.iter().copied().zip(run.measured.iter().map(|y| y - 0.7)).collect();
    // p(a, s) = s^-N exp(-sum (y - a u)^2/(2 s^2))/s over a grid
    let (mut whole, mut of_a, mut of_s) = (0.0, 0.0, 0.0);
    for i in 0..1500 {
        let a = 1.55 + 0.002 * (f64::from(i) + 0.5);
        let squares: f64 = pairs.iter().map(|(u, y)| (y - a * u) * (y - a * u)).sum();
        for j in 0..800 {
            let log_s = -2.5 + 0.005 * (f64::from(j) + 0.5);
            let s = log_s.exp();
            let density = (-12.0 * log_s - squares / (2.0 * s * s)).exp();
            whole += density;
            of_a += density * a;
            of_s += density * s;
        }
    }
    let posterior = posterior(&model, vec![run], &[1.6], (0.4, false));
    let samples = drawn(&posterior);
    let found = samples.parameters();
    for (p, expected) in found.iter().zip([of_a / whole, of_s / whole]) {
        let error = p.error_of_mean.unwrap();
        assert!((p.mean - expected).abs() < 4.0 * error + 1e-3, "{}: {} +- {error}, not {expected}", p.name, p.mean);
    }
    assert!(found[0].interval[0] > 1.55 && found[1].name == "noise y");
}

#[test]
fn a_bent_posterior_is_walked_through() {
    // a and b are known by their product: a hyperbola within priors
    let model = Model::from_text(
        "m",
        "model m { input u; param a = 1, b = 2; output y = a*b*u; prior a ~ normal(1, 1), b ~ normal(2, 1); }",
    )
    .unwrap();
    let u: Vec<f64> = (0..20).map(|k| f64::from(k % 5) - 2.0).collect();
    let y: Vec<f64> = u.iter().map(|u| 2.0 * u).collect();
    let time: Vec<f64> = (0..20).map(f64::from).collect();
    let run = model.run("r").times(time).samples("u", u.clone()).samples("y", y).build().unwrap();
    let squares: f64 = u.iter().map(|u| u * u).sum();
    let (mut whole, mut of_a, mut of_b) = (0.0, 0.0, 0.0);
    for i in 0..1200 {
        let a = -3.0 + 0.0075 * (f64::from(i) + 0.5);
        for j in 0..1200 {
            let b = -3.0 + 0.0075 * (f64::from(j) + 0.5);
            let off = a * b - 2.0;
            let density =
                (-0.5 * off * off * squares / 0.09 - 0.5 * (a - 1.0) * (a - 1.0) - 0.5 * (b - 2.0) * (b - 2.0)).exp();
            whole += density;
            of_a += density * a;
            of_b += density * b;
        }
    }
    let posterior = posterior(&model, vec![run], &[1.0, 2.0], (0.3, true));
    let samples = drawn(&posterior);
    for (p, expected) in samples.parameters().iter().zip([of_a / whole, of_b / whole]) {
        let error = p.error_of_mean.unwrap();
        assert!((p.mean - expected).abs() < 4.0 * error, "{}: {} +- {error}, not {expected}", p.name, p.mean);
    }
    let bands = samples.predict(&posterior, 400, 1).unwrap();
    let half = 0.5 * (bands[0].measurement[2][0].unwrap() - bands[0].measurement[0][0].unwrap());
    assert!((0.4..0.8).contains(&half), "{half}");
}

/// x' = -2 x + 3 u under a square wave, with a bias, in noise of first order.
fn coloured_run(model: &Model, seed: u64, rho: f64) -> Run {
    let (dt, mut x) = (0.05_f64, 0.0);
    let mut stream = Stream::named(seed, &["coloured"]);
    let mut e = stream.normal();
    let (mut time, mut u, mut y) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..500 {
        let input = if (0.06 * f64::from(k)).sin() > 0.0 { 1.0 } else { -1.0 };
        time.push(dt * f64::from(k));
        u.push(input);
        y.push(x + 0.3 + 0.1 * e);
        x = (x - 1.5 * input) * (-2.0 * dt).exp() + 1.5 * input;
        e = rho * e + (1.0 - rho * rho).sqrt() * stream.normal();
    }
    model.run("r").times(time).samples("u", u).samples("y", y).zero_order_hold("u").build().unwrap()
}

#[test]
fn draws_scatter_as_repeated_fits_do_where_noise_is_coloured() {
    let model = Model::from_text(
        "m",
        "model m { input u; state x = 0; param k = 1 in [0, 50], g = 1, b = 0; der(x) = -k*x + g*u; output y = x + b; }",
    )
    .unwrap();
    let fitted = |seed: u64| {
        let runs = [coloured_run(&model, seed, 0.9)];
        let found = fit(&model, &runs, &FitOptions::default(), &Work::default()).unwrap();
        assert!(found.is_good());
        (runs, found)
    };
    let repeats = 80;
    let values: Vec<Vec<f64>> =
        (0..repeats).map(|k| fitted(100 + k).1.estimate.parameters.iter().map(|p| p.value).collect()).collect();
    let scatter = |k: usize| {
        let mean = values.iter().map(|v| v[k]).sum::<f64>() / repeats as f64;
        (values.iter().map(|v| (v[k] - mean).powi(2)).sum::<f64>() / (repeats - 1) as f64).sqrt()
    };
    let sampling = Sampling { chains: 2, draws: 250, warmup: 150, ..SAMPLING };
    let (mut white, mut wide) = ([0.0; 3], [0.0; 3]);
    let records = 4;
    for record in 0..records {
        let (runs, found) = fitted(record);
        let errors = CorrectedErrors::of(&FitDocument::of(&found)).unwrap();
        let posterior = Posterior::of_fit(&found, &runs, &Noise::default()).unwrap();
        let narrow = sample(&posterior, &sampling, &Halt::default()).unwrap().parameters();
        let drawn = sample(&posterior.corrected(&errors).unwrap(), &sampling, &Halt::default()).unwrap().parameters();
        for k in 0..3 {
            white[k] += narrow[k].deviation.powi(2) / records as f64;
            wide[k] += drawn[k].deviation.powi(2) / records as f64;
            let own = found.estimate.parameters[k].corrected_error.unwrap();
            assert!(
                (drawn[k].deviation / own - 1.0).abs() < 0.25,
                "{}: {} beside {own}",
                drawn[k].name,
                drawn[k].deviation
            );
        }
        // the noise of 500 values that hold as much as some fifty
        let [few, many] = [&narrow, &drawn].map(|p| p[3].deviation);
        assert!(many > 2.0 * few, "{many} {few}");
    }
    for k in 0..3 {
        // the scatter of 80 fits is known to 8 %, a corrected error to a quarter, the mean of four to an eighth
        let [ratio, before] = [wide[k], white[k]].map(|v| v.sqrt() / scatter(k));
        assert!((0.65..1.4).contains(&ratio), "{k}: draws over scatter {ratio:.2}, taken for white {before:.2}");
    }
    assert!(white[2].sqrt() < 0.5 * scatter(2), "{white:?}");
}
