//! The record of a model helicopter: sticks that were recorded late, found in the frequency domain, and what that is worth behind the data.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use fdm::Model;
use fdm::estimate::{SpectralFit, SpectralOptions, fit_spectra};
use fdm::frequency::EndTerms;
use fdm::record::{ReadOptions, Run, channels, read};
use fdm::spectrum::Frequencies;
use std::path::Path;

const FOLDER: &str = "models/trex550";

fn half(model: &Model, file: &str) -> Run {
    let path = Path::new(FOLDER).join(file);
    read(&path, &channels(model.definition()), &ReadOptions { require_outputs: true, ..ReadOptions::default() })
        .unwrap()
        .0
}

/// The fit of the first half, and Theil's coefficient of every output in the second.
fn predicted(file: &str) -> (SpectralFit, Vec<f64>) {
    let model = Model::from_file(Path::new(FOLDER).join(file)).unwrap();
    let options = SpectralOptions {
        frequencies: Frequencies::Grid { lowest: Some(0.05), highest: Some(1.2) },
        ends: EndTerms::Unknown,
        finish: false,
        ..SpectralOptions::default()
    };
    let fit = fit_spectra(&model, &[half(&model, "first_half.csv")], &options, &mut ()).unwrap();
    let behind = fit.predict(&[half(&model, "second_half.csv")], &mut ()).unwrap();
    let tic = behind.quality.iter().map(|q| q.fit.tic.unwrap()).collect();
    (fit, tic)
}

#[test]
fn late_sticks_are_found_and_predict_better_than_a_rigid_body() {
    let (fit, tic) = predicted("model.fdm");
    assert!(fit.is_good(), "{}", fit.estimate.termination);
    let skew = fit.estimate.parameter("skew", None).unwrap();
    let error = skew.corrected_error.unwrap();
    assert!((skew.value + 0.18).abs() < 0.03 && error < 0.04, "{} ± {error}", skew.value);
    let (rigid, without) = predicted("rigid_body.fdm");
    // what leads its cause has no rigid body: the damping runs to its bound
    let damping = rigid.estimate.parameter("Lp", None).unwrap();
    assert_eq!(damping.value, -30.0);
    assert!(tic[0] < 0.9 * without[0] && tic[1] < 0.95 * without[1], "{tic:?} {without:?}");
}
