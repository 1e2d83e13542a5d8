//! One parameter over all repeats: bias, scatter, and how often its intervals hold the truth, each with what chance leaves open.

use super::binomial::Share;
use super::repeat::{Figure, Subject};
use serde::Serialize;

/// Standard deviations of chance on both sides of a mean.
pub(super) const NOMINAL: f64 = 1.959_963_984_540_054;

/// Kinds of standard errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// The bound of Cramer and Rao.
    CramerRao,
    /// Corrected for the colour of the residuals.
    Corrected,
}

/// What the errors of one kind are worth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Interval {
    /// Which.
    pub kind: Kind,
    /// Root mean square of the printed errors.
    pub error: f64,
    /// Scatter of the estimates over that error.
    pub ratio: f64,
    /// Nominal 95 % intervals that hold the truth, of those repeats that converged and have an interval.
    pub coverage: Share,
    /// The same of all repeats: one without an interval does not hold the truth.
    pub of_all: Share,
}

/// One parameter over all repeats.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coverage {
    /// Which.
    #[serde(flatten)]
    pub subject: Subject,
    /// Repeats that converged.
    pub repeats: usize,
    /// Mean of their estimates.
    pub mean: f64,
    /// Mean minus truth, in printed errors (the corrected ones where there are any).
    pub bias: f64,
    /// What chance alone gives to the bias in 95 % of cases: plus or minus this.
    pub bias_chance: f64,
    /// Standard deviation of the estimates.
    pub scatter: f64,
    /// By kind of errors; a kind that was never printed is missing.
    pub intervals: Vec<Interval>,
}

impl Coverage {
    /// Of the figures of all repeats.
    pub(super) fn of(subject: &Subject, figures: &[Figure]) -> Self {
        let values: Vec<f64> = figures.iter().map(|f| f.value).filter(|v| v.is_finite()).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let scatter = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        let intervals: Vec<Interval> = [Kind::CramerRao, Kind::Corrected]
            .into_iter()
            .enumerate()
            .filter_map(|(k, kind)| Interval::of(kind, k, subject.truth, figures, scatter))
            .collect();
        let error = intervals.last().map_or(f64::NAN, |i| i.error);
        Self {
            subject: subject.clone(),
            repeats: values.len(),
            mean,
            bias: (mean - subject.truth) / error,
            bias_chance: NOMINAL * scatter / n.sqrt() / error,
            scatter,
            intervals,
        }
    }

    /// What the errors of this kind are worth.
    pub fn interval(&self, kind: Kind) -> Option<&Interval> {
        self.intervals.iter().find(|i| i.kind == kind)
    }

    /// The errors to be trusted: corrected where there are any.
    pub fn trusted(&self) -> Option<&Interval> {
        self.intervals.last()
    }

    /// Whether there is more bias than chance explains.
    pub fn is_biased(&self) -> bool {
        self.bias.abs() > self.bias_chance
    }
}

impl Interval {
    fn of(kind: Kind, k: usize, truth: f64, figures: &[Figure], scatter: f64) -> Option<Self> {
        let errors: Vec<f64> = figures.iter().map(|f| f.errors[k]).filter(|e| e.is_finite()).collect();
        if errors.is_empty() {
            return None;
        }
        let error = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
        let hits = figures.iter().filter(|f| f.holds(k, truth)).count();
        let (coverage, of_all) = (Share::new(hits, errors.len()), Share::new(hits, figures.len()));
        Some(Self { kind, error, ratio: scatter / error, coverage, of_all })
    }
}

impl Figure {
    /// Whether the nominal interval by errors of a kind holds a value.
    pub(super) fn holds(&self, kind: usize, truth: f64) -> bool {
        (self.value - truth).abs() <= self.factors[kind] * self.errors[kind]
    }
}
