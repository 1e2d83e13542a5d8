//! W2t: a linear helicopter in hover, ten records of 20 s at 350 Hz, 20 parameters: response, sensitivities and normal
//! equations, on one thread and on two.

use crate::clock::{Row, median_of_runs, wall_of_runs};
use crate::start_up::record;
use crate::workload::{columnwise, data};
use fdm::estimate::{DerivedQuantities, NormalEquations, Problem, ProblemRun, RunResponse};
use fdm::record::Run;
use fdm::{Model, simulate::Simulator};

const RECORDS: usize = 10;

/// What the reference is made for: 5 % off the true parameters, in the model's order.
struct Helicopter {
    model: Model,
    runs: Vec<Run>,
    values: Vec<f64>,
    deviations: Vec<f64>,
}

impl Helicopter {
    fn load() -> Option<Self> {
        let model = Model::from_file("models/helicopter_benchmark/model.fdm").expect("the model compiles");
        let (inputs, measured, deviations) = (data("w2t_u")?, data("w2t_z")?, data("w2t_sd")?);
        let samples = inputs.len() / RECORDS / 4;
        let runs: Vec<Run> = (0..RECORDS)
            .map(|i| Run {
                name: format!("{i}"),
                inputs: inputs[i * 4 * samples..(i + 1) * 4 * samples].to_vec(),
                measured: measured[i * 9 * samples..(i + 1) * 9 * samples].to_vec(),
                ..record()
            })
            .collect();
        let values = data("w2t_p")?;
        assert!(model.definition().start().iter().zip(&values).all(|(a, b)| (1.05 * a - b).abs() < 1e-12 * b.abs()));
        Some(Self { model, runs, values, deviations })
    }

    fn problem(&self) -> Problem<'_> {
        let runs = self.runs.iter().map(|run| {
            let response = Simulator::new(self.model.dynamics(), run, 1).expect("nothing is held and delayed");
            let (name, measured) = (run.name.clone(), run.measured.clone());
            ProblemRun { name, response: RunResponse::in_time(response), measured, start: Vec::new() }
        });
        let derived = DerivedQuantities::of(self.model.definition(), self.model.dynamics());
        Problem::new(self.model.definition(), runs.collect(), derived)
    }

    /// Largest relative difference of responses and sensitivities from the reference.
    fn difference(&self) -> Option<f64> {
        let (y_all, j_all) = (data("w2t_y")?, data("w2t_J")?);
        let columns: Vec<usize> = (0..20).collect();
        let (mut y, mut packed) = (Vec::new(), Vec::new());
        for run in &self.runs {
            let mut simulator = Simulator::new(self.model.dynamics(), run, 1).expect("suited");
            let (mut own, mut jacobian) = (vec![0.0; 9 * run.len()], vec![0.0; 9 * run.len() * 24]);
            simulator.sensitivities(&self.values, &columns, &mut own, &mut jacobian).expect("finite");
            y.append(&mut own);
            packed.extend(jacobian.chunks_exact(24).flat_map(|row| row[..20].iter().copied()));
        }
        Some(columnwise(&y, &y_all, 9).max(columnwise(&packed, &j_all, 20)))
    }

    /// The normal equations from the reference's own Jacobian.
    fn expected(&self) -> Option<(Vec<f64>, Vec<f64>)> {
        let (y, jacobian, z) = (data("w2t_y")?, data("w2t_J")?, data("w2t_z")?);
        let (mut information, mut gradient) = (vec![0.0; 400], vec![0.0; 20]);
        for (k, row) in jacobian.chunks_exact(20).enumerate() {
            let weight = self.deviations[k % 9].powi(-2);
            for i in 0..20 {
                gradient[i] += weight * row[i] * (z[k] - y[k]);
                for j in 0..20 {
                    information[i * 20 + j] += weight * row[i] * row[j];
                }
            }
        }
        Some((information, gradient))
    }
}

/// A': response, sensitivities and normal equations of all records.
pub(crate) fn run(limit: &[Row]) {
    let Some(helicopter) = Helicopter::load() else { return };
    let row = |what: &str, seconds: f64, difference: f64| Row {
        workload: "w2t".into(),
        tool: "fdm (.fdm, machine code)".into(),
        what: what.into(),
        seconds,
        difference: Some(difference),
    };
    let Some(difference) = helicopter.difference() else { return };
    let mut problem = helicopter.problem();
    let mut equations = NormalEquations::new(&mut problem, &helicopter.deviations);
    equations.evaluate(&helicopter.values).expect("finite");
    let Some((information, gradient)) = helicopter.expected() else { return };
    let apart = columnwise(equations.information(), &information, 20);
    let sizes = equations.gradient().iter().zip(&gradient).map(|(a, b)| (a - b).abs() / b.abs());
    let worst = sizes.fold(apart.max(difference), f64::max);
    let seconds = median_of_runs(|| {
        equations.evaluate(std::hint::black_box(&helicopter.values)).expect("finite");
    });
    row("A' residual+jacobian+normal equations", seconds, worst).print(limit);

    let mut simulators: Vec<Simulator> = helicopter
        .runs
        .iter()
        .map(|run| Simulator::new(helicopter.model.dynamics(), run, 1).expect("suited"))
        .collect();
    let mut y = vec![0.0; 9 * helicopter.runs[0].len()];
    let seconds = median_of_runs(|| {
        for simulator in &mut simulators {
            simulator.simulate(std::hint::black_box(&helicopter.values), &mut y).expect("finite");
        }
    });
    row("simulation only", seconds, difference).print(limit);
}

/// The same on one thread and on two, in wall time, in a process that is not pinned; prints the figures and whether all
/// bits agree.
pub(crate) fn threads() {
    let Some(helicopter) = Helicopter::load() else { return };
    let mut results = Vec::new();
    for threads in [1, 2, 1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
        let figures = pool.install(|| {
            let mut problem = helicopter.problem();
            let mut equations = NormalEquations::new(&mut problem, &helicopter.deviations);
            let seconds = wall_of_runs(|| equations.evaluate(&helicopter.values).expect("finite"));
            let bits = equations.information().iter().chain(equations.gradient()).map(|v| v.to_bits());
            (seconds, bits.collect::<Vec<u64>>())
        });
        results.push(figures);
    }
    let best = |k: usize| results[k].0.min(results[k + 2].0);
    let same = results.iter().all(|r| r.1 == results[0].1);
    println!(
        "w2t      fdm, A' ten runs: 1 thread {:.2} ms, 2 threads {:.2} ms (wall), {:.2} times as fast, {}",
        1e3 * best(0),
        1e3 * best(1),
        best(0) / best(1),
        if same { "same bits" } else { "OTHER BITS" }
    );
}
