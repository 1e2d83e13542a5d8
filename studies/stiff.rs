//! What implicit steps cost as models grow: `cargo test --release --manifest-path studies/Cargo.toml --test studies stiff:: -- --ignored --nocapture`.

use fdm::Model;
use fdm::record::Run;
use fdm::simulate::{Scheme, Simulator, StepOptions, Steps, choose_steps};
use std::time::Instant;

/// A reaction front that diffuses through a line of cells: stiff by the number of cells squared. `far` couples every cell to the first,
/// so that the matrix has no band.
fn front(cells: usize, far: bool) -> Model {
    let mut text = String::from("model front { param D = 0.02, k = 5, m = 0.3, s = 1;\n state ");
    let names: Vec<String> = (0..cells).map(|i| format!("x{i}")).collect();
    let starts: Vec<String> =
        names.iter().enumerate().map(|(i, n)| if i < cells / 5 { format!("{n} = 1") } else { n.clone() }).collect();
    text.push_str(&starts.join(", "));
    text.push_str(";\n");
    for i in 0..cells {
        let (left, right) = (i.saturating_sub(1), (i + 1).min(cells - 1));
        let coupling = if far { " - 0.01*x0*x{i}".replace("{i}", &i.to_string()) } else { String::new() };
        text.push_str(&format!(
            "der(x{i}) = D*{c2}*(x{left} - 2*x{i} + x{right}) + k*x{i}*(1 - x{i})*(s*x{i} - m){coupling};\n",
            c2 = cells * cells
        ));
    }
    text.push_str(&format!("output a = x{}; output b = x{}; }}", cells / 3, cells / 2));
    Model::from_text("front.fdm", text).unwrap()
}

#[test]
#[ignore = "a study"]
fn cost_by_size() {
    println!(
        "{:>6} {:>5} {:>22} {:>10} {:>12} {:>12} {:>12}",
        "states", "far", "steps", "choosing", "response", "with S", "RK with S"
    );
    for far in [false, true] {
        for cells in [10, 25, 50, 100, 200] {
            let model = front(cells, far);
            let time: Vec<f64> = (0..41).map(|k| 0.25 * f64::from(k)).collect();
            let samples = time.len();
            let run = Run {
                name: "front".into(),
                measured: vec![f64::NAN; 2 * samples],
                time,
                inputs: Vec::new(),
                held: Vec::new(),
                input_gaps: Vec::new(),
                stated: Vec::new(),
                output_gaps: vec![0; 2],
            };
            let theta = model.definition().start();
            let begin = Instant::now();
            let chosen = choose_steps(model.dynamics(), &run, &theta, &StepOptions::default()).unwrap();
            let choosing = begin.elapsed();
            let timed = |steps: &Steps| {
                let mut simulator = Simulator::new(model.dynamics(), &run, steps.clone()).unwrap();
                let (mut y, mut jacobian) = (vec![0.0; 2 * samples], vec![0.0; 16 * samples]);
                let columns: Vec<usize> = (0..4).collect();
                let begin = Instant::now();
                let plain = simulator.simulate(&theta, &mut y);
                let response = begin.elapsed();
                simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).ok();
                let begin = Instant::now();
                simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).ok();
                (response, begin.elapsed(), plain.is_ok())
            };
            let (response, with, _) = timed(&chosen.steps);
            // as many explicit steps as stability needs
            let stable = (0.25 * 4.0 * 0.02 * (cells * cells) as f64 / 2.7).ceil().max(4.0) as usize;
            let (_, explicit, finite) = timed(&Steps::equal(Scheme::RungeKutta, stable));
            let explicit = if finite { format!("{explicit:.1?}") } else { "diverged".into() };
            println!(
                "{cells:>6} {far:>5} {:>22} {choosing:>10.1?} {response:>12.1?} {with:>12.1?} {explicit:>12} ({stable} per interval)",
                chosen.steps.to_string()
            );
        }
    }
}
