//! The iteration, correction by correction.

use super::table::{aligned_right, digits, plain, trimmed};
use crate::estimate::Iteration;

/// One row for the start and each correction: cost, what it changed, damping, size, and how many were refused before it.
pub fn history_table(history: &[Iteration]) -> String {
    let header = ["correction", "cost", "change", "damping", "largest step / error", "refused"];
    let mut table = plain(&header);
    for i in history {
        let moved = |text: String| if i.number == 0 { String::new() } else { text };
        table.add_row([
            i.number.to_string(),
            format!("{:.9e}", i.cost),
            moved(format!("{:+.2e}", i.change)),
            moved(if i.damping == 0.0 { "0".into() } else { format!("{:.0e}", i.damping) }),
            moved(digits(i.step, 3)),
            i.refused.to_string(),
        ]);
    }
    (0..header.len()).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}
