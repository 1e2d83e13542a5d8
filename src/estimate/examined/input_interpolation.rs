//! What a record says of an input about which nobody said how it goes between samples: held, or in straight lines.

use serde::{Deserialize, Serialize};

/// Likelihood ratio from which a record is said to tell: where the other way is right, chance exceeds it in at most one of a hundred
/// records (`P(L1/L0 > k) <= 1/k`; Royall 2000, J. Am. Stat. Assoc. 95, 760).
const TELLS: f64 = 100.0;

/// An input about which nobody said how it goes between samples, and what the record says.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct InputInterpolation {
    /// Name of the input.
    pub input: String,
    /// Whether it was fitted as held, in some run at least; else in straight lines.
    pub held: bool,
    /// By how much the logarithm of the likelihood (nats) is higher the other way, as far as the colour of the residuals lets it count.
    pub evidence: f64,
    /// By how much the logarithm of the likelihood (nats) is higher the other way if residuals are white noise.
    pub white: f64,
    /// The estimate that would move furthest the other way, in its standard errors; none where no error is known.
    pub moves: Option<EstimateMove>,
    /// How many times the difference between both ways the residuals ask for, where that is significantly more than twice: something else
    /// is late or early too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asked: Option<f64>,
}

/// What an estimate would become.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct EstimateMove {
    /// The parameter.
    pub parameter: String,
    /// The run that it belongs to; none when all runs share it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Its other value.
    pub value: f64,
    /// How far that is from its estimate, in its standard errors (corrected ones where they are known).
    pub standard_errors: f64,
}

impl InputInterpolation {
    /// Whether the record says that it was the other way.
    pub fn is_otherwise(&self) -> bool {
        self.evidence > TELLS.ln()
    }

    /// Whether the record says neither, and it matters: an estimate would move by its standard error or more.
    pub fn is_undecided(&self) -> bool {
        self.evidence.abs() <= TELLS.ln() && self.moves.as_ref().is_some_and(|m| m.standard_errors.abs() >= 1.0)
    }
}
