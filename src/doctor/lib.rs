//! Faults of a record, judged before it is believed: **in** samples of channels ([`Record`]) and, where there is one, a model with its runs;
//! **out** [`Finding`]s: channel, place, what, odds, bias of parameters, and the line of a map that repairs it.
//!
//! **Never** changes a record, reads files or prints. **Start** at [`examine_alone`] (one pass over the samples: `time`, `values`,
//! `runs_of_values`, `kinematics`) and [`examine_beside`] (hypotheses fitted beside the model and beside kinematics: `hypothesis`, `kinematics`, `likelihood`, `linearised`, `filtered`, `spectrum`, `search`, `beside`).

mod aliasing;
mod alone;
mod beside;
mod biases;
mod far_delays;
mod filtered;
mod finding;
mod first_cause;
mod given;
mod hypothesis;
mod information;
mod kinematics;
mod likelihood;
mod linearised;
mod record;
mod repair;
mod repeats;
mod runs_of_values;
mod search;
mod spectrum;
mod tail;
#[cfg(test)]
mod tests;
mod time;
mod values;

pub use alone::{AloneOptions, examine_alone, leading};
pub use beside::{BesideOptions, Examination, examine_beside};
pub use finding::{Bias, Fault, Finding, Place, Severity, in_order as sort};
pub use first_cause::first_cause;
pub use record::{Channel, Record, Role};
pub use repair::{Change, Repair, repaired_map};
pub use repeats::examine_repeats;
