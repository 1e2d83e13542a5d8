//! No import cycle of more than three files inside a package.

use crate::exceptions::Found;
use crate::sources::{packages, product};
use fancy_regex::Regex;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Files that import each other in a circle are one file in pieces; three are the most.
const MOST: usize = 3;

type Name = Vec<String>;

/// The modules of a package that are files, with their texts, and what their `pub use` lines hand on.
struct Package {
    texts: BTreeMap<Name, String>,
    /// Module and name, to the module that the name comes from.
    handed: BTreeMap<(Name, String), Name>,
}

fn words(path: &str) -> Name {
    path.split("::").filter(|w| !w.is_empty()).map(str::to_string).collect()
}

/// A path as it is written in a module, from the root of the package.
fn from_root(module: &Name, written: &str) -> Name {
    let mut at = module.clone();
    let mut words = words(written).into_iter().peekable();
    if words.next_if(|w| w == "crate").is_some() {
        at.clear();
    }
    while let Some(word) = words.next_if(|w| w == "self" || w == "super") {
        if word == "super" {
            at.pop();
        }
    }
    at.extend(words);
    at
}

impl Package {
    fn read(folder: &Path) -> Self {
        let handing = Regex::new(r"pub(?:\([^)]*\))? use ([\w:]+)(?:::\{([^}]*)\})?;").unwrap();
        let (mut texts, mut handed) = (BTreeMap::new(), BTreeMap::new());
        for (path, text) in product(folder) {
            let file = path.file_stem().unwrap().to_string_lossy().into_owned();
            let mut module: Name = path.parent().unwrap().iter().map(|p| p.to_string_lossy().into_owned()).collect();
            let root = ["mod", "lib", "main"].contains(&file.as_str());
            if !root {
                module.push(file);
            }
            for found in handing.captures_iter(text.as_str()).map(Result::unwrap) {
                let mut path = words(&found[1]);
                let names = match found.get(2) {
                    Some(group) => group.as_str().to_string(),
                    None => path.pop().unwrap_or_default(),
                };
                let from = from_root(&module, &path.join("::"));
                for name in names.split(',').map(|n| n.trim().rsplit(" as ").next().unwrap().to_string()) {
                    handed.insert((module.clone(), name), from.clone());
                }
            }
            // what a folder hands on it does not use
            let text = if root { handing.replace_all(&text, "").into_owned() } else { text };
            texts.insert(module, text);
        }
        Self { texts, handed }
    }

    /// The file that a path leads to, and the rest of the path.
    fn file(&self, path: &Name) -> Option<(Name, Name)> {
        let length = (0..=path.len()).rev().find(|n| self.texts.contains_key(&path[..*n]))?;
        Some((path[..length].to_vec(), path[length..].to_vec()))
    }

    /// The same behind names that are handed on.
    fn origin(&self, path: &Name, depth: usize) -> Option<Name> {
        let (file, rest) = self.file(path)?;
        let Some(name) = rest.first().filter(|_| depth < 6) else { return Some(file) };
        let Some(from) = self.handed.get(&(file.clone(), name.clone())) else { return Some(file) };
        let mut next = from.clone();
        if self.file(from).is_some_and(|(other, _)| other != file) {
            next.push(name.clone());
        }
        self.origin(&next, depth + 1)
    }

    fn imports(&self) -> BTreeMap<Name, BTreeSet<Name>> {
        let path = Regex::new(r"\b((?:crate|self|super)(?:::(?:\w+|\{[^;{}]*(?:\{[^{}]*\}[^{}]*)*\}))+)").unwrap();
        let group = Regex::new(r"(?s)^([\w:]+?)::\{(.*)\}$").unwrap();
        let mut imports = BTreeMap::new();
        for (module, text) in &self.texts {
            let mut used = BTreeSet::new();
            for found in path.find_iter(text).map(|m| m.unwrap().as_str()) {
                let written: Vec<String> = match group.captures(found).unwrap() {
                    Some(parts) => {
                        let items = parts[2].split(',').map(str::trim).filter(|item| !item.is_empty());
                        let head = |item: &str| {
                            item.split(|c: char| c.is_whitespace() || c == '{').next().unwrap().to_string()
                        };
                        items.map(|item| format!("{}::{}", &parts[1], head(item))).collect()
                    }
                    None => vec![found.to_string()],
                };
                used.extend(written.iter().filter_map(|w| self.origin(&from_root(module, w), 0)));
            }
            used.remove(module);
            imports.insert(module.clone(), used);
        }
        imports
    }

    /// Files that reach each other, the largest circles first.
    fn cycles(&self) -> Vec<Vec<String>> {
        let imports = self.imports();
        let reached: BTreeMap<&Name, BTreeSet<&Name>> = imports
            .keys()
            .map(|from| {
                let (mut seen, mut open) = (BTreeSet::new(), vec![from]);
                while let Some(next) = open.pop() {
                    open.extend(imports[next].iter().filter(|to| seen.insert(*to)));
                }
                (from, seen)
            })
            .collect();
        let circle =
            |file: &Name| reached[file].iter().filter(|other| reached[**other].contains(file)).copied().collect();
        let circles: BTreeSet<BTreeSet<&Name>> = imports.keys().map(circle).collect();
        let name = |file: &&Name| if file.is_empty() { "lib".to_string() } else { file.join("/") };
        let mut circles: Vec<Vec<String>> = circles.iter().map(|c| c.iter().map(name).collect()).collect();
        circles.sort_by_key(|c| std::cmp::Reverse(c.len()));
        circles
    }
}

/// The circles of a package that are larger than may be.
pub(crate) fn large(folder: &Path) -> Vec<Vec<String>> {
    Package::read(folder).cycles().into_iter().filter(|c| c.len() > MOST).collect()
}

#[test]
fn files_do_not_import_each_other_in_large_circles() {
    let mut found = Found::default();
    for (name, folder) in packages() {
        for (k, files) in large(&folder).into_iter().enumerate() {
            for file in files {
                found.add(&format!("{name}, cycle {}", k + 1), file);
            }
        }
    }
    found.held_to("cycles", "No import cycle of more than three files inside a package.");
}

#[test]
fn the_scanner_sees_what_it_should() {
    let folder = support::repository().join("tests/house/specimen_of_cycles");
    let cycles = Package::read(&folder).cycles();
    assert_eq!(cycles.iter().find(|c| c.len() > 1).unwrap(), &["a", "b", "room/c"], "{cycles:?}");
}
