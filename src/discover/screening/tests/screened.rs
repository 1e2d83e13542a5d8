//! Small screenings whose answers are known.

use super::colour::Colour;
use crate::bins::MeasuredRows;
use crate::screening::*;
use fdm_numeric::random::Stream;
use std::f64::consts::TAU;

/// A signal of so many cycles in a record, with a phase for each output.
fn wave(samples: usize, channels: usize, cycles: f64) -> Signals {
    let at = |k: usize| TAU * cycles * (k / channels) as f64 / samples as f64 + (k % channels) as f64;
    (0..samples * channels).map(|k| fdm_grammar::math::sin(at(k))).collect()
}

/// Runs with white noise of unit variance, two fitted columns and six linear directions.
fn records(runs: usize, samples: usize, channels: usize, colour: Colour, seed: u64) -> (Vec<Record>, Vec<Direction>) {
    let mut normal = Stream::seeded(seed);
    let mut record = |_| {
        let noise = colour.noise(samples, channels, &mut normal);
        Record {
            interval: 0.1,
            residual: (0..samples * channels).map(|k| noise[k % channels][k / channels]).collect(),
            fitted: [5.3, 9.1].iter().map(|c| Some(wave(samples, channels, *c))).collect(),
            directions: (0..6).map(|k| wave(samples, channels, 6.0 + 3.7 * k as f64)).collect(),
            rows: None,
            deviations: None,
        }
    };
    let directions = (0..6).map(|candidate| Direction { candidate, size: 2.0, shape: Shape::Linear }).collect();
    ((0..runs).map(&mut record).collect(), directions)
}

fn add(record: &mut Record, direction: usize, amount: f64) {
    let effect = record.directions[direction].clone();
    record.residual.iter_mut().zip(effect).for_each(|(r, e)| *r += amount * e);
}

fn screened(records: &[Record], channels: usize, directions: &[Direction]) -> Screening {
    let options = ScreeningOptions { draws: 50, ..ScreeningOptions::default() };
    screen(records, channels, directions, &options).unwrap()
}

#[test]
fn an_effect_is_found_with_its_size() {
    let (mut runs, directions) = records(2, 200, 2, Colour::White, 3);
    runs.iter_mut().for_each(|r| add(r, 4, 0.5));
    let found = screened(&runs, 2, &directions);
    assert_eq!(found.ranking[0], 4);
    assert!(found.family_wise < 1e-4, "{}", found.family_wise);
    // 800 samples of a wave of power 1/2: standard error 1/20
    assert!((found.candidates[4].amount - 0.5).abs() < 0.2, "{}", found.candidates[4].amount);
    assert!(found.candidates[4].gain() > 20.0);
    assert!(found.consistency[4].as_ref().unwrap().chance > 1e-3);
    assert!(found.cosine(4, 4) > 0.999 && found.cosine(4, 1).abs() < 0.3);
    let detectable = found.candidates[1].detectable.unwrap();
    // four to five standard errors, in units of size 2
    assert!((0.3..0.7).contains(&detectable), "{detectable}");
    assert_eq!(found.bias(4).len(), 2);
}

#[test]
fn noise_alone_is_no_effect() {
    let mean: f64 = (0..10)
        .map(|seed| {
            let (runs, directions) = records(1, 200, 2, Colour::Pink, 40 + seed);
            screened(&runs, 2, &directions).family_wise / 10.0
        })
        .sum();
    assert!((0.25..0.75).contains(&mean), "{mean}");
}

#[test]
fn the_same_runs_give_the_same_bits() {
    let (runs, directions) = records(2, 150, 2, Colour::Pink, 9);
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let alone = one.install(|| screened(&runs, 2, &directions));
    let many = screened(&runs, 2, &directions);
    assert_eq!(alone.family_wise.to_bits(), many.family_wise.to_bits());
    assert_eq!(alone.candidates, many.candidates);
}

