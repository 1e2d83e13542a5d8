//! A law that nobody wrote down: a force, the same function of states, inputs and their past in every run.
//!
//! A gust does not repeat, a sensor's noise does not follow the states: what one function explains in all runs is something
//! that the model lacks, whether or not the catalogue has a name for it.
//!
//! **In** a fitted model with its passages. **Out** [`Laws`]: for every place the evidence for such a force. **Never** names
//! the function. **Start** at [`laws`]; `variables` -> `functions` (what a law may be made of) -> `cells` (products of their
//! responses) -> `weighing` (noise and law found together).

mod cells;
mod functions;
#[expect(clippy::module_inception, reason = "the result is called what the room makes")]
mod law;
mod memory;
#[cfg(test)]
mod tests;
mod variables;
mod weighing;

pub(super) use law::laws;
pub use law::{Law, Laws};
