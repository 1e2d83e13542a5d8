//! What is missing, decided by one number: the log evidence of a written model on all its runs, plus its log prior odds.

mod curve;
mod feedback;
mod noise_course;
mod proposals;
mod random_effect;
mod separating;
mod sets;
mod state;
mod verdict;

pub(crate) use random_effect::log_sum;
pub use verdict::diagnose;
