//! W4: 13 channels of 105,000 samples at 350 per second, transformed from 0.1 to 3 Hz in steps of 0.005 Hz.

use crate::clock::{Row, median_of_runs};
use crate::workload::{columnwise, data};
use fdm::spectrum::{Frequencies, Transform};
use num_complex::Complex64;

const CHANNELS: usize = 13;
const BAND: Frequencies = Frequencies::Band { lowest: 0.1, highest: 3.0, spacing: Some(0.005) };

/// Measures the plan and the transform with a plan at hand.
pub(crate) fn run(limit: &[Row]) {
    let Some(x) = data("w4_x") else { return };
    let samples = x.len() / CHANNELS;
    let plan = || {
        let comb = BAND.of(samples, 1.0 / 350.0, CHANNELS).expect("the record shows the band");
        Transform::new(samples, CHANNELS, &comb)
    };
    let mut transform = plan();
    let mut sums = vec![Complex64::ZERO; CHANNELS * transform.comb().len()];
    transform.apply_to(&x, &mut sums);
    // the reference has frequencies in rows
    let count = transform.comb().len();
    let rows =
        (0..count).flat_map(|k| (0..CHANNELS).map(move |c| c * count + k)).flat_map(|at| [sums[at].re, sums[at].im]);
    let difference = data("w4_X").map(|want| columnwise(&rows.collect::<Vec<_>>(), &want, 2 * CHANNELS));
    let row = |what: &str, seconds: f64, difference: Option<f64>| Row {
        workload: "w4".into(),
        tool: "fdm".into(),
        what: what.into(),
        seconds,
        difference,
    };
    let seconds = median_of_runs(|| transform.apply_to(std::hint::black_box(&x), &mut sums));
    row("transform", seconds, difference).print(limit);
    row("plan", median_of_runs(|| _ = std::hint::black_box(plan())), None).print(limit);
}
