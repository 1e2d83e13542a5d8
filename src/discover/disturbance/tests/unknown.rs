//! Causes that no catalogue has: nonlinearities that repeat, and modes narrower than any band.
#![allow(clippy::unwrap_used)]

use super::*;

fn attributed(case: &Case) -> (ResidualEvidence, Attribution) {
    let heard = residual_evidence(&case.model, &case.fitted_runs()).unwrap();
    let attribution = attribute(&case.model, &heard, None);
    (heard, attribution)
}

#[test]
fn what_repeats_is_a_law_in_its_equation() {
    let case = Case::new(&FAMILIES[0], Hidden::Strange, false, 0.02, 0.0, SHORT, 11);
    let (ResidualEvidence { places, nonlinearities, .. }, found) = attributed(&case);
    assert!(
        nonlinearities.evidence() > 3.0 && nonlinearities.evidence() > places.evidence(),
        "{nonlinearities:?} {:?}",
        places.disturbances
    );
    assert_eq!(found.verdict, Origin::UnknownCause);
    assert!(
        found.places[..2].iter().any(|s| s.place.kind == PlaceKind::Equation && s.place.name == "q"),
        "{:?}",
        found.places
    );
}

#[test]
fn a_law_of_one_signal_is_drawn_over_it() {
    let case = Case::new(&FAMILIES[0], Hidden::Ripple, false, 0.02, 0.0, SHORT, 11);
    let (_, found) = attributed(&case);
    let law = found.nonlinearity.as_ref().unwrap_or_else(|| panic!("{found:?}"));
    assert_eq!((found.verdict, law.curve.variable.as_str()), (Origin::UnknownCause, "al"), "{found:?}");
    assert!(found.warnings.iter().any(|w| w.contains("a function of al alone")), "{:?}", found.warnings);
    // beside a constant and a slope, which the parameters make up for, it is the sine, in its unit
    assert_eq!((law.place.kind, law.place.name.as_str()), (PlaceKind::Equation, "q"));
    let points = &law.curve.points;
    let inner = &points[points.len() / 5..points.len() * 4 / 5];
    let columns = |k: usize| [1.0, inner[k].at, (150.0 * inner[k].at).sin()];
    let design = nalgebra::DMatrix::from_fn(inner.len(), 3, |k, j| columns(k)[j]);
    let values = nalgebra::DVector::from_fn(inner.len(), |k, _| inner[k].value);
    let amplitude = design.svd(true, true).solve(&values, 1e-12).unwrap()[2];
    assert!((0.03..0.065).contains(&amplitude), "{amplitude}");
}

#[test]
fn what_does_not_repeat_is_a_disturbance_in_its_equation() {
    // a disturbance on de is nearly one in the equation of q: the equation is told first
    let case = Case::new(&FAMILIES[0], Hidden::Gust(1), true, 0.01, 0.1, SHORT, 7);
    let (ResidualEvidence { places, nonlinearities, .. }, found) = attributed(&case);
    assert!(places.evidence() > nonlinearities.evidence() + 3.0, "{nonlinearities:?} {:?}", places.disturbances);
    assert_eq!((found.verdict, found.places[0].place.name.as_str()), (Origin::Disturbance, "q"));
}

#[test]
fn a_narrow_mode_in_a_sensor_is_seen_there() {
    let case = Case::new(&FAMILIES[0], Hidden::Mode, false, 0.02, 0.0, 2 * SHORT, 5);
    let (ResidualEvidence { residual_analysis, .. }, found) = attributed(&case);
    assert!(residual_analysis.repeatable < 0.001, "{residual_analysis:?}");
    assert!(
        residual_analysis.coherences[0].output == "qm" && residual_analysis.coherences[0].partner.input() == "de",
        "{residual_analysis:?}"
    );
    assert_eq!(found.verdict, Origin::UnknownCause);
    assert!(
        found.places[..2].iter().any(|s| s.place.kind == PlaceKind::Output && s.place.name == "qm"),
        "{:?}",
        found.places
    );
}

#[test]
fn noise_is_neither() {
    let case = Case::new(&FAMILIES[0], Hidden::Nothing, true, 0.03, 0.0, SHORT, 3);
    let (_, found) = attributed(&case);
    assert!(found.warnings.is_empty() && found.places.is_empty(), "{found:?}");
    assert_eq!(found.verdict, Origin::Nothing);
}

