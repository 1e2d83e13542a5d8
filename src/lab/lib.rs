//! Experiments on models: reference systems ([`experiment`]), Monte Carlo studies and profiles ([`study`]), the next
//! run ([`design`]), what a model is used for ([`requirement`]), bands of predictions ([`posterior`]).

pub mod design;
pub mod experiment;
pub mod posterior;
pub mod requirement;
pub mod study;
