//! The response of a linear model at the frequencies of a spectrum, with its exact sensitivities by parameters, delays and unknown end
//! values. Start at [`FrequencyResponse`].
//!
//! `wiring` (what drives what) -> `plan` (equations as `expression`s, solved by `elimination` in the order of least fill) ->
//! `program` (instructions on few registers, run over blocks of frequencies in lanes); `dense` where that will not do.
//! End-point terms are in `end_points`.

mod dense;
mod elimination;
#[cfg(test)]
mod end_point_tests;
mod end_points;
mod plan;
mod program;
mod response;
#[cfg(test)]
mod specimen;
#[cfg(test)]
mod tests;
mod wiring;

pub use end_points::{EndColumn, EndPoint, EndTerms};
pub use response::{FrequencyError, FrequencyResponse, Plans};
