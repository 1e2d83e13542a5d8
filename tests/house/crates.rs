//! One file for each family of foreign crates that do one thing, and no results without a type.

use crate::exceptions::Found;
use crate::sources::{packages, product};
use fancy_regex::Regex;
use std::path::Path;

/// What is done, and the crates that do it.
const FAMILIES: [(&str, &str); 7] = [
    ("transforms", "rustfft|realfft|rustdct"),
    ("random numbers", "rand|rand_chacha|sobol_burley"),
    ("distributions", "statrs"),
    ("elementary functions", "libm"),
    ("lanes", "pulp"),
    ("pixels", "resvg"),
    ("drawing in a terminal", "textplots"),
];

#[test]
fn one_file_names_a_family_of_crates() {
    let mut found = Found::default();
    let sources: Vec<_> = packages().iter().map(|(_, folder)| (folder.clone(), product(folder))).collect();
    for (family, crates) in FAMILIES {
        let named = Regex::new(&format!(r"\b(?:{crates})::")).unwrap();
        let naming = sources.iter().flat_map(|(folder, sources)| {
            let those = sources.iter().filter(|(_, text)| named.is_match(text).unwrap());
            those.map(|(path, _)| folder.join(path).strip_prefix(support::repository()).unwrap().display().to_string())
        });
        let places: Vec<String> = naming.collect();
        // the first is the one that may
        if places.len() > 1 {
            places.into_iter().for_each(|place| found.add(family, place));
        }
    }
    found.held_to("crates", "One file for each family of foreign crates.");
}

/// Where values of any shape are what is worked on: requests of an editor, files of others.
fn free(package: &str, path: &Path) -> bool {
    path.starts_with("language_server") || package == "readers" && path == Path::new("json.rs")
}

#[test]
fn results_have_types() {
    let untyped = Regex::new(r"\bjson!|serde_json::(?:\{[^}]*)?\bValue\b").unwrap();
    let mut found = Found::default();
    for (name, folder) in packages().into_iter().filter(|(name, _)| name != "results") {
        for (path, text) in product(&folder).into_iter().filter(|(path, _)| !free(&name, path)) {
            for _ in untyped.find_iter(&text) {
                found.add(&name, path.display().to_string());
            }
        }
    }
    found.held_to(
        "json",
        "No `json!` and no `serde_json::Value` outside results, the editors' server and the reader of JSON.",
    );
}
