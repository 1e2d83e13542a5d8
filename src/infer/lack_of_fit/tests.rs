//! Misfits that are known by construction, and what is said of them.
#![allow(clippy::unwrap_used)]

use super::*;
use fdm_numeric::random::Stream;
use fdm_system::model::Model;
use fdm_system::record::Run;
use std::f64::consts::TAU;

const INTERVAL: f64 = 0.02;
const SAMPLES: usize = 1000;

/// Two runs of a model with one output, whose response and record are functions of time and of the run.
fn described(response: impl Fn(usize, f64) -> f64, record: impl Fn(usize, f64) -> f64, noise: f64) -> LackOfFit {
    let model = Model::from_text(
        "m.fdm",
        "model m { time [s]; input u; state x; param a = -1; der(x) = a*x + u; output q [deg/s] = x; }",
    )
    .unwrap();
    let mut normal = Stream::seeded(4);
    let time: Vec<f64> = (0..SAMPLES).map(|k| k as f64 * INTERVAL).collect();
    let mut runs = Vec::new();
    let mut residuals: Vec<Vec<f64>> = Vec::new();
    for run in 0..2 {
        let measured: Vec<f64> = time.iter().map(|t| record(run, *t) + noise * normal.normal_of_pair()).collect();
        residuals.push(time.iter().zip(&measured).map(|(t, z)| z - response(run, *t)).collect());
        runs.push(Run {
            name: format!("run {run}"),
            time: time.clone(),
            inputs: time.iter().map(|t| response(run, *t)).collect(),
            held: vec![false],
            measured,
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0],
        });
    }
    let left = |(run, residual)| RunResidual { run, residual, interval: INTERVAL };
    let left: Vec<RunResidual<'_>> =
        runs.iter().zip(&residuals).map(|(run, residual)| left((run, residual.as_slice()))).collect();
    let mut all = lack_of_fit(&model, &left);
    assert_eq!(all.len(), 1);
    all.remove(0)
}

fn tones(run: usize, t: f64, late: f64) -> f64 {
    (TAU * (0.4 + 0.05 * run as f64) * t).sin() + 0.7 * (TAU * 2.0 * t + run as f64 - late.to_radians()).sin()
}

#[test]
fn a_late_record_is_late_where_it_is() {
    let found = described(|run, t| tones(run, t, 0.0), |run, t| tones(run, t, 14.0), 0.01);
    let strongest = found.gains.iter().max_by(|a, b| a.late.abs().total_cmp(&b.late.abs())).unwrap();
    assert!((strongest.late - 14.0).abs() < 1.5 && (strongest.frequency / 2.0 - 1.0).abs() < 0.3, "{strongest:?}");
    assert_eq!((strongest.runs, strongest.of), (2, 2));
    let said = found.sentences.join("\n");
    assert!(said.contains("late by 14") || said.contains("late by 13") || said.contains("late by 15"), "{said}");
    assert!(said.contains("Hz, in all runs"), "{said}");
    assert!((found.noise_level / 0.01 - 1.0).abs() < 0.1 && found.rms > 0.1, "{found:?}");
    assert!(found.bands.iter().map(|b| b.share).sum::<f64>() > 0.999);
}

#[test]
fn noise_is_called_noise() {
    let found = described(|run, t| tones(run, t, 0.0), |run, t| tones(run, t, 0.0), 0.05);
    assert!(
        found.sentences.len() == 1 && found.sentences[0].contains("is the noise of the record"),
        "{:?}",
        found.sentences
    );
    assert!(found.above_noise_level < 0.1 && found.gains.is_empty(), "{found:?}");
}

#[test]
fn a_band_a_time_and_an_amplitude_are_named() {
    let bump = |t: f64| if (6.0..8.0).contains(&t) { 0.5 * (TAU * 8.0 * t).sin() } else { 0.0 };
    let found = described(|run, t| tones(run, t, 0.0), |run, t| tones(run, t, 0.0) + bump(t), 0.01);
    let said = found.sentences.join("\n");
    assert!(said.contains("of the time, from 6 to ") && said.contains("of run 0 and from 6"), "{said}");
    let peak = found.bands.iter().max_by(|a, b| a.share.total_cmp(&b.share)).unwrap();
    assert!(peak.low < 8.0 && peak.high > 8.0, "{peak:?}");
    // the tones are explained, the bump is not
    let at = |f: f64| found.bands.iter().find(|b| b.low <= f && f < b.high).unwrap().explained.unwrap();
    assert!(at(0.4) > 0.999 && at(2.0) > 0.99 && at(8.0) < 0.1, "{:?}", found.bands);
    let cubic = |run: usize, t: f64| tones(run, t, 0.0);
    let found = described(cubic, |run, t| cubic(run, t) - 0.1 * cubic(run, t).powi(3), 0.01);
    let said = found.sentences.join("\n");
    assert!(said.contains("times as large where it is large"), "{said}");
    assert!(serde_json::to_string(&found).unwrap().contains("\"sentences\""));
}

#[test]
fn records_with_gaps_and_without_variation_are_described() {
    let gap = |t: f64| if t < 3.0 { f64::NAN } else { 0.0 };
    let found = described(|run, t| tones(run, t, 0.0), |run, t| tones(run, t, 0.0) + gap(t), 0.05);
    assert_eq!(found.compared, 2 * (SAMPLES - 150));
    assert!((found.noise_level / 0.05 - 1.0).abs() < 0.1, "{}", found.noise_level);
    let found = described(|_, _| 0.0, |_, _| 0.0, 0.0);
    assert_eq!((found.rms, found.noise_level), (0.0, 0.0));
    assert!(found.sentences.iter().all(|s| !s.contains("NaN") && !s.contains("inf")), "{:?}", found.sentences);
}
