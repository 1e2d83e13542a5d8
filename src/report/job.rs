//! How far a job is, as a table.

use crate::page::duration;
use crate::table::{aligned_right, plain, trimmed};
use fdm_results::documents::{JobStatus, ShardStatus};

/// Tasks done and missing, the programs at work, and files that are not used.
pub fn job_text(status: &JobStatus) -> String {
    let JobStatus { done, tasks, .. } = status;
    let mut text = format!("{}: {done} of {tasks} tasks are done", status.folder);
    match status.left {
        Some(left) if !status.is_whole() => text.push_str(&format!(", about {} left\n", duration(left))),
        _ => text.push('\n'),
    }
    if status.commands.len() > 1 {
        let mut table = plain(&["result", "tasks done"]);
        aligned_right(&mut table, 1);
        status.commands.iter().for_each(|c| _ = table.add_row([c.name.clone(), format!("{} of {}", c.done, c.tasks)]));
        text.push_str(&format!("\n{}", trimmed(&table)));
    }
    if !status.shards.is_empty() {
        let mut table = plain(&["shard", "machine (process)", "tasks done", "tasks/s", "at work for", ""]);
        (2..5).for_each(|column| aligned_right(&mut table, column));
        for ShardStatus { told, silent, alive } in &status.shards {
            table.add_row([
                told.shard.clone(),
                format!("{} ({})", told.host, told.process),
                format!("{} of {}", told.done, told.tasks),
                format!("{:.3}", told.rate()),
                duration(told.elapsed),
                if *alive { "at work".into() } else { format!("silent for {}", duration(*silent)) },
            ]);
        }
        text.push_str(&format!("\n{}", trimmed(&table)));
    }
    if !status.missing.is_empty() {
        let more = status.tasks - status.done - status.missing.len() as u64;
        let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
        text.push_str(&format!("\nmissing: {}{rest}\n", status.missing.join(", ")));
    }
    status.damaged.iter().for_each(|d| text.push_str(&format!("{d}\n")));
    text
}
