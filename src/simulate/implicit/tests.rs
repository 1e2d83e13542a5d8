//! Order, stiffness and sensitivities of the implicit method.

use crate::Model;
use crate::record::Run;
use crate::simulate::{Integrator, Simulator, Steps};

/// A run without inputs.
pub(in crate::simulate) fn run(time: Vec<f64>, outputs: usize) -> Run {
    let measured = vec![f64::NAN; time.len() * outputs];
    let (inputs, held, input_gaps, output_gaps) = (Vec::new(), Vec::new(), Vec::new(), vec![0; outputs]);
    Run { name: "r".into(), time, inputs, held, measured, input_gaps, output_gaps }
}

pub(in crate::simulate) fn model(text: &str) -> Model {
    Model::from_text("test.fdm", text).unwrap_or_else(|e| panic!("{e}"))
}

/// The response with these steps at the model's start values.
fn response(model: &Model, run: &Run, steps: &Steps) -> Vec<f64> {
    let mut y = vec![0.0; run.len() * model.layout().outputs];
    let mut simulator = Simulator::new(model.dynamics(), run, steps.clone()).expect("suited");
    simulator.simulate(&model.definition().start(), &mut y).expect("finite");
    y
}

/// The pendulum: smooth, not stiff, without a closed form.
#[test]
fn states_converge_with_order_five() {
    let pendulum = model(
        "model pendulum { param w = 2; state phi = 1.5, r; der(phi) = r; der(r) = -w^2*sin(phi); output y = phi; }",
    );
    let run = run(vec![0.0, 0.5, 1.0, 2.0, 3.0], 1);
    let at = |n| response(&pendulum, &run, &Steps::equal(Integrator::Radau, n));
    let best = at(256);
    let error = |n| at(n).iter().zip(&best).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let (coarse, fine) = (error(8), error(16));
    let order = (coarse / fine).log2();
    assert!((4.8..5.4).contains(&order), "{order}: {coarse:e} {fine:e}");
}
