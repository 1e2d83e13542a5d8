//! Speed beside the peers: the workloads W1 (residual and Jacobian of a nonlinear ship) and W5 (text to first
//! Jacobian of an 11-state helicopter) among others, each checked against reference data before it is timed.
//!
//! The peers are set up outside the repository (see docs/notebook/decisions.md). Where the hand-written limit and the reference
//! data are found, the limit runs first and last in the same run on the same core; with `PEERS` naming the peers' folder all
//! tools run. Otherwise our own figures stand alone. `cargo bench -- w3` measures one of w1, w2t, w2f, w3, w3f, w4, w5, w6, w7.
#![allow(clippy::print_stdout, reason = "a benchmark prints its figures")]

mod aircraft;
mod chain;
mod clock;
mod delay;
mod frequency;
mod helicopter;
mod start_up;
mod workload;
mod zoom;

use clock::{Row, median_of_runs};
use fdm::Model;
use fdm::estimate::{Changes, FitOptions, Noise, Options, Work, fit};
use fdm::simulate::{Block, Simulator};
use std::path::PathBuf;
use workload::{Reference, Ship};

fn main() {
    if std::env::args().any(|a| a == "--start-up") {
        return start_up::measure();
    }
    if std::env::args().any(|a| a == "--threads") {
        return helicopter::threads();
    }
    let chosen: Vec<String> = std::env::args().skip(1).filter(|a| a.starts_with('w')).collect();
    let wanted = |workload: &str| chosen.is_empty() || chosen.iter().any(|c| c == workload);
    if wanted("w2t") {
        threads();
    }
    let core = clock::pin();
    println!("one core ({core}), CPU time, medians\n");
    if wanted("w1") {
        ship();
    }
    let measures = [
        ("w2t", "w2t", helicopter::run as fn(&[Row])),
        ("w2f", "w2f", frequency::helicopter),
        ("w3", "w3", delay::run),
        ("w3f", "w3", frequency::delay),
        ("w4", "w4", zoom::run),
        ("w6", "w6", chain::run),
        ("w7", "w7", aircraft::run),
    ];
    for (name, workload, measure) in measures {
        if wanted(name) {
            let before = limit(workload);
            measure(&before);
            for row in peers(workload) {
                row.print(&before);
            }
        }
    }
    if wanted("w5") {
        start_up::run();
    }
}

/// W1, and a hundred of them in one record.
fn ship() {
    let before = limit("w1");
    for (tag, hundredfold) in [("w1", false), ("w1x100", true)] {
        let reference = Reference::load(tag);
        let by_file = Model::from_file("models/manoeuvring_ship/model.fdm").expect("the model compiles");
        let by_macro = workload::ship_macro();
        for (door, model) in [(".fdm, machine code", &by_file), ("model!", &by_macro)] {
            let ship = Ship::new(hundredfold);
            for row in residual_and_jacobian(tag, door, model, &ship, reference.as_ref()) {
                row.print(&before);
            }
            for bare in [true, false] {
                if let Some(row) = reference.as_ref().and_then(|r| fit_of(tag, door, model, &ship, r, bare)) {
                    row.print(&before);
                }
            }
        }
    }
    for row in peers("w1") {
        row.print(&before);
    }
}

/// What threads give, in a process of its own that is not pinned.
fn threads() {
    let program = std::env::current_exe().expect("this program has a path");
    if let Ok(output) = std::process::Command::new(program).arg("--threads").output() {
        print!("{}", String::from_utf8_lossy(&output.stdout));
    }
}

