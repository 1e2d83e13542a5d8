//! Where an answer goes: to the terminal as text or JSON, to a picture, to a folder, to a page.

use crate::failure::{Ending, Failure, OrFailure, Unwritten, at, ended, print, print_lines, remark};
use clap::Args;
use fdm_lab::job::Memory;
use fdm_report::page::{Subject, page};
use fdm_results::store::{Destination, make_folder, write_file};
use fdm_session::tasks::answered;
pub(crate) use fdm_session::{Answer, NamedFile, Wanted};
use fdm_session::{Conduct, Session, Verb};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What is printed.
#[derive(Debug, Args)]
#[command(next_help_heading = "Result")]
pub(crate) struct Output {
    /// Print JSON instead of tables
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) manner: Manner,
}

/// How much is said, by every verb alike; these options stand in front of the verb too.
#[derive(Debug, Args)]
pub(crate) struct Manner {
    /// Say nothing while working
    #[arg(short, long, global = true, display_order = 1000, help_heading = None)]
    pub(crate) quiet: bool,
    /// Say every remark, and how each run is integrated
    #[arg(long, global = true, display_order = 1001, help_heading = None)]
    pub(crate) verbose: bool,
}

impl Output {
    /// What is printed of an answer.
    pub(crate) fn wanted(&self) -> Wanted {
        Wanted { json: self.json, verbose: self.manner.verbose, ..Wanted::default() }
    }

    /// Prints an answer, and what goes to standard error behind it; says whether all was printed.
    pub(crate) fn print(&self, answer: &Answer) -> bool {
        let printed = match answer.json.as_ref().filter(|_| self.json) {
            Some(json) => print_lines(json),
            None => print(&answer.text),
        };
        answer.remarks.iter().for_each(|r| remark(format_args!("{r}")));
        printed
    }

    /// Prints an answer and writes what is wanted of it to places; what cannot be written is told. Says whether all went well.
    pub(crate) fn hand_over<const N: usize>(
        &self,
        answer: &Answer,
        wanted: [(Option<&PathBuf>, Option<&[u8]>); N],
    ) -> bool {
        let mut whole = self.print(answer);
        for (path, content) in wanted.into_iter().filter_map(|(path, content)| path.zip(content)) {
            if let Err(e) = write(path, content) {
                remark(format_args!("error: {e}; the result is what is printed"));
                whole = false;
            }
        }
        close(answer) && whole
    }
}

/// Says what is to be said at the very end; says whether all is well.
pub(crate) fn close(answer: &Answer) -> bool {
    answer.closing.iter().for_each(|said| remark(format_args!("{said}")));
    answer.good
}

/// Places of a whole result.
#[derive(Debug, Args)]
#[command(next_help_heading = "Result")]
pub(crate) struct Whole {
    /// Write everything to a folder: model, result, tables, pictures
    ///
    /// With the options and the fingerprints of the data.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Write one page for a browser, as `fdm report` does
    ///
    /// Equations, tables and figures, as `fdm report` makes them from a folder.
    #[arg(long, value_name = "FILE.html")]
    pub(crate) report: Option<PathBuf>,
    /// Replace files that fdm did not write; in the folder of --out those too that were changed since, while files with other names
    /// stay in any case
    #[arg(long, hide_short_help = true)]
    force: bool,
}

/// What is printed and written of a fit.
#[derive(Debug, Args)]
#[command(next_help_heading = "Result")]
pub(crate) struct Delivery {
    #[command(flatten)]
    pub(crate) output: Output,
    /// Draw measurement, model and residual over time to an SVG file
    #[arg(long, value_name = "FILE.svg", hide_short_help = true)]
    pub(crate) plot: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) whole: Whole,
}

/// What a verb is asked for, here or at the end of a job.
pub(crate) struct Asked {
    /// The command that results tell.
    pub(crate) command: Vec<String>,
    /// What was done elsewhere.
    pub(crate) done: Option<Arc<Memory>>,
}

impl Default for Asked {
    fn default() -> Self {
        Self { command: crate::command_line(), done: None }
    }
}

/// Where the answer of a verb goes.
#[derive(Clone, Copy)]
pub(crate) struct Places<'a> {
    pub(crate) output: &'a Output,
    pub(crate) plot: Option<&'a Path>,
    pub(crate) whole: &'a Whole,
}

/// Places that were looked at before the work.
pub(crate) struct Prepared<'a> {
    places: Places<'a>,
    destination: Option<Destination>,
    /// How the work is done.
    pub(crate) conduct: Conduct,
    /// What it is done on.
    pub(crate) session: Session,
}

impl<'a> Places<'a> {
    /// What is wanted of an answer that goes there.
    pub(crate) fn wanted(&self) -> Wanted {
        Wanted { files: self.whole.any(), plot: self.plot.is_some(), ..self.output.wanted() }
    }

