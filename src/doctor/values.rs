//! The values of one channel: sentinels, missing values, spikes, wrapped angles, coarse quantisation, units of angles that nobody stated.

use crate::finding::{Fault, Finding, log_odds_of};
use crate::record::{Channel, Record, Role};
use crate::repair::{Change, Repair};
use crate::runs_of_values::dithers;
use crate::tail::Tail;
use std::f64::consts::{PI, TAU};

/// Numbers that loggers, databases and file formats write where there is no value.
const SENTINELS: [f64; 14] = [
    -999.0,
    -9999.0,
    -99_999.0,
    -999.25,
    9999.0,
    99_999.0,
    9.969_209_968_386_869e36,
    1e20,
    1e30,
    -1e30,
    -32_768.0,
    32_767.0,
    65_535.0,
    2_147_483_647.0,
];

/// Numbers that stand for no value, or the end of a converter's range: one value, far from all others, in one sample or many.
pub(crate) fn sentinel(record: &Record, channel: &Channel, alpha: f64) -> Option<Finding> {
    let finite = || channel.values.iter().copied().filter(|v| v.is_finite());
    let (least, greatest) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, g), v| (l.min(v), g.max(v)));
    for extreme in [least, greatest] {
        let written = extreme / channel.scale;
        let known = SENTINELS.iter().any(|s| (written / s - 1.0).abs() < 1e-6);
        let count = finite().filter(|v| *v == extreme).count();
        if !known && count < 2 {
            continue;
        }
        let others = || finite().filter(|v| *v != extreme);
        let (low, high) = others().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, g), v| (l.min(v), g.max(v)));
        let range = high - low;
        let distance = (extreme - high).max(low - extreme);
        // of values of one range, the next lies within the range of all others but for one in their number; twice as far, squared
        let rest = others().count();
        if rest < 3 || range <= 0.0 || distance < 2.0 * range || !(known || count > 1 && 2 * count < rest) {
            continue;
        }
        // a level that a command keeps is no mark in single samples
        let starts = |k: &usize| channel.values[*k] == extreme && (*k == 0 || channel.values[*k - 1] != extreme);
        if !known && 2 * (0..channel.values.len()).filter(starts).count() <= count {
            continue;
        }
        let p = (1.0 / rest as f64).powf(distance / range) * if known { 1e-3 } else { 1.0 };
        if p > alpha {
            continue;
        }
        let samples: Vec<usize> = (0..channel.values.len()).filter(|k| channel.values[*k] == extreme).collect();
        let what = format!(
            "{written} in {count} sample(s), where all others are between {:.4} and {:.4}: it stands for a missing value",
            low / channel.scale,
            high / channel.scale
        );
        let finding = Finding::by_chance(&record.run, &channel.name, Fault::Sentinel, p, what);
        let repair = Repair::words(&format!("empty the cells that hold {written}: fdm takes empty cells for gaps"));
        return Some(finding.at_samples(&record.time, samples).repaired_by(repair));
    }
    None
}

/// Samples without a value, where more than half have one: a remark.
pub(crate) fn missing(record: &Record, channel: &Channel) -> Option<Finding> {
    let samples: Vec<usize> = (0..channel.values.len()).filter(|k| channel.values[*k].is_nan()).collect();
    let n = channel.values.len();
    if samples.is_empty() || 2 * samples.len() >= n {
        return None;
    }
    let what = format!("no value in {} of {n} samples", samples.len());
    let finding = Finding::by_chance(&record.run, &channel.name, Fault::Missing, 1.0, what);
    let mut finding = finding.at_samples(&record.time, samples).remark();
    finding.samples.clear();
    Some(finding)
}

