//! `fdm fmt`: models in the standard layout.

use crate::deliver::write;
use crate::failure::{Ending, Failure, OrFailure, ended, print_data, print_lines, report};
use clap::Args;
use fdm_grammar::Source;
use fdm_grammar::format::{Refusal, format};
use fdm_system::ModelError;
use std::io::Read;
use std::path::{Path, PathBuf};

/// What `fdm fmt` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Model files (.fdm), and folders with such files
    #[arg(value_name = "FILE", required_unless_present = "stdin")]
    files: Vec<PathBuf>,
    /// Change nothing; list the files that are not formatted, and exit with 1 if there are any
    #[arg(long)]
    check: bool,
    /// Format standard input, and print it
    #[arg(long, conflicts_with = "files")]
    stdin: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    if arguments.stdin {
        return standard_input(arguments.check);
    }
    let mut files = Vec::new();
    for path in &arguments.files {
        models(path, true, &mut files)?;
    }
    let (mut changed, mut failures) = (String::new(), Vec::new());
    for file in &files {
        match lay_out(file, arguments.check) {
            Ok(true) => changed.push_str(&format!("{}\n", file.display())),
            Ok(false) => {}
            Err(failure) => failures.push(failure),
        }
    }
    // the others are laid out although some cannot be read
    let printed = print_lines(&changed);
    if let Some(last) = failures.pop() {
        for failure in &failures {
            report(failure);
        }
        return Err(last);
    }
    ended(printed && (changed.is_empty() || !arguments.check))
}

fn standard_input(check: bool) -> Ending {
    let mut bytes = Vec::new();
    std::io::stdin().lock().read_to_end(&mut bytes).or_failure()?;
    let text = String::from_utf8(bytes).map_err(|_| Failure::input(["standard input is not UTF-8 text"]))?;
    let laid_out = laid_out(&Source::new("standard input", &*text))?;
    ended(if check { laid_out == text } else { print_data(&laid_out) })
}

/// The file, or all models in the folder and below it, in the order of their names.
fn models(path: &Path, named: bool, found: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let unreadable = |e: std::io::Error| Failure::at(path, &e);
    // a link to a folder may lead back
    let folder = if named { path.is_dir() } else { path.symlink_metadata().is_ok_and(|m| m.is_dir()) };
    if folder {
        let entries = std::fs::read_dir(path).and_then(Iterator::collect::<Result<Vec<_>, _>>).map_err(unreadable)?;
        let mut paths: Vec<PathBuf> = entries.into_iter().map(|e| e.path()).collect();
        paths.sort();
        paths.iter().try_for_each(|p| models(p, false, found))?;
    } else if named || path.extension().is_some_and(|e| e == "fdm") {
        found.push(path.into());
    }
    Ok(())
}

/// Lays a file out where it stands; says whether it was not.
fn lay_out(path: &Path, check: bool) -> Result<bool, Failure> {
    let source = fdm_system::read_source(path)?;
    let laid_out = laid_out(&source)?;
    if laid_out == source.text() {
        return Ok(false);
    }
    if !check {
        write(path, laid_out)?;
    }
    Ok(true)
}

fn laid_out(source: &Source) -> Result<String, Failure> {
    format(source).map_err(|refusal| match refusal {
        Refusal::Mistakes(diagnostics) => ModelError::Invalid { text: source.clone(), diagnostics }.into(),
        Refusal::Meaning => {
            Failure::input([format!("{}: is left as it is: formatting would change its meaning", source.name())])
        }
    })
}
