//! The command `fdm` for the studies: Cargo hands a package's tests only the programs of that package.

use std::process::ExitCode;

fn main() -> ExitCode {
    fdm_cli::main()
}
