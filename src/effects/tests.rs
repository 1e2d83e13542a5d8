//! Effects on small models: where they fit, what they write, what is left untouched.

use super::*;
use fdm_grammar::syntax::{parse_effects, print_effect};
use fdm_grammar::{Source, compile};

fn subject(text: &str) -> Subject {
    let source = Source::new("model.fdm", text);
    let base = compile(&source).unwrap_or_else(|f| panic!("{f:?}"));
    Subject::new(&source, &base.model).unwrap()
}

fn catalogue(text: &str) -> Catalogue {
    let (catalogue, findings) = Catalogue::read(&Source::new("effects.fdm", text));
    assert!(findings.is_empty(), "{findings:?}");
    catalogue
}

fn extended(text: &str, effect: &str) -> Extension {
    let subject = subject(text);
    let places = Catalogue::standard().places(&subject);
    let candidate = places.find(effect).unwrap_or_else(|| panic!("{effect} fits nowhere"));
    let extension = candidate.apply(&subject, &Nominal, &Choice::new()).unwrap();
    let compiled = extension.compile().unwrap_or_else(|f| panic!("{}\n{f:?}", extension.text()));
    assert!(matches!(extension.null(&compiled.model), Null::Identity | Null::Limit), "{}", extension.text());
    extension
}

const SHORT: &str = "model a { input u; state x; param k = 1; der(x) = u - k*x; output y = x; }";

#[test]
fn the_standard_catalogue_is_printed_as_it_is_read() {
    let (trees, findings) = parse_effects(&Source::new("effects.fdm", STANDARD));
    assert!(findings.is_empty() && trees.len() > 25);
    let printed: String = trees.iter().map(print_effect).collect();
    let (again, findings) = parse_effects(&Source::new("printed.fdm", printed.as_str()));
    assert!(findings.is_empty(), "{findings:?}\n{printed}");
    assert_eq!(again.iter().map(print_effect).collect::<String>(), printed);
}

#[test]
fn a_model_on_one_line_stays_a_model() {
    for effect in ["input_delay(u)", "actuator_lag(u)", "quadratic_damping(x)", "sensor_lag(y)", "unmodelled_mode(x)"] {
        extended(SHORT, effect);
    }
    let text = extended(SHORT, "output_bias_drift(y)").text().to_string();
    assert!(text.starts_with("model a { input u; state x; param k = 1;\n"), "{text}");
    assert!(text.contains("output y = x + drift_y*t/T_y; }"), "{text}");
}

#[test]
fn a_balance_of_forces_takes_terms_of_its_own() {
    let text =
        "model cart { input F [N]; state s = 0 [m], v = 0 [m/s]; param m = 2 [kg], b = 1 [N s/m]; let drag = b*v;
        der(s) = v; m*der(v) = F - drag; output y [m] = s; }";
    let rubbed = extended(text, "coulomb_friction(v)").text().to_string();
    assert!(rubbed.contains("m*der(v) = F - drag - friction_v*tanh(v/v0_v);"), "{rubbed}");
    assert!(rubbed.contains("param friction_v = 0 [kg*m/s^2]"), "{rubbed}");
    // the derivative on the right, and with a minus sign
    for (form, rubbed) in [
        ("F - drag = m*der(v)", "F - drag - friction_v*tanh(v/v0_v) = m*der(v);"),
        ("0 = F - drag - m*der(v)", "0 + friction_v*tanh(v/v0_v) = F - drag - m*der(v);"),
        ("-m*der(v) = drag - F", "-m*der(v) = drag - F + friction_v*tanh(v/v0_v);"),
        ("m*der(v) + drag = F", "m*der(v) + drag = F - friction_v*tanh(v/v0_v);"),
    ] {
        let other = extended(&text.replace("m*der(v) = F - drag", form), "coulomb_friction(v)").text().to_string();
        assert!(other.contains(rubbed), "{other}");
    }
    // every effect of the catalogue that fits `der(v) = .../m` fits here, and a mode feels the rate under its name
    let names = |text: &str| {
        let places = Catalogue::standard().places(&subject(text));
        places.candidates.iter().map(ToString::to_string).collect::<Vec<String>>()
    };
    assert_eq!(names(text), names(&text.replace("m*der(v) = F - drag", "der(v) = (F - drag)/m")));
    let mode = extended(text, "unmodelled_mode(v)").text().to_string();
    assert!(mode.contains("*(der(v) - ") && mode.contains("m*der(v) = F - drag + c_v*"), "{mode}");
}

