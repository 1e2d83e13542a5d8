//! Equal neighbours: a stuck sensor, values at a rail, a sensor that is read more often than it measures, rows that stand twice.

use crate::finding::{Fault, Finding};
use crate::given::is_given;
use crate::record::{Channel, Record, Role};
use crate::repair::Repair;

/// One run of equal values.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    first: usize,
    length: usize,
    value: f64,
}

/// The runs of equal neighbours, one for each change.
fn stretches(values: &[f64]) -> Vec<Stretch> {
    let mut found: Vec<Stretch> = Vec::new();
    for (k, v) in values.iter().enumerate() {
        match found.last_mut() {
            Some(last) if last.value == *v => last.length += 1,
            _ => found.push(Stretch { first: k, length: 1, value: *v }),
        }
    }
    found.retain(|s| s.value.is_finite());
    found
}

/// Part of neighbours that are equal, outside of one run.
fn equal_part(all: &[Stretch], without: usize) -> f64 {
    let others = all.iter().enumerate().filter(|(k, _)| *k != without).map(|(_, s)| s.length);
    let (pairs, equal) = others.fold((0usize, 0usize), |(p, e), l| (p + l, e + l - 1));
    // one more of each, so that no estimate is 0
    (equal as f64 + 1.0) / (pairs as f64 + 2.0)
}

/// What runs of equal values say of a channel; `still` says whether the record as a whole is at rest (N).
pub(crate) fn examine(record: &Record, channel: &Channel, alpha: f64) -> Vec<Finding> {
    let n = channel.values.len();
    // most sensors never repeat a number
    if channel.values.windows(2).filter(|w| w[0] == w[1]).take(2).count() < 2 {
        return Vec::new();
    }
    let all = stretches(&channel.values);
    if n < 20 || all.len() < 2 {
        return constant(record, channel, &all).into_iter().collect();
    }
    let mut findings = Vec::new();
    findings.extend(held(record, channel, &all));
    if findings.is_empty() {
        findings.extend(clipped(record, channel, &all, alpha));
        findings.extend(stuck(record, channel, &all, alpha));
    }
    findings
}

/// A channel that never changes: a remark, as an input that is not used in a manoeuvre is no fault.
fn constant(record: &Record, channel: &Channel, all: &[Stretch]) -> Option<Finding> {
    let [only] = all else { return None };
    if only.length < 3 {
        return None;
    }
    let what = format!("{} in all {} samples", only.value / channel.scale, only.length);
    let finding = Finding::by_chance(&record.run, &channel.name, Fault::Constant, 1.0, what);
    Some(finding.remark().repaired_by(Repair::words("what it drives cannot be determined by this run")))
}

/// Almost every run has one length above 1: the sensor measures every so many samples. Of a channel that nobody named that is a remark, as
/// the commands of a slower computer look the same.
fn held(record: &Record, channel: &Channel, all: &[Stretch]) -> Option<Finding> {
    const FEWEST: usize = 20;
    if channel.role == Role::Input || all.len() < FEWEST {
        return None;
    }
    let mut counts = [0usize; 64];
    all.iter().for_each(|s| counts[s.length.min(63)] += 1);
    let (length, many) = (2..63).map(|l| (l, counts[l])).max_by_key(|(_, c)| *c)?;
    if 10 * many < 8 * all.len() {
        return None;
    }
    // neighbours of a continuous signal are equal with the probability of a one in ten, generously
    let p = 0.1f64.powi(many.min(200) as i32);
    let measured = format!("the sensor measures {length} times slower than the record");
    let finding = |means: &str| {
        let what = format!("changes only every {length} samples: {means}");
        Finding::by_chance(&record.run, &channel.name, Fault::HeldSamples, p, what)
    };
    if channel.role == Role::Unknown {
        let remark = finding(&format!("a command that is held, or {measured}")).remark();
        return Some(remark.repaired_by(Repair::words("of a command: hold it (`--zoh`, `hold` in a map)")));
    }
    let repair = Repair::words(&format!("--every {length}, or a map of the sensor's own samples"));
    Some(finding(&measured).repaired_by(repair))
}

