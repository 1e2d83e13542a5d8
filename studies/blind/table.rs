//! The table of the study: every measure by family, effect, colour of noise and oracle gain.

use crate::case::BINS;
use crate::plan::Hides;
use crate::scorer::Outcome;
use crate::twins::NEAR;
use statrs::distribution::{Beta, ContinuousCDF, Normal};
use std::collections::BTreeMap;

/// Prints everything.
pub(crate) fn print(all: &[Outcome]) {
    if all.is_empty() {
        println!("no results yet");
        return;
    }
    let failed = all.iter().filter(|o| o.failure.is_some()).count();
    println!("\n{} cases, {failed} without an answer (counted as wrong)", all.len());
    let mut reasons: BTreeMap<&str, usize> = BTreeMap::new();
    all.iter().filter_map(|o| o.failure.as_deref()).for_each(|why| *reasons.entry(why).or_default() += 1);
    reasons.iter().for_each(|(why, n)| println!("  {n} x {why}"));
    alarms(all);
    for (title, hides) in [("one effect", Hides::Effect), ("one effect, closed loop", Hides::Loop)] {
        let lines: Vec<&Outcome> = all.iter().filter(|o| o.is(hides)).collect();
        if lines.is_empty() {
            continue;
        }
        effects(&format!("{title}, by family"), &lines, |o| o.family.clone());
        effects(&format!("{title}, by noise"), &lines, |o| format!("{} {} %", o.colour, 100.0 * o.level));
        effects(&format!("{title}, by gain"), &lines, |o| bin(o.gain));
        if hides == Hides::Effect {
            effects(&format!("{title}, by effect"), &lines, |o| o.truth[0].split('(').next().unwrap_or("").into());
            effects(&format!("{title}, by where it is"), &lines, |o| o.part.clone());
            effects(&format!("{title}, by what the nearest rival lacks"), &lines, |o| {
                if o.lead < 3.0 { "less than 3 nats".into() } else { "3 nats or more".into() }
            });
        }
    }
    pairs(all);
    gusts(all);
    outside(all);
    let mut seconds: Vec<f64> = all.iter().map(|o| o.seconds).collect();
    println!("\nseconds: median {:.2}, 95 % {:.2}", quantile(&mut seconds, 0.5), quantile(&mut seconds, 0.95));
}

fn bin(gain: f64) -> String {
    if gain < BINS[0].0 {
        return "a: below 5".into();
    }
    let k = BINS.iter().rposition(|b| gain >= b.0).unwrap_or(0);
    ["b: 5-15", "c: 15-50", "d: 50-300", "e: over 300"][k].into()
}

fn grouped<'a>(lines: &[&'a Outcome], key: impl Fn(&Outcome) -> String) -> BTreeMap<String, Vec<&'a Outcome>> {
    let mut groups: BTreeMap<String, Vec<&Outcome>> = BTreeMap::new();
    lines.iter().for_each(|o| groups.entry(key(o)).or_default().push(o));
    groups
}

/// A share with its count; nothing of nothing.
fn share(lines: &[&Outcome], holds: impl Fn(&Outcome) -> bool) -> String {
    let n = lines.len();
    if n == 0 {
        return "-".into();
    }
    format!("{:.2}", lines.iter().filter(|o| holds(o)).count() as f64 / n as f64)
}

/// The share of truths that are likelier than their nearest rival, expected of a judge who knows the noise and goes by the likelihood
/// alone.
fn could(lines: &[&Outcome]) -> String {
    if lines.is_empty() {
        return "-".into();
    }
    let normal = Normal::standard();
    // what the likelihood says of a model that lacks L nats scatters: mean L, variance 2 L
    let likelier = |o: &&Outcome| if o.lead < NEAR { normal.cdf((0.5 * o.lead).sqrt()) } else { 1.0 };
    format!("{:.2}", lines.iter().map(likelier).sum::<f64>() / lines.len() as f64)
}

fn effects(title: &str, lines: &[&Outcome], key: impl Fn(&Outcome) -> String) {
    println!("\n{title}");
    println!(
        "{:>26} | {:>4} {:>5} {:>5} {:>5} {:>5} {:>5} {:>5} {:>6} {:>5} {:>5} | {:>4} {:>5} {:>5} {:>5}",
        "gain over 15:",
        "n",
        "found",
        "top-1",
        "could",
        "group",
        "size",
        "only",
        "place",
        "h-med",
        "h-5%",
        "n",
        "found",
        "group",
        "of it"
    );
    println!("{:>26} | {:>63} | {:>22}", "", "", "gain 5 to 15");
    let mut groups = grouped(lines, key);
    groups.insert("~ all".into(), lines.to_vec());
    for (name, lines) in groups {
        let strong: Vec<&Outcome> = lines.iter().copied().filter(|o| o.gain >= 15.0).collect();
        let weak: Vec<&Outcome> = lines.iter().copied().filter(|o| (5.0..15.0).contains(&o.gain)).collect();
        let found: Vec<&Outcome> = weak.iter().copied().filter(|o| o.detected()).collect();
        let sizes: Vec<f64> = strong.iter().filter(|o| o.group > 0).map(|o| o.group as f64).collect();
        let size = if sizes.is_empty() { f64::NAN } else { sizes.iter().sum::<f64>() / sizes.len() as f64 };
        let mut held: Vec<f64> = strong.iter().filter_map(|o| o.validation_ratio).collect();
        let (median, low) = (quantile(&mut held, 0.5), quantile(&mut held, 0.05));
        println!(
            "{name:>26} | {:>4} {:>5} {:>5} {:>5} {:>5} {size:>5.2} {:>5} {:>6} {median:>5.2} {low:>5.2} | {:>4} {:>5} {:>5} {:>5}",
            strong.len(),
            share(&strong, Outcome::detected),
            share(&strong, |o| o.top),
            could(&strong),
            share(&strong, |o| o.grouped),
            share(&strong, |o| o.only),
            share(&strong, |o| o.same_part),
            weak.len(),
            share(&weak, Outcome::detected),
            share(&weak, |o| o.grouped),
            share(&found, |o| o.grouped),
        );
    }
}

