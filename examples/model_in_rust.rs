//! A model written in Rust code, simulated with its sensitivities, and fitted to what it simulated.
//!
//! `cargo run --release --example model_in_rust`

use fdm::{Changes, Fit, FitOptions, Model, Run, Simulator, Work, fit};
use std::error::Error;

/// Pitch rate after a pulse of the stick, with a delay; compiled together with this program.
pub(crate) fn pitch() -> Model {
    fdm::model! {
        model pitch "second-order pitch response with a delayed stick" {
            input stick [1];
            state q "pitch rate" [rad/s], z [rad/s^2];
            param omega = 2.0 in [0.1, 20] [rad/s], zeta = 0.7 in [0, 2] [1], K = 6.0 [1/s^3];
            param tau = 0.15 in [0, 0.5] [s];
            der(q) = z;
            der(z) = -2*zeta*omega*z - omega^2*q + K*delay(stick, tau);
            output q_m [rad/s] = q;
        }
    }
}

/// A run of eight seconds whose measurement is the model's own response at the start values.
pub(crate) fn pulse(model: &Model) -> Result<Run, Box<dyn Error>> {
    let time: Vec<f64> = (0..400).map(|k| 0.02 * f64::from(k)).collect();
    let stick: Vec<f64> = time.iter().map(|t| (-4.0 * (t - 1.0).powi(2)).exp()).collect();
    let run = model.run("pulse").times(time).samples("stick", stick).without_outputs().build()?;
    let mut y = vec![0.0; run.len()];
    Simulator::new(model.dynamics(), &run, 4)?
        .simulate(&model.definition().start(), &mut y)
        .map_err(|d| format!("the response leaves the finite numbers at {} s", d.time))?;
    Ok(Run { measured: y, output_gaps: vec![0], ..run })
}

/// Estimates from wrong start values.
pub(crate) fn estimated() -> Result<Fit, Box<dyn Error>> {
    let model = pitch();
    let run = pulse(&model)?;
    let wrong = [("omega", 3.0), ("zeta", 0.4), ("K", 4.0), ("tau", 0.05)];
    let set = wrong.map(|(name, value)| (name.to_string(), value)).to_vec();
    let options =
        FitOptions { changes: Changes { set, ..Changes::default() }, per_interval: Some(4), ..FitOptions::default() };
    Ok(fit(&model, &[run], &options, &Work::default())?)
}

#[allow(dead_code, clippy::print_stdout, reason = "the tests run the example without its main function")]
fn main() -> Result<(), Box<dyn Error>> {
    let fit = estimated()?;
    println!("{}", fdm::estimate_table(&fit.estimate));
    Ok(())
}
