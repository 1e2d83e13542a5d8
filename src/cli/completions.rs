//! `fdm completions` and `fdm man`: what shells and manuals know of the command line, from its own definition.

use crate::failure::{Failure, NUMBERS, print};
use clap::{Args, Command};
use clap_complete::{Shell, generate};
use std::path::PathBuf;
use std::process::ExitCode;

/// What `fdm completions` takes.
#[derive(Debug, Args)]
pub(crate) struct Completions {
    /// The shell
    #[arg(value_name = "SHELL", value_enum)]
    shell: Shell,
}

/// What `fdm man` takes.
#[derive(Debug, Args)]
pub(crate) struct Manual {
    /// Folder to write a page for every command to; without it the first page is printed
    #[arg(value_name = "DIR")]
    folder: Option<PathBuf>,
}

/// Prints the script that completes words of `command`.
pub(crate) fn completions(arguments: &Completions, mut command: Command) -> Result<ExitCode, Failure> {
    let mut script = Vec::new();
    let name = command.get_name().to_string();
    generate(arguments.shell, &mut command, name, &mut script);
    Ok(if print(&String::from_utf8_lossy(&script)) { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

/// Prints the first page of the manual, or writes all of them.
pub(crate) fn manual(arguments: &Manual, command: Command) -> Result<ExitCode, Failure> {
    let Some(folder) = &arguments.folder else {
        let mut page = Vec::new();
        clap_mangen::Man::new(command).render(&mut page).map_err(|e| Failure::input([e]))?;
        return Ok(if print(&String::from_utf8_lossy(&page)) { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) });
    };
    let unwritable = |e: std::io::Error| Failure::input([format!("{}: {}", folder.display(), fdm::store::reason(&e))]);
    std::fs::create_dir_all(folder).map_err(unwritable)?;
    clap_mangen::generate_to(command, folder).map_err(unwritable)?;
    Ok(ExitCode::SUCCESS)
}
