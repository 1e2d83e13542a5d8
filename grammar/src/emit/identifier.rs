//! Names and doc strings of users as identifiers, strings and comments of other languages.

use std::collections::BTreeSet;

/// A name of ASCII letters, digits and `_` that begins with a letter: other characters become `_`.
pub(super) fn plain(name: &str) -> String {
    let mut plain: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    while plain.len() > 1 && plain.ends_with('_') {
        plain.pop();
    }
    if !plain.starts_with(|c: char| c.is_ascii_alphabetic()) {
        plain.insert(0, 'm');
    }
    plain
}

/// Names that differ in what [`plain`] drops get a number behind them; in capitals when asked for.
pub(super) fn distinct<'a>(names: impl IntoIterator<Item = &'a str>, capitals: bool) -> Vec<String> {
    let mut taken: BTreeSet<String> = BTreeSet::new();
    let one = |name: &str| {
        let name = if capitals { plain(name).to_uppercase() } else { plain(name) };
        let numbered = (2..).map(|k| format!("{name}_{k}"));
        let free = std::iter::once(name.clone()).chain(numbered).find(|n| !taken.contains(n)).unwrap_or(name);
        taken.insert(free.clone());
        free
    };
    names.into_iter().map(one).collect()
}

/// Text inside a C comment or behind `//`: one line, and nothing that opens or ends a comment.
pub(super) fn comment(text: &str) -> String {
    let line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    line.replace("*/", "* /").replace("/*", "/ *")
}

/// A C string: ASCII, everything else as octal bytes of UTF-8; no trigraphs.
pub(super) fn c_string(text: &str) -> String {
    let byte = |b: u8| match b {
        b'"' | b'\\' | b'?' => format!("\\{}", b as char),
        b' '..=b'~' => (b as char).to_string(),
        other => format!("\\{other:03o}"),
    };
    format!("\"{}\"", text.bytes().map(byte).collect::<String>())
}

/// A Rust string.
pub(super) fn rust_string(text: &str) -> String {
    format!("{text:?}")
}
