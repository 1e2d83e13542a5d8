//! `fdm reproduce`: reference systems from their descriptions to the figures of the papers; with `--repeats` a Monte Carlo study of
//! each.

use crate::deliver::{NamedFile, refuse_others, write_all};
use crate::failure::{Ending, Failure, OrFailure, as_json, ended, print, print_lines, remark};
use crate::foreign_code::refuse_units_of;
use crate::options::Repeats;
use crate::progress::{Progress, RepeatProgress, counted};
use crate::tasks::Visit;
use clap::Args;
use fdm_estimate::Halt;
use fdm_lab::experiment::{Catalogue, Experiment, ExperimentError, Outcome, reproduce, tables};
use fdm_lab::job;
use fdm_lab::study::{Colour, FORM, Study, System, series};
use fdm_report::{outcome_table, outcomes_markdown, outcomes_table, studies_markdown, studies_text};
use fdm_results::store::{Identity, read_input};
use fdm_system::Model;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// What `fdm reproduce` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Reference system: the name of its folder, `all`, or the path of a folder with an `experiment.toml`
    #[arg(value_name = "NAME|all")]
    name: String,
    /// Folder of the reference systems [default: `models` here, above, or above the program]
    #[arg(long, value_name = "DIR")]
    models: Option<PathBuf>,
    /// Skip the steps marked as long
    #[arg(long)]
    thin: bool,
    /// Only write the simulated records to this folder, as CSV
    #[arg(long, value_name = "DIR")]
    records: Option<PathBuf>,
    /// Replace other files of the same names in that folder
    #[arg(long, requires = "records")]
    force: bool,
    /// Print JSON instead of tables
    #[arg(long, conflicts_with = "markdown")]
    json: bool,
    /// Print the summary as a Markdown table
    #[arg(long)]
    markdown: bool,
    /// Monte Carlo study: repeat the fits N times with other noise, and count how often the intervals hold the true values; measured
    /// records are replaced by simulated ones
    #[arg(long, value_name = "N", help_heading = "Repeats", conflicts_with = "records",
          allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    repeats: Option<u32>,
    #[command(flatten)]
    repetition: Repeats,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let experiments = arguments.experiments()?;
    refuse_units(&experiments)?;
    if let Some(count) = arguments.repeats {
        return arguments.study(&experiments, count as usize);
    }
    if let [first, ..] = arguments.repetition.given()[..] {
        return Err(Failure::input([format!("{first} belongs to --repeats; give their number with --repeats N")]));
    }
    if let Some(folder) = &arguments.records {
        return write_records(&experiments, folder, arguments.force);
    }
    let bar = counted(experiments.len(), "experiments");
    let told = InOrder::default();
    let one = |(k, experiment): (usize, &Experiment)| {
        let outcome = reproduce(experiment, arguments.thin);
        let text = arguments
            .is_told_at_once(experiments.len())
            .then(|| outcome.as_ref().map_or_else(|_| String::new(), one_of_many));
        bar.suspend(|| text.into_iter().for_each(|text| told.say(k, text)));
        bar.inc(1);
        bar.set_message(experiment.name.clone());
        (k, outcome)
    };
    // begun in their order, so that what is told first is ready first
    let mut results: Vec<(usize, Result<Outcome, ExperimentError>)> =
        experiments.iter().enumerate().par_bridge().map(one).collect();
    results.sort_by_key(|(k, _)| *k);
    bar.finish_and_clear();
    let (mut outcomes, mut wrong) = (Vec::new(), Vec::new());
    for (_, result) in results {
        match result {
            Ok(outcome) => outcomes.push(outcome),
            Err(e) => wrong.push(e),
        }
    }
    if outcomes.is_empty() && !wrong.is_empty() {
        return Err(Failure::input(wrong));
    }
    let printed = arguments.print(&arguments.text(&outcomes, experiments.len())?) && told.is_printed();
    if !wrong.is_empty() {
        return Err(Failure::input(wrong));
    }
    ended(printed && outcomes.iter().all(|o| o.passed))
}

/// A table, and a line behind it.
fn one_of_many(outcome: &Outcome) -> String {
    format!("{}\n", outcome_table(outcome))
}

/// Prints texts in their order, each as soon as those before it are there.
#[derive(Default)]
struct InOrder(Mutex<Waiting>);

#[derive(Default)]
struct Waiting {
    next: usize,
    texts: BTreeMap<usize, String>,
    /// Whether something could not be printed.
    lost: bool,
}

