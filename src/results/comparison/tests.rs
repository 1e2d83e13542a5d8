//! Comparisons of written results whose figures are known.

use super::*;
use crate::documents::specimen::{fit, parameter};
use crate::documents::{FitDocument, Matrix};
use crate::store::{Contents, DataFile, Destination, Identity, Manifest, ResultFolder};
use fdm_estimate::{FitOptions, Noise};
use fdm_system::model::Model;
use std::path::Path;

const TEXT: &str = "model m { param a = 1, b = 0, c = 0; output y = a + b + c; }";

/// A result of 100 samples whose errors are twice those of white noise.
fn candidate(folder: &Path, name: &str, free: &[&str], cost: f64, sha: &str, noise: Noise) -> Candidate {
    let model = Model::from_text("m.fdm", TEXT).unwrap();
    let options = FitOptions::default();
    let mut manifest = Manifest::new(&model, Identity::of(&model, &[], &options), noise);
    let (run, file, sha256) = ("one".to_string(), "one.csv".to_string(), Some(sha.to_string()));
    manifest.data = vec![DataFile { run, file, path: None, bytes: None, sha256, reading: None }];
    let p = free.len();
    // parameters of different size, correlated; the corrected covariance is four times as large
    let matrix = |factor: f64| {
        let size = |k: usize| 10f64.powi(k as i32);
        let row = |i: usize| (0..p).map(move |j| factor * size(i) * size(j) * if i == j { 1.0 } else { 0.5 });
        (0..p).map(|i| row(i).collect::<Vec<f64>>()).collect::<Vec<_>>()
    };
    let matrix = |factor: f64| Matrix { parameters: (0..p).collect(), values: matrix(factor) };
    let result = FitDocument {
        cost: Some(cost),
        covariance: matrix(1.0),
        corrected_covariance: matrix(4.0),
        ..fit(free.iter().map(|name| parameter(name, None, 1.0, Some([0.1, 0.2]))).collect())
    };
    let (model, used, quality, others) = (TEXT.into(), Vec::new(), Vec::new(), Vec::new());
    let contents = Contents { manifest, model, used, result: result.into(), quality, others };
    let place = folder.join(name);
    contents.write(&Destination::prepare(&place).unwrap()).unwrap();
    Candidate::new(&ResultFolder::open(&place).unwrap())
}

#[test]
fn criteria_are_those_of_the_definitions() {
    let folder = tempfile::tempdir().unwrap();
    let of = |name: &str, free: &[&str], cost: f64| candidate(folder.path(), name, free, cost, "x", Noise::Diagonal);
    let found = compare(vec![of("p", &["a"], -40.0), of("r", &["a", "b"], -50.0)]);
    let [poor, rich] = [0, 1].map(|k| found.candidates[k].criteria.unwrap());
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} and {b}");
    near(found.inflation.unwrap(), 4.0);
    near(poor.aic - rich.aic, 20.0 - 2.0);
    near(poor.bic - rich.bic, 20.0 - 100f64.ln());
    near(poor.coloured_aic.unwrap() - rich.coloured_aic.unwrap(), 20.0 / 4.0 - 2.0);
    near(poor.coloured_bic.unwrap() - rich.coloured_bic.unwrap(), 20.0 / 4.0 - 25f64.ln());
    assert_eq!((rich.aic, rich.coloured_bic), (0.0, Some(0.0)));
    let [nesting] = &found.nestings[..] else { panic!("{:?}", found.nestings) };
    assert_eq!((nesting.poorer.as_str(), nesting.richer.as_str(), nesting.further), ("p", "r", 1));
    // one output: the ratio of the sums of squares is exp(20/100)
    near(nesting.f, (0.2f64.exp() - 1.0) * 98.0 / 4.0);
    assert_eq!(nesting.degrees, (1.0, 23.0));
    // tables of F(1, 23): 4.28 at 5 %, 7.88 at 1 %
    assert!((0.01..0.05).contains(&nesting.p_value), "{nesting:?}");
}

#[test]
fn what_cannot_be_compared_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let of = |name: &str, sha: &str, noise: Noise| candidate(folder.path(), name, &["a"], -1.0, sha, noise);
    let given = Noise::Given(vec![Some(0.1)]);
    let found = compare(vec![of("a", "x", Noise::Diagonal), of("b", "z", Noise::Diagonal), of("c", "x", given)]);
    let said: Vec<&str> = found.candidates.iter().map(|c| c.incomparable.as_deref().unwrap_or_default()).collect();
    assert_eq!(said, ["", "it was not fitted to the data of a", "it assumes another noise than a"]);
    assert!(found.candidates[1].criteria.is_none() && found.nestings.is_empty());
    let twice = compare(vec![of("a", "x", Noise::Diagonal), of("a", "x", Noise::Diagonal)]);
    assert_eq!(twice.candidates[1].name, "a#2");
}
