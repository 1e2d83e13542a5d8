//! Lines of a spectrum that samples as far apart as these may have folded.

use crate::finding::{Fault, Finding};
use crate::record::{Channel, Record, Role};
use crate::repair::Repair;
use fdm_numeric::fourier::CosineTransform;

/// Intervals that differ by more have no one Nyquist frequency.
const EVEN: f64 = 0.1;
/// Chance of a line in a channel that has none.
const CHANCE: f64 = 1e-4;

/// Lines in the upper half of the frequencies that the record shows, in channels that no input drives there: vibration above the Nyquist
/// frequency looks so, and is lost among slower motion when it is folded further.
pub fn examine(record: &Record, found: &[Finding]) -> Vec<Finding> {
    const FEWEST: usize = 128;
    let n = record.time.len();
    if !record.clocked || n < FEWEST {
        return Vec::new();
    }
    let interval = (record.time[n - 1] - record.time[0]) / (n - 1) as f64;
    let uneven = record.time.windows(2).filter(|w| ((w[1] - w[0]) / interval - 1.0).abs() > EVEN).count();
    if 50 * uneven > n {
        return Vec::new();
    }
    // what a converter or a logger makes is no motion
    let made = |c: &Channel| {
        let own = found.iter().filter(|f| f.channels.first() == Some(&c.name));
        own.into_iter().any(|f| matches!(f.fault, Fault::Quantised | Fault::HeldSamples | Fault::Spikes | Fault::Stuck))
    };
    let driven: Vec<f64> = record.channels.iter().filter(|c| c.role == Role::Input).filter_map(line).collect();
    let told = |c: &Channel| {
        let part = line(c).filter(|p| driven.iter().all(|d| (p - d).abs() > 0.02))?;
        let (frequency, rate) = (0.5 * part / interval, 1.0 / interval);
        let what = format!(
            "a line at {frequency:.4} per unit of time, in the upper half of what {rate:.4} samples show: vibration, or folded from {:.4} or {:.4}",
            rate - frequency,
            rate + frequency
        );
        let remark = Finding::by_chance(&record.run, &c.name, Fault::Aliased, 1.0, what).remark();
        Some(remark.repaired_by(Repair::words("look at it at a higher rate, or filter it before it is sampled")))
    };
    record.channels.iter().filter(|c| c.role != Role::Input && !made(c)).filter_map(told).collect()
}

/// The highest line of the upper half, as a part of the Nyquist frequency: pairs of coefficients of the cosine transform beside their
/// neighbours, whose powers have an exponential law (as Fisher 1929 judges the largest).
fn line(channel: &Channel) -> Option<f64> {
    /// Pairs on each side that a pair is compared with.
    const NEAR: usize = 16;
    let mut x: Vec<f64> = channel.values.iter().copied().filter(|v| v.is_finite()).collect();
    let n = x.len();
    if n < 8 * NEAR || n < channel.values.len() {
        return None;
    }
    CosineTransform::new(n).forward(&mut x);
    let powers: Vec<f64> = x.chunks_exact(2).map(|c| c[0] * c[0] + c[1] * c[1]).collect();
    let pairs = powers.len();
    let height = |k: usize| {
        // a line falls into two pairs at most
        let from = k.saturating_sub(NEAR);
        let mut near: Vec<f64> =
            (from..(k + NEAR + 1).min(pairs)).filter(|i| i.abs_diff(k) > 1).map(|i| powers[i]).collect();
        let middle = near.len() / 2;
        let median = *near.select_nth_unstable_by(middle, f64::total_cmp).1;
        powers[k] / median * std::f64::consts::LN_2
    };
    let all = (pairs / 2..pairs).map(|k| (k, height(k)));
    let (k, h) = all.filter(|(_, h)| h.is_finite()).max_by(|a, b| a.1.total_cmp(&b.1))?;
    ((pairs as f64 / 2.0) * (-h).exp() < CHANCE).then(|| (k as f64 + 0.5) / pairs as f64)
}
