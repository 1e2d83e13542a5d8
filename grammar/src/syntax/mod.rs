//! Text to syntax tree.
//!
//! **In** a [`crate::Source`]. **Out** a [`SyntaxTree`], exactly as written. **Never** meaning: names are not looked up.
//! **Start** at [`parse`] in `recover.rs`: `scan.rs` makes tokens, `outline.rs` finds the statements in them, `parse.rs`,
//! the only file that sees the grammar's rules, reads each statement, `slips.rs` says what cannot be read,
//! `expected.rs` and `hints.rs` what should stand there and what was meant; `print.rs` leads back to text, `mathml.rs` to typeset mathematics. Effects are read
//! from texts of their own, by [`parse_effects`] in `catalogue.rs`.

mod catalogue;
mod effects;
mod expected;
mod expression;
mod extent;
mod hints;
mod mathml;
mod outline;
mod parse;
mod print;
mod print_effect;
mod recover;
mod scan;
mod slips;
mod spans;
mod tree;
mod words;

pub use catalogue::parse_effects;
pub use effects::*;
pub use extent::value_extent;
pub use mathml::{Typesetter, typeset_name};
pub use print::Printer;
pub use print_effect::print_effect;
pub use recover::{parse, parse_recovering, parse_used};
pub use scan::{Kind as TokenKind, Token, holds_effects, tokens};
pub use tree::*;
pub use words::{WORDS, WordUse, word_use, words_for};

#[cfg(test)]
mod tests;