/// Lets that stand in each other, each several times, and sums of thousands of terms.
#[test]
fn balances_are_found_in_time_and_without_deep_stacks() {
    let lets: String = (1..30).map(|k| format!("let a{k} = a{0} + a{0} - a{0};\n", k - 1)).collect();
    let sum = vec!["x"; 5000].join(" + ");
    let text = format!(
        "model deep {{ input F [N]; state x [m/s]; param m = 2 [kg], b = 1 [N s/m]; let a0 = b*x;\n{lets}
        m*der(x) = F - a29 - b*({sum}); output y [m/s] = x; }}"
    );
    let subject = subject(&text);
    let places = Catalogue::standard().places(&subject);
    let candidate = places.find("constant_force(x)").unwrap();
    let pushed = candidate.apply(&subject, &Nominal, &Choice::new()).unwrap().text().to_string();
    assert!(pushed.contains("param force_x = 0 [kg*m/s^2]") && pushed.contains(" + force_x;"));
}

#[test]
fn coupled_bodies_have_a_balance_each() {
    let text = "model two { input F; state a, b; param m = 2, n = 1, h = 0.3, k = 1;
        m*der(a) + h*der(b) = F; h*der(a) + n*der(b) = -k*b; output y = a; output z = b; }";
    let at = |state: &str| extended(text, &format!("constant_force({state})")).text().to_string();
    assert!(at("a").contains("m*der(a) + h*der(b) = F + force_a;"), "{}", at("a"));
    assert!(at("b").contains("h*der(a) + n*der(b) = -k*b + force_b;"), "{}", at("b"));
}

#[test]
fn everything_else_is_untouched_to_the_byte() {
    let text = "model a {\r\n\tinput  u, w [m];   // two inputs\r\n\tstate x [m] = (x0) , z [m];\r\n\tparam k=1 [1/s] , x0 = 0 [m]; /* start */\r\n\
        \tlet sum = u + /* both */ w;\r\n\tder(x) = ((sum - x)*k) // slow\r\n\t  ;\r\n\tder(z) = if x > 0 * x0 then k*x else -k*(z);\r\n\
        \toutput y \"seen\" [m] = (x) , y2 [m] = z ;\r\n}\r\n";
    let at = |effect: &str| extended(text, effect).text().to_string();
    let damped = at("missing_coupling(x, z)");
    assert!(damped.contains("der(x) = ((sum - x)*k) + c_x_z*z // slow\r\n\t  ;"), "{damped}");
    assert!(damped.contains("/* start */\r\n\tparam c_x_z = 0 [1/s]"), "{damped}");
    let choice = at("constant_force(z)");
    assert!(choice.contains("der(z) = (if x > 0 * x0 then k*x else -k*(z)) + force_z;"), "{choice}");
    let scaled = at("output_scale(y)");
    assert!(
        scaled.contains("output y \"seen\" [m] = (1 + k_y)*((x)) , y2 [m] = z ;") || scaled.contains("(1 + k_y)*(x) ,"),
        "{scaled}"
    );
    let mode = at("unmodelled_mode(x)");
    assert!(mode.contains("let x_rate = ((sum - x)*k) // slow\r\n\t  ;\r\n\tder(x) = x_rate + "), "{mode}");
    // taking the new lines out again leaves the old text
    let kept: Vec<&str> = at("input_saturation(u)").leak().lines().filter(|l| !l.contains("clipped")).collect();
    assert!(text.lines().filter(|l| !l.contains("sum = u")).all(|l| kept.contains(&l)));
}

