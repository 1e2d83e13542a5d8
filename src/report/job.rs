//! How far a job is: its tasks, who is at work, and files that are not used.

use super::section::{Part, Report, Rows, Section, Trust, Verdict};
use crate::progress::duration;
use crate::{html, text};
use fdm_results::documents::{JobStatus, ShardStatus};
use maud::html;

/// Tasks done and missing, the programs at work, and files that are not used.
pub fn job_text(status: &JobStatus) -> String {
    text::sections(&[progress(status), shards(status), missing(status)])
}

/// A page of how far a job is; it is made anew by the same command.
pub fn job_page(status: &JobStatus) -> String {
    let (trust, said) = match (status.is_whole(), status.shards.iter().any(|s| s.alive)) {
        (true, _) => (Trust::Good, "Every task is done; fdm job merge makes the result."),
        (false, true) => (Trust::Open, "At work."),
        (false, false) => (Trust::Reserved, "Tasks are missing, and nobody is at work on them."),
    };
    let silent = status
        .shards
        .iter()
        .filter(|s| !s.alive)
        .map(|s| format!("Shard {} on {} is silent for {}.", s.report.shard, s.report.host, duration(s.silent)));
    let damaged = (!status.damaged.is_empty())
        .then(|| format!("{} file(s) are damaged or foreign; their tasks count as missing.", status.damaged.len()));
    let verdict = Verdict::new(trust, said).with_points(silent, "shards").with_points(damaged, "missing");
    let mut sections = vec![progress(status), shards(status), missing(status)];
    sections.retain(|s| !s.parts.is_empty());
    html::page(&Report { kind: "job".into(), name: status.folder.clone(), doc: None, verdict, sections })
}

fn progress(status: &JobStatus) -> Section {
    let JobStatus { folder, done, tasks, .. } = status;
    let left = status.left.filter(|_| !status.is_whole());
    let left = left.map_or(String::new(), |left| format!(", about {} left", duration(left)));
    let mut table = Rows::over(&status.commands);
    if status.commands.len() > 1 {
        table.label("result", |c| c.name.clone());
    }
    table.sentence("command", |c| format!("`{}`", c.command.join(" "))).on_page();
    table.words("task", |c| c.task.clone()).on_page();
    table.number("tasks done", |c| format!("{} of {}", c.done, c.tasks));
    let table = Part::from(table);
    Section::new("progress", "How far it is")
        .with(Part::Markup(html! { progress max=(tasks) value=(done) {} }))
        .line(format!("{folder}: {done} of {tasks} tasks are done{left}"))
        .with(if status.commands.len() > 1 { table } else { table.on_page() })
        .explained(format!("Plan `{}`, {} file(s) with results.", status.plan, status.files))
}

fn shards(status: &JobStatus) -> Section {
    let mut table = Rows::over(&status.shards);
    table.label("shard", |s| s.report.shard.clone());
    table.words("machine (process)", |s| format!("{} ({})", s.report.host, s.report.process));
    table.number("tasks done", |s| format!("{} of {}", s.report.done, s.report.tasks));
    table.number("tasks/s", |s| format!("{:.3}", s.report.rate()));
    table.number("at work for", |s| duration(s.report.elapsed));
    table.words("", |ShardStatus { silent, alive, .. }| match alive {
        true => "at work".into(),
        false => format!("silent for {}", duration(*silent)),
    });
    Section::new("shards", "At work").with_all((!status.shards.is_empty()).then(|| Part::from(table)))
}

fn missing(status: &JobStatus) -> Section {
    let more = status.tasks.saturating_sub(status.done + status.missing.len() as u64);
    let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
    let missing = (!status.missing.is_empty())
        .then(|| [Part::Gap, Part::Line(format!("missing: {}{rest}", status.missing.join(", ")))]);
    Section::new("missing", "Missing tasks, and files that are not used")
        .with_all(missing.into_iter().flatten())
        .with_all(status.damaged.iter().map(|said| Part::Line(said.clone())))
}
