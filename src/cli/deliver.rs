//! Where an answer goes: to the terminal as text or JSON, to a picture, to a folder, to a page.

use crate::failure::{Ending, Failure, OrFailure, Unwritten, at, ended, print, print_lines, remark};
use crate::job::Shared;
use clap::Args;
use fdm_lab::job::Memory;
use fdm_report::page::{Subject, page};
use fdm_results::store::{Destination, make_folder, write_file};
use fdm_session::halt::TimeLimit;
use fdm_session::verb::answered;
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

    /// Work for an answer that is printed.
    pub(crate) fn conduct(&self, limit: &TimeLimit) -> Conduct {
        Conduct::shown(self.manner.quiet, self.wanted()).within(limit)
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
    /// The folder, and whether other files in it are replaced.
    pub(crate) out: Option<(&'a Path, bool)>,
    pub(crate) report: Option<&'a Path>,
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
        let (folder, plot) = (self.out.is_some(), self.plot.is_some());
        Wanted { files: folder || self.report.is_some(), folder, plot, ..self.output.wanted() }
    }

    /// Work for an answer that goes there.
    pub(crate) fn conduct(&self, limit: &TimeLimit) -> Conduct {
        Conduct::shown(self.output.manner.quiet, self.wanted()).within(limit)
    }

    /// Reads what a verb works on. Places that cannot be written are told before the work.
    pub(crate) fn prepare(self, verb: &dyn Verb, asked: &Asked) -> Result<Prepared<'a>, Failure> {
        let conduct = Conduct { done: asked.done.clone(), ..self.conduct(verb.given().limit) };
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
        let place = |(out, force)| Destination::prepare_for(out, names, force);
        let destination = self.out.map(place).transpose().or_failure()?;
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

    /// Prints an answer, then draws and writes its page; what cannot be written is told. Says whether all went well.
    pub(crate) fn hand_over(self, answer: &Answer) -> bool {
        self.put(answer, || Ok(()))
    }

    fn put(self, answer: &Answer, keep: impl FnOnce() -> Result<(), String>) -> bool {
        let printed = self.output.print(answer);
        let drawing = self.plot.zip(answer.plot.as_ref());
        let plot = drawing.map_or(Ok(()), |(path, drawing)| write(path, drawing).map_err(|e| e.to_string()));
        // the page is made of the same files
        let page = self.report.map_or(Ok(()), |path| write_page(path, answer));
        let kept = keep().and(page);
        let failed = [plot.err(), kept.err()];
        let say = |e: &String| remark(format_args!("error: {e}; the result is what is printed"));
        failed.iter().flatten().for_each(say);
        close(answer) && printed && failed.iter().all(Option::is_none)
    }
}

impl Prepared<'_> {
    /// Prints an answer, then writes what was asked for; what cannot be written is told. Says whether all went well.
    pub(crate) fn hand_over(&self, answer: &Answer) -> bool {
        let fill = |place: &Destination| place.fill(&answer.files).map_err(|e| e.to_string());
        self.places.put(answer, || self.destination.as_ref().map_or(Ok(()), fill))
    }
}

/// A verb whose answer goes to all places.
#[derive(Debug, Args)]
pub(crate) struct Delivered<O: Args> {
    #[command(flatten)]
    pub(crate) options: O,
    #[command(flatten)]
    delivery: Delivery,
}

impl<O: Args> Delivered<O> {
    /// Where its answer goes.
    pub(crate) fn places(&self) -> Places<'_> {
        let Delivery { output, plot, whole } = &self.delivery;
        Places { plot: plot.as_deref(), ..whole.places(output) }
    }
}

impl<O: Args + Verb> Shared for Delivered<O> {
    fn verb(&self) -> &dyn Verb {
        &self.options
    }

    fn places(&self) -> Places<'_> {
        self.places()
    }
}

impl Whole {
    /// A folder and a page, without a drawing.
    pub(crate) fn places<'a>(&'a self, output: &'a Output) -> Places<'a> {
        let out = self.out.as_deref().map(|out| (out, self.force));
        Places { output, plot: None, out, report: self.report.as_deref() }
    }
}

/// Writes the page that a verb has made, or that of the files of a result.
fn write_page(path: &Path, answer: &Answer) -> Result<(), String> {
    let page = match answer.file("page.html") {
        Some(made) => made.to_vec(),
        None => page(&Subject::from_files(&answer.files).map_err(|e| e.to_string())?).into_bytes(),
    };
    write(path, page).map_err(|e| e.to_string())
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
pub(crate) fn refuse_standing(folder: &Path) -> Result<(), Failure> {
    match folder.symlink_metadata() {
        Ok(_) => Err(Failure::input([format!("{}: exists already, and is not overwritten", folder.display())])),
        Err(_) => Ok(()),
    }
}

/// Makes a new folder with these files, and with those in folders of it: whole, or not at all.
pub(crate) fn write_folder(folder: &Path, files: &[NamedFile]) -> Result<(), Unwritten> {
    let made = Destination::prepare(folder).and_then(|place| place.fill(files));
    made.map_err(|e| Unwritten(e.to_string()))
}
