//! Experiments on models: reference systems ([`experiment`]), Monte Carlo studies and profiles ([`study`]), the next
//! run ([`design`]), work that many machines share ([`job`]), what a model is used for ([`requirement`]), bands of
//! predictions ([`posterior`]).

pub mod design;
pub mod experiment;
pub mod job;
pub mod posterior;
pub mod requirement;
pub mod study;
