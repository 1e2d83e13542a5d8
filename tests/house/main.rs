//! The rules of the house that neither Cargo nor Clippy holds. What breaks one today is listed under `exceptions/`; the lists only fall.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stdout, reason = "figures are to be seen")]

mod budget;
mod commands;
mod crates;
mod cycles;
mod exceptions;
mod facade;
mod links;
mod sources;
mod words;
mod writes;
