//! Monte-Carlo studies: the same estimation of many records that differ in their noise alone, and whether what is printed beside an
//! estimate holds over them.
//!
//! **In** a fit and its runs, or an experiment; a seed. **Out** a [`Study`]: bias, scatter and coverage of every parameter, each with what chance leaves
//! open after so many repeats. **Never** reads files, prints, or drops a repeat that went wrong. **Start** at [`series`]; `disturbance`
//! (noise) -> `bootstrap` (one [`Repeat`] of a fit) and `system` (of an experiment) -> `series` (all of them, kept and interrupted) -> [`Study`] (all). `profile` is the other
//! way to judge an interval: by refits of the one record.

mod bootstrap;
mod profile;
mod series;
mod system;
#[cfg(test)]
mod tests;

pub use bootstrap::Bootstrap;
pub(crate) use bootstrap::reached;
pub use fdm_results::documents::profile::{End, Point, Profile};
pub use fdm_results::documents::study::{
    Colour, Coverage, Figure, Interval, Kind, Pooled, Repeat, Share, Study, Subject,
};
pub use profile::{Profiler, Side};
pub use series::{FORM, REPEATS, StudyError, series};
pub use system::System;
