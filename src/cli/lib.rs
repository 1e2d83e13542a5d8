//! The command line. A command loads (`load`, `options`, `methods`), works, and delivers (`deliver`, `failure`); one file a
//! command says only what is particular to it.
//!
//! Exit codes: 0 good, 1 numbers went wrong (what was computed is printed), 2 wrong input.

mod bands;
mod campaign;
mod check;
mod checkpoint;
mod codegen;
mod compare;
mod data;
mod delays;
mod deliver;
mod design;
mod diagnose;
mod doctor;
mod effects;
mod engine;
mod export;
mod failure;
mod first_cause;
mod fit;
mod fmt;
mod foreign_code;
mod front;
mod halt;
mod help;
mod import;
mod job;
pub mod language_server;
mod load;
mod margins;
mod merge;
mod methods;
mod modes;
mod new;
mod options;
mod ownership;
mod page;
mod paths;
mod plan;
mod problem;
mod profile;
mod progress;
mod progress_file;
mod project;
mod regress;
mod reproduce;
pub mod request;
mod run;
mod sample;
mod show;
mod simulate;
mod spectra;
mod status;
mod study;
mod tasks;
mod trust;
mod validate;
mod verify;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::ffi::OsString;
use std::process::ExitCode;
use std::sync::OnceLock;

/// Find the mathematical model of a moving vehicle or a chemical reaction from measured data.
#[derive(Debug, Parser)]
#[command(name = "fdm", bin_name = "fdm", version, max_term_width = 110)]
struct Arguments {
    #[command(subcommand)]
    verb: Verb,
    /// Number of threads; results do not depend on it [default: all cores]
    #[arg(long, global = true, value_name = "N", display_order = 1000, allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Leave the project file (`fdm.toml`, in this folder or one above) aside
    #[arg(long, global = true, display_order = 1001)]
    no_project: bool,
    /// Let machine code of functional mock-up units run in a model that a file names (project, job, experiment) and that was not typed
    #[arg(long, global = true, display_order = 1002)]
    allow_units: bool,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Check a model: every mistake in its text, then every derivative against a complex step
    Check(check::Arguments),
    /// Look into a log or data file, and take channels from it as CSV
    Data(data::Arguments),
    /// Optimal input design: the manoeuvres of the next runs that reduce the standard errors most
    Design(design::Arguments),
    /// Find what a model gets wrong: name the cause, extend the model's text, measure the gain
    Diagnose(Box<diagnose::Arguments>),
    /// Judge records before they are believed: faults with odds, biases and repairs, by themselves and beside a model
    Doctor(doctor::Arguments),
    /// List candidate effects for a model: the catalogue, and where each effect fits
    Effects(effects::Arguments),
    /// Write a model or a result for other tools: functional mock-up unit, C, Rust, state space, JSBSim, DAVE-ML, PEtab
    Export(export::Arguments),
    /// Write effects into a model's own text, and print what changes
    Extend(effects::Extend),
    /// Simulate a model over recorded inputs
    Simulate(simulate::Arguments),
    /// Estimate the parameters of a model from one or several runs
    Fit(Box<fit::Arguments>),
    /// Format models: indents, spaces and columns; nothing else changes
    Fmt(fmt::Arguments),
    /// Language server for editors, on standard input and output (Language Server Protocol)
    Lsp(language_server::Arguments),
    /// Profile-likelihood confidence intervals
    Profile(Box<profile::Arguments>),
    /// Monte Carlo study: bias, scatter, interval coverage
    Study(Box<study::Arguments>),
    /// Requirements on a result: margins, modes, responses, each with its interval and the probability that it holds
    Margins(margins::Arguments),
    /// Eigenvalues of a model, linear or linearised at its trim, with the dominant states of each
    Modes(modes::Arguments),
    /// Equation error: regression of measured rates, for every equation that is linear in its parameters
    Regress(regress::Arguments),
    /// Draw one figure of a result as SVG or PNG, or list the figures
    Plot(page::Plot),
    /// Show a result in a browser on this machine, also while a fit or a study works on it
    Serve(page::Serve),
    /// Write a result as one page for a browser: text, equations, tables, figures; it needs no network
    Report(page::Report),
    /// Simulate the reference systems, fit them, and compare with the published figures
    Reproduce(reproduce::Arguments),
    /// Draws from the posterior of a result by the No-U-Turn sampler, with diagnostics
    Sample(sample::Arguments),
    /// Frequency responses of the records, with coherence and random error
    Spectra(spectra::Arguments),
    /// Show the stages of a model: syntax, model, graph, derivatives, schedule, code, linear
    Show(show::Arguments),
    /// Explain the code of a message: what it means, an example, and the example corrected
    Explain(help::Explain),
    /// Write a first model with comments and a record, ready to be checked, simulated and fitted
    New(new::Arguments),
    /// Read a problem of PEtab or a model of SBML: a readable model, its records, a project file
    Import(import::Arguments),
    /// Write a model as stand-alone C or Rust: rates, outputs, their derivatives and sensitivities, equal to the bit
    Codegen(codegen::Arguments),
    /// Cut a job into tasks that many machines can share, and say what it costs
    Plan(plan::Arguments),
    /// Do a share of the tasks of a plan; done ones are not done again
    Run(run::Arguments),
    /// End a job with what all machines have done: the result of its command, to the bit
    Merge(merge::Arguments),
    /// How far a job is, and who is at work on it
    Status(status::Arguments),
    /// Print the completion script of a shell
    Completions(help::Completions),
    /// Print the manual, or write one page for every command
    Man(help::Manual),
    /// Compare results: criteria, parameters, tests of nested models, predictions of validation data
    Compare(compare::Arguments),
    /// Validate a result with runs that it was not fitted to; only per-run parameters are estimated again
    Validate(validate::Arguments),
    /// Verify that a file of `fdm export` computes what its model does: values and derivatives
    Verify(verify::Arguments),
}

