//! The fdm language as a tree-sitter grammar, generated from `grammar.js` when this package is built.

use tree_sitter_language::LanguageFn;

#[allow(unsafe_code, reason = "the generated parser is C")]
mod generated {
    use super::LanguageFn;

    unsafe extern "C" {
        fn tree_sitter_fdm() -> *const ();
    }

    // SAFETY: the generated function has this signature and returns a constant.
    pub(super) const LANGUAGE: LanguageFn = unsafe { LanguageFn::from_raw(tree_sitter_fdm) };
}

/// The grammar, for `tree_sitter::Parser::set_language`.
pub const LANGUAGE: LanguageFn = generated::LANGUAGE;

/// What editors colour, as a query.
pub const HIGHLIGHTS: &str = include_str!("queries/highlights.scm");
