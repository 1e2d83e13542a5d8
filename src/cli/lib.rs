//! The command line: words become the options of a verb (`fdm_session`), its answer is printed and written (`deliver`, `failure`); one file a
//! verb says only where its answer goes.
//!
//! Exit codes: 0 good, 1 numbers went wrong (what was computed is printed), 2 wrong input.

mod builtin;
mod check;
mod compare;
mod data;
mod deliver;
mod design;
mod diagnose;
mod doctor;
mod effects;
mod export;
mod failure;
mod fmt;
mod front;
mod help;
mod import;
mod job;
#[cfg(any(feature = "lsp", feature = "studio"))]
mod language;
#[cfg(feature = "lsp")]
pub mod language_server;
mod lsp;
mod manual;
mod margins;
mod modes;
mod new;
mod overview;
mod ownership;
mod page;
mod paths;
mod problem;
mod profile;
mod project;
mod regress;
mod reproduce;
mod sample;
#[cfg(feature = "studio")]
mod serve;
mod show;
mod simulate;
mod spectra;
mod studio;
mod subjects;
mod trust;
mod validate;
mod verify;

use crate::deliver::{Asked, Delivered};
use crate::job::Shared;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use fdm_session::foreign_code::models_are_named_by;
use fdm_session::terminal::{Stream, width};
use fdm_session::{fit, study};
use std::ffi::OsString;
use std::process::ExitCode;
use std::sync::OnceLock;

/// Find the mathematical model of a moving vehicle or a chemical reaction from measured data.
#[derive(Debug, Parser)]
#[command(name = "fdm", bin_name = "fdm", version, after_help = overview::ADVICE)]
struct Arguments {
    #[command(subcommand)]
    verb: Verb,
    #[command(flatten)]
    manner: deliver::Manner,
    /// Number of threads, on which no result depends
    #[arg(long, global = true, value_name = "N", display_order = 1002, allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Leave the project file (`fdm.toml`) aside
    #[arg(long, global = true, display_order = 1003)]
    no_project: bool,
    /// Let machine code of units run in models that a file names
    #[arg(long, global = true, display_order = 1004)]
    allow_units: bool,
}

/// The verbs, in the order in which the overview lists them.
#[derive(Debug, Subcommand)]
enum Verb {
    /// Write a first model with comments, and a record to try it on
    New(new::Arguments),
    /// Look into a log or data file, and take channels from it as CSV
    Data(data::Arguments),
    /// Judge records before they are believed: faults, odds, repairs
    Doctor(doctor::Arguments),
    /// Check a model: every mistake in its text, and every derivative
    Check(check::Arguments),
    /// Estimate the parameters of a model from one or several runs
    Fit(Box<Delivered<fit::Options>>),
    /// Validate a result with runs that it was not fitted to
    ///
    /// Only per-run parameters are estimated again: biases and initial states.
    Validate(validate::Arguments),
    /// Find what a model gets wrong, extend its text, measure the gain
    Diagnose(Box<diagnose::Arguments>),
    /// Compare results: criteria, parameters, tests, predictions
    ///
    /// Criteria, parameters, tests of nested models, predictions of validation data.
    Compare(compare::Arguments),
    /// Simulate a model over recorded inputs
    Simulate(simulate::Arguments),
    /// Optimal input design: the next runs that reduce errors most
    Design(design::Arguments),
    /// Write a result as one page for a browser: tables and figures
    ///
    /// Text, equations, tables and figures in one file, which needs no network.
    Report(page::Report),
    /// Write a model or a result for other tools: FMU, C, Rust, PEtab
    ///
    /// Functional mock-up unit, stand-alone C or Rust with all derivatives and equal to the bit, state space, JSBSim, DAVE-ML, PEtab.
    Export(export::Arguments),

    /// Equation error: linear regression of measured rates
    ///
    /// For every equation that is linear in its parameters.
    Regress(regress::Arguments),
    /// Frequency responses of the records, with coherence and error
    Spectra(spectra::Arguments),
    /// Monte Carlo study: bias, scatter, interval coverage
    Study(Box<Delivered<study::Options>>),
    /// Profile-likelihood confidence intervals
    Profile(Box<profile::Arguments>),
    /// Draws from the posterior by the No-U-Turn sampler
    Sample(sample::Arguments),
    /// Eigenvalues of a model, linear or linearised at its trim
    ///
    /// With the dominant states of each.
    Modes(modes::Arguments),
    /// Requirements on a result, with the probability that they hold
    ///
    /// Margins, modes, responses, each with its interval and the probability that it holds.
    Margins(margins::Arguments),
    /// Draw one figure of a result as SVG or PNG, or list the figures
    Plot(page::Plot),
    /// Show a result in a browser, also while a fit works on it
    Serve(page::Serve),
    /// The application in a browser: records, model, fit, diagnosis
    Studio(studio::Arguments),

