//! Starts that the plain correction cannot use, and the strategies that can.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use fdm::Model;
use fdm::estimate::{Changes, Continuation, Fit, FitOptions, Remedy, Shooting, fit};
use fdm::record::Run;
use fdm::simulate::Simulator;
use std::f64::consts::PI;

fn blank(model: &Model, name: &str, time: Vec<f64>) -> Run {
    let (n, m, q) = (time.len(), model.layout().inputs, model.layout().outputs);
    Run {
        name: name.into(),
        time,
        inputs: vec![0.0; n * m],
        held: vec![false; m],
        measured: vec![0.0; n * q],
        input_gaps: vec![0; m],
        output_gaps: vec![0; q],
    }
}

/// The run as the model answers it with these parameters.
fn answered(model: &Model, run: Run, truth: &[(&str, f64)]) -> Run {
    let mut theta = model.definition().start();
    for (name, value) in truth {
        theta[model.definition().param(name).unwrap()] = *value;
    }
    let mut measured = vec![0.0; run.measured.len()];
    Simulator::new(model.dynamics(), &run, 8).unwrap().simulate(&theta, &mut measured).unwrap();
    Run { measured, ..run }
}

fn at(set: &[(&str, f64)]) -> Changes {
    Changes { set: set.iter().map(|(n, v)| (n.to_string(), *v)).collect(), ..Changes::default() }
}

fn value(fit: &Fit, name: &str, run: Option<&str>) -> f64 {
    fit.estimate.parameter(name, run).unwrap().value
}

/// Normal deviates from splitmix64 by Box and Muller.
struct Normal(u64);

impl Normal {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn next(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (2.0 * PI * self.uniform()).cos()
    }
}

/// A pendulum that stands on its pivot and is held there by a controller, whose torque is recorded.
const PENDULUM: &str = r#"model inverted "pendulum on its pivot" {
    input torque; state th = free; state w = free;
    param k = 4, c = 0.3, b = 1;
    der(th) = w;
    der(w) = k*sin(th) - c*w + b*torque;
    output th_m = th; output w_m = w;
}"#;

/// Balanced for `n` samples; measured with noise of this deviation.
fn balanced(model: &Model, name: &str, n: usize, noise: f64, seed: u64) -> Run {
    const DT: f64 = 0.05;
    let mut run = blank(model, name, (0..n).map(|k| DT * k as f64).collect());
    run.held = vec![true];
    let mut normal = Normal(seed);
    let rate = |x: [f64; 2], u: f64| [x[1], 5.0 * x[0].sin() - 0.4 * x[1] + 1.3 * u];
    let moved = |x: [f64; 2], k: [f64; 2], h: f64| [x[0] + h * k[0], x[1] + h * k[1]];
    let mut x = [0.1, -0.2];
    for sample in 0..n {
        let t = DT * sample as f64;
        let wanted = 0.3 * (0.7 * t).sin() + 0.2 * (1.9 * t).sin();
        let u = -9.0 * (x[0] - wanted) - 4.0 * x[1];
        run.inputs[sample] = u;
        run.measured[2 * sample] = x[0] + noise * normal.next();
        run.measured[2 * sample + 1] = x[1] + noise * normal.next();
        let h = DT / 16.0;
        for _ in 0..16 {
            let k1 = rate(x, u);
            let k2 = rate(moved(x, k1, h / 2.0), u);
            let k3 = rate(moved(x, k2, h / 2.0), u);
            let k4 = rate(moved(x, k3, h), u);
            for j in 0..2 {
                x[j] += h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]);
            }
        }
    }
    run
}

#[test]
fn an_unstable_model_is_found_by_multiple_shooting_where_the_plain_correction_fails() {
    let model = Model::from_text("inverted.fdm", PENDULUM).unwrap();
    for (n, polished) in [(160, true), (800, false)] {
        let run = balanced(&model, "balanced", n, 0.01, 7);
        let options = |shooting| FitOptions {
            changes: at(&[("k", 2.0), ("c", 0.0), ("b", 0.5)]),
            continuation: Continuation::Never,
            shooting,
            ..FitOptions::default()
        };
        let plain = fit(&model, std::slice::from_ref(&run), &options(None), &mut ()).unwrap();
        let t = std::time::Instant::now();
        let shot = fit(&model, std::slice::from_ref(&run), &options(Some(Shooting::Length(0.5))), &mut ()).unwrap();
        println!(
            "{n}: {:?} plain {} {:?} {:?}",
            t.elapsed(),
            plain.estimate.termination,
            plain.estimate.cost,
            plain.estimate.outputs[0].r2
        );
        println!(
            "{} {:?} {:?} {:?}",
            shot.estimate.termination, shot.estimate.cost, shot.shooting, shot.estimate.outputs[0].r2
        );
        for (name, want) in [("k", 5.0), ("c", 0.4), ("b", 1.3)] {
            let p = shot.estimate.parameter(name, None).unwrap();
            println!("{name} {} {:?} {want}", p.value, p.standard_error);
        }
        println!("{}", fdm::report::estimate_table(&shot.estimate));
        assert_eq!(shot.shooting.unwrap().polished, polished);
    }
}
