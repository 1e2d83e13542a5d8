//! Blocks and ties in whole studies: blocks at rest, equalities switched off. (A hydrofoil under its autopilot: `fdm reproduce hydrofoil`.)

use fdm::Model;
use fdm::estimate::{Changes, FitOptions, Status, Work, fit};
use fdm::record::Run;
use fdm::simulate::Simulator;
use support::Normal;

/// A run without measurements yet.
fn run(model: &Model, (samples, dt): (usize, f64), input: impl Fn(f64, usize) -> f64) -> Run {
    let (m, q) = (model.layout().inputs, model.layout().outputs);
    let time: Vec<f64> = (0..samples).map(|k| dt * k as f64).collect();
    Run {
        name: "run".into(),
        inputs: time.iter().flat_map(|t| (0..m).map(|i| input(*t, i)).collect::<Vec<_>>()).collect(),
        measured: vec![f64::NAN; samples * q],
        time,
        held: vec![false; m],
        input_gaps: vec![0; m],
        stated: Vec::new(),
        output_gaps: vec![0; q],
    }
}

fn theta(model: &Model, set: &[(&str, f64)]) -> Vec<f64> {
    let mut theta = model.definition().start();
    set.iter().for_each(|(name, value)| theta[model.definition().param(name).unwrap()] = *value);
    theta
}

fn response(model: &Model, run: &Run, theta: &[f64]) -> Vec<f64> {
    let mut y = vec![0.0; run.len() * model.layout().outputs];
    Simulator::new(model.dynamics(), run, 8).unwrap().simulate(theta, &mut y).unwrap();
    y
}

fn changes(set: &[(&str, f64)]) -> Changes {
    Changes { set: set.iter().map(|(n, v)| ((*n).to_string(), *v)).collect(), ..Changes::default() }
}

#[test]
fn blocks_are_at_rest_when_a_run_begins_and_follow_their_steps() {
    let model = fdm::model! {
        model blocks {
            input u [m];
            param T = 0.5 [s], S = 0.2 [s], w = 4 [rad/s], z = 0.3 [1];
            output slow [m] = lag(u, T), rest [m] = washout(u, T), both [m] = leadlag(u, S, T);
            output bounce [m] = second_order(u, w, z), ratio [m] = tf(u, [w^2], [1, 2*z*w, w^2]), twice [m] = lag(lag(2*u, T), T);
        }
    };
    assert_eq!(model.layout().states, 7, "equal blocks are one");
    let text = Model::from_text("same", model.source().text()).unwrap();
    for first in [0.0, 3.0] {
        // a step between two samples, so that it is a ramp of known beginning
        let step = run(&model, (401, 0.01), |t, _| if t > 0.995 { first + 1.0 } else { first });
        let y = response(&model, &step, &model.definition().start());
        assert_eq!(y, response(&text, &step, &text.definition().start()), "by macro and from text");
        for (k, row) in y.chunks(6).enumerate() {
            let t = 0.01 * k as f64 - 0.995;
            // the ramp of 0.01 s is a step in its middle, within 1e-4
            let s = if t > 0.005 { t } else { 0.0 };
            let moved = f64::from(u8::from(t > 0.005));
            let slow = 1.0 - (-s / 0.5).exp();
            let (wd, sigma) = (4.0 * (1.0f64 - 0.09).sqrt(), 1.2);
            let bounce = moved - moved * (-sigma * s).exp() * ((wd * s).cos() + sigma / wd * (wd * s).sin());
            let twice = 2.0 * (moved - (1.0 + s / 0.5) * (-s / 0.5).exp() * moved);
            let want = [
                first + slow,
                moved - slow,
                first + slow + 0.4 * (moved - slow),
                first + bounce,
                first + bounce,
                2.0 * first + twice,
            ];
            for (got, want) in row.iter().zip(want) {
                assert!((got - want).abs() < 3e-4, "sample {k} from {first}: {row:?} instead of {want:?}");
            }
        }
    }
}