/// W1 unit A: states and their exact derivatives by eleven coefficients and three initial values at 1.05 C.
fn residual_and_jacobian(tag: &str, door: &str, model: &Model, ship: &Ship, reference: Option<&Reference>) -> [Row; 2] {
    let theta = ship.theta(model, 1.05);
    let columns = ship.columns(model);
    let mut simulator = Simulator::new(model.dynamics(), &ship.run, 1).expect("nothing is held and delayed");
    let (n, stride) = (ship.run.len(), columns.len().div_ceil(8) * 8);
    let (mut y, mut jacobian) = (vec![0.0; 3 * n], vec![0.0; 3 * n * stride]);
    simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).expect("the ship does not diverge");
    let difference = reference.map(|r| r.difference(&y, &jacobian, stride));
    let stored = median_of_runs(|| {
        let theta = std::hint::black_box(&theta);
        simulator.sensitivities(theta, &columns, &mut y, &mut jacobian).expect("the ship does not diverge");
    });
    let streamed = median_of_runs(|| {
        let theta = std::hint::black_box(&theta);
        let mut sink = |block: Block<'_>| _ = std::hint::black_box(block.rows);
        simulator.stream(theta, &columns, &mut sink).expect("the ship does not diverge");
    });
    let row = |what: &str, seconds: f64| {
        let (tool, what) = (format!("fdm ({door})"), format!("A residual+jacobian ({what})"));
        Row { workload: tag.into(), tool, what, seconds, difference }
    };
    [row("in blocks", streamed), row("stored", stored)]
}

/// W1 unit B: the whole fit from 1.3 C and the first measured sample, measurement noise known; when it is bare, without what
/// `fdm fit` tells about residuals and steps besides.
fn fit_of(tag: &str, door: &str, model: &Model, ship: &Ship, reference: &Reference, bare: bool) -> Option<Row> {
    let run = reference.measured(&ship.run)?;
    let theta = ship.theta(model, 1.3);
    let coefficients = ship.columns(model).into_iter().take(11);
    let set = coefficients.map(|k| (model.definition().params[k].quantity.name.clone(), theta[k]));
    let options = FitOptions {
        changes: Changes { set: set.collect(), ..Changes::default() },
        options: known_noise(reference.deviations()?, bare),
        per_interval: Some(1),
        bare,
        ..FitOptions::default()
    };
    let solve = || fit(model, std::slice::from_ref(&run), &options, &Work::default()).expect("W1 can be estimated");
    let found = solve();
    assert!(found.estimate.is_good(), "{}", found.estimate.termination);
    let cost = reference.cost(&found.estimate.runs[0].residuals)?;
    let seconds = median_of_runs(|| {
        std::hint::black_box(solve());
    });
    let (tool, what) = (format!("fdm ({door})"), fit_name(bare));
    Some(Row { workload: tag.into(), tool, what, seconds, difference: Some(cost) })
}

/// Known noise; errors corrected for the colour of the residuals belong to what a bare fit leaves out.
fn known_noise(deviations: Vec<Option<f64>>, bare: bool) -> Options {
    Options { noise: Noise::Given(deviations), tolerance: 1e-8, colour: !bare, ..Options::default() }
}

/// What a row of fits is called.
fn fit_name(bare: bool) -> String {
    if bare { "B fit" } else { "B fit (all judged)" }.into()
}

/// Rows of every tool when `PEERS` names the peers' folder, else those of the limit.
fn peers(workload: &str) -> Vec<Row> {
    let Ok(folder) = std::env::var("PEERS") else { return limit(workload) };
    let output = std::process::Command::new("sh").arg(PathBuf::from(folder).join("run.sh")).arg(workload).output();
    output.map_or_else(|_| Vec::new(), |o| rows(&o.stdout))
}

/// Rows of the hand-written limit, when it has been built.
fn limit(workload: &str) -> Vec<Row> {
    let home = std::env::var("HOME").unwrap_or_default();
    let target = std::env::var("PEERS_TARGET").unwrap_or(format!("{home}/peers-target"));
    let program = PathBuf::from(target).join("limit/release/limit");
    let Ok(output) = std::process::Command::new(program).arg(workload).output() else { return Vec::new() };
    rows(&output.stdout)
}

fn rows(text: &[u8]) -> Vec<Row> {
    String::from_utf8_lossy(text).lines().filter_map(Row::parse).collect()
}
