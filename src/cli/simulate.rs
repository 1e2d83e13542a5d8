//! `fdm simulate`: the model's response over recorded inputs.

use crate::deliver::write;
use crate::failure::{Ending, Failure, as_json, aside, ended, print_data, print_lines, remark};
use crate::ownership::{Overwriting, refuse_other_tables};
use clap::Args;
use fdm_session::records::with_files;
use fdm_session::simulate::{self, Response, document, header, respond, table};
use std::path::{Path, PathBuf};

/// What `fdm simulate` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: simulate::Options,
    /// Print JSON instead of CSV
    #[arg(long, conflicts_with = "output", help_heading = "Result")]
    json: bool,
    /// Write CSV to a file instead of to the terminal; `-` for standard output
    #[arg(short, long, value_name = "FILE", help_heading = "Result")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwriting: Overwriting,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let options = &arguments.options;
    let simulate::Subject { model, folder, runs } = options.subject()?;
    let folder = folder.as_ref();
    if runs.len() > 1 && !arguments.json {
        return Err(Failure::input([
            "several runs do not fit into one table: simulate them one by one, or use --json",
        ]));
    }
    let file = arguments.output.as_deref().filter(|path| *path != Path::new("-"));
    if let (Some(path), false) = (file, arguments.overwriting.force) {
        refuse_other_tables(path, &header(&model))?;
    }
    let responses: Vec<Response<'_>> =
        runs.iter().map(|run| respond(&model, run, folder, options)).collect::<Result<_, _>>()?;
    let mut good = match &responses[..] {
        _ if arguments.json => {
            print_lines(&as_json(&responses.iter().map(|r| document(&model, r)).collect::<Vec<_>>())?)
        }
        [response] => put(&table(&model, response), file)?,
        _ => true,
    };
    for response in &responses {
        if model.layout().states > 0 && !arguments.json {
            aside(format_args!("{}: {}", response.run.name, options.integration.said(&response.accuracy)));
        }
        response.doubts(&model, folder).iter().for_each(|said| remark(format_args!("{said}")));
        for said in response.faults(&model) {
            remark(format_args!("{}", with_files(&said)));
            good = false;
        }
    }
    ended(good)
}

/// Writes or prints a table; says whether all was printed.
fn put(table: &[u8], file: Option<&Path>) -> Result<bool, Failure> {
    match file {
        Some(path) => Ok(write(path, table).map(|()| true)?),
        None => Ok(print_data(&String::from_utf8_lossy(table))),
    }
}