#[test]
fn gaps_do_not_make_effects() {
    let mut mean = [0.0; 6];
    let repeats = 30;
    for seed in 0..repeats {
        let (mut runs, directions) = records(1, 400, 2, Colour::White, 100 + seed);
        for (k, value) in runs[0].residual.iter_mut().enumerate() {
            // one output at every fourth sample, the other with a hole
            let gap = if k % 2 == 0 { (k / 2) % 4 != 0 } else { (120..200).contains(&(k / 2)) };
            if gap {
                *value = f64::NAN;
            }
        }
        let found = screen(&runs, 2, &directions, &ScreeningOptions { draws: 0, dropped: 4 }).unwrap();
        for (mean, candidate) in mean.iter_mut().zip(&found.candidates) {
            *mean += candidate.statistic / repeats as f64;
        }
    }
    // chi-square of one degree of freedom has the mean 1
    assert!(mean.iter().all(|m| (0.4..1.9).contains(m)), "{mean:?}");
}

#[test]
fn directions_are_needed_where_something_was_measured() {
    let (mut runs, directions) = records(2, 400, 2, Colour::Pink, 11);
    for run in &mut runs {
        add(run, 4, 0.5);
        let measured = |k: usize| if k.is_multiple_of(2) { (k / 2) % 4 == 1 } else { (k / 2) % 8 == 5 };
        run.residual.iter_mut().enumerate().filter(|(k, _)| !measured(*k)).for_each(|(_, v)| *v = f64::NAN);
    }
    let whole = screened(&runs, 2, &directions);
    for run in &mut runs {
        let time: Vec<f64> = (0..400).map(f64::from).collect();
        run.rows = MeasuredRows::of(&run.residual, 2, &time);
        let taken = |signal: &Signals| MeasuredRows::taken(run.rows.as_ref(), signal.clone(), 2);
        run.directions = run.directions.iter().map(taken).collect();
        assert_eq!(run.directions[0].len(), 200);
        let again = run.direction(3, 2);
        let full = wave(400, 2, 6.0 + 3.7 * 3.0);
        assert!((0..800).all(|k| again[k] == if (k / 2) % 4 == 1 { full[k] } else { 0.0 }));
    }
    let few = screened(&runs, 2, &directions);
    assert_eq!((whole.candidates, whole.family_wise.to_bits()), (few.candidates, few.family_wise.to_bits()));
}

#[test]
fn what_cannot_be_judged_is_said() {
    let options = ScreeningOptions::default();
    let fails = |runs: &[Record], directions: &[Direction]| screen(runs, 2, directions, &options).err();
    let (mut runs, directions) = records(2, 100, 2, Colour::White, 5);
    assert_eq!(fails(&[], &directions), Some(ScreeningError::Nothing));
    runs[1].residual[..190].fill(f64::NAN);
    assert_eq!(fails(&runs, &directions), Some(ScreeningError::TooShort { run: 1, samples: 5, least: 8 }));
    let (mut runs, directions) = records(1, 100, 2, Colour::White, 5);
    runs[0].directions[3][7] = f64::INFINITY;
    assert_eq!(fails(&runs, &directions), Some(ScreeningError::NotFinite { run: 0 }));
    runs[0].residual[7] = f64::NAN;
    assert_eq!(fails(&runs, &directions), None, "what is not measured does not matter");
    runs[0].residual.fill(0.0);
    runs[0].directions[3][7] = 0.0;
    assert_eq!(fails(&runs, &directions), Some(ScreeningError::NothingWrong));
    runs[0].residual.iter_mut().step_by(2).enumerate().for_each(|(k, r)| *r = (k as f64).sin());
    assert_eq!(fails(&runs, &directions), None, "one output without any misfit");
}

#[test]
fn a_spike_and_a_hum_are_cut_back() {
    let (mut runs, directions) = records(2, 300, 2, Colour::White, 6);
    runs[1].residual[2 * 77 + 1] = 40.0;
    let found = screened(&runs, 2, &directions);
    let spike = |o: &Outlier| (o.run, o.channel, o.place) == (1, 1, OutlierPlace::Sample(77));
    assert!(found.outliers.iter().any(|o| spike(o) && o.size > 8.0), "{:?}", found.outliers);
    assert!(found.family_wise > 0.01);
    let (mut runs, directions) = records(2, 300, 2, Colour::White, 6);
    for k in 0..300 {
        runs[0].residual[2 * k] += 2.0 * fdm_grammar::math::cos(TAU * 50.0 * (k as f64 + 0.5) / 300.0);
    }
    let found = screened(&runs, 2, &directions);
    let hum =
        |o: &Outlier| o.run == 0 && matches!(o.place, OutlierPlace::Frequency(f) if (f - 50.0 / 30.0).abs() < 0.02);
    assert!(found.outliers.iter().any(hum), "{:?}", found.outliers);
}

