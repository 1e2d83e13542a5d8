//! States seen delayed, in equations and in outputs: delay differential equations.
//!
//! A delayed state enters a step as a delayed input does: by three stage values that have the moments of the true signal
//! over the step (`../delayed_inputs.rs`). The past is piecewise cubic, so its moments are exact; they are smooth in the delay whether or
//! not a window's ends meet nodes, and so is the response. A delay shorter than the step sees the step that is being taken: its own
//! cubic is found by Newton's method, and its sensitivities by the same linear equations. No Padé approximation, no steps that follow
//! a delay.

mod history;
mod step;

pub(super) use history::History;
pub(super) use step::{DelayedSensitivity, DelayedStates};
