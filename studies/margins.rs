//! How often 95 % intervals of requirements hold: six of each of three vehicles, a tanker turning and a reactor among them, in white and in coloured noise.
//!
//! `FDM_REPEATS=1000 cargo test --release --manifest-path studies/Cargo.toml --test studies margins:: -- --ignored --nocapture`

use fdm::documents::{FitDocument, ResultDocument};
use fdm::estimate::{FitOptions, Status, Work, fit};
use fdm::record::Run;
use fdm::requirement::{Assessment, Draws, Known, Plan, assess};
use fdm::simulate::Simulator;
use fdm::{Model, documents::requirement::By};
use rayon::prelude::*;
use support::Normal;

const PITCH: &str = "model pitch { input e [rad]; state alpha [rad], q [rad/s], theta [rad];
    param Za = -1.2 [1/s], Ma = -6 [1/s^2], Mq = -1.8 [1/s], Md = -8 [1/s^2], tau = 0.08 in [0, 0.5] [s]; const V = 60 [m/s], g = 9.81 [m/s^2];
    der(alpha) = Za*alpha + q; der(q) = Ma*alpha + Mq*q + delay(Md*e, tau); der(theta) = q;
    output q_m [rad/s] = q, nz [1] = -V*Za*alpha/g;
    requirement damping = mode_damping(q), frequency [rad/s] = mode_frequency(q), CAP [1/s^2] = coefficient(q, e)/steady(nz, e);
    requirement wide [rad/s] = bandwidth(-theta, e), late [s] = phase_delay(-theta, e), over = overshoot(q_m, 8, step(e, -0.05)); }";

const HOVER: &str = "model hover { input s; state u, q, theta; param Xu = -0.06, Mu = 0.03, Mq = -1.1, Ms = 0.8, tau = 0.12 in [0, 1]; const g = 9.81;
    der(u) = Xu*u - g*theta; der(q) = Mu*u + Mq*q + Ms*delay(s, tau); der(theta) = q;
    output u_m = u, q_m = q, th = theta;
    requirement quick = time_to_half(q), growth = mode_real(u), power = coefficient(q, s), lag = gain(q_m, s, 2);
    requirement crossed = crossover(q_m, s), moved = maximum(th, 2, pulse(s, 0.5, 0.5)); }";

const SHIP: &str = "model ship { input rudder [deg]; state r [deg/s], psi [deg], x [m], y [m]; const U = 6 [m/s];
    param K = 0.06 [1/s], T = 12 [s], a = 0.3 [s^2/deg^2];
    der(r) = (K*rudder - r - a*r^3)/T; der(psi) = r; der(x) = U*cos(deg2rad(psi)); der(y) = U*sin(deg2rad(psi));
    output rate [deg/s] = r, heading [deg] = psi; trim { psi = 0; r = 0; x = 0; y = 0; rudder = 0; }
    requirement advance [m] = reached(x, psi, 90, 300, step(rudder, 35)), diameter [m] = reached(y, psi, 180, 400, step(rudder, 35));
    requirement first [deg] = zigzag_overshoot(heading, rudder, 10, 10, 1, 300), second [deg] = zigzag_overshoot(heading, rudder, 10, 10, 2, 300);
    requirement turning [deg/s] = at(r, 200, step(rudder, 35)), index [1/s^2] = K/T; }";

const REACTOR: &str = "model reactor { time [min]; input Temp [K]; state A [mol/L] = 2, B [mol/L], C [mol/L];
    param k1 = 0.25 [1/min], k2 = 0.1 [1/min], E1 = 6000 [K], E2 = 9000 [K]; const T0 = 330 [K];
    let f1 = k1*exp(E1*(1/T0 - 1/Temp)), f2 = k2*exp(E2*(1/T0 - 1/Temp));
    der(A) = -f1*A; der(B) = f1*A - f2*B; der(C) = f2*B; output a [mol/L] = A, b [mol/L] = B;
    requirement conversion = 1 - at(A, 8, hold(Temp, 325))/2, yield = at(B, 8, hold(Temp, 325))/2, best [mol/L] = maximum(B, 30, hold(Temp, 325));
    requirement half [min] = when(A, 1, 30, hold(Temp, 340)), area [mol*min/L] = integral(B, 20, hold(Temp, 325));
    requirement selective = at(B, 10, hold(Temp, 340))/(2 - at(A, 10, hold(Temp, 340))); }";

/// A system with its clean record.
struct System {
    name: &'static str,
    model: Model,
    clean: Run,
    /// Noise, as a part of the RMS of each output.
    noise: f64,
    truth: Vec<f64>,
}

