//! The standard catalogue over the reference models: every effect compiles, vanishes at its null, has exact derivatives, and
//! the user's text with it means what the model for screening means.

use fdm::code::{Nominal as Point, verify};
use fdm::effect::{Beginning, Candidate, Catalogue, Choice, Extension, Field, Kind, Null, Scales, Subject};
use fdm::record::Run;
use fdm::simulate::Simulator;
use fdm::{Model, ModelError};

const MODELS: &[&str] = &[
    "goodman_ship/model.fdm",
    "ship_roll_decay/linear.fdm",
    "pendulum_free_swing/driven.fdm",
    "miniature_helicopter/closed_loop.fdm",
    "methanol/model.fdm",
    "second_order_delay/model.fdm",
];

fn model(name: &str) -> Model {
    Model::from_file(support::repository().join("models").join(name)).expect("a reference model")
}

/// A record of small inputs of different frequencies.
fn run(model: &Model) -> Run {
    let (inputs, outputs) = (model.layout().inputs, model.layout().outputs);
    let time: Vec<f64> = (0..60).map(|k| 0.05 * f64::from(k)).collect();
    let input = |t: f64| (0..inputs).map(move |k| 0.05 * ((1.0 + k as f64) * t + 0.3).sin());
    Run {
        name: "run".into(),
        inputs: time.iter().flat_map(|t| input(*t)).collect(),
        held: vec![false; inputs],
        measured: vec![f64::NAN; time.len() * outputs],
        input_gaps: vec![0; inputs],
        stated: Vec::new(),
        output_gaps: vec![0; outputs],
        time,
    }
}

/// What a caller knows of such records.
struct Known;

impl Scales for Known {
    fn size(&self, _signal: &str, q: f64) -> f64 {
        0.05 * q.max(0.01)
    }
    fn speed(&self, _signal: &str, q: f64) -> f64 {
        0.1 * q.max(0.01)
    }
    fn level(&self, _signal: &str, q: f64) -> f64 {
        0.05 * q
    }
    fn beginning(&self, signal: &str) -> Beginning {
        if signal.len().is_multiple_of(2) { Beginning::Same(0.0125) } else { Beginning::Varies(0.01) }
    }
    fn step(&self) -> f64 {
        0.05
    }
    fn duration(&self) -> f64 {
        2.95
    }
}

fn response(model: &Model, run: &Run, theta: &[f64]) -> Vec<f64> {
    let mut y = vec![f64::NAN; run.len() * model.layout().outputs];
    let mut simulator = Simulator::new(model.dynamics(), run, 4_usize).expect("a run that fits");
    // a model that leaves the finite numbers fills what is before
    let _ = simulator.simulate(theta, &mut y);
    y
}

/// Parameters of `model` by the names of another that has the same.
fn by_name(model: &Model, other: &Model, theta: &[f64]) -> Vec<f64> {
    let value = |name: &str| theta[other.definition().param(name).expect("the same parameters")];
    model.definition().params.iter().map(|p| value(&p.quantity.name)).collect()
}

/// The first and the last place of every effect; only the first of a large model.
fn chosen(places: Vec<Candidate>) -> Vec<Candidate> {
    let large = places.len() > 500;
    let mut chosen = Vec::new();
    let mut rest = &places[..];
    while let Some(first) = rest.first() {
        let same = |c: &&Candidate| c.effect().signature() == first.effect().signature();
        let count = rest.iter().take_while(same).count();
        let mut picks = if large { vec![count / 2] } else { vec![0, count - 1] };
        picks.dedup();
        chosen.extend(picks.into_iter().map(|k| rest[k].clone()));
        rest = &rest[count..];
    }
    chosen
}

fn extension(candidate: &Candidate, subject: &Subject) -> Extension {
    candidate.apply(subject, &Known, &Choice::new()).unwrap_or_else(|d| panic!("{candidate}: {}", d.message))
}

fn extended(extension: &Extension) -> Result<Model, ModelError> {
    Model::compiled(extension.source().clone(), extension.compile())
}

