//! What is wrong with a fitted model before anything is explained: which output, which band, how large, when, at which amplitudes.
//!
//! **In** a fitted model, its runs, residuals. **Out** a [`Misfit`] for every output, with sentences. **Never** names a
//! cause, simulates or fits. **Start** at [`misfit()`]; `bands` (by frequency), `moments` (by time and by amplitude), `gain` (gain
//! and phase against the model), `sentences`.

mod bands;
mod gain;
#[expect(clippy::module_inception, reason = "the result is called what the room makes")]
mod misfit;
mod moments;
mod sentences;
mod spectral;
#[cfg(test)]
mod tests;

pub use bands::Band;
pub use gain::Gain;
pub use misfit::{Left, Misfit, misfit};
pub use moments::{AmplitudeBin, Window};
pub use spectral::{SpectralPassage, misfit_of_lines};
