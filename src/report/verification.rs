//! What an exported file computes, beside the model.

use super::table::{aligned_right, plain, trimmed};
use fdm_exchange::verify::{TOLERANCE, Verification};

/// A line for each kind of number, and what follows from them.
pub fn verification_table(found: &Verification) -> String {
    let mut table = plain(&["what", "numbers", "other bits", "largest relative difference"]);
    (1..4).for_each(|column| aligned_right(&mut table, column));
    for row in found.rows.iter().filter(|row| row.count > 0) {
        let difference = if row.other_bits == 0 { "0".into() } else { format!("{:.1e}", row.difference) };
        table.add_row([row.what.into(), row.count.to_string(), row.other_bits.to_string(), difference]);
    }
    let verdict = if found.is_good() {
        format!("verified: all numbers at {} points are those of the model", found.points)
    } else {
        format!("NOT verified: a difference is above {TOLERANCE:e}")
    };
    format!("{}{verdict}\n", trimmed(&table))
}
