//! What a fit says of itself, beyond its numbers: what it was made from, and what makes it doubtful.
//!
//! **In** a fit and its runs. **Out** inputs whose way between samples the record tells ([`interpolation`]), stated initial values that
//! it contradicts ([`stated_initials`]), motions with few samples and outputs that are not explained ([`unexplained`]).

pub(crate) mod doubted_initials;
pub(crate) mod input_interpolation;
pub(crate) mod interpolation;
pub(crate) mod stated_initials;
pub(crate) mod unexplained;
