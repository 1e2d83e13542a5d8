//! The ship under an autopilot with an input delay, a state delay and an output delay: everything found again in a record
//! without noise, from poor starts.

use fdm::Model;
use fdm::estimate::{Changes, FitOptions, Work, fit};
use fdm::record::Run;
use fdm::simulate::{Simulator, StepOptions, choose_steps};

const TRUTH: [(&str, f64); 5] =
    [("T", 11.3), ("K", 0.087), ("tau_order", 1.73), ("tau_loop", 2.62), ("tau_display", 0.41)];

/// Five minutes of ordered changes of course, sampled every half second.
fn record(model: &Model) -> Run {
    let time: Vec<f64> = (0..601).map(|k| 0.5 * f64::from(k)).collect();
    let ordered = |t: f64| match t {
        t if t < 10.0 => 0.0,
        t if t < 80.0 => 20.0,
        t if t < 130.0 => -15.0,
        t if t < 210.0 => 5.0 + 10.0 * (0.11 * t).sin(),
        _ => 30.0,
    };
    let mut run = Run {
        name: "courses".into(),
        inputs: time.iter().map(|t| ordered(*t)).collect(),
        measured: vec![0.0; 2 * time.len()],
        time,
        held: vec![false],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0; 2],
    };
    let mut theta = model.definition().start();
    for (name, value) in TRUTH {
        theta[model.definition().param(name).unwrap()] = value;
    }
    let fine = choose_steps(model.dynamics(), &run, &theta, &StepOptions::default()).unwrap().steps.halved();
    let mut y = vec![0.0; run.measured.len()];
    Simulator::new(model.dynamics(), &run, fine).unwrap().simulate(&theta, &mut y).unwrap();
    run.measured = y;
    run
}

#[test]
fn three_delays_of_a_ship_are_found_from_poor_starts() {
    let model = support::shipped("delays/model.fdm");
    let run = [record(&model)];
    let starts = [
        [8.0, 0.12, 1.2, 2.1, 0.7],
        [3.0, 0.03, 0.0, 0.0, 0.0],
        [30.0, 0.3, 4.0, 1.0, 3.0],
        [20.0, 0.04, 0.3, 5.0, 0.1],
    ];
    for start in starts {
        let set = TRUTH.iter().zip(start).map(|((name, _), value)| (name.to_string(), value)).collect();
        let options = FitOptions { changes: Changes { set, ..Changes::default() }, ..FitOptions::default() };
        let found = fit(&model, &run, &options, &Work::default()).unwrap();
        assert!(found.estimate.is_good(), "from {start:?}: {}", found.estimate.termination);
        for (name, want) in TRUTH {
            let got = found.estimate.parameter(name, None).unwrap().value;
            assert!((got / want - 1.0).abs() < 1e-6, "from {start:?}: {name} = {got} instead of {want}");
        }
    }
}
