//! Ways to the estimates when a fit from the given start values fails, and ways to see how far they can be trusted.
//!
//! **In** a model, runs, and where a single fit ended. **Out** better ends, estimates by length and by weights.
//! **Never** hides what was tried. **Start** at [`fallback`].

pub(super) mod confidence;
pub(super) mod continuation;
pub(super) mod fallback;
#[cfg(test)]
mod limit_tests;
pub(crate) mod multi_start;
mod screening;
pub(crate) mod segmented_response;
mod shooting;
