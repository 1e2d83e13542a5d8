//! What `model!` names of the facade, in its place.

pub use fdm_macros::model;

/// In the place of a model.
#[derive(Debug)]
pub struct Model;