#[test]
fn an_equation_stands_before_an_input_that_moves_it() {
    let case = Case::new(&FAMILIES[0], Hidden::Nothing, false, 0.05, 0.0, SHORT, 3);
    let all = places(&case.model);
    let ranked = |evidence: [f64; 3]| {
        let mut list: Vec<(Place, f64)> = all.iter().cloned().zip(evidence).collect();
        place::rank(&case.model, &mut list, |l| (&l.0, l.1));
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
    let (mut normal, q) = (Normal(Stream::seeded(77)), 3);
    for run in &mut case.runs {
        let rms = |c: usize| (run.measured.iter().skip(c).step_by(q).map(|v| v * v).sum::<f64>() / SHORT as f64).sqrt();
        let sizes: Vec<f64> = (0..q).map(rms).collect();
        for row in run.measured.chunks_exact_mut(q) {
            let shared = normal.next();
            row.iter_mut().zip(&sizes).for_each(|(z, size)| *z += 0.05 * size * shared);
        }
    }
    let case = Case::fitted(&case.model, case.runs);
    let (ResidualEvidence { places, nonlinearities, .. }, found) = attributed(&case);
    assert!(places.evidence() < 3.0 && nonlinearities.evidence() < 3.0, "{:?} {nonlinearities:?}", places.disturbances);
    assert_eq!((found.verdict, found.warnings.len()), (Origin::Nothing, 0));
}

/// A block of metal that is heated, far above zero, and the sensor on it.
const VESSEL: &str = "model vessel {
  input heater;
  param P = 45, UA = 0.6, Us = 0.2, Cs = 9, begin = 330;
  state Th = begin, Ts = begin;
  95*der(Th) = P*heater - UA*(Th - 293) - Us*(Th - Ts);
  Cs*der(Ts) = Us*(Th - Ts);
  output block = Th;
  output sensor = Ts;
}";

/// Nothing is missing, and the noise is the larger the further a temperature is from its mean.
fn vessel(seed: u64) -> Case {
    let model = Model::from_text("vessel.fdm", VESSEL).unwrap();
    let (n, q, interval) = (SHORT, 2, 6.0);
    let mut normal = Normal(Stream::seeded(500 + seed));
    let mut deviations = Vec::new();
    let runs: Vec<Run> = (0..2)
        .map(|run| {
            let heater = input(n, interval, 3 * run, 60.0).into_iter().map(|u| 0.6 + 8.0 * u).collect();
            let mut own = record(run, n, interval, heater, 1, q);
            let mut y = vec![0.0; n * q];
            let mut simulator = Simulator::new(model.dynamics(), &own, 4).unwrap();
            simulator.simulate(&model.definition().start(), &mut y).unwrap();
            let column = |c: usize| y.iter().skip(c).step_by(q).copied();
            let centre: Vec<f64> = (0..q).map(|c| column(c).sum::<f64>() / n as f64).collect();
            let away = |c: usize| (column(c).map(|v| (v - centre[c]).powi(2)).sum::<f64>() / n as f64).sqrt();
            let away: Vec<f64> = (0..q).map(away).collect();
            let grown = |(k, v): (usize, &f64)| 0.1 + (v - centre[k % q]).abs() / away[k % q];
            let each: Vec<f64> = y.iter().enumerate().map(grown).collect();
            own.measured = y.iter().zip(&each).map(|(y, size)| y + 0.5 * size * normal.next()).collect();
            deviations.push(each);
            own
        })
        .collect();
    let mut case = Case::fitted(&model, runs);
    case.records.iter_mut().zip(deviations).for_each(|(record, each)| record.deviations = Some(each));
    case
}

#[test]
fn noise_that_grows_with_its_signal_is_no_law() {
    for seed in 0..6 {
        let (heard, found) = attributed(&vessel(seed));
        assert_eq!(found.verdict, Origin::Nothing, "{seed}: {:?} {found:?}", heard.nonlinearities);
    }
}

/// Divided by an uneven deviation a slow response has fast parts too: cut off at its band it would be no combination of sensitivities any more.
#[test]
fn what_parameters_make_up_for_they_make_up_for_under_uneven_noise() {
    let case = vessel(0);
    let (fitted_runs, q) = (case.fitted_runs(), 2);
    let binned_runs = binned_run::binned_runs(&fitted_runs, q).unwrap();
    let band = binned_run::band(&fitted_runs, &binned_runs, q);
    for (binned, record) in binned_runs.iter().zip(&case.records) {
        assert!(binned.below(band) < binned.frequency.len());
        let stacked = |columns: &dyn Fn(usize) -> Vec<f64>| -> Vec<f64> {
            let padded = |mut column: Vec<f64>| {
                column.resize(binned.frequency.len(), 0.0);
                column
            };
            (0..q).flat_map(|c| padded(columns(c))).collect()
        };
        let combinations: Vec<Vec<f64>> = (0..binned.fitted[0].ncols())
            .map(|k| stacked(&|c| binned.fitted[c].column(k).iter().copied().collect()))
            .collect();
        let basis = nalgebra::DMatrix::from_fn(combinations[0].len(), combinations.len(), |i, k| combinations[k][i]);
        let basis = basis.qr().q();
        let mut cosines = crate::bins::Cosines::new(binned.samples);
        for column in record.fitted.iter().flatten() {
            let response = binned.response(&mut cosines, column, binned.reached(band));
            let response = nalgebra::DVector::from_vec(stacked(&|c| response[c].clone()));
            let left = &response - &basis * basis.tr_mul(&response);
            assert!(left.norm() < 1e-6 * response.norm(), "{} of {}", left.norm(), response.norm());
        }
    }
}
