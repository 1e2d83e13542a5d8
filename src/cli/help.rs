//! `fdm explain`: the pages of the codes that messages have; `fdm completions` and `fdm man`: what shells and manuals know of the
//! command line, from its own definition.

use crate::deliver::{NamedFile, refuse_others, write_all};
use crate::failure::{Ending, Failure, OrFailure, did_you_mean, ended, print, print_data};
use clap::{Args, Command};
use clap_complete::{Shell, generate};
use fdm_grammar::Code;
use fdm_grammar::explain::{code, page};
use std::path::PathBuf;

/// What `fdm explain` takes.
#[derive(Debug, Args)]
pub(crate) struct Explain {
    /// Codes as messages show them, such as E0201; all are listed when none is given
    #[arg(value_name = "CODE")]
    codes: Vec<String>,
}

pub(crate) fn explain(arguments: &Explain) -> Ending {
    let (mut found, mut unknown) = (Vec::new(), Vec::new());
    for text in &arguments.codes {
        match code(text.trim_matches(['[', ']'])) {
            Some(code) => found.push(code),
            None => unknown.push(refusal(text)),
        }
    }
    if !unknown.is_empty() {
        return Err(Failure::Input(unknown));
    }
    let text = match &found[..] {
        [] => list(),
        codes => codes.iter().map(|c| page(*c)).collect::<Vec<_>>().join("\n"),
    };
    ended(print(&text))
}

fn list() -> String {
    let lines: String = Code::ALL.iter().map(|c| format!("{}  {}\n", c.text(), c.title())).collect();
    lines + "\n`fdm explain CODE` shows an example of each, and the example corrected\n"
}

fn refusal(text: &str) -> String {
    let near = did_you_mean(text, Code::ALL.iter().map(|c| c.text()));
    format!("`{text}` is not the code of a message{near} (`fdm explain` lists them all)")
}

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
    /// Folder for one page a command [default: the first page is printed]
    #[arg(value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Replace other files of the same names in that folder
    #[arg(long, requires = "folder")]
    force: bool,
}

/// Prints the script that completes words of `command`.
pub(crate) fn completions(arguments: &Completions, mut command: Command) -> Ending {
    let mut script = Vec::new();
    let name = command.get_name().to_string();
    generate(arguments.shell, &mut command, name, &mut script);
    ended(print_data(&String::from_utf8_lossy(&script)))
}

/// Prints the first page of the manual, or writes all of them.
pub(crate) fn manual(arguments: &Manual, command: Command) -> Ending {
    let Some(folder) = &arguments.folder else {
        let mut page = Vec::new();
        clap_mangen::Man::new(command).render(&mut page).or_failure()?;
        return ended(print_data(&String::from_utf8_lossy(&page)));
    };
    let mut command = command.disable_help_subcommand(true);
    command.build();
    let pages = pages(command).or_failure()?;
    let of_ours = |(name, _): &&NamedFile| {
        std::fs::read_to_string(folder.join(name))
            .is_ok_and(|text| text.lines().any(|line| line.starts_with(".TH fdm")))
    };
    // pages of another version are replaced
    refuse_others(folder, &pages.iter().filter(|page| !of_ours(page)).cloned().collect::<Vec<_>>(), arguments.force)?;
    write_all(folder, &pages)?;
    ended(true)
}

/// A page for a command and for each of those below it.
fn pages(command: Command) -> std::io::Result<Vec<NamedFile>> {
    let below = command.get_subcommands().filter(|c| !c.is_hide_set()).cloned().collect::<Vec<_>>();
    let mut pages = Vec::new();
    for command in below {
        pages.extend(self::pages(command)?);
    }
    let page = clap_mangen::Man::new(command);
    let mut text = Vec::new();
    page.render(&mut text)?;
    pages.push((page.get_filename(), text));
    Ok(pages)
}
