//! The stiff integrator: three-stage Radau IIA on the generated Jacobian, with the exact sensitivities of the discrete equations.
//!
//! Libraries for stiff systems control their error from step to step and differentiate the continuous equations: what they give is not the
//! derivative of what they return, and a Gauss-Newton iteration that is to converge needs exactly that.

mod collocation;
mod sensitivity;
#[cfg(test)]
mod tests;

pub(super) use collocation::{Collocation, Past};
pub(super) use sensitivity::StiffSensitivity;