fn system(name: &'static str, text: &str, (samples, dt): (usize, f64), input: fn(f64) -> f64, noise: f64) -> System {
    let model = Model::from_text(name, text).unwrap();
    let q = model.layout().outputs;
    let time: Vec<f64> = (0..samples).map(|k| dt * k as f64).collect();
    let mut clean = Run {
        name: name.into(),
        inputs: time.iter().map(|t| input(*t)).collect(),
        measured: vec![0.0; samples * q],
        time,
        held: vec![false],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0; q],
    };
    let theta = model.definition().start();
    let mut y = vec![0.0; samples * q];
    Simulator::new(model.dynamics(), &clean, 8).unwrap().simulate(&theta, &mut y).unwrap();
    clean.measured = y;
    let truth = Plan::new(&model, &theta, &[]).unwrap().unwrap().bench().unwrap().measure(&theta, false);
    let truth: Vec<f64> = truth.iter().map(|m| m.value).collect();
    assert!(truth.iter().all(|v| v.is_finite()), "{name}: {truth:?}");
    System { name, model, clean, noise, truth }
}

fn pushes(t: f64, start: f64, unit: f64) -> f64 {
    // 3-2-1-1
    let s = (t - start) / unit;
    match s {
        s if (0.0..3.0).contains(&s) => 1.0,
        s if (3.0..5.0).contains(&s) => -1.0,
        s if (5.0..6.0).contains(&s) => 1.0,
        s if (6.0..7.0).contains(&s) => -1.0,
        _ => 0.0,
    }
}

fn systems() -> Vec<System> {
    vec![
        system("pitch", PITCH, (400, 0.04), |t| 0.05 * pushes(t, 0.5, 0.5) + 0.05 * pushes(t, 8.0, 0.8), 0.1),
        system("hover", HOVER, (400, 0.025), |t| 0.3 * pushes(t, 0.3, 0.35) - 0.3 * pushes(t, 5.0, 0.25), 0.1),
        system("ship", SHIP, (400, 1.0), |t| 20.0 * pushes(t, 5.0, 12.0) - 25.0 * pushes(t, 180.0, 18.0), 0.1),
        system("reactor", REACTOR, (300, 0.1), |t| 325.0 + 0.6 * t, 0.03),
    ]
}

/// The record with noise: white, or of first order with the correlation `rho` from sample to sample.
fn noisy(system: &System, rho: f64, seed: u64) -> Run {
    let mut run = system.clean.clone();
    let q = run.output_gaps.len();
    let mut normal = Normal(seed);
    for o in 0..q {
        let own: Vec<f64> = run.measured.iter().skip(o).step_by(q).copied().collect();
        let rms = (own.iter().map(|v| v * v).sum::<f64>() / own.len() as f64).sqrt();
        let mut e = normal.next();
        for k in 0..own.len() {
            run.measured[k * q + o] += system.noise * rms * e;
            e = rho * e + (1.0 - rho * rho).sqrt() * normal.next();
        }
    }
    run
}

/// The requirements of a fit of one record; none where it did not end at a minimum.
fn found(system: &System, run: Run) -> Option<Vec<Assessment>> {
    let name = run.name.clone();
    let runs = [run];
    let fit = fit(&system.model, &runs, &FitOptions::default(), &Work::default()).ok().filter(|f| f.is_good())?;
    let document = FitDocument::of(&fit);
    let freedom: Vec<Option<f64>> =
        document.parameters.iter().filter(|p| p.status != Status::Derived).map(|p| p.degrees_of_freedom).collect();
    let result = ResultDocument::from(document);
    let theta = result.theta(&system.model, &name);
    let covariance = result.covariance(&system.model, &name)?;
    let known = Known { theta: &theta, covariance: &covariance, freedom: &freedom };
    let draws = std::env::var("FDM_DRAWS").ok().and_then(|n| n.parse().ok()).unwrap_or(400);
    assess(&system.model, known, Draws { count: draws, seed: 1 }).ok()
}

#[test]
#[ignore = "takes long"]
fn intervals_of_requirements_hold() {
    let repeats: u64 = std::env::var("FDM_REPEATS").ok().and_then(|n| n.parse().ok()).unwrap_or(1000);
    for (noise, rho) in [("white", 0.0), ("AR(1), rho = 0.9", 0.9)] {
        for system in systems() {
            let fits: Vec<Option<Vec<Assessment>>> =
                (0..repeats).into_par_iter().map(|k| found(&system, noisy(&system, rho, 7 + 1000 * k))).collect();
            let fits: Vec<Vec<Assessment>> = fits.into_iter().flatten().collect();
            println!("{}, {noise}: {} of {repeats} fits", system.name, fits.len());
            for (k, truth) in system.truth.iter().enumerate() {
                let all = || fits.iter().map(|f| &f[k]);
                let inside = |a: &&Assessment| a.interval.is_some_and(|[low, high]| (low..=high).contains(truth));
                let hits = all().filter(inside).count();
                let drawn = all().filter(|a| a.by == Some(By::Draws)).count();
                let missing = all().filter(|a| a.value.is_none()).count();
                let share = |n: usize| 100.0 * n as f64 / fits.len().max(1) as f64;
                println!(
                    "  {:12} truth {truth:10.4}  holds {:5.1} %  by draws {:5.1} %  without a value {missing}",
                    all().next().map_or("", |a| a.name.as_str()),
                    share(hits),
                    share(drawn)
                );
            }
        }
    }
}
