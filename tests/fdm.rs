//! The command `fdm` for the tests: Cargo hands a package's tests only the programs of that package. `FDM_FAULT` lets one operation
//! on files fail.

use std::process::ExitCode;

fn main() -> ExitCode {
    if let Ok(fault) = std::env::var("FDM_FAULT") {
        fdm_results::store::fail_at(&fault).expect("a fault");
    }
    fdm_cli::main()
}
