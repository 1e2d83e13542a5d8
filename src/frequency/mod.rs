//! The response of a linear model at the frequencies of a spectrum, with its exact sensitivities.
//!
//! **In** a [`Structure`](crate::linear::Structure) with its [`Values`](crate::linear::Values), and the inputs of a
//! [`Spectrum`](crate::spectrum::Spectrum). **Out** outputs and their derivatives by parameters, delays and unknown end values,
//! or a [`FrequencyError`]. **Never** compares with measured outputs: that is `estimate`. **Start** at [`FrequencyResponse`]:
//!
//! `wiring` (what drives what) -> `plan` (equations as `expression`s, solved by `elimination` in the `order` of least fill) ->
//! `program` (instructions on few registers) -> `execution` (blocks of frequencies in lanes); `dense` where that will not do.
//! End terms are in `ends`, those of delayed inputs in `delayed_input`.

mod delayed_input;
mod dense;
mod elimination;
mod ends;
#[cfg(test)]
mod ends_tests;
mod error;
mod execution;
mod expression;
mod leaves;
mod order;
mod plan;
mod program;
mod ready;
mod reduction;
mod response;
mod scalar;
#[cfg(test)]
mod specimen;
#[cfg(test)]
mod tests;
mod wiring;

pub use ends::{EndColumn, EndPoint, EndTerms};
pub use error::FrequencyError;
pub use response::{FrequencyResponse, Plans};
