//! Bands against closed forms, and how often they hold.

use super::{Errors, Predicted};
use fdm_numeric::random::Stream;
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::Steps;

fn run(model: &Model, u: &[f64], y: &[f64]) -> Run {
    let time: Vec<f64> = (0..u.len()).map(|k| 0.1 * k as f64).collect();
    model.run("r").times(time).samples("u", u.to_vec()).samples("y", y.to_vec()).build().unwrap()
}

#[test]
fn a_line_has_the_band_of_a_line_and_a_bias_takes_its_part() {
    let model = Model::from_text("m", "model m { input u; param a = 2, b = 0 per run; output y = a*u + b; }").unwrap();
    let u: Vec<f64> = (0..40).map(f64::from).collect();
    let run = run(&model, &u, &u);
    let no = Errors { columns: &[], covariance: &[] };
    let one = Predicted {
        model: &model,
        run: &run,
        steps: Steps::from(1),
        theta: &[2.0, 0.0],
        errors: Errors { columns: &[0], covariance: &[0.04] },
        anew: no,
        noise: &[0.5],
        freedom: None,
    };
    let bands = one.bands().unwrap();
    for (k, u) in u.iter().enumerate() {
        assert!((bands.response[k] - 1.959_964 * 0.2 * u).abs() < 1e-5);
        assert!((bands.measurement[k] - 1.959_964 * (0.04 * u * u + 0.25).sqrt()).abs() < 1e-5);
    }
    // the bias of the run takes the mean of what the slope does wrong
    let anew = Predicted { anew: Errors { columns: &[1], covariance: &[0.25 / 40.0] }, ..one };
    let bands = anew.bands().unwrap();
    for (k, u) in u.iter().enumerate() {
        let off = u - 19.5;
        assert!((bands.response[k] - 1.959_964 * (0.04 * off * off + 0.25 / 40.0).sqrt()).abs() < 1e-5);
    }
}

#[test]
fn bands_hold_as_often_as_they_say() {
    // a line with its bias in the predicted run: what a fit of forty samples leaves open
    let model = Model::from_text("m", "model m { input u; param a = 2, b = 0 per run; output y = a*u + b; }").unwrap();
    let u: Vec<f64> = (0..30).map(|k| f64::from(k % 7) - 3.0).collect();
    let zeros = vec![0.0; u.len()];
    let run = run(&model, &u, &zeros);
    let mut stream = Stream::seeded(11);
    let (deviation, noise) = (0.05, 0.3);
    let mean = u.iter().sum::<f64>() / 30.0;
    let own = noise * noise / 30.0;
    let (mut response, mut measured, mut all) = (0, 0, 0);
    for _ in 0..400 {
        let a = 2.0 + deviation * stream.normal();
        let data: Vec<f64> = u.iter().map(|u| 2.0 * u + 1.0 + noise * stream.normal()).collect();
        let b = data.iter().sum::<f64>() / 30.0 - a * mean;
        let predicted = Predicted {
            model: &model,
            run: &run,
            steps: Steps::from(1),
            theta: &[a, b],
            errors: Errors { columns: &[0], covariance: &[deviation * deviation] },
            anew: Errors { columns: &[1], covariance: &[own] },
            noise: &[noise],
            freedom: None,
        };
        let bands = predicted.bands().unwrap();
        for (k, u) in u.iter().enumerate() {
            let off = a * u + b - 2.0 * u - 1.0;
            response += u32::from(off.abs() <= bands.response[k]);
            measured += u32::from((off + noise * stream.normal()).abs() <= bands.measurement[k]);
            all += 1;
        }
    }
    let share = |hits: u32| f64::from(hits) / f64::from(all);
    assert!(
        (share(response) - 0.95).abs() < 0.02 && (share(measured) - 0.95).abs() < 0.01,
        "{response} {measured} of {all}"
    );
}

#[test]
fn noise_that_varies_widens_the_band_where_it_is_large() {
    let model =
        Model::from_text("m", "model m { input u; param a = 2, s = 0.1; output y = a*u; noise y = s + 0.5*abs(u); }")
            .unwrap();
    let u: Vec<f64> = (0..10).map(f64::from).collect();
    let run = run(&model, &u, &u);
    let no = Errors { columns: &[], covariance: &[] };
    let theta = [2.0, 0.1];
    let predicted = Predicted {
        model: &model,
        run: &run,
        steps: Steps::from(1),
        theta: &theta,
        errors: no,
        anew: no,
        noise: &[f64::NAN],
        freedom: None,
    };
    let bands = predicted.bands().unwrap();
    for (k, u) in u.iter().enumerate() {
        assert!((bands.measurement[k] - 1.959_964 * (0.1 + 0.5 * u)).abs() < 1e-5 && bands.response[k] == 0.0);
    }
    assert_eq!(bands.covered(0, 1, &[0.0; 10]), Some(1.0));
}
