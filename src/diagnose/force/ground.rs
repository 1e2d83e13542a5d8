//! What all questions to residuals begin with: their lines, and the noise that would explain them alone.

use super::likelihood::{Settled, settle};
use super::mixing::Mixing;
use super::place::{ForceError, Passage};
use super::sheet::{Sheet, band, sheets};
use super::spectra::Spectra;
use super::spectrum::PRICE;

/// Lines and noise.
pub(super) struct Ground {
    /// Outputs as they were measured, with noise alone.
    pub(super) sheets: Vec<Sheet>,
    pub(super) noise: Settled,
    /// The same for combinations of outputs that have independent noises, where those of the outputs are not.
    turned: Option<(Vec<Sheet>, Settled)>,
    /// What turning adds to a log-likelihood, and what it costs.
    volume: f64,
    /// The frequency below which nearly all that the fitted parameters can change lies.
    pub(super) band: f64,
}

impl Ground {
    pub(super) fn new(passages: &[Passage<'_>], outputs: usize) -> Result<Self, ForceError> {
        let sheets = sheets(passages, outputs)?;
        let band = band(passages, &sheets, outputs);
        let noise = settle(&sheets, None, &Spectra::floor(&sheets));
        let mixings = Mixing::of(&sheets, &noise.spectra);
        let mut volume = 0.0;
        let turned = mixings.map(|mixings| {
            let cost = mixings.first().map_or(0.0, |m| PRICE * m.size() as f64);
            volume = -mixings.iter().map(Mixing::log_volume).sum::<f64>() - cost;
            let turned: Vec<Sheet> = sheets.iter().zip(mixings).map(|(sheet, m)| sheet.turned(m)).collect();
            let noise = settle(&turned, None, &Spectra::floor(&turned));
            (turned, noise)
        });
        Ok(Self { sheets, noise, turned, volume, band })
    }

    /// Lines whose noises are independent, and noise alone.
    pub(super) fn independent(&self) -> (&[Sheet], &Settled) {
        self.turned.as_ref().map_or((&self.sheets, &self.noise), |(sheets, noise)| (sheets, noise))
    }

    /// A log-likelihood of independent lines as one of the lines that were measured.
    pub(super) fn measured(&self, log_likelihood: f64) -> f64 {
        log_likelihood + self.volume
    }
}