#[test]
fn noise_that_outputs_share_is_seen() {
    let (runs, directions) = records(2, 300, 3, Colour::Common, 8);
    assert!(screened(&runs, 3, &directions).correlated);
    let (runs, directions) = records(2, 300, 3, Colour::White, 8);
    assert!(!screened(&runs, 3, &directions).correlated);
}

#[test]
fn repeated_runs_tell_the_noise_whatever_the_misfit() {
    let (mut runs, directions) = records(3, 300, 1, Colour::White, 12);
    // a lack of fit that no candidate has, larger than the noise, the same in all runs
    for run in &mut runs {
        run.residual.iter_mut().enumerate().for_each(|(k, r)| *r += ((k * k * 7) % 301) as f64 / 50.0);
    }
    let found = screened(&runs, 1, &directions);
    let level = found.spectra[0].at(0.5_f64.ln());
    assert!((0.7..1.4).contains(&level), "{level}");
    // run by run different: the lack of fit is taken for noise
    for (k, run) in runs.iter_mut().enumerate() {
        run.directions[0].iter_mut().for_each(|d| *d *= 1.0 + k as f64);
    }
    assert!(screened(&runs, 1, &directions).spectra[0].at(0.5_f64.ln()) > 2.5);
}

#[test]
fn an_effect_of_one_run_only_is_not_consistent() {
    let (mut runs, directions) = records(3, 300, 2, Colour::White, 13);
    add(&mut runs[1], 2, 0.8);
    let found = screened(&runs, 2, &directions);
    let judged = found.consistency[2].as_ref().unwrap();
    assert!(judged.chance < 1e-6 && judged.freedom == 2, "{judged:?}");
    let (amount, error) = judged.amounts[1].unwrap();
    assert!((amount - 0.8).abs() < 5.0 * error && judged.amounts[0].unwrap().0.abs() < 5.0 * error, "{judged:?}");
}

#[test]
fn joined_parameters_are_scored_together() {
    let (mut runs, mut directions) = records(2, 200, 2, Colour::White, 14);
    runs.iter_mut().for_each(|r| {
        add(r, 1, 0.25);
        add(r, 2, -0.25);
    });
    let apart = screened(&runs, 2, &directions);
    for (k, direction) in directions.iter_mut().enumerate() {
        let joined = k == 1 || k == 2;
        direction.candidate = if k > 1 { k - 1 } else { k };
        direction.shape = if joined { Shape::Joint { group: 0 } } else { Shape::Linear };
    }
    let found = screened(&runs, 2, &directions);
    let sum = apart.candidates[1].statistic + apart.candidates[2].statistic;
    assert!((found.candidates[1].statistic / sum - 1.0).abs() < 0.2);
    assert_eq!(found.amounts[1].len(), 2);
    assert!((found.amounts[1][1].1 + 0.25).abs() < 0.2 && found.amounts[1][1].0 == 2);
    assert_eq!(found.ranking[0], 1);
}

#[test]
fn what_was_fitted_cannot_be_found() {
    let (mut runs, directions) = records(2, 200, 2, Colour::White, 15);
    for run in &mut runs {
        run.directions[3] = run.fitted[1].clone().unwrap();
    }
    let found = screened(&runs, 2, &directions);
    assert_eq!(found.candidates[3].direction, None);
    assert_eq!(found.candidates[3].detectable, None);
    assert!(found.consistency[3].is_none());
    assert!((found.compensation[(1, 3)] - 1.0).abs() < 1e-6);
}

