//! How a command ends: its exit code, what it prints, and what it says when the input is wrong.

use fdm_report::{visible, wrapped};
use fdm_results::store::reason;
use fdm_session::Answer;
pub(crate) use fdm_session::failure::{Failure, OrFailure, Unwritten, as_json, at, did_you_mean};
use fdm_session::records::with_files;
pub(crate) use fdm_session::telling::{aside, in_colours, keep_quiet, remark, tell};
use fdm_session::telling::{murmur, tell_foreign};
use fdm_session::terminal::{Stream, width};
use fdm_system::ModelError;
use std::io::IsTerminal;
use std::process::ExitCode;

/// Numbers went wrong: the result so far has been printed.
const NUMBERS: u8 = 1;
const INPUT: u8 = 2;

/// How a command ends.
pub(crate) type Ending = Result<ExitCode, Failure>;

/// Tells the user and gives the exit code.
pub(crate) fn report(failure: &Failure) -> ExitCode {
    match failure {
        Failure::Model(e) => match &**e {
            ModelError::Invalid { text, diagnostics } => tell(text, diagnostics),
            other => remark(format_args!("error: {other}")),
        },
        Failure::Records(errors) => errors.iter().for_each(|e| remark(format_args!("error: {e}"))),
        Failure::Words { said, .. } => remark(format_args!("error: {said}")),
        Failure::Input(reasons) => {
            reasons.iter().for_each(|r| remark(format_args!("error: {}", with_files(r))));
            tell_foreign();
        }
        Failure::Numbers(said) | Failure::Stopped(said) => {
            remark(format_args!("error: {said}"));
            tell_foreign();
            return ExitCode::from(NUMBERS);
        }
        Failure::Astray { said, so_far } => {
            remark(format_args!("error: {said}"));
            so_far.json.as_ref().map_or_else(|| print(&so_far.text), |json| print_lines(json));
            so_far.remarks.iter().for_each(|r| remark(format_args!("{r}")));
            tell_foreign();
            return ExitCode::from(NUMBERS);
        }
        Failure::Strict => {
            remark(format_args!(
                "error: the records have findings, and --strict refuses to go on; `fdm doctor` tells them all"
            ));
            return ExitCode::from(NUMBERS);
        }
        Failure::Unwritten(file) => {
            remark(format_args!("error: {file}"));
            return ExitCode::from(NUMBERS);
        }
    }
    ExitCode::from(INPUT)
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

/// Ends with 0 when all is good, with 1 otherwise.
pub(crate) fn ended(good: bool) -> Ending {
    if !good {
        tell_foreign();
    }
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

/// Prints JSON where there is some, else the text; says whether all was.
pub(crate) fn print_answer(answer: &Answer) -> bool {
    answer.json.as_ref().map_or_else(|| print(&answer.text), |json| print_lines(json))
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
