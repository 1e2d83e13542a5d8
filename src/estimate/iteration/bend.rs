//! The second derivative of a response along a step, by a difference against the exact first one.
//!
//! Along a curved valley of the cost a straight step leaves the valley floor at once; a step that follows the bend can
//! be many times longer (geodesic acceleration: Transtrum and Sethna, 2012). It needs one more simulation and one more
//! sweep of sensitivities, and is used only where full steps fail.

use crate::simulate::Block;

/// Part of a step over which the bend is measured.
pub(in crate::estimate) const AHEAD: f64 = 0.1;

/// Adds J' R^-1 y'' of a block to `bend` (one number for each column), where y'' is the second derivative along `step` (by
/// columns) seen in the responses `ahead`, a part of the step further on. `measured` and `ahead` belong to the samples of the
/// block (by q). A difference that rounding explains is none.
pub(in crate::estimate) fn project(
    block: &Block<'_>,
    measured: &[f64],
    ahead: &[f64],
    step: &[f64],
    inverse_noise: &[f64],
    bend: &mut [f64],
) {
    let q = block.layout.outputs.len();
    for (k, _) in measured.iter().enumerate().filter(|(_, z)| !z.is_nan()) {
        let (sample, output) = (k / q, k % q);
        // R^-1 mixes the outputs of a sample when the noise is full; elsewhere only the diagonal is other than zero
        let weights = inverse_noise[output * q..(output + 1) * q].iter().enumerate();
        let outputs = weights.filter(|(o, w)| **w != 0.0 && !measured[sample * q + o].is_nan());
        let weighted: f64 = outputs.map(|(o, w)| w * second(block, ahead, step, (sample, o))).sum();
        for (column, j) in block.layout.outputs[output].columns.iter().zip(block.row(sample, output)) {
            bend[*column as usize] += weighted * j;
        }
    }
}

fn second(block: &Block<'_>, ahead: &[f64], step: &[f64], (sample, output): (usize, usize)) -> f64 {
    let row = block.layout.outputs[output].columns.iter().zip(block.row(sample, output));
    let slope: f64 = row.map(|(column, j)| j * step[*column as usize]).sum();
    let k = sample * block.layout.outputs.len() + output;
    let difference = (ahead[k] - block.y[k]) / AHEAD - slope;
    let rounding = 64.0 * f64::EPSILON * block.y[k].abs() / AHEAD;
    if difference.abs() > rounding { 2.0 / AHEAD * difference } else { 0.0 }
}
