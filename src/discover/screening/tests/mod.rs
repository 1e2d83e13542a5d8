//! What the screening says of noise alone, and of effects that are there.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod colour;
mod family;
mod screened;
mod studies;
