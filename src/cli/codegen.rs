//! `fdm codegen`: the model as stand-alone C or Rust.

use crate::failure::{Failure, NUMBERS, print};
use crate::subject::{Estimated, Subject};
use clap::{Args, ValueEnum};
use fdm::store::reason;
use fdm_grammar::emit::{Elementary, Language, stand_alone};
use std::path::PathBuf;
use std::process::ExitCode;

/// What `fdm codegen` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    subject: Subject,
    /// Language of the generated file
    #[arg(long, value_name = "LANGUAGE")]
    lang: Lang,
    /// Where generated Rust finds sin, exp, ...: `libm` (the crate, for the bits of fdm), `std`, or the path of a module of your own. In C they
    /// are bound when the file is compiled, as it says itself
    #[arg(long, value_name = "PATH", default_value = "libm")]
    elementary: String,
    /// Leave out the partials by a parameter
    #[arg(long, value_name = "NAME", help_heading = "Parameters")]
    fix: Vec<String>,
    /// Differentiate by a parameter that the model declares `fixed`
    #[arg(long, value_name = "NAME", help_heading = "Parameters")]
    free: Vec<String>,
    /// Write to a file instead of to the terminal
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// What can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Lang {
    /// C99, one file
    C,
    /// One module
    Rust,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let language = arguments.language()?;
    let model = arguments.subject.load()?;
    let mut params = model.definition().params.clone();
    let estimated = Estimated { fix: arguments.fix.clone(), free: arguments.free.clone() };
    let changes = arguments.subject.changes(&estimated);
    changes.apply(&mut params).map_err(Failure::input)?;
    let model = model.with_params(params);
    let text = stand_alone(model.definition(), model.schedule(), &language).map_err(|e| Failure::input([e]))?;
    let Some(path) = &arguments.out else {
        return Ok(if print(&text) { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) });
    };
    if path.canonicalize().is_ok_and(|p| arguments.subject.model.canonicalize().is_ok_and(|m| m == p)) {
        return Err(Failure::input([format!("{}: is the model itself", path.display())]));
    }
    std::fs::write(path, text).map_err(|e| Failure::input([format!("{}: {}", path.display(), reason(&e))]))?;
    Ok(ExitCode::SUCCESS)
}

impl Arguments {
    fn language(&self) -> Result<Language, Failure> {
        let word = |part: &str| {
            let mut letters = part.chars();
            letters.next().is_some_and(|c| c.is_ascii_alphabetic() || c == '_')
                && letters.all(|c| c.is_ascii_alphanumeric() || c == '_')
        };
        match (self.lang, self.elementary.as_str()) {
            (Lang::C, "libm") => Ok(Language::C),
            (Lang::C, _) => Err(Failure::input([
                "--elementary is for Rust: a C file takes the functions that `cc -DFDM_ELEMENTARY=...` names",
            ])),
            (Lang::Rust, "std") => Ok(Language::Rust(Elementary::Std)),
            (Lang::Rust, path) if path.trim_start_matches("::").split("::").all(word) => {
                Ok(Language::Rust(Elementary::Path(path.into())))
            }
            (Lang::Rust, path) => Err(Failure::input([format!("`{path}` is not the path of a Rust module")])),
        }
    }
}
