//! What a user chooses beside the file of a record.

use fdm_readers::RecordMap;
use serde::{Deserialize, Serialize};

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
    /// Use every n-th selected row, beginning with the first.
    pub every: usize,
    /// Inputs that keep their value until the next sample.
    pub hold: Vec<String>,
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
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            map: Vec::new(),
            from: None,
            to: None,
            every: 1,
            hold: Vec::new(),
            require_outputs: true,
            without: Vec::new(),
            any_size: false,
            map_file: None,
            salvage: false,
        }
    }
}
