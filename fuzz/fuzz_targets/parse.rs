//! Any text: read without harm, and what was read is written and read again the same.
#![no_main]

use fdm_grammar::Source;
use fdm_grammar::syntax::{Printer, parse, parse_recovering};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let source = Source::new("fuzz.fdm", text);
    let (tree, findings) = parse_recovering(&source);
    fdm_fuzz::look_at(&source, &findings);
    assert!(tree.is_some() || !findings.is_empty());
    let Some(tree) = tree.filter(|_| findings.is_empty()) else { return };
    let written = Printer::new(&tree).model();
    let again = Source::new("again.fdm", written.clone());
    let tree = parse(&again).unwrap_or_else(|f| panic!("{written}: {f:?}"));
    assert_eq!(Printer::new(&tree).model(), written);
});
