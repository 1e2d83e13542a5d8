//! A text of the language in an editor: its mistakes, what stands at a place, what can be typed there. `fdm lsp` says it in its protocol,
//! `fdm studio` to its page.

pub(crate) mod completion;
pub(crate) mod document;
pub(crate) mod hover;
