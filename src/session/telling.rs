//! What is told beside a result, on standard error.

use crate::terminal::{Stream, width};
use fdm_grammar::{Diagnostic, Source};
use fdm_report::{render, visible, wrapped};
use std::io::IsTerminal;
use std::sync::OnceLock;

/// Codes that a hint names.
const MOST_CODES: usize = 5;

/// Findings about a model, with where to read more about them.
pub fn tell(source: &Source, findings: &[Diagnostic]) {
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
pub fn in_colours(stream: &impl IsTerminal) -> bool {
    stream.is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty())
}

/// Writes a line to standard error, wrapped; where nobody listens it is lost.
pub fn remark(line: std::fmt::Arguments<'_>) {
    murmur(&wrapped(&visible(&format!("{line}\n")), width(Stream::Error)));
}

/// Whether nothing is said that the result does not depend on.
static QUIET: OnceLock<bool> = OnceLock::new();

/// From now on what [`aside`] says is left out, where that is wanted.
pub fn keep_quiet(quiet: bool) {
    let _ = QUIET.set(quiet);
}

/// A remark that `--quiet` leaves out.
pub fn aside(line: std::fmt::Arguments<'_>) {
    if QUIET.get() != Some(&true) {
        remark(line);
    }
}

/// Writes a text to standard error as it is.
pub fn murmur(text: &str) {
    use std::io::Write;
    let _ = std::io::stderr().lock().write_all(text.as_bytes());
}

/// What units of the model said of numbers that they could not give.
pub fn tell_foreign() {
    fdm_grammar::external::complaints().iter().for_each(|said| remark(format_args!("note: {said}")));
}
