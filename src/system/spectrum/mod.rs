//! Records in the frequency domain: transforms of a run's channels at chosen frequencies, with the end values that the transform of a
//! derivative needs ([`Spectrum`]); averaged spectra, frequency responses and coherence ([`FrequencyResponseEstimate`]).
//!
//! Start at [`Spectrum::of`]: `even_rows` -> `frequencies` -> `transform` (sums over samples) -> what lies between the samples.

mod bridged;
mod cross_spectra;
mod decimation;
mod direct_sum;
mod error;
mod even_rows;
mod frequencies;
mod frequency_response;
mod held_edges;
mod overlap;
mod segments;
#[expect(clippy::module_inception, reason = "a spectrum is what the room makes")]
mod spectrum;
#[cfg(test)]
mod tests;
mod transform;

pub use bridged::Bridge;
pub use cross_spectra::CrossSpectra;
pub use error::{ChannelName, SpectrumError};
pub use frequencies::{Comb, Frequencies};
pub use frequency_response::FrequencyResponseEstimate;
pub use overlap::{Overlap, independent};
pub use segments::Segmentation;
pub use segments::Window;
pub use spectrum::Interpolant;
pub use spectrum::{Ends, Spectrum, SpectrumOptions};
pub use transform::Transform;