impl InOrder {
    /// The text of the `k`-th, each once.
    fn say(&self, k: usize, text: String) {
        let mut waiting = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.texts.insert(k, text);
        let mut next = waiting.next;
        while let Some(text) = waiting.texts.remove(&next) {
            waiting.lost |= !print(&text);
            next += 1;
        }
        waiting.next = next;
    }

    fn is_printed(&self) -> bool {
        !self.0.lock().unwrap_or_else(PoisonError::into_inner).lost
    }
}

/// Models of experiments are named by their files.
fn refuse_units(experiments: &[Experiment]) -> Result<(), Failure> {
    experiments.iter().try_for_each(|e| refuse_units_of(e.models().map(|model| e.folder.join(model)))).or_failure()
}

impl Arguments {
    fn experiments(&self) -> Result<Vec<Experiment>, Failure> {
        let path = Path::new(&self.name);
        if path.join(Experiment::FILE).is_file() {
            return Ok(vec![Experiment::read(path).or_failure()?]);
        }
        let folder = self.models.clone().or_else(models).ok_or_else(|| {
            Failure::input([
                "there is no folder `models` with reference systems here or above; name one with --models DIR",
            ])
        })?;
        if self.name != "all" {
            return Ok(vec![Catalogue::one(&folder, &self.name).or_failure()?]);
        }
        let catalogue = Catalogue::open(&folder).or_failure()?;
        if catalogue.experiments.is_empty() {
            return Err(Failure::input([format!("{}: no folder in it has an {}", folder.display(), Experiment::FILE)]));
        }
        Ok(catalogue.experiments)
    }

    /// JSON and Markdown keep their lines.
    fn print(&self, made: &str) -> bool {
        if self.json || self.markdown { print_lines(made) } else { print(made) }
    }

    /// Whether the table of each of so many experiments is printed as soon as it is ready.
    fn is_told_at_once(&self, experiments: usize) -> bool {
        experiments > 1 && !self.json && !self.markdown
    }

