//! Links and paths in the docs lead somewhere.

use crate::exceptions::Found;
use fancy_regex::Regex;
use std::fs;
use std::path::{Path, PathBuf};
use support::{files, repository};

fn pages() -> Vec<PathBuf> {
    let mut pages: Vec<PathBuf> =
        ["docs", "models", "editors", "studies"].iter().flat_map(|folder| files(folder, "md")).collect();
    pages.retain(|p| !p.iter().any(|part| part == "node_modules" || part == "target"));
    pages.extend(["README.md", "CONTRIBUTING.md", "CHANGELOG.md"].map(|f| repository().join(f)));
    pages.retain(|p| p.is_file());
    pages
}

fn name(path: &Path) -> String {
    path.strip_prefix(repository()).unwrap().display().to_string()
}

/// The text without fenced blocks, in which brackets mean something else.
fn prose(text: &str) -> String {
    let mut open = false;
    let kept = text.lines().filter(|line| {
        let fence = line.trim_start().starts_with("```");
        open ^= fence;
        !open && !fence
    });
    kept.map(|line| format!("{line}\n")).collect()
}

/// The names by which headings of a page are linked to.
fn headings(text: &str) -> Vec<String> {
    let title = |line: &str| {
        let title = line.trim_start_matches('#').trim().to_lowercase();
        let kept = title.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect()
    };
    prose(text).lines().filter(|line| line.starts_with('#')).map(title).collect()
}

#[test]
fn links_lead_somewhere() {
    let link = Regex::new(r"\]\(([^)\s]+)\)").unwrap();
    let mut found = Found::default();
    for page in pages() {
        let text = fs::read_to_string(&page).unwrap();
        let text_without_code = Regex::new(r"`[^`\n]*`").unwrap().replace_all(&prose(&text), "``").into_owned();
        for target in link.captures_iter(text_without_code.as_str()).map(|c| c.unwrap()[1].to_string()) {
            if target.contains("://") || target.starts_with("mailto:") {
                continue;
            }
            let (path, heading) = target.split_once('#').unwrap_or((&target, ""));
            let file = if path.is_empty() { page.clone() } else { page.parent().unwrap().join(path) };
            let there = file.exists();
            let told = |text: String| heading.is_empty() || headings(&text).iter().any(|h| h == heading);
            if !there || file.is_file() && !fs::read_to_string(&file).map_or(heading.is_empty(), told) {
                found.add(&name(&page), target.clone());
            }
        }
    }
    found.held_to("links", "Links in the docs lead to files and headings that are there.");
}

#[test]
fn paths_name_files_that_are_there() {
    let path =
        Regex::new(r"`((?:tests|studies|src|docs|models|grammar|macros|benches|examples|fuzz|editors)/[\w./-]*[\w/])`")
            .unwrap();
    let mut found = Found::default();
    // what was tried may be gone
    for page in pages().into_iter().filter(|p| !p.starts_with(repository().join("docs/notebook"))) {
        let text = fs::read_to_string(&page).unwrap();
        for file in path.captures_iter(text.as_str()).map(|c| c.unwrap()[1].to_string()) {
            if !repository().join(&file).exists() {
                found.add(&name(&page), file);
            }
        }
    }
    found.held_to("paths", "Paths in the docs name files that are there.");
}
