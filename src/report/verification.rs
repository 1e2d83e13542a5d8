//! What an exported file computes, beside the model.

use super::section::Rows;
use crate::text;
use fdm_exchange::verify::{TOLERANCE, Verification};

/// A line for each kind of number, and what follows from them.
pub fn verification_table(found: &Verification) -> String {
    let mut table = Rows::over(found.rows.iter().filter(|row| row.count > 0));
    table.words("what", |row| row.what);
    table.number("numbers", |row| row.count);
    table.number("other bits", |row| row.other_bits);
    table.number("largest relative difference", |row| match row.other_bits {
        0 => "0".into(),
        _ => format!("{:.1e}", row.difference),
    });
    let verdict = if found.is_good() {
        format!("verified: all numbers at {} points are those of the model", found.points)
    } else {
        format!("NOT verified: a difference is above {TOLERANCE:e}")
    };
    format!("{}{verdict}\n", text::table(table))
}
