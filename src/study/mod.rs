//! Monte-Carlo studies: the same estimation of many records that differ in their noise alone, and whether what is printed beside an
//! estimate holds over them.
//!
//! **In** a fit and its runs, or an experiment; a seed. **Out** a [`Study`]: bias, scatter and coverage of every parameter, each with what chance leaves
//! open after so many repeats. **Never** reads files, prints, or drops a repeat that went wrong. **Start** at [`series`]; `disturbance`
//! (noise) -> `bootstrap` (one [`Repeat`] of a fit) and `system` (of an experiment) -> `series` (all of them, kept and interrupted) -> `coverage` (a parameter) -> `study` (all). `profile` is the other
//! way to judge an interval: by refits of the one record.

mod binomial;
mod bootstrap;
mod coverage;
mod disturbance;
mod profile;
#[cfg(test)]
mod profile_tests;
mod repeat;
mod series;
#[expect(clippy::module_inception, reason = "the result is called what the room makes")]
mod study;
mod study_error;
mod system;
#[cfg(test)]
mod tests;

pub use binomial::Share;
pub use bootstrap::Bootstrap;
pub use coverage::{Coverage, Interval, Kind};
pub use disturbance::Colour;
pub use profile::{End, Point, Profile, Profiler};
pub use repeat::{Figure, Repeat, Subject};
pub use series::{Watch, series};
pub use study::{Pooled, Study};
pub use study_error::StudyError;
pub use system::System;
