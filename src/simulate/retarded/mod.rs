//! States seen delayed, in equations and in outputs: retarded functional differential equations.
//!
//! **In** a model's step, as the integrator takes it. **Out** the dense past ([`History`]), the delayed states' part in the
//! drive of a step ([`Retarded`]), and the sensitivities of the whole ([`RetardedSensitivity`]). **Never** Padé, never
//! steps that follow a delay. **Start** at [`Retarded`].
//!
//! A delayed state enters a step as a delayed input does: by three stage values that have the moments of the true signal
//! over the step (see `../moments.rs`). The past is piecewise cubic, so its moments are exact; they are smooth in the delay whether or not a
//! window's ends meet nodes, and so is the response. A delay shorter than the step sees the step that is being
//! taken: its own cubic is found by Newton's method, and its sensitivities by the same linear equations.

mod hermite;
mod history;
mod lag;
mod lu;
mod sensitivity;
mod step;

pub(super) use history::History;
pub(super) use sensitivity::RetardedSensitivity;
pub(super) use step::Retarded;
