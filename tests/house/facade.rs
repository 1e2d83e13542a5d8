//! The facade: about sixty names, each with an example that runs, and errors that are said; a sample outside of the repository that
//! stays short and needs few packages.

use crate::sources::packages;
use fancy_regex::Regex;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use support::{files, repository};

/// A name that the facade hands on.
struct Exported {
    name: String,
    /// What it is taken from, as written.
    path: String,
    docs: String,
    hidden: bool,
}

fn read(path: impl AsRef<Path>) -> String {
    fs::read_to_string(repository().join(path)).unwrap()
}

/// The statements `pub use ...;` of the facade, name by name.
fn exported() -> Vec<Exported> {
    let text = read("src/lib.rs");
    let statement =
        Regex::new(r"(?m)((?:^(?:///|#\[).*\n)*)^pub use ([\w:]+?)(?:::\{([^}]*)\})?(?: as (\w+))?;").unwrap();
    let mut found = Vec::new();
    for captures in statement.captures_iter(text.as_str()).map(Result::unwrap) {
        let (docs, path) = (captures[1].to_string(), captures[2].to_string());
        let names: Vec<String> = match (captures.get(3), captures.get(4)) {
            (Some(group), _) => {
                group.as_str().split(',').map(|n| n.trim().to_string()).filter(|n| !n.is_empty()).collect()
            }
            (None, Some(other)) => vec![other.as_str().to_string()],
            (None, None) => vec![path.rsplit("::").next().unwrap().to_string()],
        };
        let hidden = docs.contains("#[doc(hidden)]");
        let path = |name: &String| if captures.get(3).is_some() { format!("{path}::{name}") } else { path.clone() };
        found.extend(names.iter().map(|n| Exported { name: n.clone(), path: path(n), docs: docs.clone(), hidden }));
    }
    found
}

/// The folder of the package that a path begins with.
fn package(path: &str) -> (PathBuf, Vec<String>) {
    let mut words = path.split("::");
    let name = words.next().unwrap().trim_start_matches("fdm_").to_string();
    let (_, folder) = packages().into_iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("{path}: no package"));
    (folder, words.map(String::from).collect())
}

/// Whether a path is a package or one of its modules.
fn is_module(path: &str) -> bool {
    let (folder, words) = package(path);
    let place = folder.join(words.iter().collect::<PathBuf>());
    words.is_empty() || place.join("mod.rs").is_file() || place.with_extension("rs").is_file()
}

/// The doc comment of an item and its text up to the body, in its package or where that has it from.
fn definition(path: &str) -> Option<(String, String)> {
    let (folder, words) = package(path);
    let name = words.last()?;
    let pattern = format!(r"(?m)((?:^(?:///|#\[).*\n)*)^pub (?:fn|struct|enum|trait|type) {name}\b([^{{;]*)");
    let item = Regex::new(&pattern).unwrap();
    let others = packages().into_iter().map(|(_, other)| other).filter(|other| *other != folder);
    std::iter::once(folder.clone()).chain(others).find_map(|folder| {
        let below = folder.strip_prefix(repository()).unwrap().to_str().unwrap().to_string();
        files(&below, "rs").iter().find_map(|file| {
            let text = fs::read_to_string(file).unwrap();
            item.captures(text.as_str()).unwrap().map(|c| (c[1].to_string(), c[2].to_string()))
        })
    })
}

/// Whether a doc comment holds a block that is run.
fn runs(docs: &str) -> bool {
    docs.lines().any(|line| line == "/// ```")
}

#[test]
fn every_name_of_the_facade_has_an_example_and_says_its_errors() {
    let names: Vec<Exported> = exported().into_iter().filter(|e| !e.hidden).collect();
    let (modules, items): (Vec<_>, Vec<_>) =
        names.iter().partition(|e| !e.path.starts_with("fdm_macros") && !e.path.contains("::{") && is_module_name(e));
    let mut wrong = Vec::new();
    for item in &items {
        let macros = item.path.starts_with("fdm_macros");
        let own = if macros { None } else { definition(&item.path) };
        let (docs, signature) = own.unwrap_or_default();
        if !macros && docs.is_empty() {
            wrong.push(format!("{}: no definition with a doc comment was found", item.path));
        }
        if !runs(&item.docs) && !runs(&docs) {
            wrong.push(format!("{}: no example", item.name));
        }
        if signature.contains("Result<") && !docs.contains("# Errors") {
            wrong.push(format!("{}: gives a Result and does not say its errors", item.name));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let distinct: BTreeSet<&str> = items.iter().map(|e| e.name.as_str()).collect();
    assert!((55..=75).contains(&distinct.len()), "about sixty names: {}", distinct.len());
    println!("{} names, {} modules", distinct.len(), modules.len());
}

/// A function may have the name of its module; it is the one with an example.
fn is_module_name(e: &Exported) -> bool {
    !runs(&e.docs) && is_module(&e.path)
}

#[test]
fn the_first_page_is_a_guide_that_runs() {
    let guide = read("src/guide.md");
    let fences: Vec<&str> = guide.lines().filter(|l| l.starts_with("```")).collect();
    let opening: Vec<&str> = fences.iter().step_by(2).copied().collect();
    assert!(opening.iter().filter(|l| **l == "```").count() >= 6, "{opening:?}");
    assert!(opening.iter().all(|l| ["```", "```toml"].contains(l)), "a block that is not run: {opening:?}");
    let manifest = read("Cargo.toml");
    let features = manifest.split("[features]").nth(1).unwrap().split("\n[").next().unwrap();
    for feature in features.lines().filter_map(|l| l.split_once(" = ")).map(|(name, _)| name) {
        let told = ["default", "all"].contains(&feature)
            || guide.lines().any(|l| {
                l.starts_with("| `") && l.split('|').nth(1).is_some_and(|cell| cell.contains(&format!("`{feature}`")))
            });
        assert!(told, "the guide does not name the feature `{feature}`");
    }
}

#[test]
fn the_sample_outside_is_short_and_needs_few_packages() {
    let sample = read("examples/outside/main.rs");
    assert!(sample.lines().count() <= 45, "{} lines", sample.lines().count());
    assert!(read("examples/outside/Cargo.toml").contains("default-features = false"));
    let tree = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--locked", "-p", "fdm", "--no-default-features", "-e", "normal,build"])
        .args(["--prefix", "none", "--no-dedupe"])
        .current_dir(repository())
        .output()
        .unwrap();
    assert!(tree.status.success(), "{}", String::from_utf8_lossy(&tree.stderr));
    let text = String::from_utf8(tree.stdout).unwrap();
    // and the sample itself
    let packages = text.lines().collect::<BTreeSet<_>>().len() + 1;
    println!("{packages} packages");
    assert!(packages <= MOST_PACKAGES, "{packages} packages:\n{text}");
}

/// What a program that only writes `model!` and fits may need, itself included.
const MOST_PACKAGES: usize = 90;
