//! Inputs that were measured with noise: coefficients before them are drawn towards zero, unless the noise is known.

use fdm::estimate::{SpectralOptions, Work, fit_spectra};
use fdm::record::Run;
use fdm::simulate::Simulator;
use fdm::spectrum::Frequencies;
use fdm::{Model, model};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use statrs::distribution::{ContinuousCDF, Normal};

/// Rates of pitch that hear a sideslip, which a vane measures.
fn pitching() -> Model {
    model! {
        model pitch {
            input d, beta;
            state q;
            param Mq = -1.2, Mb = -2, Md = 1.5;
            der(q) = Mq*q + Mb*beta + Md*d;
            output q_m = q;
        }
    }
}

/// Normal deviates of which neighbours correlate.
fn noise(samples: usize, kept: f64, seed: u64) -> Vec<f64> {
    let (mut chance, law) = (ChaCha8Rng::seed_from_u64(seed), Normal::standard());
    let mut fresh = move || law.inverse_cdf(chance.random_range(1e-12..1.0));
    let mut state = fresh();
    let next = |_| {
        let now = state;
        state = kept * now + (1.0 - kept * kept).sqrt() * fresh();
        now
    };
    (0..samples).map(next).collect()
}

/// Of the coefficient of the sideslip over repeats, in its scatter: how far its likeliest values are off in the mean, and the reported ones; then the mean
/// square of the latter's deviations in reported errors.
fn repeated(deviation: f64, kept: f64, repeats: u64) -> [f64; 3] {
    let model = pitching();
    let time: Vec<f64> = (0..500).map(|k| 0.05 * f64::from(k)).collect();
    let moved = |t: &f64| {
        [0.1 * (1.7 * t).sin() + 0.05 * (0.02 * t * t).cos(), 0.06 * ((0.9 * t + 1.0).sin() - (2.6 * t).cos())]
    };
    let inputs = time.iter().flat_map(moved).collect();
    let (held, input_gaps, output_gaps) = (vec![false; 2], vec![0; 2], vec![0]);
    let measured = vec![f64::NAN; time.len()];
    let flown =
        Run { name: "flight".into(), time, inputs, held, measured, input_gaps, stated: Vec::new(), output_gaps };
    let mut exact = vec![0.0; flown.len()];
    let mut simulator = Simulator::new(model.dynamics(), &flown, 4).expect("the run suits the model");
    simulator.simulate(&model.definition().start(), &mut exact).expect("stable");
    let options = SpectralOptions {
        frequencies: Frequencies::Grid { lowest: None, highest: Some(1.0) },
        input_noise: vec![("beta".into(), deviation)],
        ..SpectralOptions::default()
    };
    let (mut likeliest, mut reported, mut squares) = (Vec::new(), Vec::new(), 0.0);
    for seed in 0..repeats {
        let mut run = flown.clone();
        let vane = run.inputs.iter_mut().skip(1).step_by(2);
        vane.zip(noise(flown.len(), kept, 2 * seed)).for_each(|(v, n)| *v += deviation * n);
        let gyro = noise(flown.len(), 0.0, 2 * seed + 1);
        run.measured = exact.iter().zip(gyro).map(|(y, n)| y + 0.01 * n).collect();
        let fit = fit_spectra(&model, &[run], &options, &Work::default()).expect("an estimate");
        let found = fit.estimate.parameter("Mb", None).expect("declared");
        let corrected = fit.estimate.bias_corrections.iter().find(|d| d.name == "Mb").expect("a noisy input");
        squares += ((found.value + 2.0) / found.corrected_error.expect("determined")).powi(2);
        likeliest.push(corrected.maximum_likelihood + 2.0);
        reported.push(found.value + 2.0);
    }
    let mean = |v: &[f64]| v.iter().sum::<f64>() / repeats as f64;
    let scatter = |v: &[f64]| (v.iter().map(|x| (x - mean(v)).powi(2)).sum::<f64>() / (repeats - 1) as f64).sqrt();
    [mean(&likeliest) / scatter(&likeliest), mean(&reported) / scatter(&reported), squares / repeats as f64]
}

#[test]
fn what_noise_of_an_input_has_drawn_is_taken_off() {
    for (deviation, kept) in [(0.08, 0.0), (0.03, 0.9)] {
        let [likeliest, reported, square] = repeated(deviation, kept, 40);
        assert!(likeliest > 0.8, "nothing was drawn: {likeliest}");
        // the mean of 40 is known to 0.16
        assert!(reported.abs() < 0.5, "{likeliest} {reported}");
        assert!((0.55..1.6).contains(&square), "{deviation} {kept}: {square}");
    }
}

#[test]
fn without_noise_nothing_is_drawn() {
    let model = pitching();
    let time: Vec<f64> = (0..200).map(|k| 0.1 * f64::from(k)).collect();
    let inputs = time.iter().flat_map(|t| [(1.3 * t).sin(), (0.7 * t).cos() - 1.0]).collect();
    let (held, input_gaps, output_gaps) = (vec![false; 2], vec![0; 2], vec![0]);
    let measured = noise(time.len(), 0.0, 1);
    let run = Run { name: "flight".into(), time, inputs, held, measured, input_gaps, stated: Vec::new(), output_gaps };
    for input_noise in [Vec::new(), vec![("beta".into(), 0.0)]] {
        let options = SpectralOptions { input_noise, ..SpectralOptions::default() };
        let fit = fit_spectra(&model, std::slice::from_ref(&run), &options, &Work::default()).expect("an estimate");
        assert!(fit.estimate.bias_corrections.is_empty());
    }
}
