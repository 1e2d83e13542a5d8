//! Experiments on models: reference systems ([`experiment`]), Monte Carlo studies and profiles ([`study`]), the next
//! run ([`design`]), and work that many machines share ([`job`]).

pub mod design;
pub mod experiment;
pub mod job;
pub mod study;
