//! `fdm completions` and `fdm man`: what shells and manuals know of the command line, from its own definition, where this build has them.

use crate::failure::Ending;
use clap::{Args, Command};
use std::path::PathBuf;

#[cfg(feature = "manual")]
pub(crate) use written::{completions, manual};

#[cfg(feature = "manual")]
type Shell = clap_complete::Shell;
#[cfg(not(feature = "manual"))]
type Shell = String;

/// What `fdm completions` takes.
#[derive(Debug, Args)]
pub(crate) struct Completions {
    /// The shell
    #[arg(value_name = "SHELL")]
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

#[cfg(not(feature = "manual"))]
pub(crate) fn completions(_: &Completions, _: Command) -> Ending {
    absent()
}

#[cfg(not(feature = "manual"))]
pub(crate) fn manual(_: &Manual, _: Command) -> Ending {
    absent()
}

#[cfg(not(feature = "manual"))]
fn absent() -> Ending {
    let what = "this build of fdm has neither manual nor completions: build it with `--features manual`";
    Err(crate::failure::Failure::input([what]))
}

#[cfg(feature = "manual")]
mod written {
    use super::*;
    use crate::deliver::{NamedFile, refuse_others, write_all};
    use crate::failure::{OrFailure, ended, print_data};

    /// Prints the script that completes words of `command`.
    pub(crate) fn completions(arguments: &Completions, mut command: Command) -> Ending {
        let mut script = Vec::new();
        let name = command.get_name().to_string();
        clap_complete::generate(arguments.shell, &mut command, name, &mut script);
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
        refuse_others(
            folder,
            &pages.iter().filter(|page| !of_ours(page)).cloned().collect::<Vec<_>>(),
            arguments.force,
        )?;
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
}
