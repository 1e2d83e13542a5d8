//! Three manoeuvres of a family: two that are fitted, and one that takes no part.

use crate::chance::Chance;
use crate::families::{Drive, Family};
use fdm::Model;
use fdm::record::{Column, Run, write};
use std::f64::consts::PI;
use std::path::Path;

/// Names of the manoeuvres, and of their files.
pub(crate) const MANOEUVRES: [&str; 3] = ["run1", "run2", "holdout"];

/// A run with these inputs (one row per sample) and nothing measured.
pub(crate) fn run(model: &Model, name: &str, step: f64, inputs: Vec<f64>) -> Run {
    let (m, q) = (model.layout().inputs, model.layout().outputs);
    let samples = inputs.len() / m;
    Run {
        name: name.into(),
        time: (0..samples).map(|k| step * k as f64).collect(),
        inputs,
        held: vec![false; m],
        measured: vec![f64::NAN; samples * q],
        input_gaps: vec![0; m],
        stated: Vec::new(),
        output_gaps: vec![0; q],
    }
}

/// The three manoeuvres as deviations from the trim over the largest one: for each the inputs, one row per sample.
pub(crate) fn excitation(family: &Family, chance: &mut Chance) -> [Vec<f64>; 3] {
    let m = family.drives.len();
    std::array::from_fn(|which| {
        // the held-out run is neither larger nor smaller than both others
        let size = [1.0, 0.7, 0.85][which];
        let columns: Vec<Vec<f64>> = (0..m)
            .map(|i| match which {
                0 if !family.multisines => steps(family, i),
                2 if !family.multisines && m == 1 => sweep(family, &family.drives[i], chance),
                _ => multisine(family, i, chance),
            })
            .collect();
        (0..family.samples).flat_map(|t| columns.iter().map(|c| size * c[t]).collect::<Vec<_>>()).collect()
    })
}

/// In the inputs' units.
pub(crate) fn inputs(family: &Family, excitation: &[f64]) -> Vec<f64> {
    let scaled = |(k, x): (usize, &f64)| {
        let drive = &family.drives[k % family.drives.len()];
        drive.trim + drive.amplitude * x
    };
    excitation.iter().enumerate().map(scaled).collect()
}

/// 3-2-1-1 again and again, alternately larger and smaller, each input in its turn.
fn steps(family: &Family, input: usize) -> Vec<f64> {
    let (low, high) = family.drives[input].band;
    let unit = 0.45 / (low * high).sqrt() * 0.5;
    let (duration, count) = (family.duration(), family.drives.len());
    let slot = (14.0 * unit).min(0.45 * duration / count as f64);
    let unit = slot / 14.0;
    let value = |t: f64| {
        let at = t - 0.02 * duration;
        let k = (at / slot).floor() as i64;
        if at < 0.0 || k.rem_euclid(count as i64) != input as i64 {
            return 0.0;
        }
        let inside = (at - slot * k as f64) / unit;
        let size = [1.0, -0.5, 0.7, -1.0][(k as usize / count) % 4];
        match inside {
            x if x < 3.0 => size,
            x if x < 5.0 => -size,
            x if x < 6.0 => size,
            x if x < 7.0 => -size,
            _ => 0.0,
        }
    };
    (0..family.samples).map(|k| value(family.step * k as f64)).collect()
}

/// From the lowest to the highest frequency, faded in.
fn sweep(family: &Family, drive: &Drive, chance: &mut Chance) -> Vec<f64> {
    let (low, high) = drive.band;
    let (duration, sign) = (family.duration(), chance.sign());
    let rate = (high / low).ln() / duration;
    let value = |t: f64| sign * (2.0 * PI * low * ((rate * t).exp() - 1.0) / rate).sin();
    (0..family.samples).map(|k| value(family.step * k as f64)).collect()
}

/// Lines of the band with random phases, those of the inputs interleaved; the lowest peak of some draws, begun at rest.
fn multisine(family: &Family, input: usize, chance: &mut Chance) -> Vec<f64> {
    let (low, high) = family.drives[input].band;
    let (duration, count) = (family.duration(), family.drives.len());
    let first = ((low * duration).ceil() as usize).max(1);
    let lines: Vec<usize> = (first..=(high * duration) as usize).filter(|k| k % count == input).collect();
    let mut best: Option<(f64, Vec<f64>)> = None;
    for _ in 0..20 {
        let phases: Vec<f64> = lines.iter().map(|_| chance.between(0.0, 2.0 * PI)).collect();
        let at = |t: f64| -> f64 {
            let angles = lines.iter().zip(&phases).map(|(k, p)| 2.0 * PI * *k as f64 * t / duration + p);
            angles.map(f64::sin).sum()
        };
        let mut x: Vec<f64> = (0..family.samples).map(|k| at(family.step * k as f64)).collect();
        let begin = x[0];
        for (k, v) in x.iter_mut().enumerate() {
            *v -= begin * (-(family.step * k as f64) / (0.02 * duration)).exp();
        }
        let peak = x.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
        let power = (x.iter().map(|v| v * v).sum::<f64>() / x.len() as f64).sqrt();
        x.iter_mut().for_each(|v| *v /= peak);
        if best.as_ref().is_none_or(|(b, _)| peak / power < *b) {
            best = Some((peak / power, x));
        }
    }
    best.expect("some draws").1
}

/// Writes a run as a table that the tool reads: time, inputs and outputs of `model`, with their units.
pub(crate) fn write_run(path: &Path, model: &Model, run: &Run, time_unit: &str) {
    let definition = model.definition();
    let (m, q) = (run.held.len(), run.output_gaps.len());
    let column = |values: &[f64], width: usize, k: usize| values.iter().skip(k).step_by(width).copied().collect();
    let mut columns: Vec<(String, Option<String>, Vec<f64>)> =
        vec![("time".into(), Some(time_unit.into()), run.time.clone())];
    let unit = |u: &Option<_>| u.as_ref().map(|u: &fdm_grammar::unit::Unit| u.to_string());
    for (k, input) in definition.inputs.iter().enumerate() {
        columns.push((input.quantity.name.clone(), unit(&input.quantity.unit), column(&run.inputs, m, k)));
    }
    for (k, output) in definition.outputs.iter().enumerate() {
        columns.push((output.quantity.name.clone(), unit(&output.quantity.unit), column(&run.measured, q, k)));
    }
    let columns: Vec<Column<'_>> =
        columns.iter().map(|(n, u, v)| Column { name: n, unit: u.as_deref(), values: v }).collect();
    write(path, &columns).expect("a folder that can be written to");
}
