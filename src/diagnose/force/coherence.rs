//! What a residual hangs together with.

use serde::Serialize;

/// What a residual follows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Partner {
    /// An input.
    Input(String),
    /// A lightly damped mode that an input shakes.
    Mode(String),
}

impl Partner {
    /// The input.
    pub fn input(&self) -> &str {
        match self {
            Self::Input(name) | Self::Mode(name) => name,
        }
    }
}

/// A band in which a residual is not noise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coherence {
    /// The output.
    pub output: String,
    /// What it follows.
    pub partner: Partner,
    /// Lowest frequency of the band, in cycles per unit of time.
    pub low: f64,
    /// Highest.
    pub high: f64,
    /// The share of the residual's power in the band that follows the partner.
    pub share: f64,
    /// The chance of such a share for noise, in this band alone.
    pub chance: f64,
}

impl std::fmt::Display for Coherence {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { output, low, high, share, .. } = self;
        let share = 100.0 * share;
        match &self.partner {
            Partner::Input(name) => {
                write!(
                    f,
                    "{output}: {share:.0} % of what is left between {low:.3} and {high:.3} cycles per unit of time follows the input {name}"
                )
            }
            Partner::Mode(name) => {
                let middle = 0.5 * (low + high);
                write!(
                    f,
                    "{output}: {share:.0} % of what is left around {middle:.3} cycles per unit of time rings with the input {name}, as a lightly damped mode does"
                )
            }
        }
    }
}
