//! The command line: what was typed, one file per verb.
//!
//! Exit codes: 0 good, 1 numbers went wrong (what was computed is printed), 2 wrong input.

mod check;
mod codegen;
mod compare;
mod completions;
mod delivery;
mod design;
mod diagnose;
mod effects;
mod explain;
mod extend;
mod failure;
mod filter;
mod fit;
mod fmt;
mod histories;
mod integrator;
mod iteration;
mod keeping;
mod live;
mod lsp;
mod modes;
mod new;
mod noise;
mod plot;
mod profile;
mod progress;
mod reading;
mod records;
mod recursive;
mod regress;
mod rehearsal;
mod repetition;
mod report;
mod reproduce;
mod responses;
mod serve;
mod show;
mod simulate;
mod spectra;
mod spectral;
mod strategies;
mod study;
mod subject;
mod validate;

use clap::{CommandFactory, Parser, Subcommand};
use std::process::ExitCode;

/// Find the mathematical model of a moving vehicle or a chemical reaction from measured data.
#[derive(Debug, Parser)]
#[command(version, about, max_term_width = 110)]
struct Arguments {
    #[command(subcommand)]
    verb: Verb,
    /// Threads to use; the results do not depend on it [default: all cores]
    #[arg(long, global = true, value_name = "N", display_order = 1000, allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Check a model: every mistake of its text, then every derivative against a complex step
    Check(check::Arguments),
    /// Which input, moved how, would tell in the next run what the runs so far do not
    Design(design::Arguments),
    /// Find what a model gets wrong: name the cause, extend the model's text, measure the gain
    Diagnose(Box<diagnose::Arguments>),
    /// List what may be missing from a model: the effects of the catalogue and the places where they fit
    Effects(effects::Arguments),
    /// Write effects into a model's own text, and print what changes
    Extend(extend::Arguments),
    /// Simulate a model over recorded inputs
    Simulate(simulate::Arguments),
    /// Estimate a model's parameters from one or several runs
    Fit(Box<fit::Arguments>),
    /// Lay models out: indents, spaces and columns; nothing but those changes, and comments stay
    Fmt(fmt::Arguments),
    /// Serve an editor over standard input and output (Language Server Protocol)
    Lsp(lsp::Arguments),
    /// How far a parameter may go, all others fitted anew, until the cost has risen by more than chance explains
    Profile(Box<profile::Arguments>),
    /// Repeat a fit with other noise: bias, scatter, and how often the printed intervals hold
    Study(Box<study::Arguments>),
    /// Eigenvalues of a model, linear or linearised at its trim, with the states that dominate each
    Modes(modes::Arguments),
    /// Estimate every equation that is linear in its parameters by regression of measured rates (equation error)
    Regress(regress::Arguments),
    /// Draw one figure of a result's page as SVG or PNG, or list their names
    Plot(plot::Arguments),
    /// Serve the page of a result to a browser on this machine, also while a fit or a study works on it
    Serve(serve::Arguments),
    /// Write a result as one page for a browser: text, equations, tables, figures; it asks for nothing from a network
    Report(report::Arguments),
    /// Make the records of the reference systems, fit them, and compare with the published figures
    Reproduce(reproduce::Arguments),
    /// Frequency responses between inputs and outputs as the records show them, with coherence and random error
    Spectra(spectra::Arguments),
    /// Show what becomes of a model's text: syntax, model, graph, derivatives, schedule, code, linear
    Show(show::Arguments),
    /// Explain the code of a message: what it means, an example, and the example mended
    Explain(explain::Arguments),
    /// Write a first model with comments, ready to be checked, simulated and fitted
    New(new::Arguments),
    /// Write the model as stand-alone C or Rust: rates, outputs, their partials and sensitivities, the same bits
    Codegen(codegen::Arguments),
    /// Print the script by which a shell completes what is typed
    Completions(completions::Completions),
    /// Print the manual, or write a page for every command
    Man(completions::Manual),
    /// Several results side by side: criteria, parameters, tests of nested models, predictions of runs that were held out
    Compare(compare::Arguments),
    /// Compare a result with runs that it was not fitted to; only per-run parameters are estimated anew
    Validate(validate::Arguments),
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    if let Some(threads) = arguments.threads {
        // the pool can be set once only; nothing has used it yet
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global();
    }
    let result = match &arguments.verb {
        Verb::Check(a) => check::run(a),
        Verb::Design(a) => design::run(a),
        Verb::Diagnose(a) => diagnose::run(a),
        Verb::Effects(a) => effects::run(a),
        Verb::Extend(a) => extend::run(a),
        Verb::Simulate(a) => simulate::run(a),
        Verb::Fit(a) => fit::run(a),
        Verb::Fmt(a) => fmt::run(a),
        Verb::Lsp(a) => lsp::run(a),
        Verb::Modes(a) => modes::run(a),
        Verb::Regress(a) => regress::run(a),
        Verb::Plot(a) => plot::run(a),
        Verb::Serve(a) => serve::run(a),
        Verb::Report(a) => report::run(a),
        Verb::Reproduce(a) => reproduce::run(a),
        Verb::Spectra(a) => spectra::run(a),
        Verb::Show(a) => show::run(a),
        Verb::Explain(a) => explain::run(a),
        Verb::New(a) => new::run(a),
        Verb::Codegen(a) => codegen::run(a),
        Verb::Completions(a) => completions::completions(a, Arguments::command()),
        Verb::Man(a) => completions::manual(a, Arguments::command()),
        Verb::Compare(a) => compare::run(a),
        Verb::Profile(a) => profile::run(a),
        Verb::Study(a) => study::run(a),
        Verb::Validate(a) => validate::run(a),
    };
    result.unwrap_or_else(|failure| failure.report())
}
