//! The application layer, once: what the command line, Python, jobs and experiments ask for, and what comes of it.
//!
//! **In** the words of a verb as its options, a model with runs as a [`Session`] (from files or from memory), and how the work is done as a [`Conduct`]
//! (shown, stopped, kept). **Out** an [`Answer`]: text, JSON, files, and whether all is well; or a [`Failure`]. **Never** prints a result: remarks
//! about what is read go to standard error unless the work is quiet.
//! **Start** at [`fit::answer`]: one file a verb, each with its options and what it makes of a session. [`request`] is the door for programs that hold
//! model and runs in memory.

pub mod answer;
pub mod bands;
pub mod campaign;
mod censored;
pub mod check;
pub mod checkpoint;
pub mod conduct;
mod delays;
pub mod design;
pub mod diagnose;
pub mod doctor;
pub mod effects;
pub mod failure;
mod first_cause;
pub mod fit;
pub mod foreign_code;
pub mod from_record;
pub mod halt;
pub mod load;
pub mod margins;
pub mod methods;
pub mod modes;
mod noise;
pub mod options;
pub mod outcome;
pub mod profile;
pub mod progress;
pub mod progress_file;
pub mod records;
pub mod regress;
pub mod request;
pub mod sample;
mod session;
pub mod simulate;
pub mod spectra;
pub mod study;
pub mod tables;
pub mod telling;
pub mod terminal;
pub mod validate;
pub mod value;
pub mod verb;
mod word;

pub use answer::{Answer, NamedFile, Wanted};
pub use conduct::Conduct;
pub use failure::Failure;
pub use session::{Origin, Record, Session, Source};
pub use verb::Verb;
