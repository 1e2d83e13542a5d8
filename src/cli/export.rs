//! `fdm export`: the model of a text or a result for other tools.

use crate::deliver::write;
use crate::failure::{Ending, Failure, OrFailure, aside, ended, print_data};
use crate::ownership::Overwriting;
use crate::problem;
use clap::{Args, ValueEnum};
use fdm_estimate::equation_error::{RecursiveEstimator, RecursiveOptions};
use fdm_exchange::daveml::tables;
use fdm_exchange::fmu::{self, Contents, Version};
use fdm_exchange::jsbsim::system;
use fdm_exchange::recursive::recursive_source;
use fdm_exchange::stamp::source;
use fdm_exchange::state_space::StateSpace;
use fdm_grammar::emit::{Elementary, Language};
use fdm_lab::requirement::with_estimates;
use fdm_readers::RecordMap;
use fdm_session::campaign::{Role, known_value};
use fdm_session::load::{Estimated, ModelOrResult, with_changes};
use fdm_session::records::{RunList, read_runs};
use fdm_session::value::{map_file, number, pair};
use fdm_system::Model;
use fdm_system::record::{Known, ReadOptions};
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
    #[command(flatten)]
    estimated: Estimated,
    /// What is written
    #[arg(long, value_name = "KIND")]
    to: To,
    /// Version of the Functional Mock-up Interface
    #[arg(long, value_name = "2|3", default_value = "2", value_parser = clap::value_parser!(u8).range(2..=3))]
    fmi: u8,
    /// Library that goes into a unit [default: beside this program; `cargo build --release --package fdm-fmu` builds it]
    #[arg(long, value_name = "FILE")]
    library: Option<PathBuf>,
    /// Elementary functions of Rust: `libm` (the crate; results equal those of fdm to the bit), `std`, or the path of a module of your
    /// own; in C they are chosen when the file is compiled [default: libm]
    #[arg(long, value_name = "PATH")]
    elementary: Option<String>,
    #[command(flatten)]
    recursive: Recursive,
    /// The file, or the folder of a problem; `-` for standard output, where it is text
    #[arg(short, long, value_name = "FILE", help_heading = "Result")]
    output: Option<PathBuf>,
    /// Read by the rule for files that are written over others.
    #[command(flatten)]
    _overwriting: Overwriting,
}

/// An estimator for a vehicle in flight.
#[derive(Debug, Args)]
#[command(next_help_heading = "Recursive least squares")]
struct Recursive {
    /// With `--to c`: an estimator that follows the parameters sample by sample in flight, without allocation; records of the vehicle give
    /// the sizes of its signals and of its noise
    #[arg(long, requires = "recorded")]
    recursive: bool,
    /// Forgetting factor: weight of a sample relative to the one after it, above 0, at most 1 [default: 0.99]
    #[arg(long, value_parser = number, value_name = "G", allow_negative_numbers = true, requires = "recursive")]
    forgetting: Option<f64>,
    /// Recorded runs (CSV with a header `name [unit], ...`), or patterns; may be given several times
    #[arg(long = "data", value_name = "RUN", num_args = 1.., group = "recorded", help_heading = "Data")]
    data: Vec<PathBuf>,
    #[command(flatten)]
    list: RunList,
    /// Column of a channel when its name differs; the time is called `t`; `y=log(c [mol/l])` takes logarithms
    #[arg(long = "map", value_name = "CHANNEL=COLUMN", value_parser = pair, requires = "recorded", help_heading = "Data")]
    map: Vec<(String, String)>,
    /// Map of the channels: fields of a log or columns, with unit, sign, scale, hold, delay; a file, or `px4`, `px4-rate`, `ardupilot`, `ardupilot-rate`, `fti`
    #[arg(long, value_name = "MAP.toml", value_parser = map_file, requires = "recorded", help_heading = "Data")]
    map_file: Option<RecordMap>,
    /// Zero-order hold: this input keeps its value until the next sample [default: as the model or the map says; else where it moves only at
    /// samples, all at once]
    #[arg(long, value_name = "INPUT", requires = "recorded", help_heading = "Data")]
    zoh: Vec<String>,
    /// Value that the runs bring (`known T0 per run;`), in the model's unit or its own (`--known 'T0=20 degC'`)
    #[arg(long, value_name = "NAME=VALUE", value_parser = known_value, requires = "recorded", help_heading = "Data")]
    known: Vec<Known>,
}

