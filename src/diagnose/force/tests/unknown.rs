//! Causes that no catalogue has: laws that repeat, and modes narrower than any band.
#![allow(clippy::unwrap_used)]

use super::*;

fn attributed(case: &Case) -> (Heard, Attribution) {
    let heard = heard(&case.model, &case.passages()).unwrap();
    let attribution = attribute(&case.model, &heard, None);
    (heard, attribution)
}

#[test]
fn what_repeats_is_a_law_in_its_equation() {
    let case = Case::new(&FAMILIES[0], Hidden::Strange, false, 0.02, 0.0, SHORT, 11);
    let (Heard { places, laws, .. }, found) = attributed(&case);
    assert!(laws.evidence() > 3.0 && laws.evidence() > places.evidence(), "{laws:?} {:?}", places.forces);
    assert_eq!(found.verdict, Verdict::UnknownCause);
    assert!(
        found.sites[..2].iter().any(|s| s.place.kind == Kind::Equation && s.place.name == "q"),
        "{:?}",
        found.sites
    );
}

#[test]
fn what_does_not_repeat_is_a_disturbance_in_its_equation() {
    // a force on de is nearly one in the equation of q: the equation is told first
    let case = Case::new(&FAMILIES[0], Hidden::Gust(1), true, 0.01, 0.1, SHORT, 7);
    let (Heard { places, laws, .. }, found) = attributed(&case);
    assert!(places.evidence() > laws.evidence() + 3.0, "{laws:?} {:?}", places.forces);
    assert_eq!((found.verdict, found.sites[0].place.name.as_str()), (Verdict::Disturbance, "q"));
}

#[test]
fn a_narrow_mode_in_a_sensor_is_seen_there() {
    let case = Case::new(&FAMILIES[0], Hidden::Mode, false, 0.02, 0.0, 2 * SHORT, 5);
    let (Heard { leftover, .. }, found) = attributed(&case);
    assert!(leftover.repeatable < 0.001, "{leftover:?}");
    assert!(leftover.coherences[0].output == "qm" && leftover.coherences[0].partner.input() == "de", "{leftover:?}");
    assert_eq!(found.verdict, Verdict::UnknownCause);
    assert!(found.sites[..2].iter().any(|s| s.place.kind == Kind::Output && s.place.name == "qm"), "{:?}", found.sites);
}

#[test]
fn noise_is_neither() {
    let case = Case::new(&FAMILIES[0], Hidden::Nothing, true, 0.03, 0.0, SHORT, 3);
    let (_, found) = attributed(&case);
    assert!(found.warnings.is_empty() && found.sites.is_empty(), "{found:?}");
    assert_eq!(found.verdict, Verdict::Nothing);
}

#[test]
fn an_equation_stands_before_an_input_that_moves_it() {
    let case = Case::new(&FAMILIES[0], Hidden::Nothing, false, 0.05, 0.0, SHORT, 3);
    let all = places(&case.model);
    let ranked = |evidence: [f64; 3]| {
        let mut list: Vec<(Place, f64)> = all.iter().cloned().zip(evidence).collect();
        standing::rank(&case.model, &mut list, |l| (&l.0, l.1));
        list.into_iter().map(|l| l.0.name).collect::<Vec<_>>()
    };
    // de, al, q: within odds of 20 to 1 the first equation behind the input goes before it
    assert_eq!(ranked([10.0, 1.0, 9.0]), ["q", "de", "al"]);
    assert_eq!(ranked([10.0, 1.0, 2.0]), ["de", "q", "al"]);
    assert_eq!(ranked([5.0, 6.0, 4.0]), ["al", "q", "de"]);
}

#[test]
fn noise_that_sensors_share_is_no_force() {
    let mut case = Case::new(&FAMILIES[0], Hidden::Nothing, false, 0.03, 0.0, SHORT, 9);
    let (mut normal, q) = (Normal(ChaCha8Rng::seed_from_u64(77)), 3);
    for run in &mut case.runs {
        let rms = |c: usize| (run.measured.iter().skip(c).step_by(q).map(|v| v * v).sum::<f64>() / SHORT as f64).sqrt();
        let sizes: Vec<f64> = (0..q).map(rms).collect();
        for row in run.measured.chunks_exact_mut(q) {
            let shared = normal.next();
            row.iter_mut().zip(&sizes).for_each(|(z, size)| *z += 0.05 * size * shared);
        }
    }
    let case = Case::fitted(&case.model, case.runs);
    let (Heard { places, laws, .. }, found) = attributed(&case);
    assert!(places.evidence() < 3.0 && laws.evidence() < 3.0, "{:?} {laws:?}", places.forces);
    assert_eq!((found.verdict, found.warnings.len()), (Verdict::Nothing, 0));
}
