//! `fdm export`: the model of a text or a result for other tools.

use crate::deliver::write;
use crate::failure::{Ending, Failure, OrFailure, ended, print_data, remark};
use crate::load::ModelOrResult;
use crate::modes::with_estimates;
use crate::ownership::Overwriting;
use clap::{Args, ValueEnum};
use fdm_exchange::fmu::{self, Contents, Version};
use fdm_exchange::jsbsim::system;
use fdm_exchange::source::source;
use fdm_exchange::state_space::StateSpace;
use fdm_grammar::emit::{Elementary, Language};
use fdm_system::Model;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What `fdm export` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    model: ModelOrResult,
    /// Run of the result whose per-run parameters (biases, initial states) are used [default: the only one]
    #[arg(long, value_name = "RUN", requires = "from_result", help_heading = "Parameters")]
    like: Option<String>,
    /// What is written
    #[arg(long, value_name = "KIND")]
    to: To,
    /// Version of the Functional Mock-up Interface
    #[arg(long, value_name = "2|3", default_value = "2", value_parser = clap::value_parser!(u8).range(2..=3))]
    fmi: u8,
    /// Library that goes into a unit [default: beside this program; `cargo build --release --package fdm-fmu` builds it]
    #[arg(long, value_name = "FILE")]
    library: Option<PathBuf>,
    /// The file; `-` for standard output, where it is text
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Read by the rule for files that are written over others.
    #[command(flatten)]
    _overwriting: Overwriting,
}

/// Kinds of files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum To {
    /// Functional mock-up unit, for model exchange and co-simulation
    Fmu,
    /// C99, one file
    C,
    /// Rust, one module
    Rust,
    /// State space as JSON, for python-control and SciPy
    Control,
    /// System of JSBSim
    Jsbsim,
}

/// The model with the values that it is used with, and standard errors by name: those of a run of a result, where one is given.
pub(crate) fn with_values(
    subject: &ModelOrResult,
    like: Option<&str>,
) -> Result<(Model, BTreeMap<String, f64>), Failure> {
    let (model, folder) = subject.load()?;
    let Some(folder) = folder else { return Ok((subject.changed(&model)?, BTreeMap::new())) };
    let runs = folder.runs();
    let only = || (runs.len() == 1).then(|| runs[0].clone());
    let run = like.map(String::from).or_else(only).unwrap_or_default();
    let theta = folder.theta(&model, &run, like).or_failure()?;
    let covariance = folder.result().covariance(&model, &run);
    let found = with_estimates(&model, &theta, covariance.as_deref());
    let params = model.definition().params.iter().enumerate();
    let error = |k: usize| covariance.as_ref().map(|c| c[k * theta.len() + k].sqrt()).filter(|e| *e > 0.0);
    let errors = params.filter_map(|(k, param)| Some((param.quantity.name.clone(), error(k)?))).collect();
    Ok((subject.changed(&found)?, errors))
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let file = arguments.output.as_deref().filter(|path| *path != Path::new("-"));
    let (model, errors) = with_values(&arguments.model, arguments.like.as_deref())?;
    let text = match arguments.to {
        To::Fmu => {
            let Some(path) = file else {
                return Err(Failure::input(["a unit is not text: give a file (-o FILE.fmu)"]));
            };
            return unit(arguments, (&model, &errors), path);
        }
        To::C => source(&model, &Language::C).or_failure()?,
        To::Rust => source(&model, &Language::Rust(Elementary::Path("libm".into()))).or_failure()?,
        To::Jsbsim => system(&model).or_failure()?,
        To::Control => {
            let found = StateSpace::of(&model).or_failure()?;
            if !found.delays.is_empty() {
                remark(format_args!(
                    "note: {} delayed signal(s) stand beside the matrices, under `delays`",
                    found.delays.len()
                ));
            }
            found.json().or_failure()?
        }
    };
    let Some(path) = file else { return ended(print_data(&text)) };
    write(path, text)?;
    ended(true)
}

fn unit(arguments: &Arguments, (model, errors): (&Model, &BTreeMap<String, f64>), path: &Path) -> Ending {
    let library = match &arguments.library {
        Some(named) => named.clone(),
        None => beside().ok_or_else(|| {
            let name = library_name();
            Failure::input([format!(
                "{name} is not beside this program: build it by `cargo build --release --package fdm-fmu`, or name it with --library FILE"
            )])
        })?,
    };
    let bytes = std::fs::read(&library).map_err(|e| Failure::at(&library, &e))?;
    let version = if arguments.fmi == 2 { Version::Two } else { Version::Three };
    let written = fmu::write(&Contents { model, version, library: &bytes, errors }).or_failure()?;
    write(path, written)?;
    ended(true)
}

/// What Cargo calls the library on this kind of machine.
fn library_name() -> String {
    format!("{}fdm_fmu{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX)
}

/// The library beside this program, or in the folder beside it where Cargo puts what tests need.
fn beside() -> Option<PathBuf> {
    let program = std::env::current_exe().ok()?.canonicalize().ok()?;
    let folder = program.parent()?;
    let places = [folder.join(library_name()), folder.join("deps").join(library_name())];
    places.into_iter().find(|path| path.is_file())
}
