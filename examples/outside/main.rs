//! A pendulum with a rough bearing, fitted to samples in memory.
//!
//! `cargo run --release` in the folder of this file.

use fdm::{Fit, FitOptions, Work, fit};
use std::error::Error;

/// Angle in degrees, 20 samples per second; as a recorder would deliver it.
fn recorded() -> (Vec<f64>, Vec<f64>) {
    let times: Vec<f64> = (0..200).map(|k| 0.05 * f64::from(k)).collect();
    let noise = |t: &f64| 0.05 * (1e4 * t * t).sin();
    let angles = times.iter().map(|t| 20.0 * (-0.1 * t).exp() * (3.0 * t).cos() + noise(t)).collect();
    (times, angles)
}

pub(crate) fn estimated() -> Result<Fit, Box<dyn Error>> {
    let model = fdm::model! {
        model pendulum "pendulum with a rough bearing" {
            state omega [rad/s] = free, theta [rad] = free;
            param k = 8 in [0, 100] [1/s^2] "gravity over length", d = 0.1 in [0, 5] [1/s] "damping";
            der(omega) = -k*theta - d*omega;
            der(theta) = omega;
            output angle [deg] = rad2deg(theta);
        }
    };
    let (times, angles) = recorded();
    let run = model.run("free").times(times).samples("angle", angles).build()?;
    Ok(fit(&model, &[run], &FitOptions::default(), &Work::default())?)
}

#[allow(dead_code, clippy::print_stdout, reason = "the tests run the example without its main function")]
fn main() -> Result<(), Box<dyn Error>> {
    let found = estimated()?;
    for p in &found.estimate.parameters {
        let (error, unit) = (p.error().unwrap_or(f64::NAN), p.unit.as_deref().unwrap_or("1"));
        println!("{:12} {:10.5} +- {error:.5} {unit} ({})", p.name, p.value, p.status);
    }
    println!("{}", found.estimate.termination);
    Ok(())
}
