//! What is missing, decided by one number: the log evidence of a written model on all its runs, plus its log prior odds.

mod bands;
mod binning;
mod evidence;
mod factor;
mod gram;
mod noise;
mod prior;
mod proposals;
mod random_effect;
mod screen;
mod search;
mod state;
mod verdict;

pub(super) use verdict::diagnose;
