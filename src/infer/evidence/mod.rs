//! The log evidence of a linearised model: band Grams of its residual and columns, under the noise of each output, a mixture of spectra.

pub(crate) mod bands;
pub(crate) mod binning;
pub(crate) mod climb;
pub(crate) mod decimation;
mod factor;
pub(crate) mod gram;
pub(crate) mod noise;
pub(crate) mod parts;
pub(crate) mod prior;
pub(crate) mod question;
pub(crate) mod screen;
