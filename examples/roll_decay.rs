//! Fit a model from a file to a recorded run.
//!
//! `cargo run --release --example roll_decay`

use fdm::{Fit, FitOptions, Model, ReadOptions, Work, fit};
use std::error::Error;
use std::path::Path;

/// The tanker's free roll with damping and stiffness as the record wants them; `project` holds `models/`.
pub(crate) fn estimated(project: &Path) -> Result<Fit, Box<dyn Error>> {
    let folder = project.join("models/ship_roll_decay");
    let model = Model::from_file(folder.join("model.fdm"))?;
    let (run, _summary) = model.read_run(folder.join("run.csv"), &ReadOptions::default())?;
    Ok(fit(&model, &[run], &FitOptions::default(), &Work::default())?)
}

#[allow(dead_code, clippy::print_stdout, reason = "the tests run the example without its main function")]
fn main() -> Result<(), Box<dyn Error>> {
    let fit = estimated(Path::new(env!("CARGO_MANIFEST_DIR")))?;
    println!("{}", fdm::estimate_table(&fit.estimate));
    Ok(())
}
