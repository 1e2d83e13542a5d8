//! Records in the frequency domain: transforms of a run's channels at chosen frequencies, with the end values that the transform of a
//! derivative needs ([`Spectrum`]); averaged spectra, frequency responses and coherence ([`FrequencyResponseEstimate`]).
//!
//! Start at [`Spectrum::of`]: `even_rows` -> `frequencies` -> `transform` (sums over samples) -> what lies between the samples.

mod cross_spectra;
mod decimation;
mod direct_sum;
mod even_rows;
mod frequencies;
mod frequency_response;
mod held_edges;
#[expect(clippy::module_inception, reason = "a spectrum is what the room makes")]
mod spectrum;
#[cfg(test)]
mod tests;
mod transform;

pub use cross_spectra::{CrossSpectra, Overlap, Segmentation, Window, independent};
pub use even_rows::Bridge;
pub use frequencies::{ChannelName, Comb, Frequencies, SpectrumError};
pub use frequency_response::FrequencyResponseEstimate;
pub use spectrum::{Ends, Interpolant, Spectrum, SpectrumOptions};
pub use transform::Transform;
