//! What a user chooses beside the file of a record.

use fdm_readers::RecordMap;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What the user chose beside the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReadOptions {
    /// Channel and the column that it is read from: title or name, possibly with a unit (`time [ms]`) for a column
    /// that states none; `log(c [mol/l])` is the natural logarithm of its numbers in this unit. The time is the channel `t`.
    pub map: Vec<(String, String)>,
    /// First time to be used, as it stands in the file; a row number from 0 where the file has no time.
    pub from: Option<f64>,
    /// Last time to be used, as it stands in the file.
    pub to: Option<f64>,
    /// The instant that is the model's time 0, as it stands in the file: initial values hold there, `t` and doses count from it. Between it and
    /// the first sample that is used the model is simulated and not compared. The first sample where it is not said, by the map neither.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub begin: Option<f64>,
    /// Use every n-th selected row, beginning with the first.
    pub every: usize,
    /// Inputs that keep their value until the next sample.
    pub hold: Vec<String>,
    /// Inputs that go in straight lines between samples, whatever their samples look like.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub linear: Vec<String>,
    /// Whether every output must have a column with values, in some run at least; otherwise missing ones are all NaN.
    pub require_outputs: bool,
    /// Outputs that are left out: all NaN, whether the file has a column for them or not.
    #[serde(default)]
    pub without: Vec<String>,
    /// Whether numbers are read whose squares are none: what is only simulated needs no squares.
    #[serde(default, skip_serializing)]
    pub any_size: bool,
    /// From which fields of a log, or columns of a table, the channels are read, and how their numbers become theirs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_file: Option<RecordMap>,
    /// Whether what can be read of a damaged log is used.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub salvage: bool,
    /// Samples per second of a record without times, or whose times count rows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate: Option<f64>,
    /// Numbers and texts that stand where nothing was measured; `none` where -999 and the like are measured values.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub missing: Vec<String>,
    /// What values below a limit (`<0.5`, `BLQ`) say.
    #[serde(default, skip_serializing_if = "BelowLimit::is_default")]
    pub below_limit: BelowLimit,
    /// Whether rows of one time are repeats, each a run of its own.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub replicates: bool,
    /// The column that tells the runs of a table apart.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub runs_by: Option<String>,
    /// Which of the runs of the file is meant, from 0; all where it is not said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<usize>,
    /// Values that the run brings (`known T0 per run;`) and its file does not hold.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub known: Vec<Known>,
    /// The group that the run belongs to, by the name of the grouping (`param k per group aircraft;`).
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub groups: BTreeMap<String, String>,
    /// Which samples are compared.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub masks: Vec<Mask>,
}

/// What is made of a value of an output below the limit of quantification.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub enum BelowLimit {
    /// It is less than the limit that stands in its cell, and that is compared (left-censored).
    #[default]
    Censored,
    /// So it is, and this is the limit where none stands in its cell, in the unit of the column.
    Limit(f64),
    /// It is left out as if it were missing.
    Missing,
}

impl BelowLimit {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// A sample of an output of which no more is known than that it lies below a limit: left-censored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Censored {
    /// Name of the run.
    pub run: String,
    /// The output, by its place among those of the model.
    pub output: usize,
    /// When, as a sample of the run has it.
    pub time: f64,
    /// The limit, in the output's unit.
    pub limit: f64,
}

/// A value that a run brings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Known {
    /// Its name in the model.
    pub name: String,
    /// Its unit; that of the model where none is stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// The value.
    pub value: f64,
}

/// A column that says which samples are compared: those where it holds a number that is not 0.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mask {
    /// The output that it is said of; all outputs where none is named.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output: Option<String>,
    /// The column.
    pub column: String,
}

impl ReadOptions {
    /// Where the run begins, by what was chosen or by the map.
    pub fn beginning(&self) -> Option<f64> {
        self.begin.or_else(|| self.map_file.as_ref().and_then(|map| map.time.begin))
    }

    /// The time of the first row that is read: rows between the beginning and the first compared sample still drive the model.
    pub(crate) fn first_read(&self) -> f64 {
        let from = self.from.unwrap_or(f64::NEG_INFINITY);
        self.beginning().map_or(from, |begin| from.min(begin))
    }
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            map: Vec::new(),
            from: None,
            to: None,
            begin: None,
            every: 1,
            hold: Vec::new(),
            linear: Vec::new(),
            require_outputs: true,
            without: Vec::new(),
            any_size: false,
            map_file: None,
            salvage: false,
            rate: None,
            missing: Vec::new(),
            below_limit: BelowLimit::default(),
            replicates: false,
            runs_by: None,
            part: None,
            known: Vec::new(),
            groups: BTreeMap::new(),
            masks: Vec::new(),
        }
    }
}
