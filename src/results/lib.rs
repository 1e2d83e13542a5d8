//! Results: what they are ([`documents`]), on disk ([`store`]) and beside each other ([`comparison`]).

pub mod comparison;
pub mod documents;
pub mod store;
