//! Nonlinear terms as known inputs: a carried model has the response of the original where records are exact.

use fdm::estimate::{Nonlinear, SpectralOptions, Work, fit_spectra};
use fdm::record::Run;
use fdm::simulate::Simulator;
use fdm::spectrum::Frequencies;
use fdm::{Model, model};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use statrs::distribution::{ContinuousCDF, Normal};

/// The model in both doors: by the macro and from text.
fn ships() -> [Model; 2] {
    let by_macro = model! {
        model ship {
            input d [rad];
            state v [m/s], r [rad/s], phi [rad];
            param a = -0.5 [1/s], b = 0.8 [m/s], c = -0.4 [1/m], e = -0.9 [1/s], f = 1.2 [1/s^2], tau = 0.25 [s];
            der(v) = a*v + b*r + c*v*abs(v);
            der(r) = e*r + f*delay(sin(d)*d, tau);
            der(phi) = r;
            output v_m [m/s] = v, r_m [rad/s] = r, side [m^2/s^2] = v^2;
        }
    };
    let text = by_macro.source().text().to_string();
    [by_macro, Model::from_text("ship.fdm", text).expect("the same text")]
}

fn response(model: &Model, run: &Run) -> Vec<f64> {
    let mut y = vec![0.0; run.len() * model.layout().outputs];
    let mut simulator = Simulator::new(model.dynamics(), run, 4).expect("the run suits the model");
    simulator.simulate(&model.definition().start(), &mut y).expect("stable");
    y
}

fn run(samples: usize, dt: f64) -> Run {
    let time: Vec<f64> = (0..samples).map(|k| dt * k as f64).collect();
    let inputs = time.iter().map(|t| (1.3 * t).sin() + 0.4 * (0.05 * t * t).cos()).collect();
    Run {
        name: "turn".into(),
        time,
        inputs,
        held: vec![false],
        measured: vec![f64::NAN; 3 * samples],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0; 3],
    }
}

/// Largest difference between the responses of a model and of its carried form, driven by the exact record of the former.
fn difference(ship: &Model, carried: &Model, samples: usize, dt: f64) -> f64 {
    let mut run = run(samples, dt);
    run.measured = response(ship, &run);
    let same = response(carried, &run.with_measured(carried.definition()).expect("a record of every output"));
    run.measured.iter().zip(&same).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn a_carried_model_is_affine_and_has_the_same_response() {
    for ship in ships() {
        assert!(!ship.layout().affine.rates);
        let (carried, terms) = ship.carried().expect("all states in nonlinear terms are measured");
        assert!(carried.layout().affine.rates && carried.layout().affine.outputs.iter().all(|a| *a));
        let words: Vec<String> = terms.iter().map(|t| format!("{} in {}", t.text, t.equations.join(", "))).collect();
        assert_eq!(words, ["v*abs(v) in der(v)", "d*sin(d) in der(r)", "v^2 in side"]);
        assert_eq!((&terms[0].records[..], &terms[1].records[..]), (&["v_m".to_string()][..], &[][..]));
        // a term is linear between samples where the signals in it are, which is an error of second order
        let (coarse, fine) = (difference(&ship, &carried, 751, 0.02), difference(&ship, &carried, 1501, 0.01));
        assert!(fine < 1e-4 && (3.5..4.5).contains(&(coarse / fine)), "{coarse} {fine}");
        // the delay of a term is still a parameter
        let tau = carried.definition().param("tau").expect("declared");
        assert!(carried.layout().patterns.tau_by_param.entries().any(|(_, _, p)| p == tau));
    }
}

#[test]
fn an_affine_model_is_itself() {
    let linear =
        Model::from_text("m", "model m { state x; param a = 1; der(x) = -a*x; output y = x; }").expect("a model");
    let (same, terms) = linear.carried().expect("nothing to carry");
    assert!(terms.is_empty() && same.definition().inputs.is_empty());
}

/// Sideslip that hears the yaw rate through a nonlinear term of known size, and both parameters' errors over repeats: mean squares of
/// deviations in Cramer-Rao and in corrected errors.
fn deviations_in_errors(noise: [f64; 2], repeats: u64) -> [f64; 2] {
    let model = model! {
        model yaw {
            input d;
            state v, r;
            const u0 = 20;
            param a = -0.4, b = 6, c = 0.05, e = -1.2, f = 0.8;
            der(v) = a*v + b*d - u0*sin(r);
            der(r) = c*v + e*r + f*d;
            output v_m = v, r_m = r;
        }
    };
    let time: Vec<f64> = (0..600).map(|k| 0.05 * f64::from(k)).collect();
    let inputs = time.iter().map(|t| 0.1 * ((1.3 * t).sin() + (0.03 * t * t).cos() - 1.0)).collect();
    let measured = vec![f64::NAN; 2 * time.len()];
    let (held, input_gaps, output_gaps) = (vec![false], vec![0], vec![0; 2]);
    let mut run =
        Run { name: "turn".into(), time, inputs, held, measured, input_gaps, stated: Vec::new(), output_gaps };
    let exact = response(&model, &run);
    let frequencies = Frequencies::Grid { lowest: None, highest: Some(0.6) };
    let options =
        SpectralOptions { frequencies, nonlinear: Nonlinear::MeasuredRegressors, ..SpectralOptions::default() };
    let (mut squares, mut count) = ([0.0; 2], 0.0);
    for seed in 0..repeats {
        let (mut chance, law) = (ChaCha8Rng::seed_from_u64(seed), Normal::standard());
        let noisy = |(k, y): (usize, &f64)| y + noise[k % 2] * law.inverse_cdf(chance.random_range(1e-12..1.0));
        run.measured = exact.iter().enumerate().map(noisy).collect();
        let fit = fit_spectra(&model, std::slice::from_ref(&run), &options, &Work::default()).expect("an estimate");
        for p in fit.estimate.parameters.iter().filter(|p| ["a", "b", "c", "e", "f"].contains(&p.name.as_str())) {
            let truth = model.definition().params.iter().find(|q| q.quantity.name == p.name).expect("declared").value;
            let off = |error: Option<f64>| ((p.value - truth) / error.expect("determined")).powi(2);
            squares[0] += off(p.standard_error);
            squares[1] += off(p.corrected_error);
            count += 1.0;
        }
    }
    squares.map(|sum| sum / count)
}

#[test]
fn errors_know_the_noise_that_is_carried_in() {
    // as much in both records, and nearly all of it in the one that does not stand in the equations
    for noise in [[0.01, 0.01], [0.2, 0.001]] {
        let [plain, corrected] = deviations_in_errors(noise, 30);
        assert!(plain > 1.4, "nothing to correct: {plain}");
        assert!((0.7..1.35).contains(&corrected), "{plain} {corrected}");
    }
}
