//! Text to syntax tree.
//!
//! **In** a [`crate::Source`]. **Out** a [`SyntaxTree`], exactly as written. **Never** meaning: names are not looked up.
//! **Start** at [`parse`]; `parse.rs` is the only file that sees the grammar's rules.

mod parse;
mod tree;

pub use parse::parse;
pub use tree::*;
