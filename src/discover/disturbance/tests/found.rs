//! Responses to disturbances, and disturbances.
#![allow(clippy::unwrap_used)]

use super::*;

#[test]
fn responses_to_forces_are_differences_of_simulations() {
    let case = Case::new(&FAMILIES[0], Hidden::Nothing, false, 0.05, 0.0, 400, 3);
    let places = places(&case.model);
    assert_eq!(places.iter().map(|p| p.name.as_str()).collect::<Vec<_>>(), ["de", "al", "q"]);
    let forced_response = forced_response::ForcedResponse::new(&case.model, &places);
    let course: Vec<f64> = (0..400).map(|k| if (40..60).contains(&k) { 1.0 } else { 0.0 }).collect();
    let mut found = vec![Vec::new(); 3];
    forced_response
        .respond(0, case.fitted_runs()[0], &[vec![0.0; 400], course.clone()], &mut |place, wave, y| {
            if wave == 1 {
                found[place] = y;
            }
        })
        .unwrap();
    let q = 3;
    for (place, edit) in
        [(0, ("de;", "de, w;")), (1, ("der(al) =", "der(al) = w +")), (2, ("der(q) =", "der(q) = w +"))]
    {
        let mut text = SHORT_PERIOD.replace("input de;", "input de, w;");
        if place == 0 {
            text = text.replace("*de", "*(de + w)");
        } else {
            text = text.replace(edit.0, edit.1);
        }
        let model = Model::from_text("m.fdm", text).unwrap();
        let run = &case.runs[0];
        let simulated = |size: f64| {
            let inputs = (0..400).flat_map(|k| [run.inputs[k], size * course[k]]).collect();
            let forced_response = record(0, 400, 0.05, inputs, 2, q);
            let mut y = vec![0.0; 400 * q];
            Simulator::new(model.dynamics(), &forced_response, case.steps[0].clone())
                .unwrap()
                .simulate(&case.theta, &mut y)
                .unwrap();
            y
        };
        let (with, without) = (simulated(1.0), simulated(0.0));
        let largest = found[place].iter().fold(0.0_f64, |a, v| a.max(v.abs()));
        assert!(largest > 0.0);
        for k in 0..400 * q {
            assert!((with[k] - without[k] - found[place][k]).abs() < 1e-9 * largest, "{place} {k}");
        }
    }
    let states = forced_response.states(0, case.fitted_runs()[0]).unwrap();
    assert_eq!(states.len(), 800);
    assert!(
        (states[2 * 200 + 1] + case.theta[6] + case.records[0].residual[200 * q + 1]
            - case.runs[0].measured[200 * q + 1])
            .abs()
            < 1e-9
    );
}

#[test]
fn a_gust_is_found_in_its_equation() {
    for (family, at) in [(&FAMILIES[0], 0), (&FAMILIES[0], 1), (&FAMILIES[1], 1)] {
        let case = Case::new(family, Hidden::Gust(at), false, 0.01, 0.1, SHORT, 7);
        let found = residual_evidence(&case.model, &case.fitted_runs()).unwrap().places;
        assert!(found.evidence() > 10.0, "{}: {:?}", family.name, found.disturbances);
        assert!(found.group().any(|s| s.place.name == family.states[at]), "{}: {:?}", family.name, found.disturbances);
        let site = found.disturbances.iter().find(|s| s.place.name == family.states[at]).unwrap();
        assert!(site.course.len() == 2 && site.size > 0.0);
        assert!(site.course.iter().flatten().all(|o| o.value.is_finite() && o.deviation >= 0.0));
    }
}

#[test]
fn a_wandering_sensor_is_no_disturbance() {
    for family in &FAMILIES {
        let case = Case::new(family, Hidden::Wander(1), false, 0.01, 0.1, SHORT, 3);
        let found = residual_evidence(&case.model, &case.fitted_runs()).unwrap().places;
        assert!(found.evidence() < 3.0, "{}: {:?}", family.name, found.disturbances);
        let output = &case.model.definition().outputs[1].quantity.name;
        assert!(found.sensors[0].place.name == *output && found.sensors[0].evidence > 3.0, "{:?}", found.sensors);
    }
}

#[test]
fn too_little_is_refused_in_words() {
    let case = Case::new(&FAMILIES[0], Hidden::Nothing, false, 0.01, 0.0, SHORT, 3);
    assert_eq!(residual_evidence(&case.model, &[]).unwrap_err(), DisturbanceError::Nothing);
    let mut short = case.records[0].clone();
    short.residual.truncate(3 * 20);
    short.fitted.iter_mut().flatten().for_each(|f| f.truncate(3 * 20));
    let fitted_run = FittedRun { record: &short, ..case.fitted_runs()[0] };
    assert!(matches!(
        residual_evidence(&case.model, &[fitted_run]).unwrap_err(),
        DisturbanceError::TooShort { samples: 20, .. }
    ));
}
