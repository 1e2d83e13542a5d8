//! The second derivative of a response along a step, by a difference against the exact first one.
//!
//! Along a curved valley of the cost a straight step leaves the valley floor at once; a step that follows the bend can
//! be many times longer (geodesic acceleration: Transtrum and Sethna, 2012). It needs one more simulation and one more
//! sweep of sensitivities, and is used only where full steps fail.

use super::information::Linearised;

/// Part of a step over which the bend is measured.
pub(super) const AHEAD: f64 = 0.1;

/// Writes J' R^-1 y'' to `bend` (one number for each column), where y'' is the second derivative along `step` (by
/// columns) seen in the responses `ahead`, a part of the step further on. A difference that rounding explains is none.
pub(super) fn project(at: &Linearised<'_>, ahead: &[f64], step: &[f64], inverse_noise: &[f64], bend: &mut [f64]) {
    let q = at.outputs;
    bend.fill(0.0);
    for (k, row) in at.jacobian.chunks(at.stride).enumerate().filter(|(k, _)| !at.measured[*k].is_nan()) {
        let sample = k - k % q;
        // R^-1 mixes the outputs of a sample when the noise is full; elsewhere only the diagonal is other than zero
        let weights = &inverse_noise[(k % q) * q..(k % q + 1) * q];
        let outputs = weights.iter().enumerate().filter(|(o, w)| **w != 0.0 && !at.measured[sample + o].is_nan());
        let weighted: f64 = outputs.map(|(o, w)| w * second(at, ahead, step, sample + o)).sum();
        for (b, j) in bend.iter_mut().zip(row) {
            *b += weighted * j;
        }
    }
}

fn second(at: &Linearised<'_>, ahead: &[f64], step: &[f64], k: usize) -> f64 {
    let slope: f64 = at.jacobian[k * at.stride..].iter().zip(step).map(|(j, s)| j * s).sum();
    let difference = (ahead[k] - at.y[k]) / AHEAD - slope;
    let rounding = 64.0 * f64::EPSILON * at.y[k].abs() / AHEAD;
    if difference.abs() > rounding { 2.0 / AHEAD * difference } else { 0.0 }
}
