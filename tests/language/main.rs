//! The language: what is accepted, refused with which words, laid out, derived, generated; the macro; the effects.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stdout, reason = "figures are to be seen")]

mod bad;
mod effects;
mod format;
mod generated_code;
mod macro_same_bits;
mod macro_use;
mod reference;
mod textmate;
mod vectors;
