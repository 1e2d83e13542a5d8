//! The stiff integrator: three-stage Radau IIA on the generated Jacobian, with the exact sensitivities of the discrete equations.
//!
//! **In** a step, its drive at the stages and the states at its beginning. **Out** the states at its end and their derivatives by
//! the parameters, or that no solution was found. **Never** chooses steps by itself while a fit runs: they are chosen
//! once and kept (`../control.rs`). **Start** at `collocation.rs`; `tangent.rs` has the sensitivities.
//!
//! Libraries for stiff systems control their error from step to step and differentiate the continuous equations: what they give is not the
//! derivative of what they return, and a correction that is to converge needs exactly that.

mod collocation;
mod lu;
#[cfg(test)]
mod published;
mod sensitivity;
mod tableau;
mod tangent;
#[cfg(test)]
mod tests;

pub(super) use collocation::{Collocation, Interval, Past};
pub(super) use sensitivity::ImplicitSensitivity;
pub(super) use tableau::NODES;
