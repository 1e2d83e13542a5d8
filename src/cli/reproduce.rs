//! `fdm reproduce`: experiments from their descriptions to the figures of the papers.

use crate::failure::{Failure, NUMBERS, print};
use crate::progress::counted;
use crate::rehearsal::{Wanted, rehearsed};
use crate::repetition::Repetition;
use clap::Args;
use fdm::experiment::{Catalogue, Experiment, ExperimentError, Outcome, reproduce, tables};
use fdm::report::{
    outcome_table, outcomes_json, outcomes_markdown, outcomes_table, studies_json, studies_markdown, studies_text,
};
use fdm::study::Study;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// What `fdm reproduce` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// An experiment, by the name of its folder; `all`; or the path of a folder with an `experiment.toml`
    #[arg(value_name = "NAME|all")]
    name: String,
    /// Folder with the experiments [default: `models` here, above, or above the program]
    #[arg(long, value_name = "DIR")]
    models: Option<PathBuf>,
    /// Leave out the steps that are called long
    #[arg(long)]
    thin: bool,
    /// Write the records that the experiments make to this folder as CSV, and do nothing else
    #[arg(long, value_name = "DIR")]
    records: Option<PathBuf>,
    /// Print JSON instead of tables
    #[arg(long, conflicts_with = "markdown")]
    json: bool,
    /// Print the summary as a table of a page
    #[arg(long)]
    markdown: bool,
    /// Repeat the steps whose estimates have a truth so many times with other noise, and say how often the printed intervals hold it;
    /// measured records are replaced by what the fit says of them
    #[arg(long, value_name = "N", help_heading = "Repeats", conflicts_with = "records",
          allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    repeats: Option<u32>,
    #[command(flatten)]
    repetition: Repetition,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let experiments = arguments.experiments()?;
    if let Some(count) = arguments.repeats {
        let wanted = Wanted { count: count as usize, thin: arguments.thin, repetition: &arguments.repetition };
        return rehearsed(&experiments, &wanted, &|studies| arguments.told(studies));
    }
    if let [first, ..] = arguments.repetition.given()[..] {
        return Err(Failure::input([format!("{first} belongs to --repeats; say how many")]));
    }
    if let Some(folder) = &arguments.records {
        return written(&experiments, folder);
    }
    let bar = counted(experiments.len(), "experiments");
    let one = |experiment: &Experiment| {
        let outcome = reproduce(experiment, arguments.thin);
        bar.inc(1);
        bar.set_message(experiment.name.clone());
        outcome
    };
    let results: Vec<Result<Outcome, ExperimentError>> = experiments.par_iter().map(one).collect();
    bar.finish_and_clear();
    let (mut outcomes, mut wrong) = (Vec::new(), Vec::new());
    for result in results {
        match result {
            Ok(outcome) => outcomes.push(outcome),
            Err(e) => wrong.push(e),
        }
    }
    if outcomes.is_empty() && !wrong.is_empty() {
        return Err(Failure::input(wrong));
    }
    let printed = print(&arguments.text(&outcomes));
    if !wrong.is_empty() {
        return Err(Failure::input(wrong));
    }
    let good = printed && outcomes.iter().all(|o| o.passed);
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

impl Arguments {
    fn experiments(&self) -> Result<Vec<Experiment>, Failure> {
        let path = Path::new(&self.name);
        if path.join(Experiment::FILE).is_file() {
            return Ok(vec![Experiment::read(path).map_err(|e| Failure::input([e]))?]);
        }
        let folder = self.models.clone().or_else(models).ok_or_else(|| {
            Failure::input(["there is no folder `models` with experiments here or above; name one with --models DIR"])
        })?;
        if self.name != "all" {
            return Ok(vec![Catalogue::one(&folder, &self.name).map_err(|e| Failure::input([e]))?]);
        }
        let catalogue = Catalogue::open(&folder).map_err(|e| Failure::input([e]))?;
        if catalogue.experiments.is_empty() {
            return Err(Failure::input([format!("{}: no folder in it has an {}", folder.display(), Experiment::FILE)]));
        }
        Ok(catalogue.experiments)
    }

    fn told(&self, studies: &[Study]) -> String {
        match (self.json, self.markdown) {
            (true, _) => format!("{}\n", studies_json(studies)),
            (_, true) => studies_markdown(studies),
            _ => studies_text(studies),
        }
    }

    fn text(&self, outcomes: &[Outcome]) -> String {
        if self.json {
            return format!("{}\n", outcomes_json(outcomes));
        }
        if self.markdown {
            return outcomes_markdown(outcomes);
        }
        let mut text: String = outcomes.iter().map(|o| format!("{}\n", outcome_table(o))).collect();
        if outcomes.len() > 1 {
            text.push_str(&outcomes_table(outcomes));
        } else {
            text.pop();
        }
        text
    }
}

/// `models` in the working folder or above it, or above the program.
fn models() -> Option<PathBuf> {
    let places = [std::env::current_dir().ok(), std::env::current_exe().ok()];
    let above = places.iter().flatten().flat_map(|place| place.ancestors());
    above.map(|place| place.join("models")).find(|models| {
        let entries = std::fs::read_dir(models).into_iter().flatten().flatten();
        entries.map(|e| e.path().join(Experiment::FILE)).any(|file| file.is_file())
    })
}

fn written(experiments: &[Experiment], folder: &Path) -> Result<ExitCode, Failure> {
    let unwritable = |e: std::io::Error| Failure::input([format!("{}: {}", folder.display(), fdm::store::reason(&e))]);
    let mut text = String::new();
    for experiment in experiments {
        let place = if experiments.len() > 1 { folder.join(&experiment.name) } else { folder.into() };
        std::fs::create_dir_all(&place).map_err(unwritable)?;
        for table in tables(experiment).map_err(|e| Failure::input([e]))? {
            let path = table.write(&place).map_err(|e| Failure::input([e]))?;
            text.push_str(&format!("{}\n", path.display()));
        }
    }
    Ok(if print(&text) { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}
