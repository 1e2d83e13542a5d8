//! Every source begins with a sentence, has a name that says something, and names no machine.

use fancy_regex::Regex;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use support::{files, repository};

/// Folders of the packages, by name: what a user builds.
pub(crate) fn packages() -> Vec<(String, PathBuf)> {
    let packages = packages_below(repository());
    assert!(packages.len() > 5, "{packages:?}");
    packages
}

/// The packages of the project in `root`: the folders below `src`, one deep or two, that have a manifest, and the language.
pub(crate) fn packages_below(root: &Path) -> Vec<(String, PathBuf)> {
    let folders = |folder: &Path| -> Vec<PathBuf> {
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).filter(|p| p.is_dir()).collect()
    };
    let first = folders(&root.join("src"));
    let below = first.iter().cloned().chain(first.iter().flat_map(|f| folders(f)));
    let mut packages: Vec<(String, PathBuf)> = below
        .filter(|path| path.join("Cargo.toml").is_file())
        .map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), path))
        .collect();
    packages.extend(["grammar", "macros"].map(|name| (name.to_string(), root.join(name).join("src"))));
    packages.sort();
    packages
}

/// A source without tests and without comments, line for line.
pub(crate) fn code_of(text: &str) -> String {
    static TESTS: LazyLock<Regex> = LazyLock::new(|| Regex::new(r"#\[cfg\(test\)\]\s*mod \w+ \{").unwrap());
    static COMMENT: LazyLock<Regex> = LazyLock::new(|| Regex::new(r"//[^\n]*").unwrap());
    let code = COMMENT.replace_all(text, "").into_owned();
    let end = TESTS.find(&code).unwrap().map_or(code.len(), |m| m.start());
    code[..end].to_string()
}

/// The sources of a package without tests and without comments, by path below `folder`.
pub(crate) fn product(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    for file in files(&folder.to_string_lossy(), "rs") {
        let path = file.strip_prefix(folder).unwrap().to_path_buf();
        let parts = path.iter().map(|part| part.to_string_lossy().trim_end_matches(".rs").to_string());
        if parts.clone().any(|part| part.ends_with("tests") || part == "specimen") {
            continue;
        }
        found.push((path, code_of(&fs::read_to_string(&file).unwrap())));
    }
    found
}

pub(crate) fn rust_files() -> Vec<PathBuf> {
    ["src", "grammar", "macros", "tests", "studies", "benches", "examples"]
        .iter()
        .flat_map(|f| files(f, "rs"))
        .collect()
}

#[test]
fn files_begin_with_a_sentence_and_have_names_that_say_something() {
    // what rustc says of these stands at their lines
    for file in rust_files().iter().filter(|f| !f.starts_with(repository().join("tests/macros/ui"))) {
        let text = fs::read_to_string(file).unwrap();
        assert!(text.starts_with("//!"), "{}: begins without saying what it is", file.display());
        let name = file.file_stem().unwrap().to_string_lossy().into_owned();
        let empty = ["utils", "util", "helpers", "helper", "common", "misc", "manager"];
        assert!(!empty.contains(&name.as_str()), "{}: a name that says nothing", file.display());
    }
}

#[test]
fn nothing_names_a_machine() {
    let mut found = rust_files();
    for (folder, ending) in [("docs", "md"), ("models", "md"), ("models", "fdm"), ("studies", "md"), ("tests", "txt")] {
        found.extend(files(folder, ending));
    }
    found.extend(["README.md", "Cargo.toml", ".ci/run"].map(|f| repository().join(f)));
    // spelt in two parts so that this file does not find itself
    let places =
        [["/ho", "me/"].concat(), ["/ro", "ot/"].concat(), ["/wo", "rk/"].concat(), ["../sha", "red"].concat()];
    for file in found {
        let text = fs::read_to_string(&file).unwrap_or_default();
        for place in &places {
            assert!(!text.contains(place.as_str()), "{}: names a place on one machine: {place}", file.display());
        }
    }
}
