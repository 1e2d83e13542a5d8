//! The page of a job: how many tasks are done, who is at work, and files that are not used.

use super::document::{Head, frame};
use super::headline::judgement;
use super::progress::duration;
use super::section::{Section, Trust};
use fdm_results::documents::{JobStatus, ShardStatus};
use maud::{Markup, html};

/// A page of how far a job is; it is made anew by the same command.
pub fn job_page(status: &JobStatus) -> String {
    let mut sections = vec![Section::new("progress", "How far it is", progress(status))];
    if !status.shards.is_empty() {
        sections.push(Section::new("shards", "At work", shards(&status.shards)));
    }
    if !status.damaged.is_empty() {
        let content = html! { ul { @for said in &status.damaged { li { (said) } } } };
        sections.push(Section::new("damaged", "Files that are not used", content));
    }
    let (trust, sentence) = match (status.is_whole(), status.shards.iter().any(|s| s.alive)) {
        (true, _) => (Trust::Good, "Every task is done; fdm job merge makes the result.".to_string()),
        (false, true) => (Trust::Open, "At work.".into()),
        (false, false) => (Trust::Reserved, "Tasks are missing, and nobody is at work on them.".into()),
    };
    let silent = status.shards.iter().filter(|s| !s.alive);
    let said =
        |s: &ShardStatus| format!("Shard {} on {} is silent for {}.", s.told.shard, s.told.host, duration(s.silent));
    let damaged = (!status.damaged.is_empty()).then(|| {
        (format!("{} file(s) are damaged or foreign; their tasks count as missing.", status.damaged.len()), "damaged")
    });
    let points = silent.map(|s| (said(s), "shards")).chain(damaged).collect();
    let verdict = judgement((trust, sentence, points), None, &["shards", "damaged"]);
    frame(&Head { kind: "job", name: &status.folder, doc: None, verdict }, &sections)
}

fn progress(status: &JobStatus) -> Markup {
    html! {
        progress max=(status.tasks) value=(status.done) {}
        p { (status.done) " of " (status.tasks) " tasks are done." }
        @if let Some(left) = status.left { p { "About " (duration(left)) " left at the speed of those at work." } }
        div.scroll { table {
            thead { tr { th scope="col" { "command" } th scope="col" { "task" } th scope="col" { "done" } th scope="col" { "of" } } }
            tbody { @for c in &status.commands { tr {
                th scope="row" { code { (c.command.join(" ")) } }
                td { (c.task) }
                td.number { (c.done) }
                td.number { (c.tasks) }
            } } }
        } }
        p.note { "Plan " code { (status.plan) } ", " (status.files) " file(s) with results." }
    }
}

fn shards(shards: &[ShardStatus]) -> Markup {
    html! {
        div.scroll { table {
            thead { tr {
                @for title in ["shard", "machine", "process", "done", "of", "tasks/s", "at work for", "heard of"] {
                    th scope="col" { (title) }
                }
            } }
            tbody { @for ShardStatus { told, silent, .. } in shards { tr {
                th scope="row" { (told.shard) }
                td { (told.host) }
                td.number { (told.process) }
                td.number { (told.done) }
                td.number { (told.tasks) }
                td.number { (format!("{:.3}", told.rate())) }
                td.number { (duration(told.elapsed)) }
                td.number { (duration(*silent)) " ago" }
            } } }
        } }
    }
}
