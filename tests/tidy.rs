//! The house keeps its own rules: arrows, room headers, file sizes, words that do not belong in the project.

use std::fs;
use std::path::{Path, PathBuf};

/// A room may import only from rooms that stand before it.
const GRAMMAR: &[&str] = &[
    "stopwatch",
    "math",
    "source",
    "diagnostic",
    "explain",
    "unit",
    "syntax",
    "format",
    "expand",
    "op",
    "graph",
    "model",
    "terms",
    "check",
    "derive",
    "schedule",
    "emit",
    "linearise",
    "carried",
    "effect",
    "lib",
];
const FDM: &[&str] = &[
    "dynamics",
    "code",
    "record",
    "spectrum",
    "model",
    "linear",
    "simulate",
    "frequency",
    "quality",
    "regression",
    "estimate",
    "diagnose",
    "store",
    "comparison",
    "experiment",
    "design",
    "study",
    "report",
    "page",
    "lsp",
    "cli",
];

const LONGEST_FILE: usize = 700;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn files(folder: &Path, ending: &str, found: &mut Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|e| e.path()) {
        if path.is_dir() {
            files(&path, ending, found);
        } else if path.extension().is_some_and(|e| e == ending) {
            found.push(path);
        }
    }
    found.sort();
}

fn rust_files() -> Vec<PathBuf> {
    let mut found = Vec::new();
    for folder in ["src", "grammar/src", "macros/src", "tests", "benches", "examples"] {
        files(&root().join(folder), "rs", &mut found);
    }
    assert!(found.len() > 30, "the walk found the sources");
    found
}

/// The room of a file below `base`: its folder, or its own name when it is a file of the top.
fn room(base: &Path, file: &Path) -> String {
    let below = file.strip_prefix(base).expect("the file is below its base");
    let first = below.iter().next().expect("a file has a name").to_string_lossy();
    first.trim_end_matches(".rs").to_string()
}

#[test]
fn arrows_point_one_way() {
    let mut wrong = Vec::new();
    for (base, rooms) in [("grammar/src", GRAMMAR), ("src", FDM)] {
        let base = root().join(base);
        let mut found = Vec::new();
        files(&base, "rs", &mut found);
        for file in found {
            let room = room(&base, &file);
            // tests may look anywhere
            let tests = file.file_stem().is_some_and(|name| name.to_string_lossy().ends_with("tests"));
            if room == "lib" || tests {
                continue;
            }
            let Some(own) = rooms.iter().position(|r| *r == room) else {
                wrong.push(format!("{}: room `{room}` is not in the list of rooms", file.display()));
                continue;
            };
            let text = fs::read_to_string(&file).expect("sources are text");
            let code = text.split("#[cfg(test)]").next().unwrap_or_default();
            // documentation may point anywhere
            let code: String =
                code.lines().filter(|l| !l.trim_start().starts_with("//")).map(|l| format!("{l}\n")).collect();
            // inside the binary the library is `fdm::`, inside the library it is `crate::`
            for prefix in ["crate::", "fdm::"] {
                for (at, _) in code.match_indices(prefix) {
                    if at > 0 && code.as_bytes()[at - 1].is_ascii_alphanumeric() || code[..at].ends_with('_') {
                        continue;
                    }
                    let rest = &code[at + prefix.len()..];
                    let names: Vec<String> = if let Some(group) = rest.strip_prefix('{') {
                        let inside = group.split('}').next().unwrap_or_default();
                        inside.split(',').map(|n| n.trim().split("::").next().unwrap_or_default().into()).collect()
                    } else {
                        vec![rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()]
                    };
                    for name in names {
                        if rooms.iter().position(|r| *r == name).is_some_and(|other| other > own) {
                            wrong
                                .push(format!("{}: `{room}` imports `{name}`, which stands behind it", file.display()));
                        }
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn rooms_say_what_enters_and_leaves() {
    for file in rust_files().into_iter().filter(|f| f.ends_with("mod.rs") && !f.to_string_lossy().contains("tests/")) {
        let text = fs::read_to_string(&file).expect("sources are text");
        let header: String = text.lines().take_while(|l| l.starts_with("//!")).collect();
        for word in ["**In**", "**Out**", "**Never**", "**Start**"] {
            assert!(header.contains(word), "{}: the header of this room lacks {word}", file.display());
        }
    }
}

#[test]
fn files_are_short_and_begin_with_a_sentence() {
    for file in rust_files() {
        let text = fs::read_to_string(&file).expect("sources are text");
        assert!(text.starts_with("//!"), "{}: begins without saying what it is", file.display());
        let lines = text.lines().count();
        assert!(lines <= LONGEST_FILE, "{}: {lines} lines; split it by noun", file.display());
        let name = file.file_stem().expect("files have names").to_string_lossy().into_owned();
        assert!(
            !["utils", "util", "helpers", "helper", "common", "misc", "manager"].contains(&name.as_str()),
            "{}: a name that says nothing",
            file.display()
        );
    }
}

#[test]
fn nothing_names_a_machine() {
    let mut found = rust_files();
    for (folder, ending) in [("docs", "md"), ("models", "md"), ("models", "fdm"), (".ci", "sh")] {
        files(&root().join(folder), ending, &mut found);
    }
    found.extend(["README.md", "Cargo.toml", ".ci/run"].map(|f| root().join(f)));
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
