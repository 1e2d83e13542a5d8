//! Studies of the level and of the power: tables in docs/diagnosis.md.

use super::colour::Colour;
use super::family::{FAMILIES, Family};
use crate::diagnose::screen::calibration::Normal;
use crate::diagnose::screen::*;
use rayon::prelude::*;

fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).ok().and_then(|r| r.parse().ok()).unwrap_or(otherwise)
}

fn chosen(colours: &[Colour]) -> Vec<Colour> {
    let wanted = std::env::var("FDM_NOISE").unwrap_or_default();
    colours.iter().copied().filter(|c| wanted.is_empty() || wanted.contains(&format!("{c:?}"))).collect()
}

/// The families wanted by `FDM_FAMILY` (all of them without it).
fn families() -> Vec<(&'static str, Family)> {
    let wanted = std::env::var("FDM_FAMILY").unwrap_or_default();
    let own = FAMILIES.iter().filter(|(name, _)| wanted.is_empty() || wanted.split(',').any(|w| w == *name));
    own.map(|(name, make)| (*name, make())).collect()
}

fn options() -> ScreeningOptions {
    ScreeningOptions { draws: number("FDM_DRAWS", 200) as usize, ..ScreeningOptions::default() }
}

/// Chances of the best candidate over repeats of noise alone.
fn alarms(name: &str, family: &Family, colour: Colour) {
    let (repeats, seed) = (number("FDM_REPEATS", 200), number("FDM_SEED", 77));
    let chance = |k: u64| {
        let mut normal = Normal::new(seed * 100_000 + k);
        let records = family.noisy(colour, 0.05, &mut normal);
        let found = screen(&records, family.channels, &family.directions, &options()).unwrap();
        (found.family_wise, found.ranking[0])
    };
    let found: Vec<(f64, usize)> = (0..repeats).into_par_iter().map(chance).collect();
    let share = |level: f64| found.iter().filter(|(p, _)| *p < level).count() as f64 / repeats as f64;
    let mut first = vec![0; family.directions.len()];
    found.iter().filter(|(p, _)| *p < 0.05).for_each(|(_, c)| first[*c] += 1);
    let mut order: Vec<usize> = (0..first.len()).filter(|c| first[*c] > 0).collect();
    order.sort_by_key(|c| std::cmp::Reverse(first[*c]));
    let which: Vec<String> = order.iter().take(4).map(|c| format!("{c}: {}", first[*c])).collect();
    println!(
        "| {name} | {colour:?} | {repeats} | {:.3} | {:.3} | {:.3} | {} |",
        share(0.2),
        share(0.05),
        share(0.01),
        which.join(", ")
    );
}

#[test]
#[ignore = "a study: some minutes in release"]
fn false_alarms() {
    println!("| family | noise | runs | at 20 % | at 5 % | at 1 % | candidates in front |");
    for (name, family) in families() {
        for colour in chosen(&Colour::ALONE) {
            alarms(name, &family, colour);
        }
    }
}

#[test]
#[ignore = "a study: some minutes in release"]
fn false_alarms_shared() {
    println!("| family | noise | runs | at 20 % | at 5 % | at 1 % | candidates in front |");
    for (name, family) in families() {
        for colour in chosen(&Colour::SHARED) {
            alarms(name, &family, colour);
        }
    }
}

/// An effect of a size that promises so many units of log-likelihood: chance, rank of the truth.
fn hidden(family: &Family, colour: Colour, energies: &[f64], gain: f64, seed: u64) -> (f64, usize) {
    let mut normal = Normal::new(seed);
    let mut records = family.noisy(colour, 0.05, &mut normal);
    let candidates = family.directions.iter().map(|d| d.candidate + 1).max().unwrap();
    let truth = seed as usize % candidates;
    let amount = |k: usize| (2.0 * gain / energies[k]).sqrt();
    // of a candidate with many sizes, the one that is nearest to the size wanted
    let own = (0..energies.len()).filter(|k| family.directions[*k].candidate == truth);
    let k = own.min_by(|a, b| amount(*a).ln().abs().total_cmp(&amount(*b).ln().abs())).unwrap();
    let sign = if family.directions[k].shape == Shape::Linear && normal.next() < 0.0 { -1.0 } else { 1.0 };
    for record in &mut records {
        for (value, effect) in record.residual.iter_mut().zip(&record.directions[k]) {
            *value += sign * amount(k) * effect;
        }
    }
    let found = screen(&records, family.channels, &family.directions, &options()).unwrap();
    (found.family_wise, found.ranking.iter().position(|c| *c == truth).unwrap())
}

#[test]
#[ignore = "a study: some minutes in release"]
fn power() {
    let (repeats, seed) = (number("FDM_REPEATS", 200), number("FDM_SEED", 77));
    println!("| family | noise | gain | at 5 % | at 1 % | first | in 3 | in 8 |");
    for (name, family) in families() {
        for colour in chosen(&Colour::ALONE) {
            let energies = family.energies(colour, 0.05);
            for gain in [5.0, 10.0, 15.0, 30.0] {
                let one = |k: u64| hidden(&family, colour, &energies, gain, seed * 1_000_000 + k);
                let found: Vec<(f64, usize)> = (0..repeats).into_par_iter().map(one).collect();
                let share = |n: usize| n as f64 / repeats as f64;
                let detected = |level: f64| share(found.iter().filter(|f| f.0 < level).count());
                let within = |rank: usize| share(found.iter().filter(|f| f.1 < rank).count());
                println!(
                    "| {name} | {colour:?} | {gain} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} |",
                    detected(0.05),
                    detected(0.01),
                    within(1),
                    within(3),
                    within(8)
                );
            }
        }
    }
}
