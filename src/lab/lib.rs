//! Experiments on models: reference systems ([`experiment`]), Monte Carlo studies and profiles ([`study`]), the next
//! run ([`design`]).

pub mod design;
pub mod experiment;
pub mod study;