#[test]
fn the_standard_catalogue_is_sound_and_has_every_name() {
    let (catalogue, findings) = Catalogue::read(&fdm_grammar::Source::new("effects.fdm", fdm::effect::STANDARD));
    assert!(findings.is_empty(), "{findings:?}");
    for name in "input_delay output_delay actuator_lag sensor_lag input_dead_zone input_saturation rate_limit backlash \
        input_scale_asymmetry input_square input_cube input_curvature output_scale temperature_scale \
        output_bias_drift sensor_position thermometer_position missing_coupling missing_control heat_exchange quadratic_damping \
        cubic_stiffness quadratic_term curvature coulomb_friction product_term unmodelled_mode state_saturation \
        constant_force lag_in_coupling time_varying_parameter slow_mode process_noise joint_friction joint_damping \
        lugre_friction play_hysteresis slipstream added_mass wave_memory downwash_lag inflow_lag dynamic_stall gate \
        coefficient_curve input_curve dead_volume radiation"
        .split_whitespace()
    {
        assert!(catalogue.effects().any(|e| e.name() == name), "{name}");
    }
    assert!(catalogue.effects().all(|e| !e.doc().is_empty()));
}

#[test]
fn every_effect_compiles_vanishes_and_has_exact_derivatives_on_every_model() {
    let mut catalogue = Catalogue::standard();
    catalogue.restrict(&Field::ALL);
    for name in MODELS {
        let base = model(name);
        let subject = Subject::new(base.source(), base.definition()).expect("a text that compiles");
        let run = run(&base);
        let at_start = response(&base, &run, &base.definition().start());
        let places = catalogue.places(&subject);
        assert!(places.crowded.is_empty() && places.candidates.len() > 8, "{name}: {}", places.candidates.len());
        for candidate in chosen(places.candidates).iter().filter(|c| c.kind() != Kind::Variance) {
            let made = extension(candidate, &subject);
            let what = format!("{name}, {candidate}:\n{}\n", made.text());
            let extended = extended(&made).unwrap_or_else(|e| panic!("{what}{e}"));
            assert!(extended.warnings().is_empty(), "{what}{:?}", extended.warnings());
            let null = made.null(extended.definition());
            assert!(matches!(null, Null::Identity | Null::Limit), "{what}{null:?}");
            let found = verify(extended.definition(), extended.schedule(), &Point::start(extended.definition()));
            assert!(found.passed(), "{what}{found:?}");
            keeps_its_order(&base, &extended, &made, &what);
            means_what_it_says(&run, &extended, &made, &what);
            if null == Null::Identity {
                vanishes_in_a_simulation(&run, &extended, &made, &at_start, &what);
            }
        }
    }
}

/// Parameters of the base model keep their numbers, the new ones stand behind.
fn keeps_its_order(base: &Model, extended: &Model, made: &Extension, what: &str) {
    let names = |m: &Model| m.definition().params.iter().map(|p| p.quantity.name.clone()).collect::<Vec<_>>();
    let (old, all) = (names(base), names(extended));
    assert_eq!(all[..old.len()], old, "{what}");
    let mut new: Vec<String> = made.params().iter().map(|p| p.name.clone()).collect();
    let mut behind = all[old.len()..].to_vec();
    new.sort();
    behind.sort();
    assert_eq!(behind, new, "{what}");
}

/// The text as a user reads it gives the same bits as the model for screening.
fn means_what_it_says(run: &Run, extended: &Model, made: &Extension, what: &str) {
    let written = Model::from_text("written", made.text()).unwrap_or_else(|e| panic!("{what}{e}"));
    let mut theta = extended.definition().start();
    for (k, value) in theta.iter_mut().enumerate() {
        *value *= 1.0 + 0.01 * ((k % 7) as f64 - 3.0);
    }
    let bits = |y: Vec<f64>| y.into_iter().map(f64::to_bits).collect::<Vec<_>>();
    let screening = bits(response(extended, run, &theta));
    assert_eq!(bits(response(&written, run, &by_name(&written, extended, &theta))), screening, "{what}");
}

fn vanishes_in_a_simulation(run: &Run, extended: &Model, made: &Extension, base: &[f64], what: &str) {
    let mut theta = extended.definition().start();
    for new in made.params() {
        let k = extended.definition().param(&new.name).expect("a new parameter");
        theta[k] = if new.nuisance { new.start } else { new.null };
    }
    // an infinite limit is no value for a sensitivity, but one for a response
    let y = response(extended, run, &theta);
    let size = base.iter().filter(|v| v.is_finite()).fold(0.0_f64, |m, v| m.max(v.abs()));
    for (k, (a, b)) in base.iter().zip(&y).enumerate() {
        let same = (a - b).abs() <= 1e-8 * (size + 1e-3) || a.is_nan() && b.is_nan();
        assert!(same, "{what}sample {k}: {a} without it, {b} at its null");
    }
}

