//! Studies of the level and of the power: figures in docs/notebook/blind.csv.

use super::colour::Colour;
use super::family::{FAMILIES, Family};
use crate::screening::*;
use fdm_numeric::random::Stream;
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
    let whole = ScreeningOptions::default();
    let number = |name, otherwise: usize| number(name, otherwise as u64) as usize;
    ScreeningOptions { draws: number("FDM_DRAWS", whole.draws), dropped: number("FDM_DROPPED", whole.dropped) }
}

/// Chances of the best candidate over repeats of noise alone.
fn alarms(name: &str, family: &Family, colour: Colour) {
    let (repeats, seed) = (number("FDM_REPEATS", 200), number("FDM_SEED", 77));
    let chance = |k: u64| {
        let mut normal = Stream::seeded(seed * 100_000 + k);
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

/// An effect of a size that predicts so many units of log-likelihood: chance, rank of the truth.
fn hidden(family: &Family, colour: Colour, energies: &[f64], gain: f64, seed: u64) -> (f64, usize) {
    let mut normal = Stream::seeded(seed);
    let mut records = family.noisy(colour, 0.05, &mut normal);
    let candidates = family.directions.iter().map(|d| d.candidate + 1).max().unwrap();
    let truth = seed as usize % candidates;
    let amount = |k: usize| (2.0 * gain / energies[k]).sqrt();
    // of a candidate with many sizes, the one that is nearest to the size wanted
    let own = (0..energies.len()).filter(|k| family.directions[*k].candidate == truth);
    let k = own.min_by(|a, b| amount(*a).ln().abs().total_cmp(&amount(*b).ln().abs())).unwrap();
    let sign = if family.directions[k].shape == Shape::Linear && normal.normal_of_pair() < 0.0 { -1.0 } else { 1.0 };
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
/// 300 directions of 100 candidates, as disturbances that are made of inputs and states drive outputs of common modes.
fn many(runs: usize, samples: usize, channels: usize) -> (Vec<Record>, Vec<Direction>) {
    let mut normal = Stream::seeded(4);
    let mut records = Vec::new();
    for run in 0..runs {
        let base: Vec<Vec<f64>> = (0..12)
            .map(|b| {
                let (pole, mut x) = ([1.0, 0.1, 0.02][b / 4], 0.0);
                let u = |n: usize| if (n / (31 + 13 * run + 17 * (b % 4))).is_multiple_of(2) { 1.0 } else { -0.6 };
                let mut next = |n: usize| {
                    x += pole * (u(n) - x);
                    x
                };
                (0..samples).map(&mut next).collect()
            })
            .collect();
        let mut random = Stream::seeded(8);
        let mut signal = |k: usize| -> Signals {
            let mut pick = || (random.uniform() * 12.0) as usize;
            let (i, j, delay) = (pick(), pick(), pick());
            let force = |n: usize| {
                let (a, b) = (base[i][n.saturating_sub(delay)], base[j][n]);
                [a, a * b, a * a.abs(), a * a * a][k % 4]
            };
            let weights: Vec<f64> = (0..channels).map(|_| random.normal_of_pair()).collect();
            let mut all = vec![0.0; samples * channels];
            let mut modes = [[0.0; 2]; 3];
            for n in 0..samples {
                for (mode, [x, v]) in modes.iter_mut().enumerate() {
                    let pole = [0.03, 0.08, 0.2][mode];
                    *v += pole * (pole * (force(n) - *x) - 0.8 * *v);
                    *x += *v;
                }
                for (c, weight) in weights.iter().enumerate() {
                    all[n * channels + c] = weight * modes[c % 3][0] + 0.2 * modes[(c + k) % 3][1];
                }
            }
            all
        };
        records.push(Record {
            interval: 0.02,
            fitted: (0..25).map(|k| Some(signal(k))).collect(),
            directions: (0..300).map(&mut signal).collect(),
            residual: (0..samples * channels).map(|_| normal.normal_of_pair()).collect(),
            rows: None,
            deviations: None,
        });
    }
    let shape = |k: usize| if k.is_multiple_of(3) { Shape::Smallest } else { Shape::Finite };
    let directions = (0..300).map(|k| Direction { candidate: k / 3, size: 1.0, shape: shape(k) }).collect();
    (records, directions)
}

#[test]
#[ignore = "a measurement of time"]
fn speed() {
    let (records, directions) = many(3, 2000, 8);
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for draws in [0, number("FDM_DRAWS", 400) as usize] {
        let options = ScreeningOptions { draws, ..ScreeningOptions::default() };
        let start = std::time::Instant::now();
        let found = one.install(|| screen(&records, 8, &directions, &options).unwrap());
        println!(
            "{draws} draws: {:.2} s on one thread (chance {:.2})",
            start.elapsed().as_secs_f64(),
            found.family_wise
        );
    }
}

/// Runs that repeat each other.
#[test]
#[ignore = "a study: some minutes in release"]
fn false_alarms_repeated() {
    println!("| family | noise | runs | at 20 % | at 5 % | at 1 % | candidates in front |");
    let made = [
        ("short period, 2 equal runs", super::family::short_period(2, true, true)),
        ("ship, 3 equal runs", super::family::ship(300.0, 3, true, true)),
    ];
    for (name, family) in made {
        for colour in chosen(&Colour::ALONE) {
            alarms(name, &family, colour);
        }
    }
}
