//! Files are written by the store, which lets them appear whole; nothing else in the product writes any.

use crate::exceptions::Found;
use crate::sources::{packages, product};
use fancy_regex::Regex;
use std::path::Path;

#[test]
fn nothing_but_the_store_writes_files() {
    let writes = r"\bfs::(?:write|rename|copy|hard_link|remove_\w+|create_dir\w*)\b|\bFile::create|\bOpenOptions\b|\bFile::options\b|\bNamedTempFile\b|\btempdir";
    let writes = Regex::new(writes).unwrap();
    let mut found = Found::default();
    let store = Path::new("store");
    for (name, folder) in packages() {
        for (path, text) in product(&folder).into_iter().filter(|(p, _)| !(name == "results" && p.starts_with(store))) {
            for _ in writes.find_iter(&text) {
                found.add(&name, path.display().to_string());
            }
        }
    }
    found.held_to("writes", "Nothing but the store writes files.");
}
