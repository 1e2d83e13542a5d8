//! What runs bring: derivatives of models with known values, groups and angles that wrap, against central differences.

use fdm::Model;
use fdm::record::Run;
use fdm::simulate::Simulator;
use std::collections::BTreeMap;
use support::model;

/// Derivatives by all free params at the start values against central differences; gives the outputs.
fn checked(model: &Model, run: &Run) -> Vec<f64> {
    let params = &model.definition().params;
    let columns: Vec<usize> = (0..params.len()).filter(|k| !params[*k].fixed).collect();
    let mut simulator = Simulator::new(model.dynamics(), run, 4).expect("suited");
    let (rows, stride) = (run.len() * model.layout().outputs, columns.len().div_ceil(8) * 8);
    let (mut y, mut jacobian) = (vec![0.0; rows], vec![f64::NAN; rows * stride]);
    let theta = model.definition().start();
    simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).expect("finite");
    for (lane, column) in columns.iter().enumerate() {
        let h = 1e-5 * theta[*column].abs().max(0.1);
        let mut at = |step: f64| {
            let mut moved = theta.clone();
            moved[*column] += step;
            let mut y = vec![0.0; rows];
            simulator.simulate(&moved, &mut y).expect("finite");
            y
        };
        let (above, below) = (at(h), at(-h));
        let scale = (0..rows).map(|r| jacobian[r * stride + lane].abs()).fold(0.0, f64::max);
        for r in 0..rows {
            let (exact, central) = (jacobian[r * stride + lane], (above[r] - below[r]) / (2.0 * h));
            assert!(
                (exact - central).abs() <= 1e-7 * scale.max(1e-3),
                "{}: {exact}, {central}",
                params[*column].quantity.name
            );
        }
    }
    y
}

const COOLING: &str = "model m {
  known T0 per run [K], c per run;
  input u [K];
  state T [K] = T0;
  param k = 0.3 in [0, 10] [1/s] per group make, e = 1.1 [1];
  prior k ~ normal(0.3, 0.1);
  let   rate = k*exp(c);
  der(T) = -rate*(T - e*u);
  output y [K] = T + 0.1*T0;
}";

fn record(model: &Model, group: &str) -> Run {
    let time: Vec<f64> = (0..40).map(|k| 0.1 * f64::from(k)).collect();
    let u: Vec<f64> = time.iter().map(|t| 290.0 + t.sin()).collect();
    let run = model.run("r").times(time).samples("u", u).known("T0", 350.0).known("c", 0.2).group("make", group);
    run.without_outputs().build().expect("a run")
}

#[test]
fn values_and_groups_have_exact_derivatives() {
    let alone = model(COOLING);
    assert_eq!(alone.groupings(), ["make"]);
    let groups = BTreeMap::from([("make".to_string(), vec!["A".to_string(), "B".to_string()])]);
    let grouped = alone.grouped(groups).expect("grouped");
    let names: Vec<&str> = grouped.definition().params.iter().map(|p| p.quantity.name.as_str()).collect();
    assert!(names.starts_with(&["k[A]", "k[B]", "e"]), "{names:?}");
    assert!(grouped.definition().params[..2].iter().all(|p| p.prior.is_some()), "the prior holds for each");
    let shared = checked(&alone, &record(&alone, "A"));
    for (group, own, other) in [("A", 0, 1), ("B", 1, 0)] {
        let mut params = grouped.definition().params.clone();
        params[other].value = 0.7;
        let moved = grouped.with_params(params);
        let run = record(&moved, group);
        // the same numbers but for the sum of two products, one of them with 0
        let y = checked(&moved, &run);
        assert!(y.iter().zip(&shared).all(|(a, b)| a == b), "{group}: only its own value counts ({own})");
    }
    let missing = grouped.run("r").times(vec![0.0, 1.0]).samples("u", vec![0.0, 0.0]).known("T0", 1.0).known("c", 1.0);
    let said = missing.without_outputs().build().expect_err("no group").to_string();
    assert!(said.contains("make=A"), "{said}");
}

#[test]
fn an_angle_that_wraps_is_turned_towards_its_measurement() {
    let text = |wrap: &str| {
        format!(
            "model m {{ input r; state psi = 10, x = 1, y = 0; param g = 30, w = 2;
        der(psi) = g*r; der(x) = -w*y; der(y) = w*x;
        output a {wrap} = psi, b {} = atan2(y, x); }}",
            wrap.replace("360", "2*pi")
        )
    };
    let (plain, wrapping) = (model(&text("")), model(&text("wrap 360")));
    let time: Vec<f64> = (0..60).map(|k| 0.25 * f64::from(k)).collect();
    let r: Vec<f64> = time.iter().map(|t| 1.0 + 0.3 * t.sin()).collect();
    let free = plain.run("r").times(time.clone()).samples("r", r.clone()).without_outputs().build().expect("a run");
    let y = checked(&plain, &free);
    // the records go round in [0, 360), and a quarter of a turn ahead
    let a: Vec<f64> = y.iter().step_by(2).map(|a| (a + 90.0).rem_euclid(360.0)).collect();
    let b: Vec<f64> = y.iter().skip(1).step_by(2).map(|b| (b + 1.0).rem_euclid(std::f64::consts::TAU)).collect();
    let measured =
        wrapping.run("r").times(time).samples("r", r).samples("a", a).samples("b", b).build().expect("a run");
    let turned = checked(&wrapping, &measured);
    for (k, (z, y)) in measured.measured.iter().zip(&turned).enumerate() {
        let ahead = if k % 2 == 0 { 90.0 } else { 1.0 };
        assert!((z - y - ahead).abs() < 1e-9, "{k}: {z} {y}");
    }
}