    /// What is printed in the end, of so many experiments.
    fn text(&self, outcomes: &[Outcome], experiments: usize) -> Result<String, Failure> {
        match outcomes {
            _ if self.json => as_json(&outcomes),
            _ if self.markdown => Ok(outcomes_markdown(outcomes)),
            [one] if experiments == 1 => Ok(outcome_table(one)),
            _ => Ok(outcomes_table(outcomes)),
        }
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

fn write_records(experiments: &[Experiment], folder: &Path, force: bool) -> Ending {
    let mut places = Vec::new();
    for experiment in experiments {
        let place = if experiments.len() > 1 { folder.join(&experiment.name) } else { folder.into() };
        let tables = tables(experiment).or_failure()?;
        let files: Vec<NamedFile> = tables.iter().map(|table| (table.file(), table.bytes())).collect();
        refuse_others(&place, &files, force)?;
        places.push((place, files));
    }
    let mut text = String::new();
    for (place, files) in &places {
        write_all(place, files)?;
        files.iter().for_each(|(name, _)| text.push_str(&format!("{}\n", place.join(name).display())));
    }
    ended(print_lines(&text))
}

fn nothing_to_repeat(name: &str) -> String {
    format!(
        "{name}: nothing to repeat: no step estimates parameters with known true values, or fits measured records in the time domain"
    )
}

/// What decides the numbers of the repeats, but not how many there are.
#[derive(Serialize)]
struct Studied {
    thin: bool,
    noise_colour: Option<Colour>,
    seed: u64,
    form: u8,
}

impl Arguments {
    /// Makes an experiment ready to be repeated, and shows the repeats as tasks.
    pub(crate) fn tasks(&self, visit: Visit<'_>) -> Result<(), Failure> {
        let one = || {
            Failure::input([
                "a job repeats one experiment with one colour of noise: give `repeats`, and the others by `each`",
            ])
        };
        let (experiments, colours) = (self.experiments()?, self.colours()?);
        refuse_units(&experiments)?;
        let (Some(count), [experiment], [colour]) = (self.repeats, &experiments[..], &colours[..]) else {
            return Err(one());
        };
        let (system, identity) = self.system(experiment, *colour)?;
        if system.subjects().is_empty() {
            return Err(Failure::input([nothing_to_repeat(&experiment.name)]));
        }
        let once = |k: u64, halt: &Halt| system.once(k, halt);
        visit(&job::Repeats { once: &once, count: count.into() }, &identity)
    }

    /// These arguments at the end of a job.
    pub(crate) fn finishing(mut self, done: Arc<job::Memory>) -> Self {
        self.repetition.checkpoints.done = Some(done);
        self
    }

    /// An experiment that can be repeated, and what the bits of its repeats depend on.
    fn system(&self, experiment: &Experiment, colour: Option<Colour>) -> Result<(System, Identity), Failure> {
        let (seed, thin) = (self.repetition.seed, self.thin);
        let studied = Studied { thin, noise_colour: colour, seed, form: FORM };
        let identity = Identity::of_texts(&texts(experiment)?, &studied);
        Ok((System::new(experiment, (colour, seed), thin).or_failure()?, identity))
    }

    /// The colours of the noise that were asked for; none stands for that of the experiment.
    fn colours(&self) -> Result<Vec<Option<Colour>>, Failure> {
        match self.repetition.colours() {
            none if none.is_empty() => Ok(vec![None]),
            some if some.contains(&Colour::Fitted) => Err(Failure::input([
                "--noise-colour fitted belongs to `fdm study`: here use white, ar1 or pink, or leave it out for the noise of the experiment",
            ])),
            some => Ok(some.into_iter().map(Some).collect()),
        }
    }

    /// Studies experiments one after the other, and prints what came of them.
    fn study(&self, experiments: &[Experiment], count: usize) -> Ending {
        let colours = self.colours()?;
        let progress = Progress::new(true);
        let (mut studies, mut whole, mut wrong) = (Vec::new(), true, Vec::new());
        for experiment in experiments {
            for colour in &colours {
                let name = &experiment.name;
                let watch = RepeatProgress::new(name, count, false, progress.halt().clone());
                if !progress.halt().goes_on() {
                    whole = false;
                    continue;
                }
                match self.study_of_one(experiment, *colour, count, &watch) {
                    Ok(Some((study, kept))) => {
                        whole &= kept && study.is_whole() && study.converged > 0;
                        studies.push(study);
                    }
                    Ok(None) if experiments.len() > 1 => {}
                    Ok(None) => wrong.push(nothing_to_repeat(name)),
                    Err(Failure::Input(reasons)) => wrong.extend(reasons),
                    Err(other) => return Err(other),
                }
            }
        }
        let printed = studies.is_empty() || self.print(&self.study_text(&studies)?);
        if !wrong.is_empty() {
            return Err(Failure::Input(wrong));
        }
        ended(whole && printed)
    }

    fn study_text(&self, studies: &[Study]) -> Result<String, Failure> {
        Ok(match (self.json, self.markdown) {
            (true, _) => as_json(&studies)?,
            (_, true) => studies_markdown(studies),
            _ => studies_text(studies),
        })
    }

    /// The study of one experiment, and whether its repeats were kept; none when there is nothing to repeat.
    fn study_of_one(
        &self,
        experiment: &Experiment,
        colour: Option<Colour>,
        count: usize,
        watch: &RepeatProgress,
    ) -> Result<Option<(Study, bool)>, Failure> {
        let seed = self.repetition.seed;
        let tint = colour.map_or("described".into(), |c| format!("{c:?}").to_lowercase());
        let folder = format!("{}-{tint}", experiment.name);
        let (system, identity) = self.system(experiment, colour)?;
        for said in system.left_out() {
            remark(format_args!("note: {}: left out: {said}", experiment.name));
        }
        if system.subjects().is_empty() {
            return Ok(None);
        }
        let checkpoint = self.repetition.checkpoints.open_within(&folder, &identity, false)?;
        let work = watch.work().keeping(checkpoint.keeper());
        let repeats = series(count, &work, &|k, repeat| watch.came(k, repeat), &|k| system.once(k, work.halt()));
        watch.finish();
        let study = Study::of(&experiment.name, (colour, seed), system.subjects(), &repeats);
        Ok(Some((study, checkpoint.close())))
    }
}

/// Everything in the folder of an experiment that decides its numbers; models with the files that they use.
fn texts(experiment: &Experiment) -> Result<Vec<(String, Vec<u8>)>, Failure> {
    let unreadable = |e: std::io::Error| Failure::at(&experiment.folder, &e);
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(&experiment.folder).map_err(unreadable)?.flatten().map(|e| e.path()).collect();
    files.sort();
    let mut texts = Vec::new();
    for file in files {
        let name = file.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        match file.extension().and_then(|e| e.to_str()) {
            Some("csv" | "toml") => texts.push((name, read_input(&file).map_err(unreadable)?)),
            Some("fdm") => {
                let mut source = fdm_system::read_source(&file)?;
                Model::gather_files(&mut source);
                let all: Vec<&str> = source.texts().iter().map(|t| t.text()).collect();
                texts.push((name, all.join("\0").into_bytes()));
            }
            _ => {}
        }
    }
    Ok(texts)
}
