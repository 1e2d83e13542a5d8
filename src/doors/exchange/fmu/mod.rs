//! Functional mock-up units of FMI 2.0 and 3.0, for model exchange and co-simulation: written by [`write()`], computed by [`Instance`].
//!
//! A unit holds one prebuilt library, the same for all models: the package `fdm-fmu`, which gives [`Instance`] the functions of the
//! standard. It reads the model's text from `resources/` when an instance is made, and interprets it; no compiler is needed.
//! Source: Functional Mock-up Interface 2.0.4 and 3.0.1, Modelica Association.

mod delays;
mod description;
mod instance;
mod resources;
mod solver;
mod tangent;
#[cfg(test)]
mod tests;
mod variables;

pub(crate) use fdm_units::{DESCRIPTION, unpacked};
pub use fdm_units::{Files, Version};
pub use instance::{Events, Instance, Refused, Snapshot};
pub(crate) use resources::library_path;
pub use resources::{Contents, FmuError, Resources, ResourcesError, write};
pub use variables::{Kind, Variable, Variables};
