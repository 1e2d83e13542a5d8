//! `fdm lsp`: the language server for editors, where this build has it.

use crate::failure::Ending;
use clap::Args;

/// What `fdm lsp` takes: what editors pass to every server, which changes nothing.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Speak over standard input and output, which it always does
    #[arg(long, hide = true)]
    stdio: bool,
}

#[cfg(feature = "lsp")]
pub(crate) fn run(_: &Arguments) -> Ending {
    use crate::failure::{OrFailure, ended};
    ended(crate::language_server::serve_standard_streams().or_failure()?)
}

#[cfg(not(feature = "lsp"))]
pub(crate) fn run(_: &Arguments) -> Ending {
    let what = "this build of fdm has no language server: build it with `--features lsp`";
    Err(crate::failure::Failure::input([what]))
}
