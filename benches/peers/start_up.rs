//! W5: from the text of an 11-state model to its first Jacobian, in a process of its own.

use crate::clock::cpu_seconds;
use fdm::{Model, record::Run, simulate::Simulator};

const SAMPLES: usize = 7001;

/// Starts this program again for a single measurement, several times, and prints the median.
pub(crate) fn run() {
    let program = std::env::current_exe().expect("this program has a path");
    let mut rows: Vec<(f64, f64)> = (0..7)
        .filter_map(|_| {
            let output = std::process::Command::new(&program).arg("--start-up").output().ok()?;
            let text = String::from_utf8(output.stdout).ok()?;
            let mut numbers = text.split_whitespace().filter_map(|n| n.parse().ok());
            Some((numbers.next()?, numbers.next()?))
        })
        .collect();
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some((seconds, mebibytes)) = rows.get(rows.len() / 2) else { return };
    println!(
        "w5       fdm (.fdm, machine code)     model to first jacobian, time {:6.2} ms CPU, peak {mebibytes:.0} MiB",
        1e3 * seconds
    );
}

/// CPU seconds since the process began and peak memory in MiB, after the first Jacobian of one 20 s record at 350 Hz.
pub(crate) fn measure() {
    let model = Model::from_file("models/helicopter_benchmark/model.fdm").expect("the model compiles");
    let run = record();
    let columns: Vec<usize> = (0..model.layout().params).collect();
    let mut simulator = Simulator::new(model.dynamics(), &run, 1).expect("nothing is held and delayed");
    let stride = columns.len().div_ceil(8) * 8;
    let (mut y, mut jacobian) = (vec![0.0; 9 * SAMPLES], vec![0.0; 9 * SAMPLES * stride]);
    let theta: Vec<f64> = model.definition().start().iter().map(|p| 1.05 * p).collect();
    simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).expect("the helicopter stays finite");
    assert!(jacobian.iter().any(|j| *j != 0.0), "there are sensitivities");
    println!("{} {}", cpu_seconds(), peak_mebibytes());
}

/// Record 0 of W2: four multisine inputs, nothing measured.
pub(crate) fn record() -> Run {
    let amplitudes = [0.01, 0.01, 0.02, 0.01];
    let times: Vec<f64> = (0..SAMPLES).map(|k| k as f64 / 350.0).collect();
    let input = |t: f64, m: usize| {
        let envelope = (t / 0.5).min((20.0 - t) / 0.5).clamp(0.0, 1.0);
        let sum: f64 = (0..8)
            .map(|s| {
                let h = (2 + m % 4 + 7 * s) as f64;
                let phase = std::f64::consts::PI * (s * s) as f64 / 8.0 + 1.3 * m as f64;
                (2.0 * std::f64::consts::PI * h / 20.0 * t + phase).sin()
            })
            .sum();
        envelope * amplitudes[m] * sum
    };
    Run {
        name: "w2".into(),
        inputs: times.iter().flat_map(|t| (0..4).map(move |m| input(*t, m))).collect(),
        time: times,
        held: vec![false; 4],
        measured: vec![f64::NAN; 9 * SAMPLES],
        input_gaps: vec![0; 4],
        stated: Vec::new(),
        output_gaps: vec![0; 9],
    }
}

fn peak_mebibytes() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with("VmHWM:"));
    line.and_then(|l| l.split_whitespace().nth(1)?.parse::<f64>().ok()).map_or(f64::NAN, |kib| kib / 1024.0)
}
