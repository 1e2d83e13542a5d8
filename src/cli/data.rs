//! `fdm data`: what a log or data file holds, and channels of it as a table of text.

use crate::deliver::write;
use crate::failure::{Ending, Failure, as_json, aside, ended, print, print_data, print_lines};
use crate::ownership::{Overwriting, refuse_other_tables};
use clap::Args;
use fdm_readers::{RecordMap, Taken, take};
use fdm_report::{log_fields, log_table, visible};
use fdm_results::documents::LogDocument;
use fdm_results::store::DataFile;
use fdm_session::value::map_file;
use fdm_system::record::{Column, Dialect, open_log, write_to};
use std::path::{Path, PathBuf};

/// What `fdm data` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Log or data file: text, NPZ, MAT, ULog, DataFlash; HDF5, MAT 7.3, Parquet and XLSX in a build with their features
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// List every field with unit and range, behind the topics
    #[arg(long)]
    list: bool,
    /// Take the channels of a map, as CSV: a file, or `px4`, `px4-rate`, `ardupilot`, `ardupilot-rate`, `fti`
    #[arg(long, value_name = "MAP.toml", value_parser = map_file, conflicts_with = "list")]
    take: Option<RecordMap>,
    /// Use what can be read of a damaged file; what is lost is said
    #[arg(long)]
    salvage: bool,
    /// Print JSON
    #[arg(long, conflicts_with = "take")]
    json: bool,
    /// Write CSV to a file instead of to the terminal
    #[arg(short, long, value_name = "FILE", requires = "take")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwriting: Overwriting,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let (log, notes) =
        open_log(&arguments.file, arguments.salvage, arguments.take.as_ref()).map_err(|e| Failure::Records(vec![e]))?;
    let mut said: Vec<String> = notes.iter().map(ToString::to_string).collect();
    let Some(map) = &arguments.take else {
        said.iter().for_each(|note| aside(format_args!("note: {}", visible(note))));
        let document = LogDocument::of(&log, said);
        if arguments.json {
            return ended(print_lines(&as_json(&document)?));
        }
        let fields = if arguments.list { format!("\n{}", log_fields(&document)) } else { String::new() };
        return ended(print(&format!("{}{fields}", log_table(&document))));
    };
    let taken = take(&log, map, &|_| Some(false)).map_err(|errors| {
        let file = arguments.file.display();
        Failure::input(errors.iter().map(|e| format!("{file}: {e}")))
    })?;
    said.extend(taken.notes.iter().cloned());
    if !taken.absent.is_empty() {
        said.push(format!("not logged, and not needed: {}", taken.absent.join(", ")));
    }
    let held: Vec<&str> = taken.columns.iter().filter(|c| c.hold == Some(true)).map(|c| c.name.as_str()).collect();
    if !held.is_empty() {
        said.push(format!("values hold until the next: read them with --zoh {}", held.join(" --zoh ")));
    }
    said.iter().for_each(|note| aside(format_args!("note: {}", visible(note))));
    let text = table(&arguments.file, log.format, &taken, &said);
    match &arguments.output {
        Some(path) => {
            if !arguments.overwriting.force {
                refuse_other_tables(path, BEGINNING.as_bytes())?;
            }
            write(path, text)?;
            ended(true)
        }
        None => ended(print_data(&String::from_utf8_lossy(&text))),
    }
}

/// What a table begins with that this command wrote.
const BEGINNING: &str = "# taken by fdm from ";

/// The columns under comments that say where they come from.
fn table(file: &Path, format: &str, taken: &Taken, said: &[String]) -> Vec<u8> {
    let source = DataFile::new("", file);
    let name = file.file_name().map_or_else(|| "standard input".into(), |n| n.to_string_lossy().into_owned());
    let mut text = format!("{BEGINNING}{} ({format}", visible(&name));
    source.sha256.iter().for_each(|sum| text.push_str(&format!(", SHA-256 {sum}")));
    text.push_str(")\n");
    said.iter().for_each(|note| text.push_str(&format!("# {}\n", visible(note))));
    let mut bytes = text.into_bytes();
    let mut columns = Vec::new();
    columns.extend(taken.time.as_ref().map(|values| Column { name: "t", unit: Some("s"), values }));
    columns.extend(taken.columns.iter().map(|c| Column { name: &c.name, unit: c.unit.as_deref(), values: &c.values }));
    // memory takes everything that is written to it
    let _ = write_to(&mut bytes, Dialect::default(), &columns);
    bytes
}
