//! Two small models with records, for trying things out; every example of this crate uses them.

use crate::{Model, Run, Simulator};
use fdm_numeric::random::SplitMix;
use std::error::Error;

/// First-order decay `x' = -k x` from 1, and one run of 40 samples in 4 s: made with k = 0.5 1/s and white noise of 0.01.
///
/// # Errors
/// None: the text is a model.
///
/// ```
/// let (model, runs) = fdm::example::decay()?;
/// assert_eq!((model.name(), runs[0].len()), ("decay", 40));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn decay() -> Result<(Model, Vec<Run>), Box<dyn Error>> {
    let text = "model decay {\n  state x = 1;\n  param k = 0.3 in [0, 10] [1/s];\n  der(x) = -k*x;\n  output y = x;\n}";
    let model = Model::from_text("decay.fdm", text)?;
    let times: Vec<f64> = (0..40).map(|k| 0.1 * f64::from(k)).collect();
    let run = model.run("decay").times(times).without_outputs().build()?;
    let run = measured(&model, run, &[0.5], 0.01)?;
    Ok((model, vec![run]))
}

/// Roll of a ship by its rudder, and two runs of 600 samples in 30 s, `sweep` and `doublet`: made with d = 0.4, omega2 = 2, b = 0.8 and
/// white noise of 0.005 in roll rate and roll angle.
///
/// # Errors
/// None: the text is a model.
///
/// ```
/// let (model, runs) = fdm::example::roll()?;
/// assert_eq!(model.definition().inputs[0].quantity.name, "rudder");
/// assert_eq!([&runs[0].name, &runs[1].name], ["sweep", "doublet"]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn roll() -> Result<(Model, Vec<Run>), Box<dyn Error>> {
    let text = "model roll \"roll of a ship\" {
  input rudder [rad];
  state p \"roll rate\" [rad/s], phi \"roll angle\" [rad];
  param d = 0.2 in [0, 5] [1/s], omega2 = 1.5 in [0, 50] [1/s^2], b = 1 [1/s^2];
  der(p) = -d*p - omega2*phi + b*rudder;
  der(phi) = p;
  output p_m [rad/s] = p;
  output phi_m [rad] = phi;
}";
    let model = Model::from_text("roll.fdm", text)?;
    let times: Vec<f64> = (0..600).map(|k| 0.05 * f64::from(k)).collect();
    let sweep = |t: &f64| 0.1 * (0.3 * t + 0.05 * t * t).sin();
    let doublet = |t: &f64| if *t < 1.0 || *t >= 5.0 { 0.0 } else { 0.1 * (3.0 - t).signum() };
    let rudders = [times.iter().map(sweep).collect::<Vec<f64>>(), times.iter().map(doublet).collect()];
    let mut runs = Vec::new();
    for (name, rudder) in ["sweep", "doublet"].into_iter().zip(rudders) {
        let run = model.run(name).times(times.clone()).samples("rudder", rudder).without_outputs().build()?;
        runs.push(measured(&model, run, &[0.4, 2.0, 0.8], 0.005)?);
    }
    Ok((model, runs))
}

/// The run with the model's response at `theta` as its measurement, with noise.
fn measured(model: &Model, run: Run, theta: &[f64], deviation: f64) -> Result<Run, Box<dyn Error>> {
    let mut response = run.measured.clone();
    Simulator::new(model.dynamics(), &run, 4)?
        .simulate(theta, &mut response)
        .map_err(|d| format!("the response leaves the finite numbers at {} s", d.time))?;
    let mut noise = SplitMix(run.name.len() as u64);
    response.iter_mut().for_each(|y| *y += deviation * noise.sum_of_twelve());
    Ok(Run { measured: response, ..run })
}