#[test]
fn names_do_not_collide_and_effects_follow_each_other() {
    let text = "model a { input u; state x, u_delayed; param tau_u = 1, k = 2; der(x) = u*tau_u - k*x; der(u_delayed) = x - k*u_delayed + u; output y = u_delayed; }";
    let once = extended(text, "input_delay(u)");
    assert!(once.text().contains("let u_delayed_2 = delay(u, tau_u_2);"), "{}", once.text());
    assert!(
        once.text().contains("u_delayed_2*tau_u - k*x") && once.text().contains("k*u_delayed + u_delayed_2"),
        "{}",
        once.text()
    );
    let twice = extended(once.text(), "input_dead_zone(u)");
    assert!(twice.text().contains("delay(u_felt, tau_u_2)"), "{}", twice.text());
    let thrice = extended(twice.text(), "quadratic_damping(x)");
    let names: Vec<_> =
        compile(thrice.source()).unwrap().model.params.iter().map(|p| p.quantity.name.clone()).collect();
    assert_eq!(names, ["tau_u", "k", "tau_u_2", "width_u", "drag_x"]);
}

#[test]
fn words_of_effects_are_names_in_models() {
    subject(
        "model a { input add; state replace; param with = 1, unless = 2, nuisance = 1, try = 3, when = 1; \
         der(replace) = with*add - unless*replace*nuisance - when; output y = try*replace; }",
    );
}

#[test]
fn conditions_look_through_lets_and_know_the_order() {
    let text = "model a { input u; state x, z, phi; param k = 1; let part = k*z; der(x) = part - k*x; der(z) = u - k*z; \
                der(phi) = x; output y = phi; }";
    let places = Catalogue::standard().places(&subject(text));
    let names = |effect: &str| -> Vec<String> {
        let of = places.candidates.iter().filter(|c| c.effect().name() == effect);
        of.map(|c| c.targets().join(" ")).collect()
    };
    assert_eq!(names("missing_coupling"), ["x phi", "z x", "z phi"]);
    assert_eq!(names("missing_control"), ["x u"]);
    assert_eq!(names("product_term").len(), 2 * 6);
    assert_eq!(names("constant_force"), ["x", "z"]);
    assert_eq!(names("sensor_position"), ["y x", "y z"]);
    let noises: Vec<_> = places.candidates.iter().filter_map(|c| c.noise()).collect();
    assert_eq!(noises, ["x", "z"]);
    let adds = |written: &str| places.find(written).expect("it fits").adds_to();
    assert_eq!(adds("missing_coupling(x, phi)").as_deref(), Some("der(x)"));
    assert_eq!(adds("sensor_position(y, z)").as_deref(), Some("y"));
    assert_eq!((adds("input_delay(u)"), adds("process_noise(x)")), (None, None));
}

#[test]
fn units_follow_from_the_model_and_are_converted() {
    let model = "model a { time [min]; input u [deg]; state x [m]; param k = 1 [m/(min*deg)], d = 1 [1/min]; der(x) = k*u - d*x; output y [m] = x; }";
    let subject = subject(model);
    let own = catalogue(
        "effect late(i: input) \"late\" { param tau = 0 [s] in [0, 90] try 30; replace i with delay(i, tau); }",
    );
    let candidate = own.places(&subject).candidates[0].clone();
    let late = candidate.apply(&subject, &Nominal, &Choice::new()).unwrap();
    assert!(late.text().contains("param tau_u = 0.5 in [0, 1.5] [min] \"late\";"), "{}", late.text());
    assert_eq!((late.params()[0].null, late.params()[0].upper), (0.0, 1.5));
    let wrong =
        catalogue("effect late(i: input) \"late\" { param tau = 0 [m] in [0, 1]; replace i with delay(i, tau); }");
    let refused = wrong.places(&subject).candidates[0].apply(&subject, &Nominal, &Choice::new()).unwrap_err();
    assert!(refused.message.contains("`tau` is in m, and in min where it is used"), "{}", refused.message);
    let mode = extended(model, "unmodelled_mode(x)");
    let units: Vec<_> = mode.params().iter().map(|p| p.unit.clone().unwrap().text().to_string()).collect();
    assert_eq!(units, ["1", "1/min", "1"]);
}

#[test]
fn a_chosen_value_is_written() {
    let subject = subject(SHORT);
    let places = Catalogue::standard().places(&subject);
    let candidate = places.find("coulomb_friction( x )").unwrap();
    let choice = Choice::from([("friction".to_string(), 0.25), ("v0".to_string(), 1e-5)]);
    let made = candidate.apply(&subject, &Nominal, &choice).unwrap();
    assert!(
        made.text().contains("param friction_x = 0.25 ") && made.text().contains("param v0_x = 1e-5 "),
        "{}",
        made.text()
    );
    assert!(made.params()[1].fixed && made.params()[1].nuisance);
}

