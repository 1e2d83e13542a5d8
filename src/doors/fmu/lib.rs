//! The library inside a functional mock-up unit: [`Instance`](fdm_exchange::fmu::Instance) behind the C functions of FMI 2.0 and 3.0.
//!
//! **In** pointers that a simulator hands over, as the standard describes them. **Out** status codes and, through the simulator's logger, why
//! something came to nothing. **Never** a computation of its own.
//! Source: `fmi2FunctionTypes.h` and `fmi3FunctionTypes.h` of the Modelica Association.

#![allow(unsafe_code, reason = "the functions of the standard take pointers")]
#![allow(non_snake_case, reason = "their names are those of the standard")]

mod fmi2;
mod fmi3;
mod unit;

pub use fmi2::*;
pub use fmi3::*;
