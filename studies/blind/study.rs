//! Runs the cases of a plan: resumable, on several threads, one line of results for each.

use crate::answer;
use crate::case::Case;
use crate::plan::{Plan, Spec, number};
use crate::scorer::{Outcome, score};
use std::collections::BTreeSet;
use std::fs::OpenOptions;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Where cases and results are: FDM_BLIND_DIR, or a folder in target.
pub(crate) fn folder() -> PathBuf {
    let built_in = support::repository().join("target/blind");
    std::env::var_os("FDM_BLIND_DIR").map_or(built_in, PathBuf::from)
}

/// The lines of earlier runs.
pub(crate) fn results(folder: &Path) -> Vec<Outcome> {
    let text = std::fs::read_to_string(folder.join("results.jsonl")).unwrap_or_default();
    // a line that a killed run did not finish is made again
    text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}

/// Asks the tool about a case, and scores its answer.
pub(crate) fn run(case: &Case, folder: &Path, limit: Duration) -> Outcome {
    let folder = folder.join(case.spec.name());
    case.write(&folder);
    let (answer, seconds) = answer::ask(&folder, limit);
    score(case, &answer, seconds)
}

/// All cases of the plan that have no result yet.
pub(crate) fn study(plan: &Plan) -> Vec<Outcome> {
    let folder = folder();
    std::fs::create_dir_all(&folder).expect("a folder that can be made");
    let finished: BTreeSet<String> = results(&folder).into_iter().map(|o| o.case).collect();
    let specs: Vec<Spec> = plan.specs().into_iter().filter(|s| !finished.contains(&s.name())).collect();
    println!("{}: {} cases to run, {} finished", folder.display(), specs.len(), finished.len());
    let mut options = OpenOptions::new();
    let file =
        options.create(true).append(true).open(folder.join("results.jsonl")).expect("a file that can be written");
    let (file, next, begun) = (Mutex::new(file), AtomicUsize::new(0), Instant::now());
    let limit = Duration::from_secs(number("FDM_BLIND_TIMEOUT", 300) as u64);
    let until = Duration::from_secs(60 * number("FDM_BLIND_MINUTES", 100_000) as u64);
    std::thread::scope(|scope| {
        for _ in 0..number("FDM_BLIND_THREADS", 2).max(1) {
            scope.spawn(|| {
                while let Some(spec) = specs.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if begun.elapsed() > until {
                        break;
                    }
                    let Ok(outcome) = catch_unwind(AssertUnwindSafe(|| run(&Case::new(*spec), &folder, limit))) else {
                        println!("{}: could not be made", spec.name());
                        continue;
                    };
                    let line = serde_json::to_string(&outcome).expect("words and numbers");
                    let mut file = file.lock().expect("no thread panicked with the file");
                    writeln!(file, "{line}").expect("a file that can be written");
                    println!("{}", told(&outcome, next.load(Ordering::Relaxed).min(specs.len()), specs.len()));
                    drop(file);
                    tidy(&folder.join(&outcome.case), &outcome);
                }
            });
        }
    });
    results(&folder)
}

/// A line of progress.
fn told(o: &Outcome, at: usize, of: usize) -> String {
    let good = match o.hides.as_str() {
        "nothing" => o.p >= 0.05 && o.failure.is_none(),
        "gust" => o.verdict == "disturbance" && o.place,
        "outside" => o.warned,
        _ => o.grouped,
    };
    let mark = if good { ' ' } else { '!' };
    let said = o.failure.clone().unwrap_or_else(|| format!("{} p {:.3} {}", o.verdict, o.p, o.named.join(", ")));
    format!("{mark} {at}/{of} {} [{}] gain {:.0}: {said} ({:.1} s)", o.case, o.truth.join(", "), o.gain, o.seconds)
}

/// Folders of cases that went well are not kept, unless FDM_BLIND_KEEP=1.
fn tidy(folder: &Path, o: &Outcome) {
    let keep = std::env::var("FDM_BLIND_KEEP").is_ok_and(|v| v == "1");
    let well = match o.hides.as_str() {
        "nothing" => o.p >= 0.05 && o.failure.is_none(),
        "effect" | "loop" => o.top && o.only,
        "pair" => o.grouped && o.only,
        "gust" => o.verdict == "disturbance" && o.place,
        _ => o.warned && o.place_in_two,
    };
    if well && !keep {
        // what is left behind costs room only
        let _ = std::fs::remove_dir_all(folder);
    }
}
