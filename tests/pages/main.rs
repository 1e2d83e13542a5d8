//! The page of a result: what it holds, and what it does in a browser.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stdout, reason = "figures are to be seen")]

mod browser;
mod dots;
#[cfg(unix)]
mod kinds;
mod pictures;
mod pixels;
mod report;
mod studio;
mod window;
