//! The command `fdm` as a user runs it: every verb, files good and hostile, processes that are killed.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stdout, reason = "figures are to be seen")]

mod beginnings;
mod campaigns;
mod checkpoint;
mod combinations;
mod daveml;
mod design;
mod diagnose;
mod doors;
mod exchange;
mod first_steps;
mod held_inputs;
mod hostile;
mod imports;
mod jobs;
mod json;
mod laboratories;
mod limits;
mod live;
mod lsp;
mod missing;
mod refused_diagnoses;
mod refused_spectra;
mod reproduce;
mod results;
mod study;
mod subjects;
mod suites;
mod terminal;
mod uncertainty;
mod undetermined;
mod unexplained;
mod writing;