/// Values pile up at the least or greatest: in runs, and more than at the next level inside, which a smooth maximum has less than three of
/// four samples above. A command is what it was given as: what it does at a limit is exact, and at zero it is off.
fn clipped(record: &Record, channel: &Channel, all: &[Stretch], alpha: f64) -> Option<Finding> {
    if is_given(channel) {
        return None;
    }
    let values = || all.iter().map(|s| s.value);
    let (low, high) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let n: usize = all.iter().map(|s| s.length).sum();
    // commands have few levels, and stay at each
    let long = all.iter().filter(|s| s.length > 1).map(|s| s.length).sum::<usize>();
    let mut best: Option<(f64, f64, usize, usize)> = None;
    for rail in [low, high].into_iter().filter(|rail| channel.role == Role::Output || *rail != 0.0) {
        let at: Vec<&Stretch> = all.iter().filter(|s| s.value == rail).collect();
        let count: usize = at.iter().map(|s| s.length).sum();
        let runs = at.iter().filter(|s| s.length >= 3).count();
        let inner = values().filter(|v| *v != rail);
        let next =
            if rail == low { inner.fold(f64::INFINITY, f64::min) } else { inner.fold(f64::NEG_INFINITY, f64::max) };
        let beside: usize = all.iter().filter(|s| s.value == next).map(|s| s.length).sum();
        if runs == 0 || count < 5 || 2 * (long.saturating_sub(count)) > n - count {
            continue;
        }
        // rest is at a value from which the signal goes; a rail is met again and again, or out of motion on both sides
        let first = at.iter().any(|s| s.first == 0) && at.len() == 1;
        let last = at.iter().any(|s| s.first + s.length == n) && at.len() == 1;
        if first || last {
            continue;
        }
        let p = binomial_tail(count, count + beside, 0.75);
        if p < alpha && best.is_none_or(|b| p < b.0) {
            best = Some((p, rail, count, runs));
        }
    }
    let (p, rail, count, runs) = best?;
    let samples = (0..channel.values.len()).filter(|k| channel.values[*k] == rail).collect();
    let end = if rail == high { "greatest" } else { "least" };
    let what = format!(
        "{} is its {end} value in {count} samples, {runs} time(s) for three and more: it saturates there",
        rail / channel.scale
    );
    let repair = Repair::words("empty these cells, or give the model the limit: sat(..)");
    let finding = Finding::by_chance(&record.run, &channel.name, Fault::Clipped, p, what);
    Some(finding.at_samples(&record.time, samples).repaired_by(repair))
}

/// The longest run of one value, against the length that chance gives where neighbours are equal as often as elsewhere in the channel.
fn stuck(record: &Record, channel: &Channel, all: &[Stretch], alpha: f64) -> Option<Finding> {
    const FEWEST: usize = 5;
    let (k, longest) = all.iter().enumerate().max_by_key(|(_, s)| s.length)?;
    let n = channel.values.len();
    let equal = equal_part(all, k);
    // commands, and signals that rest anyway
    if longest.length < FEWEST || equal > 0.5 || longest.length * 10 > n * 9 {
        return None;
    }
    let (low, high) = all.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), s| (l.min(s.value), h.max(s.value)));
    if longest.value == low || longest.value == high {
        // at a rail it saturates, if it is met more than once
        let met = all.iter().filter(|s| s.value == longest.value && s.length > 2).count();
        if met > 1 {
            return None;
        }
    }
    // a signal that is quantised, or slow at its peaks, has several such runs
    let second = all.iter().enumerate().filter(|(other, _)| *other != k).map(|(_, s)| s.length).max().unwrap_or(1);
    if longest.length < 2 * second + 2 {
        return None;
    }
    // a command that ends in one value, or waits in it for most of the record
    let waits = longest.first == 0 || longest.first + longest.length == n || 2 * longest.length > n;
    if channel.role == Role::Input && waits {
        return None;
    }
    // rest before the manoeuvre, or behind it, without noise: zero to the last digit
    let at_an_end = longest.first == 0 || longest.first + longest.length == n;
    if at_an_end && longest.value == 0.0 {
        return None;
    }
    // a quantised signal at rest goes on by its step; a sensor that was stuck has to catch up
    let digit =
        channel.values.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
    let next = channel.values.get(longest.first + longest.length).copied().unwrap_or(f64::NAN);
    if !at_an_end && (next - longest.value).abs() < 3.0 * digit {
        return None;
    }
    // a command that pauses goes on from where it is, by steps as it takes elsewhere
    if is_given(channel) && (channel.role == Role::Input || at_an_end || !catches_up(&channel.values, longest)) {
        return None;
    }
    // another channel that moves shows that the record does not rest
    let within = longest.first..longest.first + longest.length;
    let moves = record.channels.iter().filter(|c| c.name != channel.name).any(|c| {
        let part = &c.values[within.clone()];
        let distinct = part.windows(2).filter(|w| w[0] != w[1]).count();
        2 * distinct > part.len()
    });
    if !moves && at_an_end && record.channels.len() > 1 {
        return None;
    }
    if at_an_end && rests(&channel.values, longest) {
        return None;
    }
    let p = (n as f64 * equal.powi(longest.length as i32 - 1)).min(1.0);
    if p > alpha {
        return None;
    }
    let what = format!(
        "stays at {} for {} samples, where neighbours are equal in {:.0} % elsewhere: it is stuck",
        longest.value / channel.scale,
        longest.length,
        100.0 * equal
    );
    let finding = Finding::by_chance(&record.run, &channel.name, Fault::Stuck, p, what);
    let repair = Repair::words("empty these cells: they are then not compared");
    Some(finding.at_samples(&record.time, within.collect()).repaired_by(repair))
}