fn alarms(all: &[Outcome]) {
    let lines: Vec<&Outcome> = all.iter().filter(|o| o.is(Hides::Nothing)).collect();
    if lines.is_empty() {
        return;
    }
    println!("\nfalse alarms without an effect (95 % bounds), and verdicts other than no_effect_found");
    println!("{:>26} | {:>5} {:>22} {:>22} {:>7}", "", "n", "p < 0.05", "p < 0.01", "verdict");
    let mut groups = grouped(&lines, |o| o.colour.clone());
    groups.extend(grouped(&lines, |o| format!("{} {}", o.colour, o.family)));
    groups.insert("~ all".into(), lines.clone());
    for (name, lines) in groups {
        let rate = |limit: f64| {
            // a run without an answer is a false alarm as well
            let n = lines.iter().filter(|o| o.p < limit || o.failure.is_some()).count();
            let (low, high) = bounds(n, lines.len());
            format!("{:.3} [{low:.3}, {high:.3}]", n as f64 / lines.len() as f64)
        };
        let verdict = share(&lines, |o| o.verdict != "no_effect_found");
        println!("{name:>26} | {:>5} {:>22} {:>22} {verdict:>7}", lines.len(), rate(0.05), rate(0.01));
    }
}

/// Clopper and Pearson's 95 % bounds of a share.
fn bounds(k: usize, n: usize) -> (f64, f64) {
    let quantile = |a: usize, b: usize, q: f64| Beta::new(a as f64, b as f64).map_or(f64::NAN, |d| d.inverse_cdf(q));
    let low = if k == 0 { 0.0 } else { quantile(k, n - k + 1, 0.025) };
    let high = if k == n { 1.0 } else { quantile(k + 1, n - k, 0.975) };
    (low, high)
}

fn pairs(all: &[Outcome]) {
    let lines: Vec<&Outcome> = all.iter().filter(|o| o.is(Hides::Pair)).collect();
    if lines.is_empty() {
        return;
    }
    println!("\ntwo effects\n{:>26} | {:>4} {:>6} {:>6} {:>22}", "", "n", "top", "groups", "groups, nothing else");
    let mut groups = grouped(&lines, |o| o.family.clone());
    groups.insert("~ all".into(), lines.clone());
    for (name, lines) in groups {
        let both = share(&lines, |o| o.grouped && o.only);
        println!(
            "{name:>26} | {:>4} {:>6} {:>6} {both:>22}",
            lines.len(),
            share(&lines, |o| o.top),
            share(&lines, |o| o.grouped)
        );
    }
}

fn gusts(all: &[Outcome]) {
    let lines: Vec<&Outcome> = all.iter().filter(|o| o.is(Hides::Gust)).collect();
    if lines.is_empty() {
        return;
    }
    println!(
        "\ndisturbances\n{:>26} | {:>4} {:>12} {:>15} {:>13}",
        "", "n", "disturbance", "right equation", "effect named"
    );
    let mut groups = grouped(&lines, |o| o.family.clone());
    groups.extend(grouped(&lines, |o| o.colour.clone()));
    groups.insert("~ all".into(), lines.clone());
    for (name, lines) in groups {
        println!(
            "{name:>26} | {:>4} {:>12} {:>15} {:>13}",
            lines.len(),
            share(&lines, |o| o.verdict == "disturbance"),
            share(&lines, |o| o.verdict == "disturbance" && o.place),
            share(&lines, |o| o.verdict == "effect_found")
        );
    }
}

fn outside(all: &[Outcome]) {
    let lines: Vec<&Outcome> = all.iter().filter(|o| o.is(Hides::Outside)).collect();
    if lines.is_empty() {
        return;
    }
    println!(
        "\ncauses outside of the catalogue\n{:>26} | {:>4} {:>6} {:>7} {:>13} {:>10} {:>16} {:>6} {:>6}",
        "", "n", "found", "warned", "place in two", "explained", "warned of others", "h-med", "h-5%"
    );
    let mut groups = grouped(&lines, |o| o.truth[0].split('(').next().unwrap_or("").into());
    groups.extend(grouped(&lines, |o| o.family.clone()));
    groups.insert("~ all".into(), lines.clone());
    for (name, lines) in groups {
        let mut held: Vec<f64> = lines.iter().filter_map(|o| o.validation_ratio).collect();
        let (median, low) = (quantile(&mut held, 0.5), quantile(&mut held, 0.05));
        let open: Vec<&Outcome> = lines.iter().copied().filter(|o| o.warned || !o.explained()).collect();
        println!(
            "{name:>26} | {:>4} {:>6} {:>7} {:>13} {:>10} {:>16} {median:>6.2} {low:>6.2}",
            lines.len(),
            share(&lines, Outcome::detected),
            share(&lines, |o| o.warned),
            share(&lines, |o| o.place_in_two),
            share(&lines, |o| !o.warned && o.explained()),
            share(&open, |o| o.warned)
        );
    }
}

fn quantile(values: &mut [f64], q: f64) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * q).round() as usize]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_those_of_the_tables() {
        // 5 of 100: 1.64 % to 11.28 %
        let (low, high) = bounds(5, 100);
        assert!((low - 0.0164).abs() < 2e-4 && (high - 0.1128).abs() < 2e-4, "{low} {high}");
        assert_eq!((bounds(0, 10).0, bounds(10, 10).1), (0.0, 1.0));
    }
}
