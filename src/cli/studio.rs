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
    use crate::failure::{Failure, aside, ended, print_lines, remark};
    use crate::project;
    use fdm_studio::{Doors, Server};
    use std::path::Path;

    // commands are those of somebody who works in the folder
    if let Some(folder) = &arguments.folder {
        std::env::set_current_dir(folder).map_err(|e| Failure::at(folder, &e))?;
    }
    let said = std::sync::Mutex::new(None);
    let completed = move |words: Vec<String>| {
        let (words, note) = project::completion(words.into_iter().map(Into::into).collect(), &crate::command())?;
        let mut said = said.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        // what is said once holds until the file says something else
        if note.is_some() && *said != note {
            note.iter().for_each(|note| remark(format_args!("{note}")));
            *said = note;
        }
        Ok(words.into_iter().map(|word| word.to_string_lossy().into_owned()).collect())
    };
    let program = std::env::current_exe().ok();
    let doors = Doors { completed: Box::new(completed), language: LANGUAGE, program };
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

/// What the language says of a text, for the editor of the page.
#[cfg(feature = "studio")]
const LANGUAGE: fdm_studio::Language = {
    use crate::language::document::{Document, Position};
    use crate::language::{completion, hover};
    use fdm_studio::{Finding, Language, Suggestion};

    fn at(text: &str, (line, character): (u32, u32)) -> (Document, usize) {
        let document = Document::new("", text.into());
        let offset = document.offset(Position { line, character });
        (document, offset)
    }
    Language {
        findings: |name, text| {
            let mut document = Document::new(name, text.into());
            document.check();
            let place = |p: Position| (p.line, p.character);
            let one = |d: &fdm_grammar::Diagnostic| Finding {
                place: document.range(d.span).map(place),
                error: d.is_error(),
                message: d.hint.as_ref().map_or_else(|| d.message.clone(), |hint| format!("{}; {hint}", d.message)),
                code: d.code.text(),
            };
            document.findings.iter().map(one).collect()
        },
        suggestions: |text, place| {
            let (document, offset) = at(text, place);
            let one = |item: completion::Item| Suggestion {
                called: item.kind == completion::Kind::Function,
                label: item.label,
                detail: item.detail,
                declared: item.declared,
            };
            completion::items(&document, offset).into_iter().map(one).collect()
        },
        explained: |text, place| {
            let (mut document, offset) = at(text, place);
            document.check();
            hover::hover(&document, offset).map(|(text, _)| text)
        },
    }
};

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
