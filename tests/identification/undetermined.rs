//! What the data do not determine does no harm: it is held where it began, and the others are what they are beside it.

use fdm::Model;
use fdm::estimate::{Fit, FitOptions, Status, Work, fit};
use fdm::record::Run;
use support::Normal;

/// A lift curve with a stall that begins at `as`, behind a lag of the flow.
const STALL: &str = "model wing \"lift behind a lag, with a stall\" {
  input alpha [rad];
  state x [rad] = 0;
  param CL0 = 0.1 [1], CLa = 5 [1], tauT = 0.4 [s], a1 = 20 [1], as = 0.25 [rad];
  der(x) = (alpha - x)/tauT;
  let X = 0.5*(1 - tanh(a1*(x - as)));
  output CL [1] = CL0 + CLa*x*((1 + sqrt(X))/2)^2;
}";

/// Steps of at most 0.05 rad, far below the stall: x follows them exactly, and the curve is a straight line there.
fn record(amplitude: f64) -> Run {
    let (count, dt, tau) = (400, 0.05_f64, 0.25);
    let mut normal = Normal(5701);
    let step = |k: usize| amplitude * [1.0, -0.5, 0.5, -1.0, 0.0, 0.7][k / 20 % 6];
    let (mut x, mut measured) = (0.0_f64, Vec::new());
    for k in 0..count {
        measured.push(0.2 + 4.5 * x + 0.005 * normal.next());
        x = step(k) + (x - step(k)) * (-dt / tau).exp();
    }
    Run {
        name: "below the stall".into(),
        time: (0..count).map(|k| dt * k as f64).collect(),
        inputs: (0..count).map(step).collect(),
        measured,
        held: vec![true],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0],
    }
}

fn fitted(text: &str, run: &Run) -> Fit {
    let model: Model = support::model(text);
    fit(&model, std::slice::from_ref(run), &FitOptions::default(), &Work::default()).unwrap()
}

/// Values and both errors of the parameters before the stall.
fn others(found: &Fit) -> Vec<f64> {
    let of = |name: &str| {
        let p = found.estimate.parameter(name, None).unwrap();
        [p.value, p.standard_error.unwrap(), p.corrected_error.unwrap()]
    };
    ["CL0", "CLa", "tauT"].into_iter().flat_map(of).collect()
}

#[test]
fn a_stall_that_no_run_visits_is_held_where_it_began() {
    let run = record(0.05);
    let found = fitted(STALL, &run);
    let known =
        fitted(&STALL.replace("a1 = 20 [1], as = 0.25 [rad]", "a1 = 20 [1] fixed, as = 0.25 [rad] fixed"), &run);
    for (name, start) in [("a1", 20.0), ("as", 0.25)] {
        let p = found.estimate.parameter(name, None).unwrap();
        assert_eq!((p.value, p.status, p.error()), (start, Status::NotDetermined, None), "{name}");
        assert!(found.estimate.undetermined.iter().any(|d| d.moves.len() == 1 && d.moves[0].0 == name), "{name}");
    }
    for (got, want) in others(&found).into_iter().zip(others(&known)) {
        assert!((got / want - 1.0).abs() < 1e-6, "{got} instead of {want}");
    }
    let lag = found.estimate.parameter("tauT", None).unwrap();
    assert!((lag.value - 0.25).abs() < 4.0 * lag.error().unwrap(), "{lag:?}");
}

#[test]
fn a_stall_that_the_start_has_in_the_record_leaves_the_lag_right() {
    // determined where it begins, and by nothing where it goes
    let run = record(0.05);
    let found = fitted(&STALL.replace("a1 = 20 [1], as = 0.25", "a1 = 20 in [0, 500] [1], as = 0.03"), &run);
    let lag = found.estimate.parameter("tauT", None).unwrap();
    let error = lag.error().expect("the lag is determined");
    assert!(error < 0.005 && (lag.value - 0.25).abs() < 4.0 * error, "{lag:?}");
}
