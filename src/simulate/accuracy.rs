//! What an integration is worth: its response compared with that of half the steps.

use super::scheme::Scheme;
use super::simulator::{Divergence, Simulator, Unsuited};
use super::steps::Steps;
use crate::dynamics::Dynamics;
use crate::record::Run;

/// What was chosen for a run and what it is worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Accuracy {
    /// How the run is integrated, and its steps.
    pub steps: Steps,
    /// Estimated integration error, as a part of each output's range, largest over outputs and samples; infinite when
    /// no step that was tried gave a finite response.
    pub error: f64,
}

/// Integration errors below this part of an output's range are of no consequence to any estimate.
pub(super) const TOLERANCE: f64 = 1e-8;

/// Integration error of a response with these steps, measured as in [`Accuracy::error`]; infinite when it, or that with half the
/// steps, is not finite.
///
/// # Errors
/// [`Unsuited`] as for [`Simulator::new`].
pub fn integration_error(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    steps: impl Into<Steps>,
) -> Result<f64, Unsuited> {
    let steps = steps.into();
    if is_exact(dynamics, run, &steps) {
        return Ok(0.0);
    }
    match response(dynamics, run, theta, &steps)? {
        Ok(coarse) => error_of(dynamics, run, theta, &steps, &coarse),
        Err(_) => Ok(f64::INFINITY),
    }
}

/// The same for a response (N by q) that is known.
///
/// # Errors
/// As [`integration_error`].
pub fn error_of(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    steps: &Steps,
    coarse: &[f64],
) -> Result<f64, Unsuited> {
    if is_exact(dynamics, run, steps) {
        return Ok(0.0);
    }
    let Ok(fine) = response(dynamics, run, theta, &steps.halved())? else { return Ok(f64::INFINITY) };
    Ok(halving(coarse, &fine, dynamics.layout().outputs, steps))
}

/// Whether halving the steps changes nothing.
fn is_exact(dynamics: &dyn Dynamics, run: &Run, steps: &Steps) -> bool {
    let layout = dynamics.layout();
    let exact = matches!(steps.scheme(), Scheme::Recursion { .. }) && layout.delayed.is_empty();
    exact || layout.states == 0 || run.len() < 2
}

/// The error of the coarse response, of which halving the steps removes all but one part in 2 to the power of the order.
pub(super) fn halving(coarse: &[f64], fine: &[f64], outputs: usize, steps: &Steps) -> f64 {
    difference(coarse, fine, outputs) * steps.scheme().part_removed_by_halving()
}

pub(super) fn response(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    steps: &Steps,
) -> Result<Result<Vec<f64>, Divergence>, Unsuited> {
    let mut simulator = Simulator::new(dynamics, run, steps.clone())?;
    simulator.suits(theta)?;
    let mut y = vec![0.0; simulator.samples() * simulator.outputs()];
    Ok(simulator.simulate(theta, &mut y).map(|()| y))
}

/// Largest difference of two responses, each output as a part of its range.
fn difference(a: &[f64], b: &[f64], outputs: usize) -> f64 {
    let mut worst = 0.0_f64;
    for i in 0..outputs {
        let column = |y: &'_ [f64]| y.iter().skip(i).step_by(outputs).copied().collect::<Vec<f64>>();
        let (a, b) = (column(a), column(b));
        let high = b.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let low = b.iter().copied().fold(f64::INFINITY, f64::min);
        let range = if high > low { high - low } else { high.abs().max(1.0) };
        worst = a.iter().zip(&b).map(|(a, b)| (a - b).abs() / range).fold(worst, f64::max);
    }
    worst
}
