//! Chooses the steps inside samples: doubled until the response no longer moves.

use super::grid::Grid;
use super::recursion::{self, Intervals};
use super::scheme::Scheme;
use super::simulator::{Divergence, Simulator, Unsuited};
use crate::dynamics::Dynamics;
use crate::record::Run;
use std::fmt;

/// What was chosen for a run and what it is worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accuracy {
    /// How the run is integrated.
    pub scheme: Scheme,
    /// Steps between neighbouring samples.
    pub per_interval: usize,
    /// Estimated integration error, as a part of each output's range, largest over outputs and samples; infinite when
    /// no step that was tried gave a finite response.
    pub error: f64,
}

impl fmt::Display for Accuracy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (scheme, steps, plural) = (self.scheme, self.per_interval, if self.per_interval == 1 { "" } else { "s" });
        match scheme {
            Scheme::RungeKutta => write!(f, "{steps} {scheme} step{plural} between samples")?,
            Scheme::Recursion { .. } if self.error == 0.0 => return write!(f, "{scheme}"),
            Scheme::Recursion { .. } => {
                write!(f, "{scheme}, {steps} step{plural} between samples for its delayed inputs")?
            }
        }
        write!(f, ", integration error {:.0e} of the range", self.error)
    }
}

/// Integration errors below this part of an output's range are of no consequence to any estimate.
pub(super) const TOLERANCE: f64 = 1e-8;
/// Steps per run beyond which halving stops: what remains is said, not hidden.
const MOST_STEPS: usize = 4_000_000;
const MOST_PER_INTERVAL: usize = 1024;

/// Doubles the steps between samples until halving the step moves no output by more than 1e-8 of its range, or
/// until halving no longer helps.
///
/// # Errors
/// [`Unsuited`] as for [`Simulator::new`]. A response that diverges with every step is not an error here: the answer has an
/// infinite error and one step per interval.
pub fn choose_steps(dynamics: &dyn Dynamics, run: &Run, theta: &[f64]) -> Result<Accuracy, Unsuited> {
    if dynamics.layout().states == 0 || run.len() < 2 {
        return Ok(Accuracy { scheme: Scheme::RungeKutta, per_interval: 1, error: 0.0 });
    }
    let scheme = linear(dynamics, run).unwrap_or(Scheme::RungeKutta);
    if scheme != Scheme::RungeKutta && dynamics.layout().delayed.is_empty() {
        return Ok(Accuracy { scheme, per_interval: 1, error: 0.0 });
    }
    let mut coarse = response(dynamics, run, theta, scheme, 1)?;
    let mut best = Accuracy { scheme, per_interval: 1, error: f64::INFINITY };
    let (mut fine, mut stalls) = (2, 0);
    while fine <= MOST_PER_INTERVAL && fine * run.len() <= MOST_STEPS {
        let next = response(dynamics, run, theta, scheme, fine)?;
        if let (Ok(a), Ok(b)) = (&coarse, &next) {
            let error = halving(a, b, dynamics.layout().outputs);
            // once is no rule: a delayed kink that falls into the step of a sample leaves it when the step is halved again
            stalls = if error > 0.7 * best.error { stalls + 1 } else { 0 };
            if error < best.error {
                best = Accuracy { per_interval: fine / 2, error, ..best };
            }
            if error <= TOLERANCE || stalls == 2 {
                break;
            }
        }
        coarse = next;
        fine *= 2;
    }
    Ok(best)
}

/// Integration error of a response with `per_interval` steps between samples, measured as in [`Accuracy::error`];
/// infinite when it, or that with half the step, is not finite.
///
/// # Errors
/// [`Unsuited`] as for [`Simulator::new`].
pub fn integration_error(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    scheme: Scheme,
    per_interval: usize,
) -> Result<f64, Unsuited> {
    if dynamics.layout().states == 0 || run.len() < 2 {
        return Ok(0.0);
    }
    if scheme != Scheme::RungeKutta && dynamics.layout().delayed.is_empty() {
        return Ok(0.0);
    }
    let (coarse, fine) = (
        response(dynamics, run, theta, scheme, per_interval)?,
        response(dynamics, run, theta, scheme, 2 * per_interval)?,
    );
    let (Ok(coarse), Ok(fine)) = (coarse, fine) else { return Ok(f64::INFINITY) };
    Ok(halving(&coarse, &fine, dynamics.layout().outputs))
}

/// The exact recursion, where a model is linear and its samples stand in few different intervals.
fn linear(dynamics: &dyn Dynamics, run: &Run) -> Option<Scheme> {
    let layout = dynamics.layout();
    let suited = recursion::suits(layout) && Intervals::of(&Grid::new(&run.time, 1)).is_some();
    suited.then(|| Scheme::Recursion { subsystems: recursion::subsystems(layout) })
}

/// The fourth-order error of the coarse response is 16/15 of what halving the step removes.
fn halving(coarse: &[f64], fine: &[f64], outputs: usize) -> f64 {
    difference(coarse, fine, outputs) * 16.0 / 15.0
}

fn response(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    scheme: Scheme,
    per_interval: usize,
) -> Result<Result<Vec<f64>, Divergence>, Unsuited> {
    let mut simulator = Simulator::with_scheme(dynamics, run, scheme, per_interval)?;
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
