//! Studies: minutes to hours each, in release; `README.md` has their commands.
#![allow(clippy::unwrap_used, reason = "a study that cannot go on fails")]
#![allow(clippy::print_stdout, reason = "studies print their figures")]

mod bars;
mod causes;
mod checkpoint;
mod coloured;
mod delays;
mod domains;
mod filter_error;
mod goodman;
mod hovering;
mod kills;
mod margins;
mod miniature;
mod nonlinear;
mod papers;
mod petab;
mod stiff;
mod trex550;
