//! Few frequencies: the weights of the outputs are uncertain too, and errors know it.

use fdm::estimate::{SpectralOptions, Work, fit_spectra, quantile};
use fdm::model;
use fdm::record::Run;
use fdm::simulate::Simulator;
use fdm::spectrum::Frequencies;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use statrs::distribution::{ContinuousCDF, Normal};

/// Per cent of intervals that hold the truth over 400 repeats with frequencies up to `highest`: by Cramer-Rao errors, and as reported.
fn coverage(highest: f64) -> [f64; 2] {
    let model = model! {
        model lag {
            input u;
            state x;
            param a = -0.8, b = 1.3;
            der(x) = a*x + b*u;
            output slow = x, fast = a*x + b*u, both = x + u;
        }
    };
    let time: Vec<f64> = (0..300).map(|k| 0.05 * f64::from(k)).collect();
    let inputs: Vec<f64> = time.iter().map(|t| (1.1 * t).sin() + (0.45 * t).cos() - 1.0).collect();
    let (held, input_gaps, output_gaps) = (vec![false], vec![0], vec![0; 3]);
    let measured = vec![f64::NAN; 3 * time.len()];
    let mut run = Run { name: "few".into(), time, inputs, held, measured, input_gaps, stated: Vec::new(), output_gaps };
    let mut exact = run.measured.clone();
    let mut simulator = Simulator::new(model.dynamics(), &run, 4).expect("the run suits the model");
    simulator.simulate(&model.definition().start(), &mut exact).expect("stable");
    let options = SpectralOptions {
        frequencies: Frequencies::Grid { lowest: None, highest: Some(highest) },
        finish: false,
        ..SpectralOptions::default()
    };
    let (mut plain, mut held, mut all) = (0.0, 0.0, 0.0);
    for seed in 0..400 {
        let (mut chance, law) = (ChaCha8Rng::seed_from_u64(seed), Normal::standard());
        run.measured = exact.iter().map(|y| y + 0.02 * law.inverse_cdf(chance.random_range(1e-12..1.0))).collect();
        let fit = fit_spectra(&model, std::slice::from_ref(&run), &options, &Work::default()).expect("an estimate");
        for (name, truth) in [("a", -0.8), ("b", 1.3)] {
            let found = fit.estimate.parameter(name, None).expect("declared");
            let off = (found.value - truth).abs();
            all += 1.0;
            plain += f64::from(off < quantile(None) * found.standard_error.expect("determined"));
            held += f64::from(off < (found.interval().expect("determined")[1] - found.value));
        }
    }
    [plain, held].map(|hits| 100.0 * hits / all)
}

#[test]
fn intervals_hold_where_outputs_are_weighed_by_few_numbers() {
    // eight frequencies, sixteen; known to 0.8
    for highest in [0.6, 1.2] {
        let [plain, held] = coverage(highest);
        assert!(plain < 93.5, "nothing to correct: {plain}");
        assert!((92.5..97.0).contains(&held) && held > plain + 1.0, "{highest} Hz: {plain} {held}");
    }
}
