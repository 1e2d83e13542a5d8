//! One record under two names, whole or in part.

use crate::finding::{Fault, Finding};
use crate::record::Record;
use crate::repair::Repair;
use std::collections::HashMap;

/// Rows of two records that are equal to the bit in every channel that changes. Records that share ten rows one after the other and more are
/// one record: of continuous signals not one row is equal by chance.
pub fn examine_repeats(records: &[Record]) -> Vec<Finding> {
    const FEWEST: usize = 10;
    let mut findings = Vec::new();
    if records.len() < 2 {
        return findings;
    }
    let rows: Vec<Vec<u64>> = records.iter().map(fingerprints).collect();
    for (b, later) in rows.iter().enumerate() {
        for (a, earlier) in rows[..b].iter().enumerate() {
            if records[a].channels.len() != records[b].channels.len() || records[a].channels.is_empty() {
                continue;
            }
            let mut at: HashMap<u64, usize> = HashMap::new();
            earlier.iter().enumerate().for_each(|(k, row)| {
                at.entry(*row).or_insert(k);
            });
            // the longest stretch of rows that follow each other in both
            let (mut longest, mut length, mut end) = (0, 0, 0);
            for (k, row) in later.iter().enumerate() {
                let follows = k > 0 && at.get(&later[k - 1]).is_some_and(|p| earlier.get(p + 1) == Some(row));
                length = match at.get(row) {
                    Some(_) if follows => length + 1,
                    Some(_) => 1,
                    None => 0,
                };
                if length > longest {
                    (longest, end) = (length, k);
                }
            }
            if longest < FEWEST {
                continue;
            }
            let whole = longest == later.len() && longest == earlier.len();
            let what = match whole {
                true => {
                    format!("holds the same {longest} samples as run `{}`: one record counts twice", records[a].run)
                }
                false => format!("{longest} samples one after the other are those of run `{}`", records[a].run),
            };
            let p = 1e-2f64.powi(longest.min(100) as i32);
            let finding = Finding::by_chance(&records[b].run, "t", Fault::Repeated, p, what);
            let place = (records[b].time[end + 1 - longest], records[b].time[end]);
            let repair = Repair::words("leave one of the two out, or cut them apart: --from, --to");
            findings.push(finding.at(place.0, place.1, longest).repaired_by(repair));
        }
    }
    findings
}

/// One number for the values of every row; rows like the row before have one of their place, so that rest is not taken for repetition.
fn fingerprints(record: &Record) -> Vec<u64> {
    let row = |k: usize| {
        record.channels.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, c| {
            (hash ^ c.values[k].to_bits()).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(17)
        })
    };
    let mut before = None;
    let mut rows = Vec::with_capacity(record.time.len());
    for k in 0..record.time.len() {
        let own = row(k);
        let still = before.replace(own) == Some(own);
        rows.push(if still { own.wrapping_add(record.time[k].to_bits()).rotate_left(7) } else { own });
    }
    rows
}
