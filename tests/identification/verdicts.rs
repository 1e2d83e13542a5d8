//! What both domains say of the same records.

use fdm::diagnose::{Cause, Diagnosis, Domain, Verdict};
use fdm::effect::Catalogue;
use fdm_grammar::Source;
use support::hidden::*;

fn first(found: &Diagnosis) -> &Cause {
    assert_eq!(found.verdict, Verdict::EffectFound, "{found:#?}");
    &found.causes[0]
}

/// Name, size and gain of the first cause in both domains.
fn agree(system: &System, hidden: &Hidden, pink: bool, seed: u64) {
    let (model, catalogue) = (system.model(), some());
    let runs = system.records(Some(hidden), 2, 0.05, pink, seed);
    let [time, frequency] =
        [Domain::Time, frequency()].map(|domain| diagnosed(&model, &runs, &[], &catalogue, domain).unwrap());
    let (a, b) = (first(&time), first(&frequency));
    assert_eq!(a.place.to_string(), hidden.effect, "{time:#?}");
    assert_eq!(b.place.to_string(), hidden.effect, "{frequency:#?}");
    let ([x, ..], [y, ..]) = (&a.parameters[..], &b.parameters[..]) else { panic!("no parameters") };
    let error = x.standard_error.unwrap().max(y.standard_error.unwrap());
    assert!((x.value - y.value).abs() < 2.0 * error, "{} by time, {} by frequency, +- {error}", x.value, y.value);
    assert!((y.value - hidden.value).abs() < 4.0 * error, "{} +- {error} instead of {}", y.value, hidden.value);
    // other samples, and a noise of each model's own: evidence is as clear, and not the same number
    assert!(a.loss.min(b.loss) > 10.0, "evidence {} by time, {} by frequency", a.loss, b.loss);
    assert!(frequency.explanations[0].probability > 0.99 && frequency.spectral.is_some() && time.spectral.is_none());
    assert!(frequency.extended.as_ref().is_some_and(|text| text != model.source().text()));
}

#[test]
fn a_delay_before_the_short_period() {
    agree(&SYSTEMS[0], &SYSTEMS[0].hidden[0], false, 1);
}

#[test]
fn a_lag_of_the_plant_under_coloured_noise() {
    agree(&SYSTEMS[1], &SYSTEMS[1].hidden[1], true, 2);
}

#[test]
fn a_coupling_that_is_missing() {
    agree(&SYSTEMS[2], &SYSTEMS[2].hidden[0], false, 3);
}

#[test]
fn nothing_where_nothing_is_hidden() {
    for (k, pink) in [(0, false), (1, true)] {
        let runs = SYSTEMS[k].records(None, 2, 0.05, pink, 4);
        let found = diagnosed(&SYSTEMS[k].model(), &runs, &[], &some(), frequency()).unwrap();
        assert_eq!(found.verdict, Verdict::NoEffectFound, "{found:#?}");
        assert!(found.lack_of_fit.len() == SYSTEMS[k].model().layout().outputs, "{:?}", found.lack_of_fit);
    }
}

/// Nothing is integrated: a helicopter that would leave the record is diagnosed with its loops closed.
#[test]
fn an_unstable_helicopter_under_an_attitude_loop() {
    let late: Vec<&str> =
        SOME.split_inclusive("}\n").filter(|e| e.contains("input_delay") || e.contains("actuator_lag")).collect();
    let (catalogue, findings) = Catalogue::read(&Source::new("late.fdm", late.concat()));
    assert!(findings.is_empty() && catalogue.effects().count() == 2, "{findings:?}");
    let found = diagnosed(&hover(), &hover_records(2, 0.03), &[], &catalogue, frequency()).unwrap();
    let cause = first(&found);
    assert_eq!(cause.place.to_string(), "input_delay(lon)", "{found:#?}");
    let tau = &cause.parameters[0];
    assert!((tau.value - 0.04).abs() < 4.0 * tau.standard_error.unwrap(), "{tau:?}");
}
