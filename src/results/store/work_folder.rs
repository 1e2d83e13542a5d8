//! A folder in which a command works while it runs, gone when it ends.

use std::fs;
use std::io;
use std::path::{Component, Path};
use tempfile::TempDir;

/// A folder with files, gone when it is dropped.
#[derive(Debug)]
pub struct WorkFolder(TempDir);

impl WorkFolder {
    /// With these files: names, which may have folders in them, and contents.
    ///
    /// # Errors
    /// Of the file system; of the kind `InvalidInput` for a name that leads out of the folder.
    pub fn with(files: &[(String, Vec<u8>)]) -> io::Result<Self> {
        let folder = tempfile::tempdir()?;
        for (name, contents) in files {
            if !Path::new(name).components().all(|c| matches!(c, Component::Normal(_))) {
                return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("`{name}` leads out of the folder")));
            }
            let path = folder.path().join(name);
            path.parent().map_or(Ok(()), fs::create_dir_all)?;
            fs::write(path, contents)?;
        }
        Ok(Self(folder))
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        self.0.path()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_stand_in_it_and_never_beside_it() {
        let file = |name: &str| vec![(name.to_string(), b"a".to_vec())];
        let folder = WorkFolder::with(&file("deep/a.txt")).unwrap();
        let path = folder.path().to_path_buf();
        assert_eq!(fs::read(path.join("deep/a.txt")).unwrap(), b"a");
        drop(folder);
        assert!(!path.exists());
        for name in ["../a.txt", "/a.txt", "deep/../../a.txt"] {
            assert!(WorkFolder::with(&file(name)).is_err(), "{name}");
        }
    }
}
