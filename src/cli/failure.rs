//! How a command ends: its exit code, what it prints, and what it says when the input is wrong.

use fdm_grammar::diagnostic::nearest;
use fdm_grammar::{Diagnostic, Source};
use fdm_results::store::reason;
use fdm_system::ModelError;
use fdm_system::record::RecordError;
use std::fmt::Display;
use std::io::IsTerminal;
use std::path::Path;
use std::process::ExitCode;

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
            Self::Input(reasons) => reasons.iter().for_each(|r| remark(format_args!("error: {r}"))),
        }
        ExitCode::from(INPUT)
    }
}

impl From<ModelError> for Failure {
    fn from(e: ModelError) -> Self {
        Self::Model(Box::new(e))
    }
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
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
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
    murmur(format_args!("{}", fdm_report::render(source, findings, in_colours(&std::io::stderr()))));
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

/// Writes a line to standard error; where nobody listens it is lost.
pub(crate) fn remark(line: std::fmt::Arguments<'_>) {
    murmur(format_args!("{line}\n"));
}

/// The same as it is.
fn murmur(text: std::fmt::Arguments<'_>) {
    use std::io::Write;
    let _ = std::io::stderr().lock().write_fmt(text);
}

/// Writes to standard output; a closed pipe is an end, not a failure. What cannot be written is told; says whether all was.
pub(crate) fn print(text: &str) -> bool {
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
