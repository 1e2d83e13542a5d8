//! Measured data: reading files into runs.
//!
//! **In** CSV files, the channels that a model asks for. **Out** [`Run`]s in the model's units; errors that name
//! file, row and column. **Never** simulates or judges the model. **Start** at [`Run`].

mod run;

pub use run::Run;
