//! What a fitted model gets wrong: the misfit, its cause, the model with the cause in it, and the gain.
//!
//! **In** a model with its text, measured runs, a catalogue of effects. **Out** what is wrong and where, the effects that explain it
//! (or the groups of effects that these data cannot tell apart), the extended text, and what it gains on runs that
//! took no part. **Never** reads or writes files, prints, or judges a model by the noise that it made for itself.
//! **Start** at [`search`], whose result is in `diagnosis.rs`; sub-rooms: `screen` (candidates against the residuals, and what
//! noise alone would do), `force` (where something unknown enters), `misfit` (what is wrong before anything is explained),
//! `search` (from the model as it stands to the extended one).

pub mod diagnosis;
pub mod force;
pub mod misfit;
pub mod screen;
pub mod search;
