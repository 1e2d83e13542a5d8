//! What is found in a record.

use crate::repair::Repair;
use serde::{Deserialize, Serialize};
use std::fmt;

/// The kind of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// A number that stands for "no value", such as -9999.
    Sentinel,
    /// Samples without a value.
    Missing,
    /// Single samples far from their neighbours.
    Spikes,
    /// One value for much longer than chance allows.
    Stuck,
    /// Values that pile up at the least or greatest.
    Clipped,
    /// Steps of a quantiser that are coarse beside the signal.
    Quantised,
    /// A sensor that is read more often than it measures.
    HeldSamples,
    /// Whole rows that stand in the record twice.
    DoubledRows,
    /// A pause in the record, or missing samples.
    Gap,
    /// Intervals that are not even where the clock is.
    UnevenTime,
    /// Time in another unit.
    TimeUnit,
    /// An angle that jumps back at the end of its range.
    Wrapped,
    /// Another unit than the one stated or assumed.
    Unit,
    /// The opposite sign.
    Sign,
    /// Two channels in each other's place.
    Swapped,
    /// Axes in another order or with other signs.
    Axes,
    /// A channel that is stamped too late or too early.
    Delay,
    /// A delay that grows with time.
    Drift,
    /// An input that keeps its value between samples, or goes in straight lines, where the other was assumed.
    Hold,
    /// A state that does not begin where the model says.
    Beginning,
    /// A constant that is added.
    Offset,
    /// A constant that is added from some time on.
    ZeroShift,
    /// A factor that is no unit's.
    Scale,
    /// A channel that is filtered where others are not.
    Filtered,
    /// A line of the spectrum that samples this far apart may have folded.
    Aliased,
    /// An input that never changes.
    Constant,
    /// Samples of one run that stand in another one too.
    Repeated,
    /// Inputs that move together.
    CorrelatedInputs,
    /// Samples that are too far apart for the model.
    SlowSampling,
    /// Parameters that the record does not determine.
    NotDetermined,
}

impl Fault {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Sentinel => "sentinel values",
            Self::Missing => "missing values",
            Self::Spikes => "spikes",
            Self::Stuck => "stuck sensor",
            Self::Clipped => "saturation",
            Self::Quantised => "coarse quantisation",
            Self::HeldSamples => "held samples",
            Self::DoubledRows => "doubled rows",
            Self::Gap => "dropout",
            Self::UnevenTime => "jitter of the time stamps",
            Self::TimeUnit => "unit of time",
            Self::Wrapped => "wrapped angle",
            Self::Unit => "unit",
            Self::Sign => "sign",
            Self::Swapped => "swapped channels",
            Self::Axes => "axes",
            Self::Delay => "delay",
            Self::Drift => "clock drift",
            Self::Hold => "hold of the input",
            Self::Beginning => "initial value",
            Self::Offset => "offset",
            Self::ZeroShift => "shift of zero",
            Self::Scale => "scale factor",
            Self::Filtered => "filtered channel",
            Self::Aliased => "aliasing",
            Self::Constant => "constant input",
            Self::Repeated => "same record twice",
            Self::CorrelatedInputs => "correlated inputs",
            Self::SlowSampling => "sampling interval",
            Self::NotDetermined => "no excitation",
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.words())
    }
}

/// How a finding is to be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// A fault: with `--strict` nothing goes on.
    Finding,
    /// True and worth knowing, and no fault by itself.
    Remark,
}

/// Where in the record.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// Time of the first sample concerned, in the record's unit of time.
    pub from: f64,
    /// Time of the last.
    pub to: f64,
    /// Samples concerned.
    pub samples: usize,
}

/// What a fault does to a parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bias {
    /// The parameter.
    pub parameter: String,
    /// Value without the repair minus value with it, in standard errors of the repaired fit.
    pub standard_errors: f64,
}

/// One finding.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// The run.
    pub run: String,
    /// The channels; `t` is the time.
    pub channels: Vec<String>,
    /// What it is.
    pub fault: Fault,
    /// Finding or remark.
    pub severity: Severity,
    /// Where, when it is not everywhere.
    pub place: Option<Place>,
    /// In a sentence.
    pub what: String,
    /// Natural logarithm of the odds that it is so. From a p value by the bound of Sellke, Bayarri and Berger (2001), `1/(-e p ln p)`; beside
    /// a model from the likelihood, less the logarithm of the number of hypotheses.
    pub log_odds: f64,
    /// What it does to parameters, the largest first; empty where that is not known.
    pub biases: Vec<Bias>,
    /// What mends it.
    pub repair: Option<Repair>,
    /// The samples of the channel that are not to be believed.
    #[serde(skip)]
    pub samples: Vec<usize>,
}

impl Finding {
    /// A finding about one channel, with the odds of a family-wise p value.
    pub fn by_chance(run: &str, channel: &str, fault: Fault, p: f64, what: String) -> Self {
        Self {
            run: run.into(),
            channels: vec![channel.into()],
            fault,
            severity: Severity::Finding,
            place: None,
            what,
            log_odds: log_odds_of(p),
            biases: Vec::new(),
            repair: None,
            samples: Vec::new(),
        }
    }

    /// At single samples, which are not to be believed.
    pub(crate) fn at_samples(mut self, time: &[f64], samples: Vec<usize>) -> Self {
        if let (Some(first), Some(last)) = (samples.first(), samples.last()) {
            self = self.at(time[*first], time[*last], samples.len());
        }
        self.samples = samples;
        self
    }

    /// At these times.
    #[must_use]
    pub fn at(mut self, from: f64, to: f64, samples: usize) -> Self {
        self.place = Some(Place { from, to, samples });
        self
    }

    /// Mended so.
    #[must_use]
    pub fn repaired_by(mut self, repair: Repair) -> Self {
        self.repair = Some(repair);
        self
    }

    /// As a remark.
    #[must_use]
    pub fn remark(mut self) -> Self {
        self.severity = Severity::Remark;
        self
    }

    /// How sure it is, in words.
    pub fn sureness(&self) -> String {
        format!("probability {}", probability(1.0 / (1.0 + (-self.log_odds).exp())))
    }
}

/// A probability as people read it, in two digits: no search over a list of causes makes one surer than that.
pub fn probability(p: f64) -> String {
    match p {
        p if p > 0.995 => "above 0.99".into(),
        p if p < 0.005 => "below 0.01".into(),
        p => format!("{p:.2}"),
    }
}

/// Logarithm of the largest odds against chance that a p value gives (Sellke, Bayarri and Berger 2001); 0 for p above 1/e.
pub(crate) fn log_odds_of(p: f64) -> f64 {
    let p = p.max(1e-300);
    if p >= (-1f64).exp() { 0.0 } else { -1.0 - p.ln() - (-p.ln()).ln() }
}

/// In the order in which they are told: findings before remarks, the surest first; what is equally sure in the order of the record.
pub fn in_order(findings: &mut [Finding]) {
    findings.sort_by(|a, b| a.severity.cmp(&b.severity).then(b.log_odds.total_cmp(&a.log_odds)));
}
