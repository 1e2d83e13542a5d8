//! Find the mathematical model of a moving vehicle or a chemical reaction from measured data.

pub mod dynamics;
pub mod record;
pub mod report;
