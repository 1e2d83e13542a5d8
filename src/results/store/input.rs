//! Files that are read whole because somebody, or another file, has named them: of a kind that ends, and of a size that is read.

use fdm_system::record::open_input;
use std::io::{self, Read};
use std::path::Path;

/// Most bytes of a text that is read whole: tables, plans and problems. A plan of a million tasks has a tenth of it; larger ones are
/// records, which have a reader of their own.
pub const MOST_BYTES: u64 = 1 << 30;

/// The bytes of an input file ([`open_input`]).
///
/// # Errors
/// As [`open_input`]; for a file of more than [`MOST_BYTES`].
pub fn read_input(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open_input(path)?.take(MOST_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(io::Error::other(format!("is larger than the limit of {} MiB", MOST_BYTES >> 20)));
    }
    Ok(bytes)
}

/// The text of an input file ([`read_input`]).
///
/// # Errors
/// As [`read_input`]; for what is not UTF-8.
pub fn read_input_text(path: &Path) -> io::Result<String> {
    String::from_utf8(read_input(path)?).map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "is not UTF-8 text"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn only_what_ends_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.toml");
        fs::write(&file, "a = 1").unwrap();
        assert_eq!(read_input_text(&file).unwrap(), "a = 1");
        assert!(read_input(folder.path()).unwrap_err().to_string().contains("directory"));
        fs::write(&file, [0xff, 0xfe]).unwrap();
        assert!(read_input_text(&file).unwrap_err().to_string().contains("UTF-8"));
        #[cfg(unix)]
        for device in ["/dev/zero", "/dev/null"] {
            assert!(read_input(Path::new(device)).unwrap_err().to_string().contains("device"), "{device}");
        }
    }
}
