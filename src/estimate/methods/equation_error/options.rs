//! How an equation is made a regression, and how it is solved.

use fdm_system::spectrum::Frequencies;
use serde::Serialize;

/// Where rates and regressors are compared.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub enum Domain {
    /// At the samples.
    #[default]
    Time,
    /// At these frequencies.
    Frequency(Frequencies),
}

/// Where rates of measured states come from in the time domain.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub enum Smoothing {
    /// The derivative of a polynomial of degree four through so many neighbouring samples (odd, at least 5); nearer to the ends
    /// the same samples serve. States in the regressors stay as measured.
    Local {
        /// Samples in the window.
        points: usize,
    },
    /// A sine series of the record without the line between its ends, its terms weighted by `1/(1 + (f/cutoff)^6)`; regressors
    /// take the smoothed states.
    Fixed {
        /// Where the weight is a half, in cycles per unit of time.
        cutoff: f64,
    },
    /// A sine series with the cut-off of each channel where its own signal sinks into its own noise (Wiener's filter;
    /// Morelli 1995).
    Optimal,
}

impl Default for Smoothing {
    fn default() -> Self {
        Self::Local { points: 9 }
    }
}

/// The trend removed from rates and regressors, run by run, in the time domain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub enum Detrend {
    /// Nothing: constants are the model's own.
    #[default]
    None,
    /// Their mean, which takes out any bias of an equation.
    Mean,
    /// The line that fits best, which takes out biases that drift.
    Line,
}

/// How many principal components make the solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub enum Components {
    /// As many as the data carry (see [`Chosen`](super::Chosen)).
    #[default]
    Auto,
    /// Where R^2 has levelled off and the standard errors are least (Black, Murray-Smith and Padfield 1986), also where columns can be
    /// told apart: errors are smaller, and values are pulled to what the data show best.
    Levelled,
    /// So many, or all when there are fewer.
    Count(usize),
}

/// Everything that can be chosen about a regression.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct RegressionOptions {
    /// Time or frequency.
    pub domain: Domain,
    /// Rates in the time domain.
    pub smoothing: Smoothing,
    /// Trends in the time domain.
    pub detrend: Detrend,
    /// Size of the solution.
    pub components: Components,
}
