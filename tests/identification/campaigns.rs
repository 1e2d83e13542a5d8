//! What runs bring: derivatives of models with known values, groups and angles that wrap, against central differences.

use fdm::Model;
use fdm::estimate::{FitOptions, Work, fit};
use fdm::record::Run;
use fdm::simulate::Simulator;
use std::collections::BTreeMap;
use support::{Normal, model};

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

/// Eight flights from other trims: each has angles of attack and of the elevator of its own about which one linear model holds.
#[test]
fn runs_at_other_trims_fit_one_model() {
    let short_period = model(
        "model short_period {
  input  de [rad];
  param  alpha_0 = 0 per run [rad] \"angle of attack in trim\", de_0 = 0 per run [rad] \"elevator in trim\";
  state  alpha = free [rad], q = free [rad/s];
  param  Za = -0.8 [1/s], Ma = -3 [1/s^2], Mq = -1 [1/s], Md = -5 [1/s^2];
  der(alpha) = Za*(alpha - alpha_0) + q;
  der(q) = Ma*(alpha - alpha_0) + Mq*q + Md*(de - de_0);
  output alpha_m [rad] = alpha, q_m [rad/s] = q;
}",
    );
    const DT: f64 = 0.05;
    let truth = [("Za", -1.1), ("Ma", -4.2), ("Mq", -1.6), ("Md", -7.5)];
    let [za, ma, mq, md] = truth.map(|(_, value)| value);
    let trims: Vec<(f64, f64)> = (0..8).map(|k| (0.02 + 0.02 * f64::from(k), -0.01 - 0.012 * f64::from(k))).collect();
    let flown = |number: usize, (alpha_0, de_0): (f64, f64)| {
        let mut noise = Normal(40 + number as u64);
        let (mut inputs, mut measured) = (Vec::new(), Vec::new());
        // it begins off its trim, as no flight is trimmed altogether
        let mut x = [alpha_0 + 0.01 * noise.next(), 0.02 * noise.next()];
        let elevator = |t: f64| {
            let phase = 1.0 + 0.7 * number as f64;
            de_0 + 0.03 * ((1.7 * t + phase).sin() - phase.sin()) + if (2.0..3.5).contains(&t) { 0.04 } else { 0.0 }
        };
        for k in 0..240 {
            let t = DT * f64::from(k);
            let de = elevator(t);
            inputs.push(de);
            measured.extend([x[0] + 0.001 * noise.next(), x[1] + 0.002 * noise.next()]);
            let next = elevator(t + DT);
            let rates = |x: [f64; 2], part: f64| {
                let u = de + part * (next - de) - de_0;
                let a = x[0] - alpha_0;
                [za * a + x[1], ma * a + mq * x[1] + md * u]
            };
            let steps = 10;
            let h = DT / f64::from(steps);
            for step in 0..steps {
                let part = f64::from(step) / f64::from(steps);
                let ahead = |k: [f64; 2], by: f64| [x[0] + by * k[0], x[1] + by * k[1]];
                let a = rates(x, part);
                let b = rates(ahead(a, h / 2.0), part + 0.5 / f64::from(steps));
                let c = rates(ahead(b, h / 2.0), part + 0.5 / f64::from(steps));
                let d = rates(ahead(c, h), part + 1.0 / f64::from(steps));
                x = [0, 1].map(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
            }
        }
        Run {
            name: format!("flight {number}"),
            time: (0..240).map(|k| DT * f64::from(k)).collect(),
            held: vec![false],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0; 2],
            inputs,
            measured,
        }
    };
    let runs: Vec<Run> = trims.iter().enumerate().map(|(k, trim)| flown(k, *trim)).collect();
    for count in [2, 8] {
        let found = fit(&short_period, &runs[..count], &FitOptions::default(), &Work::default()).expect("a fit");
        assert!(found.estimate.is_good(), "{}", found.estimate.termination);
        let off = |name: &str, run: Option<&str>, truth: f64| {
            let p = found.estimate.parameter(name, run).expect("estimated");
            let error = p.error().expect("an error");
            println!("{count} flights, {name} {run:?}: {truth:.4}, {:.5} +- {error:.5}", p.value);
            assert!((p.value - truth).abs() < 4.0 * error && error < 0.1 * truth.abs().max(0.05), "{name} {run:?}");
        };
        truth.iter().for_each(|(name, value)| off(name, None, *value));
        for (run, (alpha_0, de_0)) in runs[..count].iter().zip(&trims) {
            off("alpha_0", Some(&run.name), *alpha_0);
            off("de_0", Some(&run.name), *de_0);
        }
    }
}