#[test]
fn a_user_replaces_an_effect_of_the_catalogue() {
    let mut all = Catalogue::standard();
    let before = all.effects().count();
    all.extend(catalogue("effect quadratic_damping(z: state) \"mine\" { param c = 0; add der(z) += c*z*abs(z); }"));
    assert_eq!(all.effects().count(), before);
    assert!(all.effects().any(|e| e.doc() == "mine"));
}

#[test]
fn no_text_makes_the_reader_panic_or_slow() {
    let step = STANDARD.len() / 25;
    for cut in (0..STANDARD.len()).step_by(step) {
        if let Some(part) = STANDARD.get(..cut) {
            let _ = parse_effects(&Source::new("cut.fdm", part));
        }
        if let Some(part) = STANDARD.get(cut..) {
            let _ = parse_effects(&Source::new("cut.fdm", part));
        }
    }
    let deep =
        format!("effect a(x: state) {{ param c = 0; add der(x) += {}x{}; }}", "(".repeat(5000), ")".repeat(5000));
    let (_, findings) = parse_effects(&Source::new("deep.fdm", deep));
    assert!(findings[0].message.starts_with("nested deeper"), "{}", findings[0].message);
    let many = "effect a(x: state) { param c = 0; add der(x) += c*x; }\n".repeat(1100);
    let (trees, findings) = parse_effects(&Source::new("many.fdm", many));
    assert!(trees.len() == 1000 && findings.len() == 1, "{} {findings:?}", trees.len());
}

#[test]
fn blocks_of_the_language_serve_in_effects() {
    let own = catalogue(
        "effect lagging(y: output) \"lag of {y}\" { param T = 0 [s] in [0, 1] try 0.1; replace y with lag(y, T); }",
    );
    let subject =
        subject("model a { input u [m]; state x [m] = 1; param k = 1 [1/s]; der(x) = k*(u - x); output y [m] = 2*x; }");
    let made = own.places(&subject).candidates[0].apply(&subject, &Nominal, &Choice::new()).unwrap();
    assert!(made.text().contains("output y [m] = lag(2*x, T_y);"), "{}", made.text());
    let compiled = made.compile().unwrap_or_else(|f| panic!("{f:?}"));
    assert_eq!(made.null(&compiled.model), Null::Limit);
}

#[test]
fn effects_of_a_field_are_asked_for_where_they_fit_many_places() {
    let source = Source::new(
        "m",
        "model m { input u, v; state a, b, c, d, e; param k = 1;
         der(a) = -k*a + u; der(b) = -k*b + v; der(c) = -k*c; der(d) = -k*d; der(e) = -k*e; output y = a; }",
    );
    let subject = Subject::new(&source, &compile(&source).expect("a model").model).expect("a text");
    let mut catalogue = Catalogue::standard();
    let count =
        |c: &Catalogue, name: &str| c.places(&subject).candidates.iter().filter(|p| p.effect().name() == name).count();
    // 5 equations, 20 pairs of different states: too many; a stand-in is never tried unasked
    assert_eq!(
        (count(&catalogue, "cross_flow_drag"), count(&catalogue, "hinge"), count(&catalogue, "cubic_damping")),
        (0, 0, 5)
    );
    let crowded: Vec<String> = catalogue.places(&subject).crowded.iter().map(ToString::to_string).collect();
    assert!(
        crowded.contains(&"`cross_flow_drag` fits 100 places; only `--catalogue ship` tries them".to_string()),
        "{crowded:?}"
    );
    catalogue.restrict(&[Field::Ship]);
    assert_eq!(
        (count(&catalogue, "cross_flow_drag"), count(&catalogue, "root_outflow"), count(&catalogue, "input_delay")),
        (100, 0, 2)
    );
}