/// Single samples that stand out of their neighbours: far beyond the tail of the second differences, back again in the next sample, and much
/// further than the neighbours are from theirs. Samples without a value are left out.
pub(crate) fn spikes(record: &Record, channel: &Channel, alpha: f64) -> Option<Finding> {
    let x = &channel.values;
    let n = x.len();
    if n < 20 {
        return None;
    }
    let height = |k: usize| x[k] - 0.5 * (x[k - 1] + x[k + 1]);
    let usable = |k: usize| x[k].is_finite();
    let mut sizes = Vec::with_capacity(n);
    sizes.extend(x.windows(3).map(|w| (w[1] - 0.5 * (w[0] + w[2])).abs()).filter(|h| h.is_finite()));
    let tail = Tail::new(&mut sizes)?;
    // the last digit of the numbers is no spike
    let digit = x.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
    let limit = (tail.start + tail.scale * (0.25 * n as f64 / alpha).ln().max(0.0)).max(3.0 * digit);
    let stands_out = |k: &usize| {
        let k = *k;
        let h = height(k).abs();
        if !(h > limit && h.is_finite()) {
            return false;
        }
        let step = |a: usize, b: usize| (x[a] - x[b]).abs();
        let before = if k >= 2 && usable(k - 2) { step(k - 1, k - 2) } else { 0.0 };
        let behind = if k + 2 < n && usable(k + 2) { step(k + 2, k + 1) } else { 0.0 };
        step(k + 1, k - 1) < 0.5 * h && before.max(behind) < 0.25 * h
    };
    let samples: Vec<usize> = (1..n - 1).filter(stands_out).collect();
    let first = *samples.first()?;
    // more than one in twenty is no fault of single samples
    if 20 * samples.len() > n {
        return None;
    }
    // a command may well be a pulse of one sample; a fault leaves the range of all other samples
    if channel.role != Role::Output || tail.scale <= 0.0 {
        let mut is_spike = vec![false; n];
        samples.iter().for_each(|k| is_spike[*k] = true);
        let others = (0..n).filter(|k| !is_spike[*k] && usable(*k)).map(|k| x[k]);
        let (low, high) = others.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, g), v| (l.min(v), g.max(v)));
        if !samples.iter().any(|k| x[*k] > high + 0.5 * (high - low) || x[*k] < low - 0.5 * (high - low)) {
            return None;
        }
    }
    let largest = samples.iter().map(|k| height(*k).abs()).fold(0.0, f64::max);
    let p = tail.exceeded(largest).max(1e-300);
    let what = match samples.len() {
        1 => format!("{:.4} at {:.4} stands {largest:.4} out of its neighbours", x[first], record.time[first]),
        n => format!("{n} single samples stand up to {largest:.4} out of their neighbours"),
    };
    let finding = Finding::by_chance(&record.run, &channel.name, Fault::Spikes, p.min(alpha), what);
    let repair = Repair::words("empty these cells, or fit with --loss student");
    Some(finding.at_samples(&record.time, samples).repaired_by(repair))
}

/// Jumps by a whole turn.
pub(crate) fn wrapped(record: &Record, channel: &Channel) -> Option<Finding> {
    let unit = channel.unit.as_deref();
    let periods: &[f64] = match unit {
        Some("rad") => &[TAU],
        Some("deg") => &[360.0],
        None | Some("1") => &[360.0, TAU],
        _ => return None,
    };
    let x = &channel.values;
    let finite = || x.iter().copied().filter(|v| v.is_finite());
    let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    for period in periods {
        if high - low > 1.02 * period || high - low < 0.8 * period {
            continue;
        }
        let (mut samples, mut other) = (Vec::new(), 0.0_f64);
        for k in 1..x.len() {
            let step = (x[k] - x[k - 1]).abs();
            if step >= 0.8 * period {
                samples.push(k);
            } else if step.is_finite() {
                other = other.max(step);
            }
        }
        if samples.is_empty() || other > 0.35 * period {
            continue;
        }
        // in the unit of the column, where the map acts
        let written = period / channel.scale;
        let what = format!("jumps by a whole turn of {written:.6} {} time(s): it is wrapped", samples.len());
        // each jump meets the turn within a fifth, of all sizes up to the range
        let p = (0.2f64).powi(samples.len().min(40) as i32) * (other / period).max(1e-3).powi(2);
        let change = Change { wrap: Some(*period), ..Change::default() };
        let mut finding = Finding::by_chance(&record.run, &channel.name, Fault::Wrapped, p, what);
        finding.repair = Some(Repair::map([(channel.name.clone(), change)]));
        finding = finding.at_samples(&record.time, samples);
        finding.samples.clear();
        return Some(finding);
    }
    None
}

