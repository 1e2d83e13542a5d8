//! Nonlinear models identified in the frequency domain by both ways, beside the time domain: what noise in the records does to
//! terms that are carried in, and what amplitude does to terms that are linearised.
//!
//! `cargo test --release --manifest-path studies/Cargo.toml --test studies nonlinear:: -- --ignored --nocapture`

use fdm::estimate::Nonlinear;
use rayon::prelude::*;
use support::nonlinear::{Found, System, pendulum, roll_decay, ship};

/// Repeats of the noise; `FDM_REPEATS` thins them.
fn repeats() -> u64 {
    std::env::var("FDM_REPEATS").ok().and_then(|n| n.parse().ok()).unwrap_or(200)
}

/// Over the repeats: mean, scatter and the root mean square of what was printed.
#[derive(Clone, Copy)]
struct Middle {
    mean: f64,
    scatter: f64,
    printed: f64,
}

fn middle(found: &[Vec<Option<Found>>], k: usize) -> Option<Middle> {
    let one: Vec<Found> = found.iter().filter_map(|f| f[k]).collect();
    let n = one.len() as f64;
    let mean = one.iter().map(|f| f.value).sum::<f64>() / n;
    let scatter = (one.iter().map(|f| (f.value - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let printed = (one.iter().map(|f| f.error.powi(2)).sum::<f64>() / n).sqrt();
    (!one.is_empty()).then_some(Middle { mean, scatter, printed })
}

/// What a mean of normal errors is off by chance, in its standard errors: the largest of the 46 that are compared in all studies
/// is beyond it once in 350 runs of them.
const CHANCE: f64 = 4.0;
/// Bias that counts as none, in printed errors: it moves an interval of two errors by a twentieth.
const NONE: f64 = 0.1;

/// Time domain beside frequency domain at each noise; returns parameters by noise whose bias in the frequency domain is more than chance.
fn compare(system: &System, nonlinear: Nonlinear, noises: &[f64]) -> Vec<Vec<String>> {
    println!("\n{}, {nonlinear:?}, {} repeats", system.name, repeats());
    println!("  noise  parameter      truth   time: bias  scatter  printed   frequency: bias  scatter  printed");
    let mut biases = Vec::new();
    for noise in noises {
        let both = |seed: u64| {
            let run = system.noisy(*noise, 7000 + seed);
            (system.in_time(&run), system.in_frequency(&run, nonlinear))
        };
        let found: Vec<_> = (0..repeats()).into_par_iter().map(both).collect();
        let (time, frequency): (Vec<_>, Vec<_>) = found.into_iter().unzip();
        let (mut largest, mut biased) = (0.0f64, Vec::new());
        for (k, (name, truth)) in system.params().enumerate() {
            let (Some(t), Some(f)) = (middle(&time, k), middle(&frequency, k)) else { continue };
            // in percent of the truth
            let part = |v: f64| 100.0 * v / truth.abs();
            println!(
                "  {noise:5.3}  {name:9} {truth:10.2e}  {:10.3}% {:7.3}% {:7.3}%       {:10.3}% {:7.3}% {:7.3}%",
                part(t.mean - truth),
                part(t.scatter),
                part(t.printed),
                part(f.mean - truth),
                part(f.scatter),
                part(f.printed)
            );
            if truth != 0.0 {
                let bias = (f.mean - truth).abs();
                largest = largest.max(bias / f.printed);
                if bias > CHANCE * f.scatter / (repeats() as f64).sqrt() + NONE * f.printed {
                    biased.push(format!("{name} by {:.2} printed errors", bias / f.printed));
                }
            }
        }
        println!("  largest bias in the frequency domain: {largest:.2} printed errors; more than chance: {biased:?}");
        biases.push(biased);
    }
    biases
}

#[test]
#[ignore = "a study"]
fn carried_terms_by_noise() {
    let noises = [0.001, 0.003, 0.01, 0.03];
    for system in [
        ship("ship, zig-zag of 20 deg", 0.35),
        pendulum("pendulum", 2.0, 0.5),
        roll_decay("roll decay from 17 deg", 0.3),
    ] {
        let biases = compare(&system, Nonlinear::MeasuredRegressors, &noises);
        // noise in records biases what is computed from them in proportion to its square
        assert!(biases[0].is_empty(), "{}: {:?}", system.name, biases[0]);
    }
}

#[test]
#[ignore = "a study"]
fn linearised_terms_by_noise() {
    for system in [
        ship("ship, zig-zag of 0.3 deg", 0.005),
        pendulum("pendulum, small", 0.05, 0.0),
        roll_decay("roll decay from 0.3 deg", 0.005),
    ] {
        let biases = compare(&system, Nonlinear::Linearised, &[0.01, 0.05]);
        assert!(biases[1].is_empty(), "{}: {:?}", system.name, biases[1]);
    }
}

#[test]
#[ignore = "a study"]
fn linearised_pendulum_by_amplitude() {
    println!("\npendulum without Coulomb friction, noise-free: bias of w2, linearised and carried");
    for torque in [0.05, 0.2, 0.5, 1.0, 2.0] {
        let system = pendulum("pendulum", torque, 0.0);
        let largest = system.clean.measured.iter().step_by(2).fold(0.0, |a: f64, x| a.max(x.abs()));
        let of = |how| system.in_frequency(&system.noisy(1e-4, 3), how)[0].unwrap();
        let (linear, carried) = (of(Nonlinear::Linearised), of(Nonlinear::MeasuredRegressors));
        let part = |v: f64| 100.0 * (v - 64.0) / 64.0;
        println!(
            "  to {largest:.3} rad: linearised {:8.3} % ± {:.3} %, carried {:8.3} % ± {:.3} %",
            part(linear.value),
            linear.error / 0.64,
            part(carried.value),
            carried.error / 0.64
        );
    }
}
