//! What may be opened to be read whole: files on a disk, and pipes that a shell or a program before has opened. Everything else may have no end.

use std::fs::{self, File};
use std::io;
use std::path::Path;

/// Why something is not opened.
#[derive(Debug, thiserror::Error)]
pub enum InputError {
    /// The operating system refuses.
    #[error(transparent)]
    System(#[from] io::Error),
    /// A directory.
    #[error("is a directory, not a file")]
    Directory,
    /// A pipe with a name: reading waits until somebody writes.
    #[error("is a named pipe, from which reading may wait for ever, not a file")]
    NamedPipe,
    /// A device or a socket.
    #[error("is a device or a socket, which may have no end, not a file")]
    Device,
}

impl From<InputError> for io::Error {
    fn from(error: InputError) -> Self {
        match error {
            InputError::System(error) => error,
            other => Self::other(other),
        }
    }
}

/// Opens what is to be read whole.
///
/// # Errors
/// [`InputError`]: of the file system; for directories, for pipes with names, on which reading may wait for ever, and for devices and sockets,
/// which may have no end.
pub fn open_input(path: &Path) -> Result<File, InputError> {
    let about = fs::metadata(path)?;
    if about.is_dir() {
        return Err(InputError::Directory);
    }
    if is_pipe(&about) {
        // those that the shell or a program before has opened
        let opened = |path: &Path| path.starts_with("/dev") || path.starts_with("/proc");
        if !opened(path) && !path.canonicalize().is_ok_and(|place| opened(&place)) {
            return Err(InputError::NamedPipe);
        }
    } else if !about.is_file() {
        return Err(InputError::Device);
    }
    Ok(File::open(path)?)
}

#[cfg(unix)]
fn is_pipe(about: &fs::Metadata) -> bool {
    std::os::unix::fs::FileTypeExt::is_fifo(&about.file_type())
}

#[cfg(not(unix))]
fn is_pipe(_: &fs::Metadata) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_ends_is_opened() {
        let refused = |path: &str| open_input(Path::new(path)).unwrap_err().to_string();
        assert!(open_input(Path::new("Cargo.toml")).is_ok());
        assert!(refused(".").contains("directory") && refused("none.csv").contains("No such file"));
        #[cfg(unix)]
        for device in ["/dev/zero", "/dev/null"] {
            assert!(refused(device).contains("device"), "{device}");
        }
    }
}
