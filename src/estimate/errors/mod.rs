//! What is known about the estimates: covariance, errors, what the data do not determine.
//!
//! **In** the quadratic and the residuals at the end of an iteration. **Out** standard errors (Cramer-Rao, and corrected for the
//! colour of the residuals), statuses, directions in words. **Never** changes an estimate, but for what the
//! noise of records in the equations has drawn. **Start** at [`statistics`].

mod averaged;
#[cfg(test)]
mod belief;
mod beliefs;
mod carried;
pub(super) mod coloured;
pub(super) mod coloured_rows;
pub(super) mod coloured_spectra;
#[cfg(test)]
mod coloured_tests;
mod combination;
pub(super) mod conclusion;
pub(super) mod derived;
pub(super) mod direction;
mod forgetful;
mod freedom;
pub(super) mod known_noise;
mod mixture;
pub(super) mod noise_colour;
mod noise_power;
mod restricted;
mod row_map;
pub(super) mod sandwich;
mod short_runs;
mod spectral_rows;
pub(super) mod statistics;
mod undone;
mod weighing;
