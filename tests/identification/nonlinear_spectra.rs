//! Nonlinear models in the frequency domain, linearised and with their terms carried in, beside the time domain.

use fdm::estimate::{Nonlinear, SpectralError, SpectralOptions, Work, fit_spectra};
use support::nonlinear::{Found, System, pendulum, roll_decay, ship};

/// Prints estimates beside each other; returns the largest difference of those that both ways have, in standard errors of
/// the difference if the ways had nothing in common.
fn apart(system: &System, [time, frequency]: [&[Option<Found>]; 2]) -> f64 {
    let mut largest: f64 = 0.0;
    println!("{}", system.name);
    for (((name, truth), t), f) in system.params().zip(time).zip(frequency) {
        let (Some(t), Some(f)) = (t, f) else { continue };
        let d = (t.value - f.value).abs() / t.error.hypot(f.error);
        println!(
            "  {name:8} {truth:10.4e}  {:10.4e} ± {:8.1e}  {:10.4e} ± {:8.1e}  {d:.2}",
            t.value, t.error, f.value, f.error
        );
        largest = largest.max(d);
    }
    largest
}

#[test]
fn carried_terms_give_what_the_time_domain_gives() {
    for (system, noise) in [
        (ship("ship, carried", 0.35), 1e-3),
        (pendulum("pendulum, carried", 2.0, 0.5), 1e-3),
        (roll_decay("roll decay, carried", 0.3), 1e-3),
    ] {
        let run = system.noisy(noise, 11);
        let found = [system.in_time(&run), system.in_frequency(&run, Nonlinear::MeasuredRegressors)];
        let d = apart(&system, [&found[0], &found[1]]);
        assert!(d < 3.0, "{}: {d} standard errors apart", system.name);
    }
}

#[test]
fn small_motions_linearised_give_what_the_time_domain_gives() {
    for (system, noise) in [
        (ship("ship, linearised", 0.005), 0.05),
        (pendulum("pendulum, linearised", 0.05, 0.0), 0.05),
        (roll_decay("roll decay, linearised", 0.005), 0.01),
    ] {
        let run = system.noisy(noise, 12);
        let found = [system.in_time(&run), system.in_frequency(&run, Nonlinear::Linearised)];
        let d = apart(&system, [&found[0], &found[1]]);
        assert!(d < 3.0, "{}: {d} standard errors apart", system.name);
    }
}

#[test]
fn a_rate_that_is_not_measured_cannot_be_carried_and_is_named() {
    let model = support::shipped("ship_roll_decay/model.fdm");
    let run = roll_decay("roll decay", 0.3).clean.with_channels(&[], &[0]);
    let options = SpectralOptions { nonlinear: Nonlinear::MeasuredRegressors, ..SpectralOptions::default() };
    let told = fit_spectra(&model, &[run], &options, &Work::default()).unwrap_err();
    assert!(matches!(told, SpectralError::NotCarried(_)));
    let told = told.to_string();
    assert!(told.contains("`p*abs(p)` of `der(p)`") && told.contains("measure it"), "{told}");
}
