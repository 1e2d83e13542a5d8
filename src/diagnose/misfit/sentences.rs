//! The misfit in words.

use super::misfit::Misfit;
use super::moments::{AmplitudeBin, Window};

/// Below this share above the noise floor an output is matched to its noise.
const NOTHING: f64 = 0.1;
/// A band is told that holds more of the error than this, and twice as much as its noise.
const BAND: f64 = 0.2;
/// Windows together that are told hold this much of the error, in at most a third of the time.
const MOST: f64 = 0.6;
/// The error is told to grow with amplitude when it does by this factor.
const GROWTH: f64 = 1.5;
/// Phases and gains that are told.
const DEGREES: f64 = 2.0;
const PERCENT: f64 = 3.0;

/// Everything that stands out.
pub(super) fn sentences(misfit: &Misfit, time: &str, runs: usize) -> Vec<String> {
    let name = &misfit.output;
    let unit = misfit.unit.as_ref().map_or(String::new(), |u| format!(" {u}"));
    if misfit.above_floor < NOTHING {
        return vec![format!("{name}: the error of {}{unit} is the noise of the record", short(misfit.rms))];
    }
    let mut said = vec![format!(
        "{name}: the error is {}{unit}, {} times the noise of the record ({}{unit})",
        short(misfit.rms),
        short(misfit.rms / misfit.floor.max(f64::MIN_POSITIVE)),
        short(misfit.floor)
    )];
    said.extend(band(misfit, time));
    said.extend(phase(misfit, time, runs));
    said.extend(when(misfit, time));
    said.extend(growth(misfit));
    said
}

/// `Hz`, or cycles per the model's unit of time.
fn per(time: &str) -> String {
    match time {
        "s" => "Hz".into(),
        "1" | "" => "per unit of time".into(),
        other => format!("1/{other}"),
    }
}

/// The band that holds what is above the noise: from the first to the last octave that sticks out.
fn band(misfit: &Misfit, time: &str) -> Option<String> {
    let out: Vec<usize> = (0..misfit.bands.len())
        .filter(|k| misfit.bands[*k].share > 2.0 * misfit.bands[*k].noise && misfit.bands[*k].share > BAND / 4.0)
        .collect();
    let (first, last) = (*out.first()?, *out.last()?);
    let share: f64 = misfit.bands[first..=last].iter().map(|b| b.share).sum();
    if share < BAND {
        return None;
    }
    let (name, per) = (&misfit.output, per(time));
    let (low, high) = (misfit.bands[first].low, misfit.bands[last].high);
    let percent = (100.0 * share).round();
    Some(if first == 0 {
        format!("{name}: {percent} % of the error is below {} {per}", short(high))
    } else if last + 1 == misfit.bands.len() {
        format!("{name}: {percent} % of the error is above {} {per}", short(low))
    } else {
        format!("{name}: {percent} % of the error is between {} and {} {per}", short(low), short(high))
    })
}

fn phase(misfit: &Misfit, time: &str, runs: usize) -> Vec<String> {
    let (name, per) = (&misfit.output, per(time));
    let within = |agree: usize, of: usize| match (agree == of, runs) {
        (_, 1) => String::new(),
        (true, _) => ", in all runs".into(),
        (false, _) => format!(", in {agree} of {of} runs"),
    };
    let off = |g: &&super::gain::Gain| g.late.abs().to_radians().max((g.gain - 1.0).abs());
    let strongest = misfit.gains.iter().max_by(|a, b| off(a).total_cmp(&off(b)));
    let Some(gain) = strongest else { return Vec::new() };
    let (mut said, f) = (Vec::new(), short(gain.frequency));
    if gain.late.abs() > DEGREES {
        let side = if gain.late > 0.0 { "late" } else { "early" };
        let degrees = short(gain.late.abs());
        said.push(format!("{name}: the record is {side} by {degrees} deg at {f} {per}{}", within(gain.runs, gain.of)));
    }
    let percent = 100.0 * (gain.gain - 1.0);
    if percent.abs() > PERCENT {
        let side = if percent > 0.0 { "larger" } else { "smaller" };
        let percent = short(percent.abs());
        said.push(format!(
            "{name}: the record is {percent} % {side} than the response at {f} {per}{}",
            within(gain.runs, gain.of)
        ));
    }
    said
}

/// The fewest windows that hold most of the error, when they are few.
fn when(misfit: &Misfit, time: &str) -> Option<String> {
    let mut order: Vec<&Window> = misfit.windows.iter().collect();
    order.sort_by(|a, b| b.share.total_cmp(&a.share));
    let (mut share, mut samples, mut chosen) = (0.0, 0.0, Vec::new());
    for window in order {
        if share >= MOST {
            break;
        }
        share += window.share;
        samples += window.samples;
        chosen.push(window);
    }
    if share < MOST || samples > 1.0 / 3.0 {
        return None;
    }
    chosen.sort_by(|a, b| (&a.run, a.from).partial_cmp(&(&b.run, b.from)).unwrap_or(std::cmp::Ordering::Equal));
    // neighbours in one run are one stretch
    let mut stretches: Vec<(String, f64, f64)> = Vec::new();
    for window in chosen {
        let length = window.to - window.from;
        match stretches.last_mut() {
            Some((run, _, to)) if *run == window.run && window.from - *to <= 0.2 * length => *to = window.to,
            _ => stretches.push((window.run.clone(), window.from, window.to)),
        }
    }
    let unit = if time == "1" { String::new() } else { format!(" {time}") };
    let told: Vec<String> = stretches
        .iter()
        .take(3)
        .map(|(run, from, to)| format!("from {} to {}{unit} of {run}", short(*from), short(*to)))
        .collect();
    (stretches.len() <= 3).then(|| {
        format!(
            "{}: {} % of the error is in {} % of the time, {}",
            misfit.output,
            (100.0 * share).round(),
            (100.0 * samples).round(),
            told.join(" and ")
        )
    })
}

fn growth(misfit: &Misfit) -> Vec<String> {
    let mut said = Vec::new();
    for group in misfit.amplitudes.chunk_by(|a, b| a.signal == b.signal) {
        let (Some(low), Some(high)) = (group.first(), group.last()) else { continue };
        if group.len() < 2 || low.rms.max(high.rms) <= 0.0 {
            continue;
        }
        let times = |a: &AmplitudeBin, b: &AmplitudeBin| a.rms / b.rms.max(f64::MIN_POSITIVE);
        let signal = if low.signal == misfit.output { "it".into() } else { low.signal.clone() };
        let (name, above, below) = (&misfit.output, short(high.from), short(low.to));
        if times(high, low) > GROWTH {
            let factor = short(times(high, low));
            said.push(format!("{name}: the error is {factor} times as large where {signal} is large (beyond {above}) as where it is small (below {below})"));
        } else if times(low, high) > GROWTH {
            let factor = short(times(low, high));
            said.push(format!("{name}: the error is {factor} times as large where {signal} is small (below {below}) as where it is large (beyond {above})"));
        }
    }
    said
}

/// Three digits.
fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 12) as usize;
    let text = format!("{value:.digits$}");
    if value.abs() < 1e-4 || value.abs() >= 1e6 {
        return format!("{value:.2e}");
    }
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
}
