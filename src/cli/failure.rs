//! How the command line ends, and what it says when the input is wrong.

use fdm::ModelError;
use fdm::record::RecordError;
use fdm_grammar::{Diagnostic, Source};
use std::fmt::Display;
use std::io::IsTerminal;
use std::process::ExitCode;

/// Numbers went wrong: the result so far has been printed.
pub(crate) const NUMBERS: u8 = 1;
const INPUT: u8 = 2;
/// Codes that a hint names.
const MOST_CODES: usize = 5;

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

/// Options that would be ignored are told, not ignored.
pub(crate) fn none_ignored(method: &str, given: &[&str], belongs: &str) -> Result<(), Failure> {
    match given {
        [] => Ok(()),
        given => Err(Failure::input([format!(
            "{} belongs to {belongs} and has no part in {method}; leave it out",
            given.join(", ")
        )])),
    }
}

/// Findings about a model, with where to read more about them.
pub(crate) fn tell(source: &Source, findings: &[Diagnostic]) {
    if findings.is_empty() {
        return;
    }
    murmur(format_args!("{}", fdm::report::render(source, findings, in_colours(&std::io::stderr()))));
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
            remark(format_args!("error: the result cannot be printed: {}", fdm::store::reason(&e)));
            false
        }
        _ => true,
    }
}
