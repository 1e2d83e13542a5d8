//! Faults of a record, judged before it is believed, and the edits that mend them: **in** samples of channels ([`Record`]); **out** [`Finding`]s:
//! channel, place, what, odds, bias of parameters, and the line of a map that repairs it.
//!
//! **Never** changes a record, reads files or prints. **Start** at [`examine_alone`] (one pass over the samples: `time`, `values`,
//! `runs_of_values`, `kinematics`). `edit` and `catalogue` are what may be wrong with channels; `fdm_infer` weighs it beside a model.

mod aliasing;
mod alone;
mod by_kinematics;
mod catalogue;
mod edit;
mod finding;
mod given;
mod independent;
mod information;
mod kinematics;
mod masked;
mod record;
mod repair;
mod repeats;
mod runs_of_values;
mod tail;
#[cfg(test)]
mod tests;
mod time;
mod values;

pub use aliasing::examine as aliased;
pub use alone::{AloneOptions, examine_alone, leading};
pub use by_kinematics::{Sized, Witness};
pub use catalogue::{Estimated, Hypothesis, discrete};
pub use edit::{Channels, Edit, Slot, edited, lag_weights, time_factor};
pub use finding::{Bias, Fault, Finding, Place, Severity, in_order as sort, probability};
pub use information::{Pace, information, pace};
pub use kinematics::{Balance, Kinematics};
pub use masked::mask;
pub use record::{Channel, Record, Role};
pub use repair::{Change, Repair, repaired_map};
pub use repeats::examine_repeats;
pub use tail::Tail;
