//! The width of what is printed.

use std::io;
use terminal_size::{Width, terminal_size_of};

/// Columns where there is no terminal, so that files hold the same whoever writes them.
const WITHOUT_TERMINAL: usize = 100;
/// Fewer columns than these hold no table.
const LEAST: usize = 40;

/// Where something is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stream {
    /// Standard output.
    Out,
    /// Standard error.
    Error,
}

/// Columns of a stream: what `COLUMNS` says, else those of the terminal, else 100.
pub fn width(stream: Stream) -> usize {
    let said = || std::env::var("COLUMNS").ok()?.trim().parse::<usize>().ok().filter(|columns| *columns > 0);
    let seen = || match stream {
        Stream::Out => terminal_size_of(io::stdout()),
        Stream::Error => terminal_size_of(io::stderr()),
    };
    let columns = said().or_else(|| seen().map(|(Width(columns), _)| usize::from(columns)));
    columns.unwrap_or(WITHOUT_TERMINAL).max(LEAST)
}
