//! `fdm studio`: the application in a browser, over the files of a folder.

use crate::failure::Ending;
use clap::Args;
use std::path::PathBuf;

/// What `fdm studio` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder of the project: `fdm.toml`, model, records, results [default: the working folder]
    #[arg(value_name = "FOLDER")]
    folder: Option<PathBuf>,
    /// Port on this machine [default: any that is free]
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true, allow_negative_numbers = true)]
    port: u16,
    /// Only print the address
    #[arg(long)]
    no_browser: bool,
}

#[cfg(feature = "studio")]
pub(crate) fn run(arguments: &Arguments) -> Ending {
    use crate::failure::{Failure, aside, ended, print_lines};
    use crate::project;
    use fdm_studio::{Doors, Server};
    use std::path::Path;

    // commands are those of somebody who works in the folder
    if let Some(folder) = &arguments.folder {
        std::env::set_current_dir(folder).map_err(|e| Failure::at(folder, &e))?;
    }
    let completed = |words: Vec<String>| {
        let words = project::completed(words.into_iter().map(Into::into).collect(), &crate::command())?;
        Ok(words.into_iter().map(|word| word.to_string_lossy().into_owned()).collect())
    };
    #[cfg(feature = "lsp")]
    let language = Some(std::sync::Mutex::new(crate::language_server::window::answering()));
    #[cfg(not(feature = "lsp"))]
    let language = None;
    let program = std::env::current_exe().ok();
    let doors = Doors { completed: Box::new(completed), language, program };
    let server = Server::bind(Path::new(""), arguments.port, doors)?;
    let address = server.address();
    print_lines(&format!("{address}\n"));
    if !arguments.no_browser && !opened(&address) {
        aside(format_args!("no browser could be opened: open the address above"));
    }
    aside(format_args!("Ctrl-C ends it; everything stands in the folder"));
    server.run();
    ended(true)
}

/// Opens a browser as the system does; says whether one was found.
#[cfg(feature = "studio")]
fn opened(address: &str) -> bool {
    use std::process::{Command, Stdio};
    let (program, words): (&str, &[&str]) = match std::env::consts::OS {
        "macos" => ("open", &[]),
        "windows" => ("rundll32", &["url.dll,FileProtocolHandler"]),
        _ => ("xdg-open", &[]),
    };
    let quiet = Stdio::null;
    Command::new(program).args(words).arg(address).stdin(quiet()).stdout(quiet()).stderr(quiet()).spawn().is_ok()
}

#[cfg(not(feature = "studio"))]
pub(crate) fn run(_: &Arguments) -> Ending {
    let what = "this build of fdm has no studio: build it with `--features studio`";
    Err(crate::failure::Failure::input([what]))
}