    /// Reads what a verb works on. Places that cannot be written are told before the work.
    pub(crate) fn prepare(self, verb: &dyn Verb, asked: &Asked) -> Result<Prepared<'a>, Failure> {
        let conduct = Conduct::shown(self.output.manner.quiet, self.wanted()).within(verb.given().limit);
        let conduct = Conduct { done: asked.done.clone(), ..conduct };
        let session = verb.session(&conduct)?.of_command(asked.command.clone());
        let names = verb.names(&session);
        self.prepared(conduct, session, &names)
    }

    /// Looks at the places of a result with files of these names.
    pub(crate) fn prepared(
        self,
        mut conduct: Conduct,
        session: Session,
        names: &[String],
    ) -> Result<Prepared<'a>, Failure> {
        let destination = self.whole.destination(names)?;
        conduct.beside = destination.iter().map(|place| place.folder().to_path_buf()).collect();
        Ok(Prepared { places: self, destination, conduct, session })
    }

    /// Works out what a verb is asked for, and hands it over.
    pub(crate) fn deliver(self, verb: &dyn Verb, asked: &Asked) -> Ending {
        let mut prepared = self.prepare(verb, asked)?;
        let answer = answered(verb, &prepared.session, &mut prepared.conduct);
        prepared.conduct.progress.finish();
        ended(prepared.hand_over(&answer?))
    }
}

impl Prepared<'_> {
    /// Prints an answer, then writes what was asked for; what cannot be written is told. Says whether all went well.
    pub(crate) fn hand_over(&self, answer: &Answer) -> bool {
        let Places { output, plot, whole } = self.places;
        let printed = output.print(answer);
        let drawing = plot.zip(answer.plot.as_ref());
        let plot = drawing.map_or(Ok(()), |(path, drawing)| write(path, drawing).map_err(|e| e.to_string()));
        let page = whole.write_page(&answer.files);
        let folder = self.destination.as_ref().map_or(Ok(()), |place| place.fill(&answer.files));
        let kept = folder.map_err(|e| e.to_string()).and(page);
        let failed = [plot.err(), kept.err()];
        let say = |e: &String| remark(format_args!("error: {e}; the result is what is printed"));
        failed.iter().flatten().for_each(say);
        close(answer) && printed && failed.iter().all(Option::is_none)
    }
}

impl Delivery {
    /// The places of a fit.
    pub(crate) fn places(&self) -> Places<'_> {
        Places { output: &self.output, plot: self.plot.as_deref(), whole: &self.whole }
    }
}

impl Whole {
    /// The options that were given.
    pub(crate) fn given(&self) -> Vec<&'static str> {
        let own = [("--out", self.out.is_some()), ("--report", self.report.is_some())];
        own.into_iter().filter(|(_, given)| *given).map(|(name, _)| name).collect()
    }

    /// Whether it will be asked what the result was made from.
    fn any(&self) -> bool {
        self.out.is_some() || self.report.is_some()
    }

    /// Looks at the folder, where one is wanted, for a result with files of these names.
    fn destination(&self, names: &[String]) -> Result<Option<Destination>, Failure> {
        let out = self.out.as_deref();
        out.map(|out| Destination::prepare_for(out, names, self.force)).transpose().or_failure()
    }

    /// Writes the page, where it is wanted, from the files of a result.
    fn write_page(&self, files: &[NamedFile]) -> Result<(), String> {
        let Some(path) = &self.report else { return Ok(()) };
        let page = page(&Subject::from_files(files).map_err(|e| e.to_string())?);
        write(path, page).map_err(|e| e.to_string())
    }
}

/// Writes a file: all of it, or what stood there before stays.
pub(crate) fn write(path: &Path, contents: impl AsRef<[u8]>) -> Result<(), Unwritten> {
    write_file(path, contents.as_ref()).map_err(|e| Unwritten(at(path, &e)))
}

/// Refuses files of a folder that would be written over others of the same name; with `force` they are replaced. What stands there
/// just so is as good as written.
pub(crate) fn refuse_others(folder: &Path, files: &[NamedFile], force: bool) -> Result<(), Failure> {
    let differs = |(name, contents): &&NamedFile| {
        let path = folder.join(name);
        path.symlink_metadata().is_ok() && std::fs::read(&path).ok().as_ref() != Some(contents)
    };
    let others: Vec<String> = files.iter().filter(differs).map(|(name, _)| name.clone()).collect();
    if force || others.is_empty() {
        return Ok(());
    }
    Err(Failure::Input(others.iter().map(|name| standing(&folder.join(name))).collect()))
}

/// What is said of a file that stands where another would be written.
pub(crate) fn standing(path: &Path) -> String {
    format!(
        "{}: exists already, and is not overwritten; give another folder, or replace it with --force",
        path.display()
    )
}

/// Writes files to a folder, which is made where there is none.
pub(crate) fn write_all(folder: &Path, files: &[NamedFile]) -> Result<(), Unwritten> {
    make_folder(folder).map_err(|e| Unwritten(at(folder, &e)))?;
    files.iter().try_for_each(|(name, contents)| write(&folder.join(name), contents))
}

/// Refuses a folder that stands there already.
#[cfg(feature = "petab")]
pub(crate) fn refuse_standing(folder: &Path) -> Result<(), Failure> {
    match folder.symlink_metadata() {
        Ok(_) => Err(Failure::input([format!("{}: exists already, and is not overwritten", folder.display())])),
        Err(_) => Ok(()),
    }
}

/// Makes a new folder with these files, and with those in folders of it: whole, or not at all.
#[cfg(feature = "petab")]
pub(crate) fn write_folder(folder: &Path, files: &[NamedFile]) -> Result<(), Unwritten> {
    let made = Destination::prepare(folder).and_then(|place| place.fill(files));
    made.map_err(|e| Unwritten(e.to_string()))
}