    /// List candidate effects for a model, and where each fits
    Effects(effects::Arguments),
    /// Write effects into a model's own text, and print what changes
    Extend(effects::Extension),
    /// Read a problem of PEtab or a model of SBML
    ///
    /// What is written is a readable model, its records and a project file.
    Import(import::Arguments),
    /// Verify that an exported file computes what its model does
    Verify(verify::Arguments),
    /// Format models: indents, spaces and columns, nothing else
    Fmt(fmt::Arguments),
    /// Show the stages of a model, from its text to machine code
    ///
    /// Syntax, model, graph, derivatives, schedule, code, linear.
    Show(show::Arguments),
    /// Explain the code of a message, with an example corrected
    Explain(help::Explain),
    /// Language server for editors (Language Server Protocol)
    Lsp(lsp::Arguments),
    /// Share the work of a command between machines
    Job(job::Arguments),
    /// Simulate and fit the reference systems beside published figures
    Reproduce(reproduce::Arguments),
    /// Print the completion script of a shell
    Completions(manual::Completions),
    /// Print the manual, or write one page for every command
    Man(manual::Manual),
}

/// All verbs and options, as clap knows them: to check what is quoted elsewhere, or to write a manual.
pub fn command() -> clap::Command {
    let columns = width(Stream::Out).min(MOST_COLUMNS);
    let command = subjects::with_places(Arguments::command().term_width(columns));
    let template = overview::template(&command);
    command.help_template(template)
}

/// Longer lines of help are hard to read.
const MOST_COLUMNS: usize = 110;

/// Whether words, the first of which is the name of the program, are a command line; nothing is done.
///
/// # Errors
/// What is wrong with them.
pub fn understood(words: impl IntoIterator<Item = OsString>) -> Result<(), String> {
    let command = command();
    let words = subjects::sorted(words.into_iter().collect(), &command).map_err(|failure| failure.to_string())?;
    command.try_get_matches_from(words).map(drop).map_err(|e| e.to_string())
}

/// Does what the command line asks for.
pub fn main() -> ExitCode {
    main_with(std::env::args_os())
}

/// The words of the command line, where they are not those of the process.
static WORDS: OnceLock<Vec<String>> = OnceLock::new();

/// The words of the command line, as results tell them.
fn command_line() -> Vec<String> {
    WORDS.get().cloned().unwrap_or_else(|| std::env::args_os().map(|w| w.to_string_lossy().into_owned()).collect())
}

/// Does what these words ask for, the first of which is the name of the program: once in a process.
pub fn main_with(words: impl IntoIterator<Item = OsString>) -> ExitCode {
    let words: Vec<OsString> = words.into_iter().collect();
    if builtin::is_asked(&words) {
        failure::print(&builtin::told());
        return ExitCode::SUCCESS;
    }
    let mut command = command();
    let sorted = subjects::sorted(words, &command);
    let words = match sorted.and_then(|words| project::completed(words, &command)) {
        Ok(words) => words,
        Err(failure) => return failure::report(&failure),
    };
    let _ = WORDS.set(words.iter().map(|w| w.to_string_lossy().into_owned()).collect());
    let matches = match command.try_get_matches_from_mut(&words) {
        Ok(matches) => matches,
        Err(e) => {
            let missing = subjects::missing(&e, &words, &command);
            return missing.map_or_else(|| failure::refuse_words(&e), |failure| failure::report(&failure));
        }
    };
    let arguments = match Arguments::from_arg_matches(&matches) {
        Ok(arguments) => arguments,
        Err(e) => return failure::refuse_words(&e.format(&mut command)),
    };
    if let Err(failure) = paths::refuse_conflicts(&command, &matches) {
        return failure::report(&failure);
    }
    failure::keep_quiet(arguments.manner.quiet);
    if let Some(threads) = arguments.threads {
        // the pool can be set once only; nothing has used it yet
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global();
    }
    if let Verb::Reproduce(_) | Verb::Job(_) = &arguments.verb {
        models_are_named_by("a file", arguments.allow_units);
    }
    let result = match &arguments.verb {
        Verb::New(a) => new::run(a),
        Verb::Data(a) => data::run(a),
        Verb::Doctor(a) => doctor::run(a),
        Verb::Check(a) => check::run(a),
        Verb::Fit(a) => a.run(&Asked::default()),
        Verb::Validate(a) => validate::run(a),
        Verb::Diagnose(a) => a.run(&Asked::default()),
        Verb::Compare(a) => compare::run(a),
        Verb::Simulate(a) => simulate::run(a),
        Verb::Design(a) => design::run(a),
        Verb::Report(a) => page::report(a),
        Verb::Export(a) => export::run(a),
        Verb::Regress(a) => regress::run(a),
        Verb::Spectra(a) => spectra::run(a),
        Verb::Study(a) => a.run(&Asked::default()),
        Verb::Profile(a) => a.run(&Asked::default()),
        Verb::Sample(a) => sample::run(a),
        Verb::Modes(a) => modes::run(a),
        Verb::Margins(a) => margins::run(a),
        Verb::Plot(a) => page::plot(a),
        Verb::Serve(a) => page::serve(a),
        Verb::Studio(a) => studio::run(a),
        Verb::Effects(a) => effects::run(a),
        Verb::Extend(a) => effects::extend(a),
        Verb::Import(a) => import::run(a),
        Verb::Verify(a) => verify::run(a),
        Verb::Fmt(a) => fmt::run(a),
        Verb::Show(a) => show::run(a),
        Verb::Explain(a) => help::explain(a),
        Verb::Lsp(a) => lsp::run(a),
        Verb::Job(a) => job::run(a),
        Verb::Reproduce(a) => reproduce::run(a),
        Verb::Completions(a) => manual::completions(a, self::command()),
        Verb::Man(a) => manual::manual(a, self::command()),
    };
    result.unwrap_or_else(|failure| failure::report(&failure))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        command().debug_assert();
    }
}
