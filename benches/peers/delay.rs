//! W3t: second order with an input delay, five parameters, 30 s at 40 Hz: residual and Jacobian, and the whole fit.
//!
//! The reference samples the delayed input at the stages of its steps; `fdm` gives the stages the moments of the true signal
//! (see docs/notebook/decisions.md), so that the two differ by the error of the former.

use crate::clock::{Row, median_of_runs};
use crate::workload::{columnwise, data};
use crate::{fit_name, known_noise};
use fdm::estimate::{Changes, FitOptions, Work, fit};
use fdm::record::Run;
use fdm::{Model, simulate::Simulator};

/// Measures A and B.
pub(crate) fn run(limit: &[Row]) {
    let model = Model::from_file("models/second_order_delay/model.fdm").expect("the model compiles");
    let Some(run) = record() else { return };
    let row = |what: &str, seconds: f64, difference: Option<f64>| Row {
        workload: "w3t".into(),
        tool: "fdm (.fdm, machine code)".into(),
        what: what.into(),
        seconds,
        difference,
    };
    let Some(theta) = data("w3_p") else { return };
    let columns: Vec<usize> = (0..5).collect();
    let mut simulator = Simulator::new(model.dynamics(), &run, 1).expect("suited");
    let (mut y, mut jacobian) = (vec![0.0; run.len()], vec![0.0; 8 * run.len()]);
    simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).expect("finite");
    let packed: Vec<f64> = jacobian.chunks_exact(8).flat_map(|row| row[..5].iter().copied()).collect();
    let difference = data("w3_y").zip(data("w3_J"));
    let difference = difference.map(|(want, rows)| columnwise(&y, &want, 1).max(columnwise(&packed, &rows, 5)));
    let seconds = median_of_runs(|| {
        let theta = std::hint::black_box(&theta);
        simulator.stream(theta, &columns, &mut |block| _ = std::hint::black_box(block.rows[0])).expect("finite");
    });
    row("A residual+jacobian", seconds, difference).print(limit);

    let start = model.definition().params.iter().map(|p| (p.quantity.name.clone(), 1.3 * p.value));
    let set: Vec<_> = start.collect();
    for bare in [true, false] {
        let options = FitOptions {
            changes: Changes { set: set.clone(), ..Changes::default() },
            options: known_noise(vec![Some(1.0)], bare),
            per_interval: Some(1),
            bare,
            ..FitOptions::default()
        };
        let solve =
            || fit(&model, std::slice::from_ref(&run), &options, &Work::default()).expect("W3 can be estimated");
        let found = solve();
        assert!(found.estimate.is_good(), "{}", found.estimate.termination);
        let cost = found.estimate.runs[0].residuals.iter().map(|v| v * v).sum();
        let seconds = median_of_runs(|| {
            std::hint::black_box(solve());
        });
        row(&fit_name(bare), seconds, Some(cost)).print(limit);
    }
}

fn record() -> Option<Run> {
    let (inputs, measured) = (data("w3_u")?, data("w3_z")?);
    Some(Run {
        name: "w3".into(),
        time: (0..inputs.len()).map(|k| k as f64 / 40.0).collect(),
        inputs,
        measured,
        held: vec![false],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0],
    })
}
