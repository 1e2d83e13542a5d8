//! Lines beside central differences, closed forms and the record in time.
#![allow(clippy::unwrap_used)]

use super::bins::SpectralBins;
use super::options::SpectralOptions;
use crate::problem::response::Response;
use fdm_system::frequency::EndTerms;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::spectrum::Frequencies;

const MODEL: &str = "model m { input u; state x, z; param a = -1, b = 2, tau = 0.2 in [0, 3];
    der(x) = a*x + b*delay(u, tau); der(z) = x - z; output y = x + 0.5*z, v = z; }";

fn lines(frequencies: Frequencies, ends: EndTerms) -> (SpectralBins, Model, Run) {
    let (n, dt) = (120, 0.1);
    let time: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
    let run = Run {
        name: "r".into(),
        inputs: time.iter().map(|t| (1.3 * t + 0.4).sin() + 0.2 * t).collect(),
        measured: time.iter().flat_map(|t| [(0.9 * t).sin() + 0.3 * t, (1.4 * t).cos() - 0.1 * t]).collect(),
        time,
        held: vec![false],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0; 2],
    };
    let model = Model::from_text("m.fdm", MODEL).unwrap();
    let options = SpectralOptions { frequencies, ends, ..SpectralOptions::default() };
    (SpectralBins::new(&model, std::slice::from_ref(&run), &options).unwrap(), model, run)
}

#[test]
fn columns_are_central_differences_of_parameters_ends_and_drifts() {
    let band = Frequencies::Band { lowest: 0.2, highest: 2.0, spacing: Some(0.13) };
    for frequencies in [Frequencies::Grid { lowest: None, highest: Some(2.0) }, band] {
        let (lines, model, _) = lines(frequencies, EndTerms::Unknown);
        let mut response = lines.response(0).unwrap();
        let theta: Vec<f64> = model
            .definition()
            .start()
            .into_iter()
            .chain((0..lines.own().count()).map(|k| 0.3 + 0.1 * k as f64))
            .collect();
        let cells = response.samples() * response.outputs();
        response.weigh((0..cells).map(|k| 1.0 + 0.01 * k as f64).collect());
        // not in order, and not all
        let columns: Vec<usize> = (0..theta.len()).rev().filter(|k| *k != 3).collect();
        let (mut y, mut jacobian) = (vec![0.0; cells], vec![0.0; cells * columns.len()]);
        response.columns(&theta, &columns, &mut y, (&mut jacobian, columns.len())).unwrap();
        for (c, column) in columns.iter().enumerate() {
            let mut at = |h: f64| {
                let mut theta = theta.clone();
                theta[*column] += h;
                let mut y = vec![0.0; cells];
                response.simulate(&theta, &mut y).unwrap();
                y
            };
            let (above, below) = (at(1e-5), at(-1e-5));
            for k in 0..cells {
                let (central, exact) = ((above[k] - below[k]) / 2e-5, jacobian[k * columns.len() + c]);
                assert!(
                    (central - exact).abs() < 1e-5 * (1.0 + exact.abs()),
                    "column {column}, cell {k}: {exact} {central}"
                );
            }
        }
    }
}

/// A straight line is a drift and nothing else.
#[test]
fn what_a_run_has_for_itself_is_found() {
    let (lines, model, _) = lines(Frequencies::Grid { lowest: None, highest: Some(3.0) }, EndTerms::Omitted);
    let names: Vec<&str> = lines.own().collect();
    assert_eq!(names, ["drift(y)", "drift(v)"]);
    let mut response = lines.response(0).unwrap();
    let theta = model.definition().start();
    let mut y = vec![0.0; response.samples() * response.outputs()];
    response.simulate(&[&theta[..], &[0.7, -0.2]].concat(), &mut y).unwrap();
    let own = response.settle(&theta, &y).unwrap();
    assert!((own[0] - 0.7).abs() < 1e-9 && (own[1] + 0.2).abs() < 1e-9, "{own:?}");
}

/// White noise has the variance of its samples in every line, and a course in time is that of the record in the band.
#[test]
fn lines_have_the_variance_of_samples() {
    let (lines, _, run) = lines(Frequencies::Grid { lowest: None, highest: Some(4.9) }, EndTerms::Unknown);
    let measured = lines.measured(0);
    let course = lines.course(0, &measured, 2);
    let power = |values: &[f64]| {
        let column: Vec<f64> = values.iter().skip(1).step_by(2).copied().collect();
        let mean = column.iter().sum::<f64>() / column.len() as f64;
        column.iter().map(|v| (v - mean).powi(2)).sum::<f64>()
    };
    let of_lines: f64 = measured.iter().skip(1).step_by(2).map(|v| v * v).sum();
    let of_samples = power(&run.measured);
    assert!((of_lines / of_samples - 1.0).abs() < 0.1, "{of_lines} {of_samples}");
    assert!((power(&course) / of_samples - 1.0).abs() < 0.1, "{} {of_samples}", power(&course));
}
