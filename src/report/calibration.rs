//! A simulation-based calibration: ranks of the truth among draws, a row for each parameter.

use super::overlay::bars;
use super::table::{aligned_right, plain, trimmed};
use fdm_results::documents::calibration::CalibrationDocument;

/// Verdict, then a row for each parameter.
pub fn calibration_text(found: &CalibrationDocument) -> String {
    let verdict = match (found.is_good(), found.done == found.asked) {
        (true, _) => "the ranks are uniform: draws and intervals are what they say",
        (false, false) => "repeats are missing",
        (false, true) => "the ranks are not uniform: draws and intervals are not what they say",
    };
    let mut text = format!(
        "{}: {verdict}\n{} of {} repeats, family-wise p {:.3}, {} divergent trajectories, seed {}\n\n",
        found.model, found.done, found.asked, found.p, found.divergent, found.seed
    );
    let runs = found.parameters.iter().any(|p| p.run.is_some());
    let mut header = vec!["parameter"];
    header.extend(runs.then_some("run"));
    let left = header.len() + 1;
    header.extend(["ranks", "mean rank", "shift", "spread", "p", ""]);
    let mut table = plain(&header);
    for p in &found.parameters {
        let mut row = vec![p.name.clone()];
        row.extend(runs.then(|| p.run.clone().unwrap_or_default()));
        row.extend([
            bars(&p.counts),
            format!("{:.3}", p.mean_rank),
            format!("{:.1}", p.shift),
            format!("{:.1}", p.spread),
            format!("{:.3}", p.p),
            p.said(found.alone()).into(),
        ]);
        table.add_row(row);
    }
    (left..left + 4).for_each(|column| aligned_right(&mut table, column));
    text.push_str(&trimmed(&table));
    text
}
