//! Long comparisons of both domains.

use fdm::diagnose::{Diagnosis, Domain, Verdict};
use fdm::effect::Catalogue;
use std::time::Instant;
use support::hidden::*;

fn told(found: &Diagnosis) -> (String, f64, String, usize) {
    match found.causes.first() {
        Some(c) => {
            let p = &c.parameters[0];
            let value = format!("{:.4}+-{:.4}", p.value, p.standard_error.unwrap_or(f64::NAN));
            (c.place.to_string(), c.loss, value, c.group.len())
        }
        None => (format!("{:?}", found.verdict), 0.0, String::new(), 0),
    }
}

#[test]
#[ignore = "a study"]
fn domains() {
    let catalogue = Catalogue::standard();
    let seeds: u64 = std::env::var("FDM_SEEDS").ok().and_then(|s| s.parse().ok()).unwrap_or(2);
    let (mut count, mut same, mut right, mut near) = (0, 0, [0; 2], 0);
    let mut nulls = [0; 3];
    println!("{:14} {:24} {:5} | time: named, gain, size, p, s | frequency", "system", "hidden", "noise");
    for system in SYSTEMS {
        let model = system.model();
        for hidden in system.hidden.iter().map(Some).chain([None]) {
            for (pink, seed) in (0..2 * seeds).map(|k| (k % 2 == 1, 10 + k)) {
                let runs = system.records(hidden, 2, 0.05, pink, seed);
                let found = [Domain::Time, frequency()].map(|domain| {
                    let begin = Instant::now();
                    let found = diagnosed(&model, &runs, &[], &catalogue, domain).unwrap();
                    (found, begin.elapsed().as_secs_f64())
                });
                let name = hidden.map_or("-", |h| h.effect);
                let line: Vec<String> = found
                    .iter()
                    .map(|(d, s)| {
                        let (place, gain, value, group) = told(d);
                        format!("{place:26} {gain:8.1} {value:18} group {group} ({:.2}) {s:4.1} s", d.explanations[0].probability)
                    })
                    .collect();
                println!(
                    "{:14} {name:24} {:5} | {}",
                    system.name,
                    if pink { "pink" } else { "white" },
                    line.join(" | ")
                );
                let named = |k: usize| told(&found[k].0).0;
                match hidden {
                    None => {
                        nulls[2] += 1;
                        (0..2).for_each(|k| nulls[k] += usize::from(found[k].0.verdict != Verdict::NoEffectFound));
                    }
                    Some(hidden) => {
                        count += 1;
                        same += usize::from(named(0) == named(1));
                        (0..2).for_each(|k| right[k] += usize::from(named(k) == hidden.effect));
                        let gains = [0, 1].map(|k| told(&found[k].0).1);
                        near += usize::from((gains[0] - gains[1]).abs() < 5.0 + 0.1 * gains[0]);
                    }
                }
            }
        }
    }
    println!("same cause {same} of {count}; right {} by time, {} by frequency; gains alike {near}", right[0], right[1]);
    println!("alarms of {}: {} by time, {} by frequency", nulls[2], nulls[0], nulls[1]);
}

/// The unstable helicopter in both domains, with the whole catalogue of linear effects.
#[test]
#[ignore = "a study"]
fn hover_in_both_domains() {
    let runs = hover_records(3, 0.03);
    for domain in [frequency(), Domain::Time] {
        let begin = Instant::now();
        match diagnosed(&hover(), &runs, &[], &some(), domain) {
            Ok(found) => {
                let (place, gain, value, group) = told(&found);
                println!(
                    "{place} gain {gain:.1} {value} group {group} ({:.2}), {:?}",
                    found.explanations[0].probability,
                    begin.elapsed()
                );
            }
            Err(why) => println!("{why}"),
        }
    }
}
