//! Text to syntax tree.
//!
//! **In** a [`crate::Source`]. **Out** a [`SyntaxTree`], exactly as written. **Never** meaning: names are not looked up.
//! **Start** at [`parse`] in `recover.rs`: `scan.rs` makes tokens, `outline.rs` finds the statements in them, `parse.rs`,
//! the only file that sees the grammar's rules, reads each statement, `slips.rs` says what cannot be read,
//! `expected.rs` what should stand there and what was meant; `print.rs` leads back to text, `mathml.rs` to typeset mathematics. Effects are read
//! from texts of their own, by [`parse_effects`] in `catalogue.rs`.

mod catalogue;
mod expected;
mod expression;
mod mathml;
mod outline;
mod parse;
mod print;
mod recover;
mod scan;
mod slips;
mod spans;
mod tree;

pub use catalogue::{parse_effects, *};
pub use mathml::{Typesetter, typeset_name};
pub use print::{Printer, print_effect};
pub use recover::{parse, parse_recovering, parse_used};
pub use scan::{Kind as TokenKind, Token, WORDS, WordUse, holds_effects, tokens, word_use, words_for};
pub use spans::value_extent;
pub use tree::*;

#[cfg(test)]
mod tests;
