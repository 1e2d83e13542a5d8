//! What the paper on the Puma says of principal components, from simulated flights; the other figures of the papers come out in `fdm reproduce`.

use fdm::equation_error::{Chosen, Components, by_cutoff, regress};
use std::slice::from_ref;
use support::papers::{model, puma};

/// Black, Murray-Smith and Padfield (1986), table 1 and figure 4.
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
