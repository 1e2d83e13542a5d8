//! `fdm --version --verbose`: what is built in, for reports of faults and for messages that name a feature.

use crate::export::unit_library;
use fdm_readers::Format;
use std::env::consts::{ARCH, OS};
use std::ffi::OsString;

/// Whether the words ask for the version at length: no verb, and both options.
pub(crate) fn is_asked(words: &[OsString]) -> bool {
    let options: Vec<&str> = words.iter().skip(1).filter_map(|word| word.to_str()).collect();
    let is = |names: [&str; 2]| options.iter().any(|word| names.contains(word));
    let all = ["--version", "-V", "--verbose", "--quiet", "-q", "--no-project"];
    is(["--version", "-V"]) && options.contains(&"--verbose") && options.iter().all(|word| all.contains(word))
}

/// Version, kind of machine, formats of records and other parts, each whether it is built in.
pub(crate) fn told() -> String {
    let listed = |all: &[(&str, bool)], built: bool| {
        let names: Vec<&str> = all.iter().filter(|(_, is)| *is == built).map(|(name, _)| *name).collect();
        if names.is_empty() { "none".to_string() } else { names.join(", ") }
    };
    let formats: Vec<(&str, bool)> =
        std::iter::once(("text", true)).chain(Format::ALL.map(|f| (f.name(), f.is_read()))).collect();
    let parts = [
        ("machine code (jit)", cfg!(feature = "jit")),
        ("functional mock-up units in models (units)", cfg!(feature = "units")),
        ("figures as PNG (png)", cfg!(feature = "png")),
        ("language server (lsp)", cfg!(feature = "lsp")),
        ("manual pages and completions (manual)", cfg!(feature = "manual")),
    ];
    let library = unit_library().map_or_else(|why| why, |path| path.display().to_string());
    let profile = if cfg!(debug_assertions) { "with checks for debugging" } else { "optimised" };
    format!(
        "fdm {}\nbuilt for: {ARCH}, {OS}, {profile}\nreads: {}\nreads not: {}\nbuilt in: {}\nnot built in: {}\nlibrary of units: {library}\n",
        env!("CARGO_PKG_VERSION"),
        listed(&formats, true),
        listed(&formats, false),
        listed(&parts, true),
        listed(&parts, false),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_both_options_without_a_verb_ask_for_it() {
        let asked = |words: &str| is_asked(&words.split(' ').map(OsString::from).collect::<Vec<_>>());
        assert!(asked("fdm --version --verbose") && asked("fdm --verbose -V"));
        assert!(!asked("fdm --version") && !asked("fdm fit --verbose --version") && !asked("fdm --verbose"));
    }

    #[test]
    fn every_format_is_told_once() {
        let told = told();
        assert!(Format::ALL.iter().all(|f| told.matches(f.name()).count() == 1), "{told}");
        assert_eq!(told.lines().count(), 7);
    }
}
