//! A part of the page, and how far a result can be relied on.

use maud::{Markup, html};

/// A part of the page that can be pointed at.
pub(super) struct Section {
    /// The name by which links find it.
    pub(super) anchor: &'static str,
    /// Above it, and in the list of contents.
    pub(super) title: &'static str,
    pub(super) content: Markup,
}

impl Section {
    pub(super) fn new(anchor: &'static str, title: &'static str, content: Markup) -> Self {
        Self { anchor, title, content }
    }
}

/// How far a result can be relied on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Trust {
    Good,
    Reserved,
    Bad,
    /// Nobody knows yet.
    Open,
}

impl Trust {
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Reserved => "reserved",
            Self::Bad => "bad",
            Self::Open => "working",
        }
    }

    pub(super) fn sign(self) -> &'static str {
        match self {
            Self::Good => "✓",
            Self::Reserved => "!",
            Self::Bad => "✗",
            Self::Open => "…",
        }
    }
}

/// How far a result can be relied on, in a sentence, and what speaks against it, each with the section that shows it.
pub(super) type Verdict = (Trust, String, Vec<(String, &'static str)>);

/// What stands between backticks is a name.
pub(super) fn quoted(sentence: &str) -> Markup {
    html! { @for (k, part) in sentence.split('`').enumerate() { @if k % 2 == 1 { code { (part) } } @else { (part) } } }
}
