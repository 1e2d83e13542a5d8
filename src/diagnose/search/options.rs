//! What a user may choose about a search.

use super::domain::Domain;
use crate::diagnose::screen::ScreeningOptions;
use crate::estimate::FitOptions;

/// How to search.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchOptions {
    /// An effect is looked for as long as the chance that noise makes the best one is below this.
    pub alpha: f64,
    /// Most effects that are accepted.
    pub most: usize,
    /// How the model as it stands is fitted.
    pub fit: FitOptions,
    /// How candidates are screened.
    pub screening: ScreeningOptions,
    /// Where models are compared with records.
    pub domain: Domain,
}

impl Default for SearchOptions {
    fn default() -> Self {
        Self {
            alpha: 0.01,
            most: 4,
            fit: FitOptions::default(),
            screening: ScreeningOptions::default(),
            domain: Domain::Time,
        }
    }
}

/// Hears what is being done.
pub type Watcher<'w> = dyn Fn(&str) + Sync + 'w;
