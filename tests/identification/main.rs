//! Estimates and diagnoses through the library: known truths found again, errors that hold, both domains alike.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stdout, reason = "figures are to be seen")]

mod best_kept;
mod blocks;
mod both_domains;
mod campaigns;
mod carried;
mod certified;
mod combinations;
mod delays;
mod events;
mod examples;
mod few_frequencies;
mod filter_error;
mod flight_path;
mod hidden_effects;
mod identified_delays;
mod intervals;
mod kinetics;
mod library;
mod likelihoods;
mod linear_models;
mod measured_inputs;
mod modes;
mod nonlinear_spectra;
mod posterior;
mod records;
mod recovery;
mod recursive;
mod reference_papers;
mod sensitivities;
mod spectra_partials;
mod steps;
mod stiff;
mod strategies;
mod surfaces;
mod tables;
mod trex550;
mod undetermined;
mod units;
mod verdicts;
