//! The record of a model helicopter: sticks that were recorded late, found in the frequency domain, and what that is worth behind the data.

use fdm::Model;
use fdm::estimate::{Changes, SpectralFit, SpectralOptions, Work, changed, fit_spectra};
use fdm::frequency::EndTerms;
use fdm::record::{ReadOptions, Run, channels, read};
use fdm::spectrum::Frequencies;

const FOLDER: &str = "models/trex550";

fn half(model: &Model, file: &str) -> Run {
    let path = support::repository().join(FOLDER).join(file);
    read(&path, &channels(model.definition()), &ReadOptions { require_outputs: true, ..ReadOptions::default() })
        .unwrap()
        .0
}

/// The fit of one half, and Theil's coefficient of both rates in the other.
fn predicted(model: &Model, from: &str, to: &str) -> (SpectralFit, Vec<f64>) {
    let options = SpectralOptions {
        frequencies: Frequencies::Grid { lowest: Some(0.05), highest: Some(1.2) },
        ends: EndTerms::Unknown,
        finish: false,
        ..SpectralOptions::default()
    };
    let fit = fit_spectra(model, &[half(model, from)], &options, &Work::default()).unwrap();
    let behind = fit.predict(&[half(model, to)], &Work::default()).unwrap();
    let tic = behind.quality.iter().map(|q| q.fit.tic.unwrap()).collect();
    (fit, tic)
}

fn model(file: &str) -> Model {
    Model::from_file(support::repository().join(FOLDER).join(file)).unwrap()
}

const HALVES: [&str; 2] = ["first_half.csv", "second_half.csv"];

/// The structure was chosen inside the first half (studies/trex550.rs), that of the rigid body too.
#[test]
fn late_sticks_are_found_and_roll_is_predicted_better_than_by_any_rigid_body() {
    let known = || ["skew", "Llon", "Lq"].map(String::from);
    let changes = Changes { set: known().map(|name| (name, 0.0)).into(), fix: known().into(), ..Changes::default() };
    let rigid = changed(&model("coupled.fdm"), &changes).unwrap();
    for [from, to] in [HALVES, [HALVES[1], HALVES[0]]] {
        let (fit, tic) = predicted(&model("model.fdm"), from, to);
        assert!(fit.is_good(), "{}", fit.estimate.termination);
        let skew = fit.estimate.parameter("skew", None).unwrap();
        let error = skew.corrected_error.unwrap();
        assert!((skew.value + 0.19).abs() < 0.03 && error < 0.04, "{} ± {error}", skew.value);
        let (least, without) = predicted(&rigid, from, to);
        // what leads its cause has no rigid body: the damping runs to its bound
        assert_eq!(least.estimate.parameter("Lp", None).unwrap().value, -30.0);
        // and pitch gains nothing
        assert!(tic[0] < 0.9 * without[0] && (tic[1] / without[1] - 1.0).abs() < 0.05, "{tic:?} {without:?}");
        let (_, uncoupled) = predicted(&model("rigid_body.fdm"), from, to);
        assert!(tic[0] < 0.9 * uncoupled[0] && tic[1] < 0.95 * uncoupled[1], "{tic:?} {uncoupled:?}");
    }
}