#[test]
fn a_field_that_does_not_exist_is_told_with_the_nearest() {
    let (_, findings) = Catalogue::read(&Source::new(
        "e",
        "effect e(x: state) for shipp \"of a ship\" { param c = 0; add der(x) += c*x; }",
    ));
    assert!(findings[0].message.contains("`shipp` is no field"), "{findings:?}");
    assert_eq!(findings[0].hint.as_deref(), Some("did you mean `ship`?"));
}

const VECTORS: &str = "model a {
  input u[2]; state x[2] = [0.5, 0]; param A[2, 2] = [[-1, 0], [0.5, -2]], b = 1;
  der(x) = A*x + b*u;
  output y[2] = x, sum_x = sum(x);
}";

#[test]
fn elements_of_vectors_take_effects_in_their_own_place() {
    let at = |effect: &str, lines: &[&str]| {
        let made = extended(VECTORS, effect);
        for line in lines {
            assert!(made.text().contains(line), "{effect}: no `{line}`\n{}", made.text());
        }
    };
    at("quadratic_damping(x[2])", &["der(x) = A*x + b*u + [0, -drag_x2*x[2]*abs(x[2])];"]);
    at("output_bias(y[1])", &["output y[2] = x + [bias_y1, 0], sum_x = sum(x);"]);
    at("input_delay(u[2])", &["let u_input_delay[2] = [u[1], u2_delayed];", "b*u_input_delay;", "delay(u[2], tau_u2)"]);
    at("sensor_lag(y[2])", &["let y_true[2] = x;", "output y[2] = [y_true[1], y2_lagged]"]);
    at("lag_in_coupling(x[2], x[1])", &["state x1_late = 0.5", "der(x) = A*x + b*u + [0, c_x2_x1*(x1_late - x[1])];"]);
    at("unmodelled_mode(x[1])", &["let x_rate[2] = A*x + b*u;", "der(x) = x_rate + [", "*(x_rate[1] - "]);
}

#[test]
fn the_zeros_of_a_matrix_are_couplings_that_may_be_missing() {
    let places = Catalogue::standard().places(&subject(VECTORS));
    let names = |effect: &str| -> Vec<String> {
        let of = places.candidates.iter().filter(|c| c.effect().name() == effect);
        of.map(|c| c.targets().join(" ")).collect()
    };
    assert_eq!(names("missing_coupling"), ["x[1] x[2]"]);
    assert_eq!(names("missing_control"), ["x[1] u[2]", "x[2] u[1]"]);
    assert_eq!(names("sensor_position"), ["y[1] x[2]", "y[2] x[1]"]);
    let untried: Vec<&str> = places.untried.iter().map(|u| u.name.as_str()).collect();
    assert_eq!(untried, ["A[1,1]", "A[2,1]", "A[2,2]"]);
}

/// Two bodies on a line, masses as a matrix: a force on the second stands in the second row.
#[test]
fn balances_of_vectors_take_forces_row_by_row() {
    let text = "model a { input f; state s[2], v[2]; param k = 1, d = 0.1; const m = 2; \
                der(s) = v; [[m + 1, 1], [1, 1]]*der(v) = [f, 0] - k*s - d*v; output y = s[1]; }";
    let made = extended(text, "coulomb_friction(v[2])");
    assert!(made.text().contains("= [f, 0] - k*s - d*v + [0, -friction_v2*tanh(v[2]/v0_v2)];"), "{}", made.text());
}

#[test]
fn what_nothing_can_be_attached_to_is_told() {
    let text = "model a { input u; use \"lag.fdm\" as act(x = u, T = T_act); state z; param T_act = 0.3, tau = 0.1 in [0, 1]; \
                der(z) = act.y - z + delay(u, tau); output z_m = z; }";
    let lag = "model lag { input x; param T = 0.1, k = 1; state y; der(y) = (k*x - y)/T; output y_m = y; }";
    let mut source = Source::new("a.fdm", text);
    fdm_grammar::gather(&mut source, &mut |_| Ok(lag.to_string()));
    let base = compile(&source).unwrap_or_else(|f| panic!("{f:?}"));
    let subject = Subject::new(&source, &base.model).unwrap();
    let told: Vec<String> = Catalogue::standard().places(&subject).untried.iter().map(ToString::to_string).collect();
    assert_eq!(told.len(), 3, "{told:?}");
    for (name, reason) in [("act.y", "submodel"), ("act.k", "submodel"), ("tau", "delay")] {
        assert!(told.iter().any(|t| t.contains(&format!("`{name}`")) && t.contains(reason)), "{name}: {told:?}");
    }
}

