//! How a command ends: its exit code, what it prints, and what it says when the input is wrong.

use crate::load::with_files;
use crate::terminal::{Stream, width};
use fdm_grammar::diagnostic::nearest;
use fdm_grammar::{Diagnostic, Source};
use fdm_report::{render, visible, wrapped};
use fdm_results::store::reason;
use fdm_system::ModelError;
use fdm_system::record::RecordError;
use std::fmt::Display;
use std::io::IsTerminal;
use std::path::Path;
use std::process::ExitCode;
use std::sync::OnceLock;

/// Numbers went wrong: the result so far has been printed.
const NUMBERS: u8 = 1;
const INPUT: u8 = 2;
/// Codes that a hint names.
const MOST_CODES: usize = 5;

/// How a command ends.
pub(crate) type Ending = Result<ExitCode, Failure>;

/// Wrong input.
#[derive(Debug)]
pub(crate) enum Failure {
    /// A model that cannot be read or compiled.
    Model(Box<ModelError>),
    /// Records that cannot be used, each with all its problems.
    Records(Vec<RecordError>),
    /// Anything else, one sentence each.
    Input(Vec<String>),
    /// Nothing is wrong with the input, but with the numbers.
    Numbers(String),
    /// Something was found in the records, and `--strict` refuses to go on.
    Strict,
    /// Nothing is wrong with the input, but a file could not be written.
    Unwritten(Unwritten),
}

/// A file that could not be written, and why.
#[derive(Debug)]
pub(crate) struct Unwritten(pub(crate) String);

impl Display for Unwritten {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl From<Unwritten> for Failure {
    fn from(e: Unwritten) -> Self {
        Self::Unwritten(e)
    }
}

impl Failure {
    /// From things that say what is wrong.
    pub(crate) fn input(reasons: impl IntoIterator<Item = impl Display>) -> Self {
        Self::Input(reasons.into_iter().map(|r| r.to_string()).collect())
    }

    /// From a file or folder and what is wrong with it.
    pub(crate) fn at(path: &Path, error: &std::io::Error) -> Self {
        Self::Input(vec![at(path, error)])
    }

    /// Tells the user and gives the exit code.
    pub(crate) fn report(&self) -> ExitCode {
        match self {
            Self::Model(e) => match &**e {
                ModelError::Invalid { text, diagnostics } => {
                    tell(text, diagnostics);
                }
                other => remark(format_args!("error: {other}")),
            },
            Self::Records(errors) => errors.iter().for_each(|e| remark(format_args!("error: {e}"))),
            Self::Input(reasons) => {
                reasons.iter().for_each(|r| remark(format_args!("error: {}", with_files(r))));
                tell_foreign();
            }
            Self::Numbers(said) => {
                remark(format_args!("error: {said}"));
                tell_foreign();
                return ExitCode::from(NUMBERS);
            }
            Self::Strict => {
                remark(format_args!(
                    "error: the records have findings, and --strict refuses to go on; `fdm doctor` tells them all"
                ));
                return ExitCode::from(NUMBERS);
            }
            Self::Unwritten(file) => {
                remark(format_args!("error: {file}"));
                return ExitCode::from(NUMBERS);
            }
        }
        ExitCode::from(INPUT)
    }
}

impl From<ModelError> for Failure {
    fn from(e: ModelError) -> Self {
        Self::Model(Box::new(e))
    }
}

/// Words on the command line that mean nothing, or that ask for help.
pub(crate) fn refuse_words(e: &clap::Error) -> ExitCode {
    let plain = e.render().to_string();
    if !e.use_stderr() {
        // help, which clap has wrapped, with colours where they are wanted
        let _ = e.print();
    } else if in_colours(&std::io::stderr()) && visible(&plain) == plain {
        murmur(&wrapped(&e.render().ansi().to_string(), width(Stream::Error)));
    } else {
        murmur(&wrapped(&visible(&plain), width(Stream::Error)));
    }
    ExitCode::from(u8::try_from(e.exit_code()).unwrap_or(INPUT))
}

/// Errors of the packages below, most of which mean that the input is wrong.
pub(crate) trait OrFailure<T> {
    /// The value, or the error as wrong input.
    fn or_failure(self) -> Result<T, Failure>;
}

impl<T, E: Display> OrFailure<T> for Result<T, E> {
    fn or_failure(self) -> Result<T, Failure> {
        self.map_err(|e| Failure::input([e]))
    }
}

/// A path and what is wrong with it.
pub(crate) fn at(path: &Path, error: &std::io::Error) -> String {
    format!("{}: {}", path.display(), reason(error))
}

/// Ends with 0 when all is good, with 1 otherwise.
pub(crate) fn ended(good: bool) -> Ending {
    if !good {
        tell_foreign();
    }
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

/// What units of the model said of numbers that they could not give.
fn tell_foreign() {
    fdm_grammar::external::complaints().iter().for_each(|said| remark(format_args!("note: {said}")));
}

/// The name that was probably meant, to stand behind a message; empty when none is near.
pub(crate) fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    nearest(name, known).map_or(String::new(), |near| format!("; did you mean `{near}`?"))
}

/// Findings about a model, with where to read more about them.
pub(crate) fn tell(source: &Source, findings: &[Diagnostic]) {
    if findings.is_empty() {
        return;
    }
    let plain = render(source, findings, false);
    // what would act on the terminal is shown without colours, which act on it too
    let coloured = in_colours(&std::io::stderr()) && visible(&plain) == plain;
    let columns = width(Stream::Error);
    match coloured {
        true => murmur(&wrapped(&render(source, findings, true), columns)),
        false => murmur(&wrapped(&visible(&plain), columns)),
    }
    let mut codes: Vec<&str> = Vec::new();
    for code in findings.iter().map(|f| f.code.text()) {
        if !codes.contains(&code) && codes.len() < MOST_CODES {
            codes.push(code);
        }
    }
    remark(format_args!("`fdm explain {}` says more\n", codes.join(" ")));
}

/// Whether a stream shows colours: a terminal, unless `NO_COLOR` is set to something (no-color.org).
pub(crate) fn in_colours(stream: &impl IsTerminal) -> bool {
    stream.is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty())
}