impl Recursive {
    /// Options that would be ignored are refused.
    fn refuse(&self, to: To) -> Result<(), Failure> {
        let said = match (self.recursive, to) {
            (true, To::C) => return Ok(()),
            (true, _) => "--recursive is for --to c: the estimator is a file of C",
            (false, _) if !self.data.is_empty() || self.list.is_given() => {
                "records are for --recursive: a model is written without them"
            }
            (false, _) => return Ok(()),
        };
        Err(Failure::input([said]))
    }

    /// The estimator, weighed by the records.
    fn source(&self, model: &Model) -> Result<String, Failure> {
        let groups = self.list.table()?.map(|table| table.groups(model)).unwrap_or_default();
        let model = if groups.is_empty() { model.clone() } else { model.grouped(groups)? };
        let reading = ReadOptions {
            map: self.map.clone(),
            map_file: self.map_file.clone(),
            hold: self.zoh.clone(),
            known: self.known.clone(),
            require_outputs: true,
            ..ReadOptions::default()
        };
        let mut files = self.list.files((&self.data, Role::Fit), &reading, &model)?;
        files.retain(|file| file.role == Role::Fit);
        let runs = read_runs(&files, &model, &[], true)?;
        let forgetting = self.forgetting.unwrap_or(RecursiveOptions::default().forgetting);
        let estimator = RecursiveEstimator::of(&model, &runs, forgetting).or_failure()?;
        recursive_source(&estimator).or_failure()
    }
}

/// Kinds of files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum To {
    /// Functional mock-up unit, for model exchange and co-simulation
    Fmu,
    /// C99, one file: rates, outputs, their derivatives and sensitivities, equal to the bit
    C,
    /// Rust, one module, with what the file of C holds
    Rust,
    /// State space as JSON, for python-control and SciPy
    Control,
    /// System of JSBSim
    Jsbsim,
    /// Tables of the model, as DAVE-ML 2.0
    Daveml,
    /// Folder with a problem of PEtab, version 1: SBML and tables, of a result with its records
    Petab,
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