/// A quantiser whose step is coarse beside what the channel does: all values are multiples of one step and few levels are used. Of a channel
/// that nobody named that is a remark, unless noise makes it go to and fro between levels: a command of few levels is a schedule.
pub(crate) fn quantised(record: &Record, channel: &Channel) -> Option<Finding> {
    /// Levels between least and greatest, beyond which the noise of the step is a thousandth of the signal.
    const FEW: f64 = 48.0;
    const FEWEST: usize = 50;
    if channel.role == Role::Input {
        return None;
    }
    let x: Vec<f64> = channel.values.iter().copied().filter(|v| v.is_finite()).collect();
    if x.len() < FEWEST {
        return None;
    }
    let (low, high) = x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    let range = high - low;
    // the least step that occurs; numbers that differ by rounding are one
    let mut step = f64::INFINITY;
    for w in x.windows(2) {
        let d = (w[1] - w[0]).abs();
        if d > 1e-9 * range {
            step = step.min(d);
            if range > FEW * step {
                return None;
            }
        }
    }
    if !step.is_finite() || range < 3.0 * step {
        return None;
    }
    let whole = |v: &f64| {
        let parts = (v - low) / step;
        (parts - parts.round()).abs() < 0.01
    };
    if !x.iter().all(whole) {
        return None;
    }
    let levels = (range / step).round();
    let what = format!(
        "steps of {:.4}, {levels:.0} over the whole range: noise of {:.4} that is not random",
        step / channel.scale,
        step / channel.scale / 12f64.sqrt()
    );
    let p = (0.02f64).powi(x.len().min(100) as i32);
    if channel.role == Role::Unknown && !dithers(&channel.values, step) {
        let what = format!("{what}; of a command, a schedule of {:.0} levels", levels + 1.0);
        return Some(Finding::by_chance(&record.run, &channel.name, Fault::Quantised, p, what).remark());
    }
    let repair = Repair::words("record it with more digits; or state the noise: --noise ").line_with(&format!(
        "{}={:.4}",
        channel.name,
        step / 12f64.sqrt()
    ));
    Some(Finding::by_chance(&record.run, &channel.name, Fault::Quantised, p, what).repaired_by(repair))
}

/// A channel whose unit only the model states, where its numbers look like degrees for radians or the reverse. Angles of vehicles in motion
/// scatter by 0.01 to 1 rad and their rates likewise: the logarithm of the deviation is taken as normal about 0.1 rad with a factor of 5.
pub(crate) fn angle_unit(record: &Record, channel: &Channel) -> Option<Finding> {
    const USUAL: f64 = 0.1;
    const FACTOR: f64 = 5.0;
    if channel.stated {
        return None;
    }
    let (to_model, written, meant) = match channel.unit.as_deref() {
        Some("rad" | "rad/s" | "rad/s^2") => (PI / 180.0, "degrees", "radians"),
        Some("deg" | "deg/s" | "deg/s^2") => (180.0 / PI, "radians", "degrees"),
        _ => return None,
    };
    let in_radians = if to_model < 1.0 { 1.0 } else { PI / 180.0 };
    let values = channel.values.iter().copied().filter(|v| v.is_finite());
    let (mut n, mut mean, mut squares) = (0.0, 0.0, 0.0);
    for v in values {
        n += 1.0;
        let d = v - mean;
        mean += d / n;
        squares += d * (v - mean);
    }
    let deviation = (squares / n).sqrt() * in_radians;
    if n < 3.0 || deviation <= 0.0 {
        return None;
    }
    let cost = |s: f64| 0.5 * ((s / USUAL).ln() / FACTOR.ln()).powi(2);
    // two hypotheses; nine of ten columns have the unit of the model
    let log_odds = cost(deviation) - cost(deviation * to_model) - 9f64.ln();
    if log_odds <= 3f64.ln() {
        return None;
    }
    let what = format!(
        "the column `{}` states no unit and scatters by {:.4}: {written} for a model in {meant}",
        channel.column,
        deviation / in_radians
    );
    let change = Change { factor: to_model, ..Change::default() };
    let mut finding = Finding::by_chance(&record.run, &channel.name, Fault::Unit, 1.0, what);
    finding.log_odds = log_odds.max(log_odds_of(1.0));
    Some(finding.repaired_by(Repair::map([(channel.name.clone(), change)])))
}
