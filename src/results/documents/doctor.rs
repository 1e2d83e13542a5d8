//! What was found in records, and what was assumed about them.

use fdm_doctor::{Finding, Severity};
use fdm_infer::{Examination, Weighed};
use fdm_system::record::Assumptions;
use serde::{Deserialize, Serialize};

/// What a result says of the records that it was made from: what was assumed, and what the quick tests of the doctor found.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct JudgedRecords {
    /// The records about which something was assumed.
    pub assumed: Vec<Assumptions>,
    /// Findings and remarks, in their order.
    pub findings: Vec<Finding>,
}

impl JudgedRecords {
    /// None where nothing was assumed or found.
    pub fn unless_empty(self) -> Option<Self> {
        (!self.assumed.is_empty() || !self.findings.is_empty()).then_some(self)
    }

    /// What should be known before the numbers are used, each in a sentence.
    pub fn warnings(&self) -> impl Iterator<Item = String> {
        let findings = self.findings.iter().filter(|f| f.severity == Severity::Finding);
        findings.map(|f| {
            format!("record `{}`: `{}`: {}: {} ({})", f.run, f.channels.join("`, `"), f.fault, f.what, f.sureness())
        })
    }
}

/// The result of `fdm doctor`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DoctorDocument {
    /// The model's name; null where the records were judged by themselves.
    pub model: Option<String>,
    /// The records, with all that was assumed about them.
    pub records: Vec<Assumptions>,
    /// Findings and remarks, findings first, the surest first.
    pub findings: Vec<Finding>,
    /// What was weighed beside the model for the first fault, the likeliest first, no fault among it; empty without a model.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub weighed: Vec<Weighed>,
    /// Fits that were made.
    pub fits: usize,
    /// What could not be looked at, and why.
    pub notes: Vec<String>,
}

impl DoctorDocument {
    /// Of records that were judged, beside a model of this name if there is one.
    pub fn of(model: Option<&str>, records: Vec<Assumptions>, found: &Examination) -> Self {
        let (findings, notes, weighed) = (found.findings.clone(), found.notes.clone(), found.weighed.clone());
        Self { model: model.map(String::from), records, findings, weighed, fits: found.fits, notes }
    }

    /// Whether anything but remarks was found.
    pub fn is_clean(&self) -> bool {
        self.findings.iter().all(|f| f.severity == Severity::Remark)
    }
}