/// The blocks of docs/reference/effects.md between "```LANGUAGE" and "```".
fn blocks(language: &str) -> Vec<String> {
    let page = std::fs::read_to_string(support::repository().join("docs/reference/effects.md")).expect("the page");
    let mut blocks = Vec::new();
    let mut open = false;
    for line in page.lines() {
        if line.starts_with("```") {
            open = line == format!("```{language}");
            blocks.extend(open.then(String::new));
        } else if let Some(block) = blocks.last_mut().filter(|_| open) {
            block.push_str(line);
            block.push('\n');
        }
    }
    blocks
}

#[test]
fn the_examples_of_the_page_are_read_and_applied() {
    let base = model("pendulum_free_swing/driven.fdm");
    let subject = Subject::new(base.source(), base.definition()).expect("a text that compiles");
    let blocks = blocks("fdm-effects");
    assert_eq!(blocks.len(), 2);
    for block in blocks {
        let source = fdm_grammar::Source::new("docs/reference/effects.md", block);
        let (catalogue, findings) = Catalogue::read(&source);
        let told: Vec<String> = findings.iter().map(|f| f.line(&source)).collect();
        assert!(told.is_empty(), "{}", told.join("\n"));
        let places = catalogue.places(&subject).candidates;
        for effect in catalogue.effects() {
            assert!(places.iter().any(|c| c.effect().name() == effect.name()), "{}", effect.name());
        }
        for candidate in places {
            extended(&extension(&candidate, &subject)).unwrap_or_else(|e| panic!("{candidate}: {e}"));
        }
    }
}

#[test]
fn the_difference_of_the_page_is_what_is_written() {
    let base = model("ship_roll_decay/linear.fdm");
    let subject = Subject::new(base.source(), base.definition()).expect("a text that compiles");
    let places = Catalogue::standard().places(&subject);
    let made = extension(places.find("quadratic_damping(p)").expect("a place"), &subject);
    let shown = blocks("diff").remove(0);
    for line in shown.lines() {
        let (sign, text) = line.split_at(1);
        let (old, new) = (base.source().text(), made.text());
        let (before, after) = (old.lines().any(|l| l == text), new.lines().any(|l| l == text));
        assert_eq!((before, after), (sign != "+", sign != "-"), "{line}");
    }
}

#[test]
fn a_model_compiled_with_the_program_is_extended_too() {
    let base = fdm::model! {
        model tank "a tank with an outlet" {
            input inflow [m^3/s];
            state h "level" [m] = 1;
            param area = 2 [m^2], outlet = 0.3 [m^2/s];
            der(h) = (inflow - outlet*h)/area;
            output h_m [m] = h;
        }
    };
    let subject = Subject::new(base.source(), base.definition()).expect("a text that compiles");
    for candidate in Catalogue::standard().places(&subject).candidates {
        if candidate.kind() != Kind::Variance {
            let extended = extended(&extension(&candidate, &subject)).unwrap_or_else(|e| panic!("{candidate}: {e}"));
            assert!(extended.layout().params > base.layout().params);
        }
    }
}

#[test]
fn inputs_of_submodels_are_replaced_where_they_are_connected() {
    let text = "model a { input u [m]; use \"lag.fdm\" as act(x = u, T = T_act); state z [m]; param T_act = 0.3 [s], k = 2 [1/s]; \
                der(z) = k*(act.y - z); output z_m [m] = z; }";
    let lag = "model lag { input x [m]; param T = 0.1 [s]; state y [m]; der(y) = (x - y)/T; output y_m [m] = y; }";
    let mut source = fdm_grammar::Source::new("a.fdm", text);
    fdm_grammar::gather(&mut source, &mut |_| Ok(lag.to_string()));
    let base = Model::from_source(source).unwrap_or_else(|e| panic!("{e}"));
    let subject = Subject::new(base.source(), base.definition()).expect("a text that compiles");
    let places = Catalogue::standard().places(&subject);
    let made = extension(places.find("input_delay(u)").expect("a place"), &subject);
    assert!(made.text().contains("act(x = u_delayed, T = T_act)"), "{}", made.text());
    let extended = extended(&made).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(made.null(extended.definition()), Null::Identity);
    assert!(places.find("missing_coupling(z, act.y)").is_none());
}
