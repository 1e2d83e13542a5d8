//! A model for other tools, and what became of it there.
//!
//! **In** a [`Model`](fdm_system::Model) with the values of its parameters. **Out** functional mock-up units ([`fmu`]), stand-alone
//! source ([`stamp`]), estimators for a vehicle in flight ([`recursive`]), systems of JSBSim ([`jsbsim`]), tables ([`daveml`]), linear
//! models ([`state_space`]), and what a given file computes beside what the model does ([`verify`]). Every file carries the [`Stamp`] of the model that it was made from.
//! **Never** a fit, and nothing of a result folder. **Start** at [`fmu::write`] and [`verify::Artefact`].

pub mod daveml;
pub mod fmu;
pub mod jsbsim;
pub mod recursive;
pub mod stamp;
pub mod state_space;
pub mod verify;
mod xml;

pub use stamp::Stamp;
