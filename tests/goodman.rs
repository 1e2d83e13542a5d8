#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
use fdm::Model;
use fdm::estimate::{Changes, FitOptions, fit};
use fdm::record::Run;
use fdm::simulate::Simulator;

fn ship(n: usize, dt: f64) -> (Model, Run) {
    let model = Model::from_file("models/goodman_ship/model.fdm").unwrap();
    let time: Vec<f64> = (0..n).map(|k| dt * k as f64).collect();
    let inputs = time.iter().map(|t| (2.32 * t).min(35.0).to_radians()).collect();
    let mut run = Run {
        name: "turn".into(),
        inputs,
        measured: vec![0.0; n * 3],
        time,
        held: vec![false],
        input_gaps: vec![0],
        output_gaps: vec![0; 3],
    };
    let mut y = vec![0.0; n * 3];
    Simulator::new(model.dynamics(), &run, 8).unwrap().simulate(&model.definition().start(), &mut y).unwrap();
    run.measured = y;
    (model, run)
}

#[test]
fn explore() {
    for (n, dt) in [(61, 1.0)] {
        let (model, run) = ship(n, dt);
        let y = &run.measured[(n - 1) * 3..];
        println!("{:?} {} deg/s", y, y[2].to_degrees());
        let params = model.definition().params.clone();
        let go = |what: &str, set: Vec<(String, f64)>| {
            let options = FitOptions { changes: Changes { set, ..Changes::default() }, ..FitOptions::default() };
            let t = std::time::Instant::now();
            let f = fit(&model, std::slice::from_ref(&run), &options, &mut ()).unwrap();
            let worst = params
                .iter()
                .map(|p| (f.estimate.parameter(&p.quantity.name, None).unwrap().value / p.value - 1.0).abs())
                .fold(0.0, f64::max);
            println!(
                "{what}: {} after {} worst {worst:.1e} cost {:?} {:?} cond {:?}  {:?}",
                f.estimate.termination,
                f.estimate.iterations,
                f.estimate.cost,
                t.elapsed(),
                f.estimate.condition,
                f.integration
            );
        };
        go("true", vec![]);
        for factor in [2.0, 0.5] {
            go(&format!("all*{factor}"), params.iter().map(|p| (p.quantity.name.clone(), p.value * factor)).collect());
            for p in &params {
                go(&format!("{} *{factor}", p.quantity.name), vec![(p.quantity.name.clone(), p.value * factor)]);
            }
        }
    }
}

#[test]
#[ignore]
fn combos() {
    for (n, dt) in [(61, 1.0)] {
        let (model, run) = ship(n, dt);
        let params = model.definition().params.clone();
        let mut counts = std::collections::BTreeMap::<String, usize>::new();
        let t = std::time::Instant::now();
        for noise in [0.0, 0.02] {
            let mut run = run.clone();
            let mut s = 1u64;
            for k in 0..run.measured.len() {
                let mut u = || {
                    s = s.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                    (s >> 11) as f64 / (1u64 << 53) as f64
                };
                let g: f64 = (0..12).map(|_| u()).sum::<f64>() - 6.0;
                let big = [25.3, 9.0, 0.035][k % 3];
                run.measured[k] += noise * big * g;
            }
            let mut best = f64::INFINITY;
            for combo in 0..2048usize {
                let set = params
                    .iter()
                    .enumerate()
                    .map(|(k, p)| (p.quantity.name.clone(), p.value * if combo >> k & 1 == 1 { 2.0 } else { 0.5 }))
                    .collect();
                let mut options =
                    FitOptions { changes: Changes { set, ..Changes::default() }, ..FitOptions::default() };
                options.continuation = fdm::estimate::Continuation::Never;
                let a = fit(&model, std::slice::from_ref(&run), &options, &mut ()).unwrap();
                best = best.min(a.estimate.cost.unwrap_or(f64::INFINITY));
                let good = |f: &fdm::estimate::Fit| {
                    f.estimate.outputs.len() > 0
                        && f.estimate.cost.unwrap_or(f64::INFINITY) < if noise == 0.0 { -2000.0 } else { best + 0.1 }
                };
                let r2 =
                    |f: &fdm::estimate::Fit| f.estimate.outputs.iter().map(|o| o.r2.unwrap_or(0.0)).collect::<Vec<_>>();
                let plain = if good(&a) {
                    "plain".to_string()
                } else {
                    options.continuation = fdm::estimate::Continuation::Auto;
                    let b = fit(&model, std::slice::from_ref(&run), &options, &mut ()).unwrap();
                    println!(
                        "{combo:011b} plain {} it {} cost {:?} {:?} r2 {:?} -> auto {} {:?} {} {:?}",
                        a.estimate.termination,
                        a.estimate.iterations,
                        a.estimate.cost,
                        a.estimate.condition,
                        r2(&a),
                        b.estimate.termination,
                        b.estimate.cost,
                        good(&b),
                        b.rescue.as_ref().map(|r| r.to_string())
                    );
                    options.continuation =
                        fdm::estimate::Continuation::Shares((1..8).map(|k| k as f64 / 8.0).collect());
                    let c = fit(&model, std::slice::from_ref(&run), &options, &mut ()).unwrap();
                    format!("plain failed, auto {} eighths {}", good(&b), good(&c))
                };
                *counts.entry(plain).or_default() += 1;
            }
            println!("noise {noise}: {counts:?} {:?}", t.elapsed());
            counts.clear();
        }
    }
}