#[test]
fn every_run_begins_at_rest_with_its_own_first_sample() {
    let model = Model::from_text(
        "lags",
        "model m { input u; state x = initial(u)*k; param T = 0.4, k = 2, a = 1.5;
         der(x) = a*(k*lag(u, T) - x); output y = x, z = lag(x, T); }",
    )
    .unwrap();
    let records: Vec<Run> = [1.0, -4.0]
        .into_iter()
        .map(|level| {
            let mut record = run(&model, (120, 0.05), |t, _| level + if t > 1.0 { (2.0 * t).sin() } else { 0.0 });
            record.name = format!("from {level}");
            record.measured = response(&model, &record, &model.definition().start());
            assert!((record.measured[2] - record.measured[0]).abs() < 1e-12, "at rest");
            assert!((record.measured[0] - 2.0 * level).abs() < 1e-12);
            record
        })
        .collect();
    let away = [("T", 0.7), ("k", 1.0), ("a", 1.0)];
    let found =
        fit(&model, &records, &FitOptions { changes: changes(&away), ..FitOptions::default() }, &Work::default())
            .unwrap();
    for (name, want) in [("T", 0.4), ("k", 2.0), ("a", 1.5)] {
        let value = found.estimate.parameter(name, None).unwrap().value;
        assert!((value / want - 1.0).abs() < 1e-6, "{name}: {value}");
    }
    assert!(found.estimate.parameters.iter().all(|p| !p.name.contains("initial")), "first samples are not reported");
    let refused = FitOptions { changes: changes(&[("initial(u)", 1.0)]), ..FitOptions::default() };
    assert!(fit(&model, &records, &refused, &Work::default()).is_err());
}

#[test]
fn an_equality_is_tested_by_switching_its_tie_off() {
    let model = fdm::model! {
        model roll {
            input d [rad];
            state p [rad/s], r [rad/s];
            param L = -2 [1/s], N = -1.5 [1/s], k = 3 [1/s^2], c = 2 [1/s^2];
            tie N = L, c = 0.5*k;
            der(p) = L*p + k*d;
            der(r) = N*r + c*d;
            output p_m [rad/s] = p, r_m [rad/s] = r;
        }
    };
    assert_eq!(model.definition().params.len(), 2);
    let mut record = run(&model, (300, 0.02), |t, _| (2.0 * t).sin() + (5.3 * t).cos());
    let open = model.untied(&["all".into()]).unwrap();
    assert_eq!((open.open_ties(), open.definition().params.len()), (vec!["N".to_string(), "c".into()], 4));
    let mut normal = Normal(5);
    // one equality holds, the other does not
    let truth = theta(&open, &[("L", -2.0), ("N", -2.0), ("k", 3.0), ("c", 1.3)]);
    record.measured = response(&open, &record, &truth).iter().map(|y| y + 0.01 * normal.next()).collect();
    let records = [record];
    let fitted = |model: &Model| fit(model, &records, &FitOptions::default(), &Work::default()).unwrap();
    let n_open = fitted(&model.untied(&["N".into()]).unwrap());
    let [tied, c_open, both] = [&model, &model.untied(&["c".into()]).unwrap(), &open].map(fitted);
    let own = tied.estimate.parameter("c", None).unwrap();
    let k = tied.estimate.parameter("k", None).unwrap();
    assert_eq!((own.status, own.value), (Status::Tied, 0.5 * k.value));
    assert!((own.error().unwrap() / (0.5 * k.error().unwrap()) - 1.0).abs() < 1e-6);
    // twice the fall of the cost is chi-squared with one degree of freedom where the equality holds
    let cost = |fit: &fdm::estimate::Fit| fit.estimate.cost.unwrap();
    let (holds, fails) = (2.0 * (cost(&c_open) - cost(&both)), 2.0 * (cost(&n_open) - cost(&both)));
    assert!((0.0..10.8).contains(&holds) && fails > 100.0, "{holds} {fails}");
    let c = both.estimate.parameter("c", None).unwrap();
    assert!((c.value - 1.3).abs() < 4.0 * c.error().unwrap() && c.status == Status::Estimated);
    let wrong = model.untied(&["M".into()]).unwrap_err().to_string();
    assert_eq!(wrong, "`M` is not tied; tied are `N`, `c`");
}