/// A bin from -1 to 1 in the first output.
fn ramp(samples: usize, channels: usize) -> Signals {
    let at = |k: usize| 2.0 * (k / channels) as f64 / samples as f64 - 1.0;
    (0..samples * channels).map(|k| if k.is_multiple_of(channels) { at(k) } else { 0.0 }).collect()
}

#[test]
fn a_drift_is_found_in_the_lowest_lines() {
    let (mut runs, directions) = records(2, 300, 2, Colour::White, 21);
    for run in &mut runs {
        run.directions[4] = ramp(300, 2);
        // 200 in twice the gain: sum of squares of 600 values of mean square 1/3
        add(run, 4, 0.45);
    }
    let found = screened(&runs, 2, &directions);
    assert_eq!(found.ranking[0], 4);
    assert!(found.family_wise < 0.01 && (0.3..0.6).contains(&found.candidates[4].amount), "{}", found.family_wise);
}

#[test]
fn a_drift_is_no_effect_in_noise_that_drifts() {
    let chance = |seed: u64| {
        let (mut runs, directions) = records(2, 300, 1, Colour::Pink, 300 + seed);
        runs.iter_mut().for_each(|run| run.directions[4] = ramp(300, 1));
        screened(&runs, 1, &directions).candidates[4].chance
    };
    let found: Vec<f64> = (0..30).map(chance).collect();
    assert!(found.iter().filter(|p| **p < 0.05).count() <= 5, "{found:?}");
    // nor is it taken for noise in every case
    assert!(found.iter().filter(|p| **p < 0.5).count() >= 5, "{found:?}");
}

/// All candidates together would leave nothing of three means, nor of the bins below the corner of the noise.
#[test]
fn a_zero_is_found_in_slow_noise() {
    let (family, mut normal) = (super::family::short_period(3, false, false), Stream::seeded(31));
    let mut chance = |deviations: f64| {
        let mut runs = family.noisy(Colour::Markov, 0.05, &mut normal);
        let own = runs.iter().flat_map(|run| run.residual.iter().step_by(family.channels));
        let size = (own.map(|r| r * r).sum::<f64>() / 1200.0).sqrt();
        // the mean of 400 such values has the variance of 400 / 19 independent ones
        let zero = deviations * size * (19.0_f64 / 400.0).sqrt();
        runs.iter_mut().for_each(|run| run.residual.iter_mut().step_by(family.channels).for_each(|r| *r += zero));
        let found = screened(&runs, family.channels, &family.directions);
        (found.family_wise, found.ranking[0])
    };
    let found: Vec<(f64, usize)> = (0..6).map(|_| chance(5.0)).collect();
    assert!(found.iter().filter(|(p, first)| *p < 0.01 && *first == 0).count() >= 5, "{found:?}");
    let nothing: Vec<(f64, usize)> = (0..20).map(|_| chance(0.0)).collect();
    assert!(nothing.iter().filter(|(p, _)| *p < 0.05).count() <= 4, "{nothing:?}");
}

#[test]
fn noise_alone_has_the_same_spectrum_without_judging() {
    let (runs, directions) = records(2, 200, 2, Colour::Pink, 22);
    let alone = spectra(&runs, 2, &ScreeningOptions::default()).unwrap();
    assert_eq!(alone, screened(&runs, 2, &directions).spectra);
}

#[test]
fn what_a_resonance_leaves_at_the_ends_is_no_effect() {
    // a short pulse where the record begins: all bins below the resonance alike, as what a cut-off wave leaves
    let chance = |seed: u64| {
        let (mut runs, directions) = records(2, 300, 1, Colour::Resonant, 500 + seed);
        for (k, run) in runs.iter_mut().enumerate() {
            // no run repeats the other
            run.directions[4] = (0..300).map(|n| (k as f64 + 1.0) * (-(n as f64 / 4.0)).exp()).collect();
            run.directions[0] = wave(300, 1, 12.0 + 5.3 * k as f64);
        }
        screen(&runs, 1, &directions, &ScreeningOptions { draws: 0, dropped: 1 }).unwrap().candidates[4].chance
    };
    let found: Vec<f64> = (0..40).map(chance).collect();
    assert!(found.iter().filter(|p| **p < 0.05).count() <= 6, "{found:?}");
}
