//! Values and rows of several subsystems: packed, large, shown twice, and with what is written to the rows in between.

use crate::model::Model;
use crate::record::Run;
use crate::simulate::Simulator;

/// A chain of nine states, three small subsystems, one state shown twice, outputs that are no states, a constant.
const SEVERAL: &str = "model several {
    input u, v;
    state a1 = x0, a2 = 0, a3 = 0, a4 = 0, a5 = 0, a6 = 0, a7 = 0, a8 = 0, a9 = 0;
    state b = 1, c1 = 0, c2 = 0.3, d = 0;
    param k = 0.7, h = 1.3, g = 0.4, o = 0.2, x0 = 0.5;
    der(a1) = u - k*a1; der(a2) = k*(a1 - a2); der(a3) = a2 - a3; der(a4) = a3 - a4; der(a5) = a4 - a5;
    der(a6) = a5 - a6; der(a7) = a6 - a7; der(a8) = a7 - a8; der(a9) = a8 - h*a9;
    der(b) = -g*b + o; der(c1) = c2; der(c2) = -h*c1 - g*c2 + v; der(d) = u + v;
    output y1 = a9, y2 = c1, y3 = c1, y4 = b, y5 = a1 + k*a9 + o, y6 = c2 - h*v, y7 = d;
}";
/// Two small subsystems in one vector, each with both inputs.
const SMALL: &str = "model small {
    input u, v;
    state b = 1, c1 = 0, c2 = 0.3;
    param h = 1.3, g = 0.4;
    der(b) = -g*b + u + h*v; der(c1) = c2; der(c2) = -h*c1 - g*c2 + v + g*u;
    output y1 = c2, y2 = b, y3 = c2;
}";
/// Two small subsystems in one vector, with an output of the second that is no state.
const MIXED: &str = "model mixed {
    input u, v;
    state b = 1, c1 = 0, c2 = 0.3;
    param h = 1.3, g = 0.4;
    der(b) = -g*b + u + h*v; der(c1) = c2; der(c2) = -h*c1 - g*c2 + v + g*u;
    output y1 = b, y2 = c1 + h*c2, y3 = u;
}";
/// Outputs that are not linear.
const GENERAL: &str = "model general {
    input u, v;
    state b = 1, c1 = 0, c2 = 0.3;
    param h = 1.3, g = 0.4;
    der(b) = -g*b + u; der(c1) = c2; der(c2) = -h*c1 - g*c2 + v;
    output y1 = c2*b, y2 = b + g, y3 = c1^2;
}";

fn run(outputs: usize) -> Run {
    let n = 300;
    Run {
        name: "r".into(),
        time: (0..n).map(|k| 0.05 * k as f64 + if k > 150 { 0.02 } else { 0.0 }).collect(),
        inputs: (0..n).flat_map(|k| [(0.1 * k as f64).sin(), (0.03 * (k * k % 41) as f64).cos()]).collect(),
        held: vec![false, true],
        measured: vec![f64::NAN; outputs * n],
        input_gaps: vec![0; 2],
        stated: Vec::new(),
        output_gaps: vec![0; outputs],
    }
}

#[test]
fn values_and_rows_agree_whatever_is_written_to_the_rows_in_between() {
    for text in [SEVERAL, SMALL, MIXED, GENERAL] {
        for per in [1, 3] {
            let model = Model::from_text("m.fdm", text).expect("compiles");
            let (q, theta) = (model.layout().outputs, model.definition().start());
            let run = run(q);
            let mut simulator = Simulator::new(model.dynamics(), &run, per).expect("suited");
            let all: Vec<usize> = (0..theta.len()).collect();
            for columns in [&all[..], &all[1..2]] {
                let cells = q * run.len();
                let (mut y, mut alone, mut jacobian) = (vec![0.0; cells], vec![0.0; cells], vec![0.0; cells * 8]);
                simulator.simulate(&theta, &mut alone).expect("finite");
                simulator.sensitivities(&theta, columns, &mut y, &mut jacobian).expect("finite");
                assert!(alone.iter().zip(&y).all(|(a, b)| a.to_bits() == b.to_bits()), "{per}");
                // whoever takes the rows writes to all of them
                let mut again = vec![0.0; cells * 8];
                let mut sink = |block: crate::simulate::Block<'_>| {
                    block.copy_to(&mut y, &mut again, 8);
                    block.rows.fill(f64::NAN);
                };
                simulator.stream(&theta, columns, &mut sink).expect("finite");
                assert!(again.iter().zip(&jacobian).all(|(a, b)| a.to_bits() == b.to_bits()), "{per}");
                for (c, param) in columns.iter().enumerate() {
                    let mut at = |step: f64| {
                        let (mut moved, mut y) = (theta.clone(), vec![0.0; cells]);
                        moved[*param] += step;
                        simulator.simulate(&moved, &mut y).expect("finite");
                        y
                    };
                    let (above, below) = (at(1e-5), at(-1e-5));
                    for k in 0..cells {
                        let (slope, exact) = ((above[k] - below[k]) / 2e-5, jacobian[k * 8 + c]);
                        assert!(
                            (slope - exact).abs() < 1e-7 * (1.0 + exact.abs()),
                            "{per} {param} {k}: {slope} {exact}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn the_state_that_leaves_the_finite_numbers_first_is_told_though_others_share_its_vector() {
    let text = "model apart { input u, v; state calm = 1, wild = 1e300; param k = 1, g = 400; der(calm) = -k*calm + u;
        der(wild) = g*wild + v; output y = calm, z = wild; }";
    let model = Model::from_text("m.fdm", text).expect("compiles");
    let (run, theta) = (run(2), model.definition().start());
    let mut simulator = Simulator::new(model.dynamics(), &run, 1).expect("suited");
    let mut y = vec![0.0; 2 * run.len()];
    let found = simulator.simulate(&theta, &mut y).expect_err("it overflows");
    assert_eq!(found.state, Some(1));
    let mut jacobian = vec![0.0; 2 * run.len() * 8];
    let again = simulator.sensitivities(&theta, &[0, 1], &mut y, &mut jacobian).expect_err("it overflows");
    assert_eq!((again.state, again.sample, again.time), (found.state, found.sample, found.time));
}
