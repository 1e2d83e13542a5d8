//! A package with a cycle of three files, for the scanner.

mod a;
mod b;
mod d;
mod room;

pub use a::Alpha;
