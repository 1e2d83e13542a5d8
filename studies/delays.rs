//! What a delayed state costs: time of a step with sensitivities, beside the same model without the delay.
//!
//! `cargo test --release --manifest-path studies/Cargo.toml --test studies delays:: -- --ignored --nocapture`

use fdm::Model;
use fdm::record::Run;
use fdm::simulate::Simulator;
use std::time::Instant;

/// Nanoseconds of a step: response alone, and with sensitivities; the best of several.
fn cost(text: &str, tau: f64) -> (f64, f64) {
    let model = Model::from_text("cost.fdm", text).unwrap_or_else(|e| panic!("{e}"));
    let (n, per) = (2000, 4);
    let time: Vec<f64> = (0..n).map(|k| 0.02 * k as f64).collect();
    let run = Run {
        name: "cost".into(),
        inputs: time.iter().map(|t| (2.0 * t).sin() + (5.0 * t).cos()).collect(),
        measured: vec![f64::NAN; n * model.layout().outputs],
        time,
        held: vec![false],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0; model.layout().outputs],
    };
    let mut theta = model.definition().start();
    if let Some(k) = model.definition().param("tau") {
        theta[k] = tau;
    }
    let columns: Vec<usize> = (0..theta.len()).collect();
    let mut simulator = Simulator::new(model.dynamics(), &run, per).expect("suited");
    let mut y = vec![0.0; run.measured.len()];
    let mut best = (f64::INFINITY, f64::INFINITY);
    for _ in 0..15 {
        let begin = Instant::now();
        simulator.simulate(&theta, &mut y).expect("finite");
        best.0 = best.0.min(begin.elapsed().as_secs_f64());
        let begin = Instant::now();
        simulator.stream(&theta, &columns, &mut |_| ()).expect("finite");
        best.1 = best.1.min(begin.elapsed().as_secs_f64());
    }
    let steps = (per * (n - 1)) as f64;
    (best.0 / steps * 1e9, best.1 / steps * 1e9)
}

#[test]
#[ignore = "a study"]
fn what_a_delayed_state_costs() {
    let ship = |delayed: &str| {
        format!(
            "model ship {{ input d; state u = 2, v, r; param c1 = -0.1, c2 = -0.4, c3 = 0.3, c4 = -0.2, c5 = 0.5, c6 = 0.1{};
            der(u) = -0.1*(u - 2) + c1*v^2*u; der(v) = c2*v + c3*r*u + c6*d; der(r) = c4*r + c5*d*u - {delayed};
            output a = u; output b = v; output c = r; }}",
            if delayed == "v" { "" } else { ", tau = 0.1 in [0, 2]" }
        )
    };
    let plain = cost(&ship("v"), 0.0);
    println!("{:34} {:>8} {:>8}", "ns per step (h = 0.005)", "response", "with S");
    println!("{:34} {:8.0} {:8.0}", "no delay", plain.0, plain.1);
    for tau in [0.333, 0.005, 0.0031, 0.0] {
        let with = cost(&ship("delay(v, tau)"), tau);
        println!("{:34} {:8.0} {:8.0}", format!("one delayed state, tau = {tau}"), with.0, with.1);
    }
}
