//! Records in the frequency domain.
//!
//! **In** a [`Run`](crate::record::Run) on an even grid of time. **Out** [`Spectrum`]: transforms of its channels at chosen frequencies and
//! the end values that the transform of a derivative needs. **Never** a model. **Start** at [`Spectrum::of`]: `even_rows` -> `frequencies` ->
//! `transform` (sums over samples) -> `interpolant` (what lies between them).

mod cycles;
mod direct_sum;
mod error;
mod even_rows;
mod fft;
mod frequencies;
mod interpolant;
mod spectrum;
#[cfg(test)]
mod tests;
mod transform;

pub use error::{ChannelName, SpectrumError};
pub use frequencies::{Comb, Frequencies};
pub use interpolant::Interpolant;
pub use spectrum::{Ends, Spectrum, SpectrumOptions};
pub use transform::Transform;
