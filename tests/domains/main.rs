//! Diagnoses in the time and in the frequency domain: on linear systems they name the same causes with the same sizes and gains.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stdout, reason = "figures of studies")]

#[path = "../noise/mod.rs"]
mod noise;
mod refusals;
mod studies;
mod systems;
mod verdicts;