/// All verbs and options, as clap knows them: to check what is quoted elsewhere, or to write a manual.
pub fn command() -> clap::Command {
    Arguments::command()
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
    let mut command = Arguments::command();
    let words = match project::completed(words.into_iter().collect(), &command) {
        Ok(words) => words,
        Err(failure) => return failure.report(),
    };
    let _ = WORDS.set(words.iter().map(|w| w.to_string_lossy().into_owned()).collect());
    let matches = match command.try_get_matches_from_mut(words) {
        Ok(matches) => matches,
        Err(e) => return failure::refuse_words(&e),
    };
    let arguments = match Arguments::from_arg_matches(&matches) {
        Ok(arguments) => arguments,
        Err(e) => return failure::refuse_words(&e.format(&mut command)),
    };
    if let Err(failure) = paths::refuse_conflicts(&command, &matches) {
        return failure.report();
    }
    if let Some(threads) = arguments.threads {
        // the pool can be set once only; nothing has used it yet
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global();
    }
    if let Verb::Reproduce(_) | Verb::Plan(_) | Verb::Run(_) | Verb::Merge(_) = &arguments.verb {
        foreign_code::models_are_named_by("a file", arguments.allow_units);
    }
    let result = match &arguments.verb {
        Verb::Check(a) => check::run(a),
        Verb::Data(a) => data::run(a),
        Verb::Design(a) => design::run(a),
        Verb::Diagnose(a) => diagnose::run(a),
        Verb::Doctor(a) => doctor::run(a),
        Verb::Effects(a) => effects::run(a),
        Verb::Export(a) => export::run(a),
        Verb::Extend(a) => effects::extend(a),
        Verb::Simulate(a) => simulate::run(a),
        Verb::Fit(a) => fit::run(a),
        Verb::Fmt(a) => fmt::run(a),
        Verb::Lsp(a) => language_server::run(a),
        Verb::Margins(a) => margins::run(a),
        Verb::Modes(a) => modes::run(a),
        Verb::Regress(a) => regress::run(a),
        Verb::Plot(a) => page::plot(a),
        Verb::Serve(a) => page::serve(a),
        Verb::Report(a) => page::report(a),
        Verb::Reproduce(a) => reproduce::run(a),
        Verb::Sample(a) => sample::run(a),
        Verb::Spectra(a) => spectra::run(a),
        Verb::Show(a) => show::run(a),
        Verb::Explain(a) => help::explain(a),
        Verb::New(a) => new::run(a),
        Verb::Import(a) => import::run(a),
        Verb::Codegen(a) => codegen::run(a),
        Verb::Completions(a) => help::completions(a, Arguments::command()),
        Verb::Man(a) => help::manual(a, Arguments::command()),
        Verb::Plan(a) => plan::run(a),
        Verb::Run(a) => run::run(a),
        Verb::Merge(a) => merge::run(a),
        Verb::Status(a) => status::run(a),
        Verb::Compare(a) => compare::run(a),
        Verb::Profile(a) => profile::run(a),
        Verb::Study(a) => study::run(a),
        Verb::Validate(a) => validate::run(a),
        Verb::Verify(a) => verify::run(a),
    };
    result.unwrap_or_else(|failure| failure.report())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }
}
