//! Flight-path reconstruction: known errors put into the sensors of a flight, and found again by the kinematic model.

use fdm::estimate::{FitOptions, Work, fit};
use fdm::record::Run;
use support::Normal;

const G: f64 = 9.80665;
const DT: f64 = 0.04;

/// Errors of the sensors.
const TRUTH: [(&str, f64); 11] = [
    ("bax", 0.08),
    ("bay", -0.05),
    ("baz", 0.12),
    ("bp", 0.003),
    ("bq", -0.002),
    ("br", 0.001),
    ("Ka", 1.12),
    ("ba", -0.01),
    ("Kb", 0.9),
    ("bb", 0.015),
    ("late", 0.14),
];

/// A sum of sines: value and derivative.
fn wave(t: f64, mean: f64, parts: &[(f64, f64, f64)]) -> (f64, f64) {
    parts.iter().fold((mean, 0.0), |(x, d), (size, omega, phase)| {
        (x + size * (omega * t + phase).sin(), d + size * omega * (omega * t + phase).cos())
    })
}

/// Motion at a time: u, v, w, phi, theta, psi with their rates.
fn motion(t: f64) -> [(f64, f64); 6] {
    [
        wave(t, 80.0, &[(4.0, 0.21, 0.3), (1.0, 0.9, 1.0)]),
        wave(t, 0.5, &[(3.0, 0.8, 0.0), (1.5, 1.9, 0.4)]),
        wave(t, 5.0, &[(2.5, 0.6, 1.1), (2.0, 1.7, 2.0)]),
        wave(t, 0.05, &[(0.5, 0.33, 0.2), (0.2, 1.1, 0.9)]),
        wave(t, 0.04, &[(0.12, 0.27, 0.5), (0.05, 1.3, 1.9)]),
        wave(t, 0.3, &[(0.6, 0.19, 0.0), (0.1, 0.7, 0.6)]),
    ]
}

/// What perfect sensors say of it: ax, ay, az, p, q, r, and the rate of climb.
fn sensed(t: f64) -> [f64; 7] {
    let [(u, du), (v, dv), (w, dw), (phi, dphi), (theta, dtheta), (_, dpsi)] = motion(t);
    let ((sp, cp), (st, ct)) = (phi.sin_cos(), theta.sin_cos());
    let p = dphi - dpsi * st;
    let q = dtheta * cp + dpsi * ct * sp;
    let r = dpsi * ct * cp - dtheta * sp;
    [
        du + q * w - r * v + G * st,
        dv + r * u - p * w - G * ct * sp,
        dw + p * v - q * u - G * ct * cp,
        p,
        q,
        r,
        u * st - v * ct * sp - w * ct * cp,
    ]
}

fn flown(samples: usize, seed: u64) -> Run {
    let mut noise = Normal(seed);
    let truth = |name: &str| TRUTH.iter().find(|(n, _)| *n == name).unwrap().1;
    let (mut inputs, mut measured, mut h) = (Vec::new(), Vec::new(), 1000.0);
    for k in 0..samples {
        let t = DT * k as f64;
        let all = sensed(t);
        let biases = ["bax", "bay", "baz", "bp", "bq", "br"].map(truth);
        for (i, (value, bias)) in all.iter().zip(biases).enumerate() {
            inputs.push(value + bias + if i < 3 { 2e-3 } else { 2e-5 } * noise.next());
        }
        let [(u, _), (v, _), (w, _), (phi, _), (theta, _), (psi, _)] = motion(t);
        // the vanes are late
        let [(ul, _), (vl, _), (wl, _), ..] = motion(t - truth("late"));
        let airspeed = |u: f64, v: f64, w: f64| (u * u + v * v + w * w).sqrt();
        let alpha = truth("Ka") * (wl / ul).atan() + truth("ba");
        let beta = truth("Kb") * (vl / airspeed(ul, vl, wl)).asin() + truth("bb");
        let exact = [airspeed(u, v, w), alpha, beta, phi, theta, psi, h];
        let sizes = [0.2, 0.003, 0.003, 0.002, 0.002, 0.004, 0.5];
        // what the vanes show first was before the record
        let known = |o: usize| k > 4 || !(1..=2).contains(&o);
        let seen = exact.iter().zip(sizes).enumerate();
        measured.extend(seen.map(|(o, (y, s))| if known(o) { y + s * noise.next() } else { f64::NAN }));
        // Simpson's rule
        h += DT / 6.0 * (all[6] + 4.0 * sensed(t + 0.5 * DT)[6] + sensed(t + DT)[6]);
    }
    Run {
        name: "flight".into(),
        time: (0..samples).map(|k| DT * k as f64).collect(),
        held: vec![false; 6],
        input_gaps: vec![0; 6],
        stated: Vec::new(),
        output_gaps: vec![0, 5, 5, 0, 0, 0, 0],
        inputs,
        measured,
    }
}

#[test]
fn errors_of_sensors_are_found_from_kinematics_alone() {
    let model = support::shipped("flight_path/model.fdm");
    let found = fit(&model, &[flown(1000, 3)], &FitOptions::default(), &Work::default()).unwrap();
    assert!(found.estimate.is_good(), "{}", found.estimate.termination);
    for (name, truth) in TRUTH {
        let p = found.estimate.parameter(name, None).unwrap();
        let error = p.error().unwrap();
        println!("{name:>5} {truth:>8.4} {:>9.5} +- {error:.5}  {:+.2}", p.value, (p.value - truth) / error);
        assert!((p.value - truth).abs() < 3.5 * error, "{name}: {} +- {error}, {truth}", p.value);
    }
    let late = found.estimate.parameter("late", None).unwrap();
    assert!(late.error().unwrap() < 0.01 && found.fallback.is_none());
}
