//! Work that is cut into independent tasks, so that many machines can do it: the starts of a fit, the repeats of a study, the sides of
//! profiles, whole fits of many runs or models.
//!
//! **In** a command that was cut ([`Tasks`]), a [`Shard`] that says which part is wanted. **Out** one result for each task, as bytes
//! ([`work_off`]); [`Kind::kept`] gives them the form in which the command itself looks for what it has done before. The command then ends by
//! the same code, and with the same bits, as on one machine. **Never** schedules: engines do that. **Start** at [`Tasks`].

mod plan;
mod tasks;

pub use plan::{Plan, PlanError, PlannedCommand, Shard, ShardError};
pub use tasks::{Kind, Memory, Repeats, Sides, Starts, Tasks, work_off};
