//! `fdm lsp`: the language server.

use crate::failure::{Failure, NUMBERS};
use clap::Args;
use std::process::ExitCode;

/// What `fdm lsp` takes: what editors pass to every server, which changes nothing.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Speak over standard input and output, which it always does
    #[arg(long, hide = true)]
    stdio: bool,
}

pub(crate) fn run(_: &Arguments) -> Result<ExitCode, Failure> {
    let orderly = fdm::lsp::serve_standard_streams().map_err(|e| Failure::input([e]))?;
    Ok(if orderly { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}
