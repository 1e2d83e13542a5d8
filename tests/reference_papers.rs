//! What the papers on helicopters and time delays show, from simulated flights: quick versions of `studies_papers.rs`.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod noise;
mod papers;

use fdm::estimate::SpectralOptions;
use fdm::frequency::EndTerms;
use fdm::regression::{Chosen, Components, by_cutoff, regress};
use papers::{bo105, errors, fitted, found, hfb320, mean, model, off_by, puma, truth, up_to};
use std::slice::from_ref;

/// Marchand and Fu (1985), figure 2.
#[test]
fn end_terms_decide_about_derivatives_from_runs_that_end_in_motion() {
    let model = bo105::bo105();
    let runs = bo105::with_noise(&bo105::runs(&model), 1.0, 1);
    let error = |ends| mean(&errors(&model, &bo105::fit(&model, &runs, ends)));
    let (known, free, without) = (error(EndTerms::Known), error(EndTerms::Unknown), error(EndTerms::Omitted));
    assert!(known < 0.02 && free < 0.02, "with end terms: {known}, {free}");
    assert!(without > 0.2, "without: {without}");
}

/// Marchand and Fu (1985), figure 6.
#[test]
fn five_parameters_fit_where_four_do_not() {
    let with = hfb320::hfb320();
    let run = hfb320::with_noise(&hfb320::run(&with, true), 0.05, 1);
    let histories = |m: &fdm::Model| {
        let options = SpectralOptions { finish: true, changes: off_by(m, 0.2), ..hfb320::options(EndTerms::Unknown) };
        let fit = fitted(m, from_ref(&run), &options);
        let quality = fit.finish.as_ref().unwrap().quality[0].fit.clone();
        (fit, quality.r2.unwrap(), quality.tic.unwrap())
    };
    let (five, r2, tic) = histories(&with);
    let tau = found(&five, "tau").value;
    assert!((tau / 0.18 - 1.0).abs() < 0.01, "tau {tau}");
    assert!(r2 > 0.997 && tic < 0.03, "{r2} {tic}");
    let (_, r2, tic) = histories(&model("hfb320/no_delay.fdm"));
    assert!(r2 < 0.985 && tic > 0.06, "{r2} {tic}");
}

#[test]
fn two_channels_have_a_delay_each() {
    let two = model("hfb320/two_channels.fdm");
    let run = hfb320::with_noise(&hfb320::two_channels(&two, true), 0.05, 1);
    let options = SpectralOptions { changes: off_by(&two, 0.2), ..hfb320::options(EndTerms::Unknown) };
    let fit = fitted(&two, &[run], &options);
    for (name, want) in [("tau_q", 0.18), ("tau_p", 0.11)] {
        let value = found(&fit, name).value;
        assert!((value / want - 1.0).abs() < 0.01, "{name} {value}");
    }
}

/// Black, Murray-Smith and Padfield (1986), tables 4 and 5.
#[test]
fn a_delay_left_out_more_than_halves_the_pitch_damping() {
    let flight = puma::doublet_of(&puma::flight(), 2.5);
    let run = puma::longitudinal(&puma::with_noise(&flight, 1.0, 1));
    let fit = |file: &str| fitted(&model(file), from_ref(&run), &up_to(puma::HIGHEST, EndTerms::Unknown));
    let (with, without) = (fit("puma/model.fdm"), fit("puma/no_delay.fdm"));
    for (name, want) in truth(&model("puma/model.fdm")) {
        let p = found(&with, &name);
        assert!((p.value - want).abs() < 4.0 * p.error().unwrap(), "{name} {}", p.value);
    }
    let damping = found(&without, "Mq").value;
    assert!(damping.abs() < 0.5 * 0.823, "{damping}");
    assert!(without.estimate.cost > with.estimate.cost);
}

/// The same, table 6.
#[test]
fn transfer_functions_share_a_denominator() {
    let m = puma::transfer_functions();
    let run = papers::noisy(&puma::short_period(&m), &puma::SHORT_PERIOD_NOISE, 1);
    let options = SpectralOptions { changes: off_by(&m, 0.2), ..up_to(puma::HIGHEST, EndTerms::Unknown) };
    let fit = fitted(&m, &[run], &options);
    for (name, want) in truth(&m) {
        let p = found(&fit, &name);
        assert!((p.value - want).abs() < 3.0 * p.error().unwrap(), "{name} {}", p.value);
    }
}

/// The same, table 1 and figure 4.
#[test]
fn five_of_six_components_make_the_pitching_moment() {
    let equation = model("puma/pitching_moment.fdm");
    let run = |delay: f64| {
        let flight = puma::flight_of_theory(delay);
        puma::pitching_moment(&puma::with_noise(&puma::doublet_of(&flight, 2.0), 1.0, 1))
    };
    let delayed = run(0.134);
    let options = puma::at_frequencies(puma::HIGHEST, puma::PUBLISHED);
    let fit = regress(&equation, from_ref(&delayed), &options).unwrap().fits.swap_remove(0);
    assert_eq!((fit.rows, fit.chosen), (16, 5));
    assert!(matches!(fit.reason, Chosen::Collinear(_)));
    let [.., four, five, six] = &fit.components[..] else { panic!("six components") };
    assert!(five.r_squared - four.r_squared > 0.1 && six.r_squared - five.r_squared < 0.005);
    assert!(five.standard_errors.iter().zip(&six.standard_errors).filter(|(a, b)| a < b).count() >= 4);
    // columns that can be told apart are all kept where nobody asks for the published rule
    let all = regress(&equation, from_ref(&delayed), &puma::at_frequencies(puma::HIGHEST, Components::Auto)).unwrap();
    assert_eq!(all.fits[0].chosen, 6);
    // and by that rule too, where the last one is more than chance
    let prompt = regress(&equation, &[run(0.0)], &options).unwrap();
    assert_eq!(prompt.fits[0].chosen, 6);
    // rotor and noise above the band of the rigid body
    let explained = |cutoff: f64| {
        let found = regress(&equation, from_ref(&delayed), &puma::at_frequencies(cutoff, puma::PUBLISHED)).unwrap();
        found.fits[0].equations[0].r_squared
    };
    assert!(explained(0.565) > 0.98 && explained(1.0) < 0.97 && explained(5.0) < 0.6);
    assert_eq!(by_cutoff(&equation, &[delayed], &options, &[0.285, 0.565]).len(), 2);
}
