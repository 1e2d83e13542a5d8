//! Records in the frequency domain.
//!
//! **In** a [`Run`](crate::record::Run) on an even grid of time. **Out** [`Spectrum`]: transforms of its channels at chosen frequencies and
//! the end values that the transform of a derivative needs. **Never** a model. **Start** at [`Spectrum`].

mod spectrum;

pub use spectrum::Spectrum;
