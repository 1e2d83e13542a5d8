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
    let mut table = plain(&["parameter", "run", "ranks", "mean rank", "shift", "spread", "p", ""]);
    for p in &found.parameters {
        table.add_row([
            p.name.clone(),
            p.run.clone().unwrap_or_default(),
            bars(&p.counts),
            format!("{:.3}", p.mean_rank),
            format!("{:.1}", p.shift),
            format!("{:.1}", p.spread),
            format!("{:.3}", p.p),
            p.said(found.alone()).into(),
        ]);
    }
    (3..7).for_each(|column| aligned_right(&mut table, column));
    text.push_str(&trimmed(&table));
    text
}
