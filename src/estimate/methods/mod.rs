//! The methods of estimation, each with its options, fit and error, and the one door to all of them.
//!
//! **In** a model, runs, options. **Out** what the method finds. **Start** at [`identify`]; which options have a part in which method is
//! said in [`combinations`].

pub(crate) mod combinations;
pub mod equation_error;
pub(crate) mod filter_error;
pub(crate) mod identify;
pub(crate) mod output_error;
pub(crate) mod responses;
pub(crate) mod spectra;
pub(crate) mod time_domain;
