//! Records in the frequency domain.
//!
//! **In** a [`Run`](crate::record::Run) on an even grid of time. **Out** [`Spectrum`]: transforms of its channels at chosen frequencies and
//! the end values that the transform of a derivative needs. **Never** a model. **Start** at [`Spectrum::of`]: `even_rows` -> `frequencies` ->
//! `transform` (sums over samples) -> `interpolant` (what lies between them).

mod chirp;
mod cross_spectra;
mod cycles;
mod decimation;
mod direct_sum;
mod error;
mod even_rows;
pub(crate) mod fft;
mod frequencies;
mod frequency_response;
mod interpolant;
mod overlap;
#[cfg(test)]
mod response_tests;
mod segments;
#[expect(clippy::module_inception, reason = "the result is called what the room makes")]
mod spectrum;
#[cfg(test)]
mod tests;
mod transform;
mod window;

pub use cross_spectra::CrossSpectra;
pub use error::{ChannelName, SpectrumError};
pub use frequencies::{Comb, Frequencies};
pub use frequency_response::FrequencyResponseEstimate;
pub use interpolant::Interpolant;
pub use overlap::{Overlap, independent};
pub use segments::Segmentation;
pub use spectrum::{Ends, Spectrum, SpectrumOptions};
pub use transform::Transform;
pub use window::Window;
