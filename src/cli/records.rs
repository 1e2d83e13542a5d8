//! The recorded runs that a verb works on.

use crate::failure::{Failure, remark};
use clap::Args;
use fdm::Model;
use fdm::record::{ReadOptions, Run, Summary, channels, read};
use fdm::store::{DataFile, Manifest};
use std::path::PathBuf;

/// Which files, and how they are to be read.
#[derive(Debug, Args)]
#[command(next_help_heading = "Data")]
pub(crate) struct Records {
    /// Recorded run (CSV with a header `name [unit], ...`); may be given several times
    #[arg(long = "data", value_name = "RUN", required = true)]
    pub(crate) data: Vec<PathBuf>,
    #[command(flatten)]
    selection: Selection,
}

/// What is used of the files, and as what.
#[derive(Debug, Args)]
#[command(next_help_heading = "Data")]
pub(crate) struct Selection {
    /// Column of a channel when its name differs; the time is called `t`; `y=log(c [mol/l])` takes logarithms
    #[arg(long = "map", value_name = "CHANNEL=COLUMN", value_parser = pair, requires = "data")]
    map: Vec<(String, String)>,
    /// Use the record from this time on, in the file's unit
    #[arg(long, value_name = "TIME", allow_negative_numbers = true, requires = "data")]
    from: Option<f64>,
    /// Use the record up to this time, in the file's unit
    #[arg(long, value_name = "TIME", allow_negative_numbers = true, requires = "data")]
    to: Option<f64>,
    /// Use every N-th sample
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, requires = "data")]
    every: usize,
    /// Input that keeps its value until the next sample, instead of being linear between samples
    #[arg(long, value_name = "INPUT", requires = "data")]
    hold: Vec<String>,
}

impl Records {
    /// Reads all runs; the problems of all files are reported together. Runs are named after their files.
    pub(crate) fn load(&self, model: &Model, require_outputs: bool) -> Result<Vec<(Run, Summary)>, Failure> {
        load(&self.data, &self.selection.options(require_outputs), model)
    }

    /// How the files are read, when all outputs are wanted.
    pub(crate) fn options(&self) -> ReadOptions {
        self.selection.options(true)
    }

    /// What is written about the files into a result.
    pub(crate) fn describe(&self, runs: &[Run], manifest: &mut Manifest) {
        manifest.data = runs.iter().zip(&self.data).map(|(run, file)| DataFile::new(&run.name, file)).collect();
        manifest.reading = self.selection.options(true);
    }
}

impl Selection {
    pub(crate) fn options(&self, require_outputs: bool) -> ReadOptions {
        ReadOptions {
            map: self.map.clone(),
            from: self.from,
            to: self.to,
            every: self.every,
            hold: self.hold.clone(),
            require_outputs,
        }
    }
}

/// Reads runs; the problems of all files are reported together. Runs are named after their files.
pub(crate) fn load(files: &[PathBuf], options: &ReadOptions, model: &Model) -> Result<Vec<(Run, Summary)>, Failure> {
    let channels = channels(model.definition());
    let (mut runs, mut errors) = (Vec::new(), Vec::new());
    for path in files {
        match read(path, &channels, options) {
            Ok(run) => runs.push(run),
            Err(e) => errors.push(e),
        }
    }
    if !errors.is_empty() {
        return Err(Failure::Records(errors));
    }
    tell_apart(&mut runs);
    Ok(runs)
}

/// Runs whose files share a name are numbered.
fn tell_apart(runs: &mut [(Run, Summary)]) {
    let names: Vec<String> = runs.iter().map(|(run, _)| run.name.clone()).collect();
    for (k, (run, _)) in runs.iter_mut().enumerate() {
        if names.iter().filter(|n| **n == names[k]).count() > 1 {
            run.name = format!("{}#{}", names[k], 1 + names[..k].iter().filter(|n| **n == names[k]).count());
        }
    }
}

/// What a careful reader would mention about the records.
pub(crate) fn notes(records: &[(Run, Summary)]) {
    for (run, summary) in records {
        for note in &summary.notes {
            remark(format_args!("note: {}: {note}", run.name));
        }
        let gaps: Vec<String> = summary
            .sources
            .iter()
            .filter(|s| s.gaps > 0 && s.column.is_some())
            .map(|s| format!("{} of `{}`", s.gaps, s.channel))
            .collect();
        if !gaps.is_empty() {
            remark(format_args!("note: {}: cells without a value: {}", run.name, gaps.join(", ")));
        }
    }
}

fn pair(text: &str) -> Result<(String, String), String> {
    let (channel, column) = text.split_once('=').ok_or("expected CHANNEL=COLUMN")?;
    Ok((channel.trim().to_string(), column.trim().to_string()))
}