#[test]
fn friction_of_a_joint_is_tried_where_a_force_acts_on_a_speed() {
    let text = |force: &str| {
        format!(
            "model a {{ input T [{force}]; state a [rad/s], b [rad/s]; const J = 1 [kg*m^2]; param k = 1 [1/s]; \
             der(a) = -{acts} - k*a; der(b) = {acts} - k*b; output y [rad/s] = a; }}",
            acts = if force == "rad" { "k^2*T" } else { "T/J" }
        )
    };
    let count = |force: &str| {
        let places = Catalogue::standard().places(&subject(&text(force)));
        places.candidates.iter().filter(|c| c.effect().name() == "joint_friction").count()
    };
    // a torque on either rate and between both, either way round; an angle of a flap is no torque
    assert_eq!((count("N*m"), count("rad")), (4, 0));
}

#[test]
fn friction_does_not_act_on_temperatures_and_concentrations() {
    // units of x and z; without any where x has none
    let text = |x: &str, z: &str| {
        let unit = |text: String| if x.is_empty() { String::new() } else { format!(" [{text}]") };
        let (flow, rate) = (unit(format!("{x}/s")), unit("1/s".into()));
        let yields = unit(if x == z { "1".into() } else { format!("{z}*m^3/mol") });
        let (x, z) = (unit(x.into()), unit(z.into()));
        format!(
            "model a {{ input u{flow}; state x{x}, z{z}; param k = 1{rate}, l = 1{rate}, c = 1{yields};
             der(x) = u - k*x; der(z) = c*k*x - l*z; output y{z} = z; }}"
        )
    };
    let count = |x: &str, z: &str, effect: &str| {
        let places = Catalogue::standard().places(&subject(&text(x, z)));
        places.candidates.iter().filter(|c| c.effect().name() == effect && c.targets()[0] == "x").count()
    };
    let kinds = [("", 1, 1), ("m/s", 1, 0), ("A", 1, 0), ("K", 0, 2), ("mol*m^-3", 0, 0), ("kg*m^-3", 0, 0)];
    for (unit, friction, radiation) in kinds {
        let of = |effect: &str| count(unit, unit, effect);
        let found = (of("coulomb_friction"), of("quadratic_damping"), of("radiation"));
        assert_eq!(found, (friction, friction, radiation), "{unit}");
        // what is no friction is tried everywhere
        assert_eq!((of("quadratic_term") + of("curvature"), of("constant_force")), (3, 1), "{unit}");
    }
    // a reaction goes back from what it made, and heat is no reactant
    let back = |x: &str, z: &str| {
        let places = Catalogue::standard().places(&subject(&text(x, z)));
        places.candidates.iter().filter(|c| c.effect().name() == "reverse_reaction").count()
    };
    assert_eq!([back("", ""), back("mol*m^-3", "mol*m^-3"), back("mol*m^-3", "K")], [1, 1, 0]);
}

#[test]
fn a_step_of_reactions_is_changed_in_all_its_balances_with_all_its_reactants() {
    let text = "model m { state A [mol/L] = 1, B [mol/L] = 1, C [mol/L] = 0, D [mol/L] = 0;
        param k1 = 0.5 [L/(mol*min)], k2 = 0.1 [1/min]; time [min];
        reactions { A + B -> C : k1*A*B; C -> D : k2*C; }
        output a [mol/L] = A, c [mol/L] = C; }";
    let back = extended(text, "reverse_reaction(k1)").text().to_string();
    assert!(back.contains("A + B -> C : (k1 - r_k1*C/(max(A, 1e-6)*max(B, 1e-6)))*A*B;"), "{back}");
    assert!(back.contains("r_k1 = 0 [1/min]"), "{back}");
    // what is no reaction stands beside them
    let lost = extended(text, "constant_force(A)").text().to_string();
    assert!(lost.contains("der(A) = reaction(A) + force_A;"), "{lost}");
    let slow = extended(text, "inhibition(A, D, k1)").text().to_string();
    assert!(slow.contains("A + B -> C : (k1/(1 + c_A_D_k1*D/most_A))*A*B;"), "{slow}");
}