/// Writes a line to standard error, wrapped; where nobody listens it is lost.
pub(crate) fn remark(line: std::fmt::Arguments<'_>) {
    murmur(&wrapped(&visible(&format!("{line}\n")), width(Stream::Error)));
}

/// Whether nothing is said that the result does not depend on.
static QUIET: OnceLock<bool> = OnceLock::new();

/// From now on what [`aside`] says is left out, where that is wanted.
pub(crate) fn keep_quiet(quiet: bool) {
    let _ = QUIET.set(quiet);
}

/// A remark that `--quiet` leaves out.
pub(crate) fn aside(line: std::fmt::Arguments<'_>) {
    if QUIET.get() != Some(&true) {
        remark(line);
    }
}

/// Writes a text to standard error as it is.
fn murmur(text: &str) {
    use std::io::Write;
    let _ = std::io::stderr().lock().write_all(text.as_bytes());
}

/// Prints what people read, wrapped: nothing in it acts on a terminal.
pub(crate) fn print(text: &str) -> bool {
    print_as_it_is(&wrapped(&visible(text), width(Stream::Out)))
}

/// Prints JSON, source and names of files, line by line as they are; nothing in them acts on a terminal.
pub(crate) fn print_lines(text: &str) -> bool {
    print_as_it_is(&visible(text))
}

/// Prints with colours where they are wanted, unless something in the plain text would act on the terminal.
pub(crate) fn print_coloured(text: impl Fn(bool) -> String) -> bool {
    let plain = text(false);
    let coloured = in_colours(&std::io::stdout()) && visible(&plain) == plain;
    if coloured { print_as_it_is(&wrapped(&text(true), width(Stream::Out))) } else { print(&plain) }
}

/// Prints what programs read: as it is, unless it goes to a terminal.
pub(crate) fn print_data(text: &str) -> bool {
    if std::io::stdout().is_terminal() { print_lines(text) } else { print_as_it_is(text) }
}

/// Writes to standard output; a closed pipe is an end, not a failure. What cannot be written is told; says whether all was.
fn print_as_it_is(text: &str) -> bool {
    use std::io::{ErrorKind, Write};
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            remark(format_args!("error: the result cannot be printed: {}", reason(&e)));
            false
        }
        _ => true,
    }
}

/// A document as JSON.
pub(crate) fn as_json(document: &impl serde::Serialize) -> Result<String, Failure> {
    fdm_results::documents::to_text(document).map_err(|e| Failure::input([e]))
}
