//! The command as a user runs it: in a folder of its own, or in that of the project.

use serde_json::Value;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::{fs, io};
use tempfile::TempDir;

/// The command under test: the program that Cargo built for the package whose tests run. It is named `fdm-tested`, so that it does not
/// stand in the place of `fdm` itself. Its lines are not wrapped, so that sentences are found whole.
pub fn fdm() -> Command {
    let beside = || {
        let test = std::env::current_exe().unwrap();
        // <target>/<profile>/deps/<test>
        test.parent().and_then(Path::parent).unwrap().join("fdm-tested")
    };
    let mut command = Command::new(std::env::var_os("CARGO_BIN_EXE_fdm-tested").map_or_else(beside, PathBuf::from));
    command.env("COLUMNS", "100000");
    command
}

/// What was said on standard error.
pub fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// What was printed on standard output.
pub fn printed(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// A folder with the files of one test, in which the command runs; gone when it is dropped.
pub struct Desk(TempDir);

impl Desk {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// With these files: names and what they hold.
    pub fn with<C: AsRef<[u8]>>(files: impl IntoIterator<Item = (&'static str, C)>) -> Self {
        let desk = Self::new();
        for (name, content) in files {
            desk.write(name, content);
        }
        desk
    }

    pub fn folder(&self) -> &Path {
        self.0.path()
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, content).unwrap();
        path
    }

    pub fn text(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    /// What is in a folder of the desk (`""` is the desk itself), in order.
    pub fn names(&self, folder: &str) -> Vec<String> {
        let name = |entry: io::Result<fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
        let mut names: Vec<String> = fs::read_dir(self.path(folder)).unwrap().map(name).collect();
        names.sort();
        names
    }

    /// The command with these words, separated by white space, to be run here.
    pub fn command(&self, words: &str) -> Command {
        let mut command = fdm();
        command.args(words.split_whitespace()).current_dir(self.folder());
        command
    }

    /// The same with arguments that may hold white space.
    pub fn command_of<S: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = S>) -> Command {
        let mut command = fdm();
        command.args(arguments).current_dir(self.folder());
        command
    }

    pub fn fdm(&self, words: &str) -> Output {
        self.command(words).output().unwrap()
    }

    /// Exit code 0, and what was printed.
    pub fn good(&self, words: &str) -> String {
        good(&mut self.command(words))
    }

    /// The same, as JSON.
    pub fn json(&self, words: &str) -> Value {
        serde_json::from_str(&self.good(words)).unwrap()
    }

    /// Wrong input: exit code 2, nothing on standard output, and what was said.
    pub fn refused(&self, words: &str) -> String {
        refused(&mut self.command(words))
    }
}

impl Default for Desk {
    fn default() -> Self {
        Self::new()
    }
}

/// The command with these words in the folder of the project.
pub fn at_home(words: &str) -> Command {
    let mut command = fdm();
    command.args(words.split_whitespace()).current_dir(crate::repository());
    command
}

/// Exit code 0, and what was printed.
pub fn good(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{command:?}: {}", said(&output));
    String::from_utf8(output.stdout).unwrap()
}

/// Wrong input: exit code 2, nothing on standard output, and what was said.
pub fn refused(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{command:?}: {}", said(&output));
    said(&output)
}
