//! The command `fdm`.

use std::process::ExitCode;

fn main() -> ExitCode {
    fdm_cli::main()
}
