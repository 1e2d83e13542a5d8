//! The times of the samples: dropouts, and jitter of the stamps.

use crate::finding::{Fault, Finding};
use crate::record::Record;
use crate::repair::Repair;

/// Dropouts and jitter. Intervals that differ by design (chemistry, decades of time) are neither.
pub(crate) fn examine(record: &Record, alpha: f64) -> Vec<Finding> {
    const FEWEST: usize = 20;
    /// Samples at an end of the record that are a lead or a tail.
    const FEW: usize = 3;
    if !record.clocked || record.time.len() < FEWEST {
        return Vec::new();
    }
    let steps: Vec<f64> = record.time.windows(2).map(|w| w[1] - w[0]).collect();
    let mut sorted = steps.clone();
    let middle = sorted.len() / 2;
    let median = sorted.select_nth_unstable_by(middle, f64::total_cmp).1.to_owned();
    if !median.is_finite() || median <= 0.0 {
        return Vec::new();
    }
    // stamps that are rounded differ by their last digit
    let digit = last_digit(&record.time);
    let even = steps.iter().filter(|d| (**d - median).abs() <= 0.5 * median).count();
    // by design: more than a tenth of the intervals differ by half of the usual one
    if 10 * (steps.len() - even) > steps.len() {
        return Vec::new();
    }
    let mut findings = Vec::new();
    let spread: f64 = {
        let near = steps.iter().filter(|d| (**d - median).abs() <= 0.5 * median);
        (near.map(|d| (d - median).powi(2)).sum::<f64>() / even.max(1) as f64).sqrt()
    };
    // a pause: beyond what the jitter of intervals explains, and one sample at least is not there
    let long: Vec<usize> = (0..steps.len()).filter(|k| steps[*k] > 1.8 * median + 6.0 * spread).collect();
    if let Some(first) = long.first() {
        let missing: f64 = long.iter().map(|k| (steps[*k] / median).round() - 1.0).sum();
        let longest = long.iter().map(|k| steps[*k]).fold(0.0, f64::max);
        let whole = long.iter().filter(|k| {
            let parts = steps[**k] / median;
            (parts - parts.round()).abs() < 0.1 + 3.0 * spread / median
        });
        let kind = if whole.count() == long.len() { "samples are missing" } else { "samples would fit in" };
        let what = match long.len() {
            1 => format!(
                "no sample for {longest:.4} from {:.4} on, where the usual interval is {median:.4}: {missing:.0} {kind}",
                record.time[*first]
            ),
            n => format!(
                "{n} dropouts, the longest {longest:.4}, where the usual interval is {median:.4}: {missing:.0} {kind}"
            ),
        };
        let last = long.last().copied().unwrap_or(*first);
        let place = (record.time[*first], record.time[last + 1]);
        let finding = Finding::by_chance(&record.run, "t", Fault::Gap, alpha * (-longest / median).exp(), what);
        // a few samples before or behind all others are cut off, and nothing is missing between those that are left
        let lead = if let [one] = long[..] { one < FEW || steps.len() - one <= FEW } else { false };
        let mut finding = finding.at(place.0, place.1, missing as usize);
        let repair = if lead {
            let (side, option) = if *first < FEW { ("before", "--from") } else { ("behind", "--to") };
            finding = finding.remark();
            finding.what.push_str(&format!("; the record is whole without the few samples {side} it"));
            format!("leave them out: {option}")
        } else {
            "fit the parts before and behind as runs of their own: --from, --to".into()
        };
        findings.push(finding.repaired_by(Repair::words(&repair)));
    }
    let allowed = (0.02 * median).max(1.5 * digit);
    if spread > allowed {
        let part = 100.0 * spread / median;
        let what = format!(
            "intervals scatter by {part:.1} % of {median:.4}: the stamps are those of a busy computer, or the sampling is not even"
        );
        // the sum of squares over what rounding explains, in units of its own deviation
        let z = (steps.len() as f64).sqrt() * (spread / allowed).ln();
        let p = fdm_numeric::statistics::normal_tail(z).max(1e-300);
        if p < alpha {
            findings.push(
                Finding::by_chance(&record.run, "t", Fault::UnevenTime, p, what)
                    .repaired_by(Repair::words("[time]\nrate = ").with_rate(1.0 / median)),
            );
        }
    }
    findings
}

/// The last decimal digit in which times differ, from the first thousand.
fn last_digit(time: &[f64]) -> f64 {
    const LOOKED_AT: usize = 1000;
    for places in 0..12 {
        let unit = 10f64.powi(places);
        let whole = |t: &f64| {
            let scaled = t * unit;
            (scaled - scaled.round()).abs() < 1e-6 * scaled.abs().max(1.0)
        };
        if time.iter().take(LOOKED_AT).all(whole) {
            return 1.0 / unit;
        }
    }
    0.0
}