/// Whether the step out of a run of equal values is beyond all others in the channel: what goes on below has to be caught up with.
fn catches_up(values: &[f64], run: &Stretch) -> bool {
    let end = run.first + run.length;
    let steps = values.windows(2).enumerate().map(|(k, w)| (k, (w[1] - w[0]).abs()));
    let (mut out, mut others) = (0.0_f64, 0.0_f64);
    for (k, step) in steps.filter(|(_, step)| step.is_finite()) {
        let side = if k + 1 == end { &mut out } else { &mut others };
        *side = side.max(step);
    }
    out > 2.0 * others
}

/// Whether a run of equal values at an end of the record is a rest: motion dies out towards it, or grows out of it, by steps that are much smaller
/// than usual. A sensor that sticks does so at any speed, and in its noise.
fn rests(values: &[f64], run: &Stretch) -> bool {
    const BESIDE: usize = 8;
    /// Of the usual step.
    const GENTLE: f64 = 0.2;
    let steps = |part: &[f64]| -> Vec<f64> {
        part.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| d.is_finite() && *d > 0.0).collect()
    };
    let end = run.first + run.length;
    // with the step into the run, or out of it
    let beside = if run.first == 0 {
        &values[end - 1..(end + BESIDE).min(values.len())]
    } else {
        &values[run.first.saturating_sub(BESIDE)..=run.first]
    };
    let (near, mut all) = (steps(beside), steps(values));
    if near.is_empty() || all.len() < BESIDE {
        return false;
    }
    let middle = all.len() / 2;
    let usual = *all.select_nth_unstable_by(middle, f64::total_cmp).1;
    near.iter().sum::<f64>() < GENTLE * usual * near.len() as f64
}

/// Whether a channel goes to a neighbouring level and back at once, again and again, as noise makes a quantised sensor do: nearly all such
/// returns are by one step. Those of a command go by any number of its levels.
pub(crate) fn dithers(values: &[f64], step: f64) -> bool {
    /// Returns by one step where two sizes were as likely: one of 256.
    const FEWEST: usize = 8;
    let all = stretches(values);
    let back = |w: &&[Stretch]| w[1].length <= 2 && w[0].value == w[2].value;
    let (by_one, returns) = all
        .windows(3)
        .filter(back)
        .fold((0usize, 0usize), |(one, n), w| (one + usize::from((w[1].value - w[0].value).abs() < 1.5 * step), n + 1));
    by_one >= FEWEST && 10 * by_one >= 8 * returns
}

/// Rows that repeat the row before in every channel that otherwise changes, at another time.
pub(crate) fn doubled_rows(record: &Record, alpha: f64) -> Option<Finding> {
    let n = record.time.len();
    let mut changing = Vec::new();
    let mut chance = 1.0_f64;
    for channel in &record.channels {
        let pairs = channel.values.windows(2).filter(|w| w[0].is_finite() && w[1].is_finite());
        let (all, equal) = pairs.fold((0usize, 0usize), |(a, e), w| (a + 1, e + usize::from(w[0] == w[1])));
        // commands are equal most of the time and tell nothing
        if all > 20 && 2 * equal < all {
            changing.push((channel, (equal as f64 + 1.0) / (all as f64 + 2.0)));
        }
    }
    if n < 20 || changing.len() < 2 {
        return None;
    }
    let rows: Vec<usize> = (1..n).filter(|k| changing.iter().all(|(c, _)| c.values[*k] == c.values[k - 1])).collect();
    let alone = |i: &usize| {
        let near = |j: Option<&usize>, by: usize| j.is_some_and(|k| k.abs_diff(rows[*i]) == by);
        !near(rows.get(i + 1), 1) && !near(i.checked_sub(1).and_then(|j| rows.get(j)), 1)
    };
    let isolated: Vec<usize> = (0..rows.len()).filter(alone).collect();
    if rows.is_empty() || 2 * isolated.len() < rows.len() {
        return None;
    }
    // without doubled rows the channels are equal by themselves, as often as in the other rows
    for (channel, _) in &changing {
        let elsewhere = (1..n).filter(|k| channel.values[*k] == channel.values[k - 1]).count() - rows.len();
        chance *= ((elsewhere as f64 + 1.0) / (n as f64 + 1.0)).min(1.0);
    }
    let p = binomial_tail(rows.len(), n - 1, chance.max(1e-12));
    if p > alpha {
        return None;
    }
    let what = format!("{} row(s) repeat the row before in all {} channels that change", rows.len(), changing.len());
    let finding = Finding::by_chance(&record.run, "t", Fault::DoubledRows, p, what);
    let repair = Repair::words("remove these rows: their times are not those of their values");
    let mut finding = finding.at_samples(&record.time, rows).repaired_by(repair);
    finding.samples.clear();
    Some(finding)
}

/// Probability of `count` or more successes in `n` trials, by the bound of Chernoff (1952), which is above it.
pub(crate) fn binomial_tail(count: usize, n: usize, p: f64) -> f64 {
    let (k, n) = (count as f64, n as f64);
    let q = k / n;
    if n == 0.0 || q <= p {
        return 1.0;
    }
    let part = |a: f64, b: f64| if a == 0.0 { 0.0 } else { a * (a / b).ln() };
    (-n * (part(q, p) + part(1.0 - q, 1.0 - p))).exp()
}
