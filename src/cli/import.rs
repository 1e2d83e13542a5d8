//! `fdm import`: a problem of PEtab, or a model of SBML, becomes a folder with a model, records and a project file.

use crate::deliver::{refuse_standing, write_folder};
use crate::failure::{Ending, Failure, aside, ended, print};
use clap::Args;
use std::path::PathBuf;

/// What `fdm import` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Problem of PEtab (its .yaml file, version 1 or 2), or model of SBML (.xml)
    #[arg(value_name = "PROBLEM")]
    problem: PathBuf,
    /// Folder that is made: model.fdm, runs.csv, runs/, fdm.toml, and IMPORT.md with what was left out
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let folder = &arguments.out;
    refuse_standing(folder)?;
    let import = fdm_petab::import(&arguments.problem).map_err(Failure::Input)?;
    let mut files = vec![("model.fdm", &import.model), ("IMPORT.md", &import.report)];
    if !import.runs.is_empty() {
        files.extend([("runs.csv", &import.table), ("fdm.toml", &import.project)]);
    }
    files.extend(import.runs.iter().map(|f| (f.path.as_str(), &f.text)));
    let files: Vec<_> = files.iter().map(|(name, text)| (name.to_string(), text.as_bytes().to_vec())).collect();
    write_folder(folder, &files)?;
    import.remarks.iter().for_each(|r| aside(format_args!("note: {r}")));
    let place = folder.display();
    let next = match import.runs.is_empty() {
        true => format!("{place}\n\n  fdm check {place}/model.fdm\n"),
        false => format!("{place}\n\n  cd {place}\n  fdm fit\n"),
    };
    ended(print(&next))
}
