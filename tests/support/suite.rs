//! Suites as files: what is printed is compared with files below `tests/suite/`. `FDM_BLESS=1` writes them anew.

use similar::TextDiff;
use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;

/// Files of one folder below `tests/suite/`, one for each thing that is printed.
pub struct Suite {
    folder: PathBuf,
    seen: BTreeSet<String>,
    wrong: Vec<String>,
}

fn blessed() -> bool {
    std::env::var_os("FDM_BLESS").is_some()
}

impl Suite {
    pub fn new(folder: &str) -> Self {
        let folder = crate::repository().join("tests/suite").join(folder);
        Self { folder, seen: BTreeSet::new(), wrong: Vec::new() }
    }

    /// What stands in a file of the suite; nothing where it is not there.
    pub fn expected(&self, file: &str) -> String {
        fs::read_to_string(self.folder.join(file)).unwrap_or_default()
    }

    /// Compares a file with what is printed now.
    pub fn check(&mut self, file: &str, got: &str) {
        self.seen.insert(file.to_string());
        let (path, expected) = (self.folder.join(file), self.expected(file));
        if expected == got && path.is_file() {
            return;
        }
        if blessed() {
            fs::create_dir_all(&self.folder).unwrap();
            fs::write(&path, got).unwrap();
            return;
        }
        let name = path.strip_prefix(crate::repository()).unwrap().display().to_string();
        let diff = TextDiff::from_lines(expected.as_str(), got);
        self.wrong.push(diff.unified_diff().context_radius(3).header(&name, "printed now").to_string());
    }

    /// Fails with all differences, and with files that nothing is printed for.
    pub fn finish(mut self) {
        let entries = fs::read_dir(&self.folder).unwrap().map(|e| e.unwrap());
        for stale in entries.filter(|e| !self.seen.contains(e.file_name().to_str().unwrap())) {
            if blessed() {
                fs::remove_file(stale.path()).unwrap();
            } else {
                self.wrong.push(format!("{}: nothing is printed for this file\n", stale.path().display()));
            }
        }
        assert!(
            self.wrong.is_empty(),
            "{}\nWhere this is as it should be, `FDM_BLESS=1 cargo test -p fdm-tests` writes the files anew; read their difference before committing it.",
            self.wrong.join("\n")
        );
    }
}
