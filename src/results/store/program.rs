//! Which program this is: the fingerprint of the file that holds its machine code.

use super::disk::reason;
use super::fingerprint::fingerprint;
use std::fs;
use std::path::PathBuf;
use std::sync::OnceLock;

/// SHA-256 of the file that this code was loaded from: the program, or the library that another program has loaded.
///
/// # Errors
/// A sentence, where the file cannot be read.
pub fn program_fingerprint() -> Result<&'static str, String> {
    static FOUND: OnceLock<Result<String, String>> = OnceLock::new();
    let read = || {
        let file = file()?;
        let bytes = fs::read(&file).map_err(|e| format!("{}: {}", file.display(), reason(&e)))?;
        Ok(fingerprint(&bytes))
    };
    FOUND.get_or_init(read).as_deref().map_err(Clone::clone)
}

fn file() -> Result<PathBuf, String> {
    if let Some(library) = mapped() {
        return Ok(library);
    }
    std::env::current_exe().map_err(|e| format!("the file of this program: {}", reason(&e)))
}

/// The file behind the memory in which this function stands, where it is not the program itself (proc(5): `maps`).
fn mapped() -> Option<PathBuf> {
    let here = mapped as fn() -> Option<PathBuf> as usize;
    let maps = fs::read_to_string("/proc/self/maps").ok()?;
    let place = maps.lines().find(|line| {
        let range = line.split(' ').next().and_then(|range| range.split_once('-'));
        let number = |text: &str| usize::from_str_radix(text, 16).ok();
        range.is_some_and(|(from, to)| number(from).is_some_and(|f| f <= here) && number(to).is_some_and(|t| here < t))
    })?;
    let path = PathBuf::from(place.splitn(6, ' ').nth(5)?.trim_start());
    // the program itself can be read under this name even when its file was replaced meanwhile
    let own = PathBuf::from("/proc/self/exe");
    let is_program = fs::read_link(&own).is_ok_and(|program| program == path);
    Some(if is_program { own } else { path })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fingerprint_is_that_of_the_file_of_this_test() {
        let program = fs::read(std::env::current_exe().unwrap()).unwrap();
        assert_eq!(program_fingerprint(), Ok(fingerprint(&program).as_str()));
    }
}
