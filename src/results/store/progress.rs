//! The report of work that goes on: one small file beside the place of the result, replaced now and then, gone at the end.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The file beside a folder that work is to fill.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProgressFile {
    path: PathBuf,
}

impl ProgressFile {
    /// Of a folder, which need not be there yet. The file stands beside it, so that the folder is nothing but a result.
    pub fn of(folder: impl AsRef<Path>) -> Self {
        // a link keeps pointing to the place where the result stands
        let folder = fs::canonicalize(&folder).unwrap_or_else(|_| folder.as_ref().to_path_buf());
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        Self { path: folder.with_file_name(format!(".{name}.progress")) }
    }

    /// Where it stands.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Puts a text in the place of the last report: a reader finds the one or the other, never a part. Nothing waits
    /// for the disk; what a power failure takes was worth a second.
    ///
    /// # Errors
    /// Those of the file system; the last report stands then.
    pub fn tell(&self, text: &str) -> io::Result<()> {
        let new = self.next();
        let written = fs::write(&new, text).and_then(|()| fs::rename(&new, &self.path));
        if written.is_err() {
            let _ = fs::remove_file(&new);
        }
        written
    }

    /// The last report; none when no work goes on.
    pub fn read(&self) -> Option<String> {
        fs::read_to_string(&self.path).ok()
    }

    /// Ends it.
    pub fn remove(&self) {
        // and what a program that died has left half written
        [&self.path, &self.next()].into_iter().for_each(|path| _ = fs::remove_file(path));
    }

    fn next(&self) -> PathBuf {
        self.path.with_extension("progress.new")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_stands_beside_the_folder_and_leaves_nothing() {
        let desk = tempfile::tempdir().unwrap();
        let folder = desk.path().join("result");
        let file = ProgressFile::of(&folder);
        assert_eq!(file.read(), None);
        file.tell("one").unwrap();
        file.tell("two").unwrap();
        assert_eq!(file.read().as_deref(), Some("two"));
        // the folder appears, and the place stays the same
        fs::create_dir(&folder).unwrap();
        assert_eq!(ProgressFile::of(&folder).read().as_deref(), Some("two"));
        assert_eq!(fs::read_dir(desk.path()).unwrap().count(), 2);
        fs::write(desk.path().join(".result.progress.new"), "ha").unwrap();
        file.remove();
        assert_eq!(fs::read_dir(desk.path()).unwrap().count(), 1);
        assert!(ProgressFile::of(desk.path().join("none/result")).tell("x").is_err());
    }
}