#[test]
fn heat_flows_by_differences_of_temperature() {
    let text = |unit: &str| {
        format!(
            "model a {{ input room [{unit}], u [{unit}/s]; state T [{unit}], S [{unit}]; param k = 1 [1/s], c = 1;
             der(T) = c*u; der(S) = u - k*(S - room); output y [{unit}] = T; }}"
        )
    };
    let heat = extended(&text("K"), "heat_exchange(T, S)");
    assert!(heat.text().contains("*(S - T)"), "{}", heat.text());
    let lost = extended(&text("K"), "heat_exchange(T)");
    assert!(lost.text().contains(" - T)"), "{}", lost.text());
    // as a speed, T would be coupled with each signal by its own size
    let names = ["heat_exchange", "missing_coupling", "missing_control"];
    for (unit, expected) in [("K", [4, 0, 0]), ("degC", [4, 0, 0]), ("m/s", [0, 3, 1])] {
        let places = Catalogue::standard().places(&subject(&text(unit)));
        let count = |name| places.candidates.iter().filter(|c| c.effect().name() == name).count();
        assert_eq!(names.map(count), expected, "{unit}");
    }
}

#[test]
fn a_thermometer_has_its_scale_about_a_temperature_and_stands_between_two() {
    let text = |x: &str, z: &str| {
        format!(
            "model a {{ state x [{x}], z [{z}]; param k = 1 [1/s]; der(x) = -k*x; der(z) = -k*z; output y [{z}] = z; }}"
        )
    };
    let written = |effect: &str| extended(&text("K", "K"), effect).text().to_string();
    let (scaled, between) = (written("temperature_scale(y)"), written("thermometer_position(y, z, x)"));
    assert!(scaled.contains("*(z - middle_y)"), "{scaled}");
    assert!(between.contains("*(x - z)"), "{between}");
    // each has one of two forms, and what no sensor feels is not tried
    let names = ["output_scale", "temperature_scale", "sensor_position", "thermometer_position"];
    let kinds = [
        ("m", "m", [1, 0, 1, 0]),
        ("K", "K", [0, 1, 0, 1]),
        ("degC", "degC", [0, 1, 0, 1]),
        ("K", "m", [1, 0, 0, 0]),
        ("m", "K", [0, 1, 0, 0]),
    ];
    for (x, z, expected) in kinds {
        let places = Catalogue::standard().places(&subject(&text(x, z)));
        let count = |name| places.candidates.iter().filter(|c| c.effect().name() == name).count();
        assert_eq!(names.map(count), expected, "{x} {z}");
    }
}

#[test]
fn heat_is_radiated_from_absolute_zero_on_whatever_the_scale() {
    let text = |unit: &str| {
        format!(
            "model a {{ input room [{unit}]; state T [{unit}]; param k = 1 [1/s]; der(T) = k*(room - T); output y [{unit}] = T; }}"
        )
    };
    for (unit, zero) in [("K", "0"), ("degC", "-273.15")] {
        for effect in ["radiation(T)", "radiation(T, room)"] {
            let made = extended(&text(unit), effect);
            assert!(made.text().contains(&format!("zero_T = {zero} [{unit}]")), "{}", made.text());
        }
    }
}

#[test]
fn explained_examples_have_the_mistake_and_no_other_and_their_corrections_none() {
    let pages = concat!(env!("CARGO_MANIFEST_DIR"), "/../../grammar/explain");
    let mut tested = 0;
    for page in std::fs::read_dir(pages).unwrap().map(|entry| entry.unwrap().path()) {
        let text = std::fs::read_to_string(&page).unwrap();
        let code = page.file_stem().unwrap().to_str().unwrap();
        for (kind, example) in text.split("```").filter_map(|part| part.split_once('\n')) {
            if example.starts_with("effect") {
                let (_, findings) = Catalogue::read(&Source::new("page.fdm", example));
                assert_eq!(findings.is_empty(), kind == "fdm", "{code}: {findings:?}");
                assert!(findings.iter().all(|f| f.code.text() == code), "{code}: {findings:?}");
                tested += 1;
            }
        }
    }
    assert!(tested >= 8, "{tested}");
}