/// Refuses a model that foreign code has a part in.
pub(crate) fn without_units(model: &Model) -> Result<(), Failure> {
    const SAID: &str = "the model uses a functional mock-up unit (`use fmu`), whose code goes into no file of ours; \
        `fdm export --to control` writes its matrices";
    if model.holds_foreign_code() { Err(Failure::input([SAID])) } else { Ok(()) }
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    arguments.recursive.refuse(arguments.to)?;
    arguments.refuse_elementary()?;
    let file = arguments.output.as_deref().filter(|path| *path != Path::new("-"));
    if arguments.to == To::Petab {
        let Some(folder) = file else {
            return Err(Failure::input(["a problem of PEtab is a folder: name it with -o DIR"]));
        };
        return problem::run(&arguments.model, folder);
    }
    let (model, errors) = with_values(&arguments.model, arguments.like.as_deref())?;
    let model = with_changes(&model, &arguments.estimated.changes())?;
    // matrices are numbers; everything else would have to bring the code
    if arguments.to != To::Control {
        without_units(&model)?;
    }
    let text = match arguments.to {
        To::Fmu => {
            let Some(path) = file else {
                return Err(Failure::input(["a unit is not text: give a file (-o FILE.fmu)"]));
            };
            return unit(arguments, (&model, &errors), path);
        }
        To::C if arguments.recursive.recursive => arguments.recursive.source(&model)?,
        To::C => source(&model, &Language::C).or_failure()?,
        To::Rust => source(&model, &Language::Rust(arguments.elementary()?)).or_failure()?,
        // written before
        To::Petab => String::new(),
        To::Jsbsim => system(&model).or_failure()?,
        To::Daveml => {
            let found = tables(&model, &errors).or_failure()?;
            for (table, error) in &found.resampled {
                aside(format_args!(
                    "note: `{table}` is no linear table: on a finer grid straight lines err by {error:.1e} at most"
                ));
            }
            found.text
        }
        To::Control => {
            let found = StateSpace::of(&model).or_failure()?;
            if !found.delays.is_empty() {
                aside(format_args!(
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

impl Arguments {
    /// Elementary functions are chosen where Rust is written.
    fn refuse_elementary(&self) -> Result<(), Failure> {
        let said = match (&self.elementary, self.to) {
            (None, _) | (_, To::Rust) => return Ok(()),
            (_, To::C) => "--elementary is for Rust: in C use `cc -DFDM_ELEMENTARY=...` when you compile the file",
            _ => "--elementary is for --to rust",
        };
        Err(Failure::input([said]))
    }

    /// Where Rust finds elementary functions.
    fn elementary(&self) -> Result<Elementary, Failure> {
        let word = |part: &str| {
            let mut letters = part.chars();
            letters.next().is_some_and(|c| c.is_ascii_alphabetic() || c == '_')
                && letters.all(|c| c.is_ascii_alphanumeric() || c == '_')
        };
        match self.elementary.as_deref().unwrap_or("libm") {
            "std" => Ok(Elementary::Std),
            path if path.trim_start_matches("::").split("::").all(word) => Ok(Elementary::Path(path.into())),
            path => Err(Failure::input([format!("`{path}` is not the path of a Rust module")])),
        }
    }
}

fn unit(arguments: &Arguments, (model, errors): (&Model, &BTreeMap<String, f64>), path: &Path) -> Ending {
    let library = match &arguments.library {
        Some(named) => named.clone(),
        None => unit_library().map_err(|why| Failure::input([why]))?,
    };
    let bytes = fdm_results::store::read_input(&library).map_err(|e| Failure::at(&library, &e))?;
    let version = if arguments.fmi == 2 { Version::Two } else { Version::Three };
    let written = fmu::write(&Contents { model, version, library: &bytes, errors }).or_failure()?;
    write(path, written)?;
    ended(true)
}

/// The library that goes into units: the one that the environment names, that beside this program, or that where it was built; or where to get it.
pub(crate) fn unit_library() -> Result<PathBuf, String> {
    let named = std::env::var_os(LIBRARY).map(PathBuf::from);
    if let Some(path) = named {
        let lost = || format!("{LIBRARY} names {}, where no file is", path.display());
        return if path.is_file() { Ok(path) } else { Err(lost()) };
    }
    let name = library_name();
    beside().ok_or_else(|| {
        let folder = std::env::current_exe().ok().and_then(|p| Some(p.parent()?.display().to_string()));
        let folder = folder.unwrap_or_else(|| "FOLDER".into());
        format!(
            "{name} is neither beside this program nor where it was built: in a checkout of fdm type\n  \
             cargo build --release --package fdm-fmu && cp target/release/{name} {folder}\n\
             or name it by --library FILE or {LIBRARY}"
        )
    })
}

/// The variable that names the library of units where it is not beside the program, as in a wheel.
const LIBRARY: &str = "FDM_FMU_LIBRARY";

/// What Cargo calls the library on this kind of machine.
fn library_name() -> String {
    format!("{}fdm_fmu{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX)
}

/// The library beside this program or in the build folder, where `cargo install` leaves it; or in the folder within where Cargo puts what others
/// need.
fn beside() -> Option<PathBuf> {
    let program = std::env::current_exe().ok()?.canonicalize().ok()?;
    let folder = program.parent()?;
    // `OUT_DIR` is PROFILE/build/PACKAGE/out
    let built = Path::new(env!("OUT_DIR")).ancestors().nth(3)?;
    let places = [folder, built].into_iter().flat_map(|folder| [folder.to_path_buf(), folder.join("deps")]);
    places.map(|place| place.join(library_name())).find(|path| path.is_file())
}
