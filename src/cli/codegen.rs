//! `fdm codegen`: the model as stand-alone C or Rust.

use crate::deliver::write;
use crate::export::without_units;
use crate::failure::{Ending, Failure, OrFailure, ended, print_data};
use crate::load::{Estimated, ModelFile};
use crate::ownership::Overwriting;
use clap::{Args, ValueEnum};
use fdm_grammar::emit::{Elementary, Language, stand_alone};
use std::path::{Path, PathBuf};

/// What `fdm codegen` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    model: ModelFile,
    /// Language of the generated file
    #[arg(long, value_name = "LANGUAGE")]
    lang: Lang,
    /// Elementary functions of generated Rust: `libm` (the crate; results equal those of fdm to the bit), `std`, or the path of a module
    /// of your own. In C they are chosen when the file is compiled
    #[arg(long, value_name = "PATH", default_value = "libm")]
    elementary: String,
    #[command(flatten)]
    estimated: Estimated,
    /// Write to a file instead of to the terminal; `-` for standard output
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwriting: Overwriting,
}

/// Languages of the generated file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Lang {
    /// C99, one file
    C,
    /// One module
    Rust,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let language = arguments.language()?;
    let model = arguments.model.load_changed(&arguments.estimated)?;
    without_units(&model)?;
    let text = stand_alone(model.definition(), model.schedule(), &language).or_failure()?;
    let Some(path) = arguments.out.as_deref().filter(|path| *path != Path::new("-")) else {
        return ended(print_data(&text));
    };
    write(path, text)?;
    ended(true)
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
                "--elementary is for Rust: in C use `cc -DFDM_ELEMENTARY=...` when you compile the file",
            ])),
            (Lang::Rust, "std") => Ok(Language::Rust(Elementary::Std)),
            (Lang::Rust, path) if path.trim_start_matches("::").split("::").all(word) => {
                Ok(Language::Rust(Elementary::Path(path.into())))
            }
            (Lang::Rust, path) => Err(Failure::input([format!("`{path}` is not the path of a Rust module")])),
        }
    }
}
