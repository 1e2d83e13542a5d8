//! A moving system as fdm sees it: the model's text made into code ([`Model`]), records of its runs ([`record`]) with
//! their spectra ([`spectrum`]), responses with exact sensitivities in the time domain ([`simulate`]) and in the
//! frequency domain ([`frequency`]), and its linear form with modes ([`linear`]).
//!
//! Nothing here estimates. Arrows: `dynamics < code, record < spectrum < model < linear < simulate < frequency`.

pub mod code;
pub mod dynamics;
pub mod frequency;
pub mod linear;
pub mod model;
pub mod record;
pub mod simulate;
pub mod spectrum;

pub use model::{Model, ModelError, NotTied, read_source};
