//! Vectors, matrices and submodels from text to estimate: names in files, eigenvalues, the numbers of scalar models.

use fdm::Model;
use fdm::linear::{LinearModel, Modes, Values};
use fdm::record::{Column, ReadOptions, channels, read, write};
use fdm_grammar::Code;
use num_complex::Complex64;
use support::model;

fn eigenvalues(path: &str) -> Vec<Complex64> {
    let path = support::repository().join("models/hover").join(path);
    let model = Model::from_file(path).unwrap_or_else(|mistakes| panic!("{mistakes}"));
    // a vector of speeds and angles has no unit
    assert!(model.warnings().iter().all(|w| w.code == Code::UnitUnknown), "{:?}", model.warnings());
    let mut linear = LinearModel::new(&model).expect("a trim");
    let mut values = Values::default();
    linear.evaluate(&model.definition().start(), &mut values).expect("a trim");
    let modes = Modes::new(linear.structure(), &values).expect("modes");
    modes.modes.iter().map(|m| m.s).collect()
}

#[test]
fn a_helicopter_is_the_same_as_matrices_as_equations_and_as_a_rigid_body() {
    let matrices = eigenvalues("matrices.fdm");
    assert_eq!(matrices.len(), 9);
    for other in ["linear.fdm", "model.fdm"] {
        let other = eigenvalues(other);
        for (a, b) in matrices.iter().zip(&other) {
            assert!((a - b).norm() < 1e-9, "{matrices:?}\n{other:?}");
        }
    }
    // as Ren & Feng print them
    let printed =
        [(0.0, 0.0), (-2.38, 0.0), (-1.03, 0.0), (-0.473, 0.0), (-0.310, 0.0), (0.021, 1.035), (0.231, 0.568)];
    for (re, im) in printed {
        let nearest = matrices.iter().map(|s| (s - Complex64::new(re, im)).norm()).fold(f64::INFINITY, f64::min);
        assert!(nearest < 0.01, "{re} + {im}j: {matrices:?}");
    }
}

#[test]
fn columns_of_elements_are_read_and_written() {
    let model = model(
        "model m { input u[2] [deg]; state x[2]; param k = 1; der(x) = -k*x + u; output y[2] [deg] = x, Y[1, 2] = transpose(x); }",
    );
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("data.csv");
    let values = [0.0, 1.0, 2.0];
    let names =
        [("t", Some("s")), ("u[1]", Some("rad")), ("u[2]", Some("deg")), ("y[1]", Some("deg")), ("Y[1,1]", None)];
    let names = names.into_iter().chain([("y[2]", None), ("Y[1,2]", None)]);
    let columns: Vec<Column> = names.map(|(name, unit)| Column { name, unit, values: &values }).collect();
    write(&path, &columns).expect("written");
    let text = std::fs::read_to_string(&path).expect("text");
    assert!(text.starts_with("t [s],u[1] [rad],u[2] [deg],y[1] [deg],\"Y[1,1]\",y[2],\"Y[1,2]\"\n"), "{text}");
    let (run, _) = read(&path, &channels(model.definition()), &ReadOptions::default()).expect("a record");
    assert_eq!(run.measured, [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0]);
    let degrees = 180.0 / std::f64::consts::PI;
    assert!((run.inputs[2] - degrees).abs() < 1e-12 || (run.inputs[1] - degrees).abs() < 1e-12, "{:?}", run.inputs);
}
