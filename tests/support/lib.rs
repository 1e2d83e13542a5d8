//! What the tests and the studies share: the command, shipped models, systems with something hidden, noise.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(missing_docs, reason = "read beside the tests that use it")]

pub mod command;
pub mod hidden;
pub mod hovering;
pub mod nonlinear;
pub mod papers;
#[cfg(unix)]
pub mod studio;
pub mod suite;
pub mod turbulence;
pub mod writing;

pub use command::{Desk, fdm};
pub use fdm_numeric::random::Normal;
pub use suite::Suite;

use std::path::{Path, PathBuf};
use std::{fs, io};

/// The folder of the project.
pub fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

/// A model of the project, by its path below `models/`.
pub fn shipped(path: &str) -> fdm::Model {
    fdm::Model::from_file(repository().join("models").join(path)).unwrap_or_else(|mistakes| panic!("{mistakes}"))
}

/// A model from its text.
pub fn model(text: &str) -> fdm::Model {
    fdm::Model::from_text("test.fdm", text).unwrap_or_else(|mistakes| panic!("{mistakes}"))
}

/// All files below a folder of the project with this ending, in order.
pub fn files(folder: &str, ending: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    walk(&repository().join(folder), ending, &mut found);
    found.sort();
    found
}

fn walk(folder: &Path, ending: &str, found: &mut Vec<PathBuf>) {
    let entries: io::Result<Vec<_>> = fs::read_dir(folder).and_then(Iterator::collect);
    for path in entries.unwrap_or_else(|e| panic!("{}: {e}", folder.display())).iter().map(fs::DirEntry::path) {
        if path.is_dir() {
            walk(&path, ending, found);
        } else if path.extension().is_some_and(|e| e == ending) {
            found.push(path);
        }
    }
}
