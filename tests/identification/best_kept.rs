//! The best is kept over all passes of a fit: weights of smooth tables, coarse steps, chosen ones, and a limit of time.

use fdm::Model;
use fdm::estimate::{Fit, FitOptions, Halt, Stop, Work, fit};
use fdm::record::Run;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use support::Normal;

/// Nothing moves at the start values: steps are chosen for a model at rest, and found too coarse where the tables have bent.
const CART: &str = "model cart \"a servo with a stop, and curves of thrust, drag and spring\" {
  input u [1];
  state w [1] = 0, v [m/s] = 0, x [m] = 0;
  param tau = 0.5 in [0.01, 5] [s], k = 1 [1];
  param D1 = 0 [m/s^2], D2 = 0 [m/s^2], D3 = 0 [m/s^2], D4 = 0 [m/s^2];
  param S1 = 0 [m/s^2], S2 = 0 [m/s^2], S3 = 0 [m/s^2], S4 = 0 [m/s^2];
  table T(w [1]) [m/s^2] = linear { w: [-0.8, -0.4, 0, 0.4, 0.8], T: free 0 };
  table D(v [m/s]) [m/s^2] = linear { -2: D1, -0.7: D2, 0: 0, 0.7: D3, 2: D4 };
  table S(x [m]) [m/s^2] = linear { -2: S1, -1: S2, 0: 0, 1: S3, 2: S4 };
  smooth T by order 2; smooth D by order 2; smooth S by order 2;
  der(w) = (clip(k*u, -0.8, 0.8) - w)/tau;
  der(v) = T(w) - D(v) - S(x);
  der(x) = v;
  output w_m [1] = w, v_m [m/s] = v, x_m [m] = x;
}";

/// A value between others at even places of -1 to 1 times `reach`.
fn between(values: [f64; 5], reach: f64, at: f64) -> f64 {
    let place = ((at / reach).clamp(-1.0, 1.0) + 1.0) * 2.0;
    let k = (place as usize).min(3);
    values[k] + (place - k as f64) * (values[k + 1] - values[k])
}

/// Rates of the truth, its curves in straight pieces too.
fn rates([w, v, x]: [f64; 3], u: f64) -> [f64; 3] {
    let thrust = between([-2.6, -1.6, 0.0, 1.6, 2.6], 0.8, w);
    let spring = between([-9.0, -2.3, 0.0, 2.3, 9.0], 2.0, x);
    [((1.3 * u).clamp(-0.8, 0.8) - w) / 0.2, thrust - 0.9 * v - spring, v]
}

/// A record of commands that last half a second, by Runge and Kutta's method in a hundred steps a sample.
fn record() -> Run {
    let (count, dt, parts) = (90, 0.05, 100);
    let mut normal = Normal(5703);
    let inputs: Vec<f64> =
        (0..count).map(|k| [0.9, -0.3, 0.5, -0.9, 0.2, -0.6, 0.7, 0.0, -0.4, 0.4, -0.8, 0.6][k / 10 % 12]).collect();
    let (mut state, mut measured) = ([0.0; 3], Vec::new());
    for u in &inputs {
        measured.extend(state.iter().zip([0.01, 0.02, 0.02]).map(|(y, s)| y + s * normal.next()));
        let h = dt / f64::from(parts);
        let ahead = |s: [f64; 3], d: [f64; 3], h: f64| [0, 1, 2].map(|i| s[i] + h * d[i]);
        for _ in 0..parts {
            let a = rates(state, *u);
            let b = rates(ahead(state, a, 0.5 * h), *u);
            let c = rates(ahead(state, b, 0.5 * h), *u);
            let d = rates(ahead(state, c, h), *u);
            state = [0, 1, 2].map(|i| state[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        }
    }
    Run {
        name: "commands".into(),
        time: (0..count).map(|k| dt * k as f64).collect(),
        inputs,
        measured,
        held: vec![true],
        input_gaps: vec![0],
        stated: vec![true],
        output_gaps: vec![0; 3],
    }
}

/// A fit whose time is over after it was asked for so often, and how often it was.
fn fitted(model: &Model, run: &Run, left: usize) -> (Fit, usize) {
    let asked = Arc::new(AtomicUsize::new(0));
    let count = Arc::clone(&asked);
    let over = move || (count.fetch_add(1, Ordering::Relaxed) >= left).then_some(Stop::TimeLimit);
    let work = Work::until(&Halt::asking(over));
    let found = fit(model, std::slice::from_ref(run), &FitOptions::default(), &work).unwrap();
    (found, asked.load(Ordering::Relaxed))
}

/// Logarithm of the likelihood of the residuals, without what is known of the tables.
fn likelihood(found: &Fit) -> f64 {
    found.estimate.outputs.iter().map(|o| -(o.compared as f64) * o.rms.unwrap().ln()).sum()
}

#[test]
fn more_time_never_gives_less_and_the_end_says_what_ended_it() {
    let (model, run): (Model, Run) = (support::model(CART), record());
    let (whole, asked) = fitted(&model, &run, usize::MAX);
    assert!(whole.is_good() && whole.integration.iter().all(|a| a.error < 1e-6), "{}", whole.estimate.termination);
    for (output, noise) in whole.estimate.outputs.iter().zip([0.01, 0.02, 0.02]) {
        assert!((output.rms.unwrap() / noise - 1.0).abs() < 0.15, "{output:?}");
    }
    let mut least = f64::NEG_INFINITY;
    for part in [0.02, 0.05, 0.1, 0.2, 0.5, 0.97] {
        let (found, _) = fitted(&model, &run, (asked as f64 * part) as usize);
        let reached = likelihood(&found);
        // weights of tables that are not chosen yet, and coarser steps, are worth less than this
        assert!(reached > least - 3.0, "{part}: {reached} after {least}");
        least = least.max(reached);
        let is_whole = (reached - likelihood(&whole)).abs() < 1e-6;
        let stopped = found.estimate.termination.is_stopped() && !found.is_good();
        assert!(stopped || is_whole && found.is_good(), "{part}: {}", found.estimate.termination);
    }
}
