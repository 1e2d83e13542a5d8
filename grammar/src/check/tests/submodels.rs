//! Submodels: what they mean, and what is told about them.

use crate::{Compiled, Source, compile, gather};

const ACTUATOR: &str = "model actuator \"first-order actuator\" {
  input  x \"command\" [deg];
  state  z \"position\" [deg] = z0;
  param  T = 0.1 in [0.01, 1] [s], z0 = 0 [deg] per run, gain = 1 fixed [1];
  prior  T ~ normal(0.1, 0.02);
  noise  y = 0.1;
  trim   { z = 0; x = 0; }
  der(z) = (gain*x - z)/T;
  output y \"surface\" [deg] = z;
}";

/// A model with its files, by name.
pub(super) fn source(text: &str, files: &[(&str, &str)]) -> Source {
    let mut source = Source::new("m.fdm", text);
    gather(&mut source, &mut |name| {
        let file = files.iter().find(|(n, _)| *n == name);
        file.map(|(_, text)| text.to_string()).ok_or_else(|| "there is no such file".into())
    });
    source
}

fn compiled(text: &str, files: &[(&str, &str)]) -> Compiled {
    let source = source(text, files);
    compile(&source).unwrap_or_else(|e| panic!("{}", e.iter().map(|d| d.line(&source)).collect::<Vec<_>>().join("\n")))
}

/// What is told, a line each.
fn told(text: &str, files: &[(&str, &str)]) -> Vec<String> {
    let source = source(text, files);
    let findings = match compile(&source) {
        Ok(compiled) => compiled.warnings,
        Err(findings) => findings,
    };
    findings.iter().map(|d| d.line(&source)).collect()
}

#[test]
fn a_submodel_is_its_equations_under_another_name() {
    let whole = compiled(
        "model m { input dlon [deg]; param T_act = 0.2 [s]; use \"actuator.fdm\" as act(x = 2*dlon, T = 2*T_act);
         use \"actuator.fdm\" as second(x = act.y, T = 0.3, z0 = 0); output y [deg] = second.y; }",
        &[("actuator.fdm", ACTUATOR)],
    );
    let model = &whole.model;
    assert!(whole.warnings.is_empty(), "{:?}", whole.warnings);
    let params: Vec<_> = model.params.iter().map(|p| (&*p.quantity.name, p.value, p.fixed, p.per_run)).collect();
    let expected = [
        ("T_act", 0.2, false, false),
        ("act.z0", 0.0, false, true),
        ("act.gain", 1.0, true, false),
        ("second.T", 0.3, true, false),
        ("second.z0", 0.0, true, false),
        ("second.gain", 1.0, true, false),
    ];
    assert_eq!(params, expected);
    assert_eq!(model.params[3].upper, 1.0);
    assert!(model.params.iter().all(|p| p.prior.is_none()));
    let states: Vec<_> = model.states.iter().map(|s| (&*s.quantity.name, &*s.quantity.doc)).collect();
    assert_eq!(states, [("act.z", "position"), ("second.z", "position")]);
    assert_eq!((model.inputs.len(), model.outputs.len(), model.trim.len(), model.derived.len()), (1, 1, 2, 1));
    let shown = crate::graph::show(&model.graph, model.states[0].rate, model);
    assert_eq!(shown, "(2*act.gain*dlon - act.z)/(2*T_act)");
}

#[test]
fn files_may_use_files() {
    let pair = "model pair { input u [deg]; param T = 0.1 [s]; use \"../one/actuator.fdm\" as a(x = u, T = T);
                use \"../one/actuator.fdm\" as b(x = a.y, T = T); output y [deg] = b.y; }";
    let whole = compiled(
        "model m { input u [deg]; use \"two/pair.fdm\" as p(u = u); output y [deg] = p.y; }",
        &[("two/pair.fdm", pair), ("one/actuator.fdm", ACTUATOR)],
    );
    let names: Vec<_> = whole.model.states.iter().map(|s| &*s.quantity.name).collect();
    assert_eq!(names, ["p.a.z", "p.b.z"]);
    assert_eq!(whole.model.params[0].quantity.name, "p.T");
}

#[test]
fn mistakes_of_a_file_are_told_once_at_their_place() {
    let broken = ACTUATOR.replace("gain*x", "gian*x");
    let said = told(
        "model m { input u [deg]; use \"a.fdm\" as a(x = u); use \"a.fdm\" as b(x = a.y); output y [deg] = b.y + c; }",
        &[("a.fdm", &broken)],
    );
    let expected = [
        "m.fdm:1:101: error[E0201]: `c` is not declared",
        "a.fdm:8:13: error[E0201]: `gian` is not declared; did you mean `gain`?",
    ];
    assert_eq!(said, expected);
    let said =
        told("model m { use \"a.fdm\" as a(x = 1); output y [deg] = a.y; }", &[("a.fdm", "model a {\n state x\n}}")]);
    assert!(said.iter().all(|s| s.starts_with("a.fdm:")) && !said.is_empty(), "{said:#?}");
}

#[test]
fn units_are_checked_across_files() {
    let said = told(
        "model m { input u [rad]; use \"a.fdm\" as a(x = u); output y [rad] = deg2rad(a.y); }",
        &[("a.fdm", ACTUATOR)],
    );
    assert_eq!(said.len(), 1, "{said:#?}");
    assert!(
        said[0].starts_with("m.fdm:1:47: error[E0602]: `a.x` is declared in deg, its value is in rad"),
        "{said:#?}"
    );
    let slow = ACTUATOR.replace("input  x", "time [min];\n  input  x").replace("[s]", "[min]");
    let said = told("model m { input u [deg]; use \"a.fdm\" as a(x = u); output y [deg] = a.y; }", &[("a.fdm", &slow)]);
    assert_eq!(said.len(), 1, "{said:#?}");
    assert!(said[0].contains("the submodel `a` counts time in min, this model in s"), "{said:#?}");
}

#[test]
fn wrong_connections_are_told() {
    let said = |connections: &str| {
        let text = format!("model m {{ input u [deg]; use \"a.fdm\" as a{connections}; output y [deg] = a.y; }}");
        told(&text, &[("a.fdm", ACTUATOR)])
    };
    let one = |connections: &str, part: &str| {
        let said = said(connections);
        assert!(said.len() == 1 && said[0].contains(part), "{said:#?}");
    };
    one("", "error[E0802]: nothing is connected to the input `x` of `a`; `as a(x = ...)`");
    one("(x = u, X = 1)", "error[E0201]: `a` has no input or param `X`; did you mean `x`?");
    one("(x = u, gian = 1)", "did you mean `gain`?");
    one("(x = u, y = 1)", "error[E0207]: `y` is an output of `a`; inputs and params are connected; its value is `a.y`");
    one("(x = u, x = 1)", "error[E0202]: `x` of `a` is connected a second time");
    one("(x = u, T = 2)", "error[E0304]: `a.T` starts at 2, outside its bounds [0.01, 1]");
    one("(x = a)", "error[E0207]: `a` is a submodel, not a quantity; its names are `a.x`");
    one("(x = v)", "error[E0201]: `v` is not declared");
    one("(x = u, T = a.z)", "the param `a.T` cannot depend on the state `a.z`");
}

#[test]
fn names_of_submodels_are_known_and_others_are_not() {
    let said = told(
        "model m { input u [deg]; use \"a.fdm\" as act(x = u); output y [deg] = act.yy + act.z; }",
        &[("a.fdm", ACTUATOR)],
    );
    assert_eq!(said, ["m.fdm:1:70: error[E0201]: `act.yy` is not declared; did you mean `act.y`?"]);
    let said = told(
        "model m { input u [deg]; param a = 1; use \"a.fdm\" as a(x = u); output y [deg] = a*u; }",
        &[("a.fdm", ACTUATOR)],
    );
    assert_eq!(said.len(), 1, "{said:#?}");
    assert!(said[0].contains("error[E0202]: `a` is declared a second time"), "{said:#?}");
}

#[test]
fn files_that_are_not_there_and_circles_are_told() {
    let text = "model m { use \"dir/a.fdm\" as a; use \"b.fdm\" as b; output y = a.y + b.y; }";
    let b = "model b { use \"c.fdm\" as c; output y = c.y; }";
    let c = "model c { use \"b.fdm\" as b; output y = b.y; }";
    let said = told(text, &[("b.fdm", b), ("c.fdm", c)]);
    let expected = [
        "m.fdm:1:15: error[E0801]: the submodel `dir/a.fdm` cannot be read: there is no such file; \
         paths are relative to the file that says `use`",
        "c.fdm:1:15: error[E0206]: files use each other in a circle: b.fdm -> c.fdm -> b.fdm; \
         a model cannot be a part of itself",
    ];
    assert_eq!(said, expected);
    let own = told("model m { use \"m.fdm\" as a; output y = a.y; }", &[]);
    assert!(own.len() == 1 && own[0].contains("m.fdm -> m.fdm"), "{own:#?}");
    let lone = compile(&Source::new("m", "model m { use \"m.fdm\" as a; output y = a.y; }")).expect_err("no files");
    assert!(lone[0].message.contains("no files are read here"), "{lone:?}");
}

#[test]
fn levels_and_sizes_are_limited() {
    let level = |k: usize| {
        format!("model l {{ use \"{}.fdm\" as a; use \"{}.fdm\" as b; output y = a.y + b.y; }}", k + 1, k + 1)
    };
    let chain = |levels: usize, last: &str| {
        let mut files: Vec<(String, String)> = (1..levels).map(|k| (format!("{k}.fdm"), level(k))).collect();
        files.push((format!("{levels}.fdm"), last.into()));
        let files: Vec<(&str, &str)> = files.iter().map(|(n, t)| (&**n, &**t)).collect();
        told(&level(0), &files)
    };
    let small = "model l { param k = 1; output y = k; }";
    assert_eq!(chain(4, small), Vec::<String>::new());
    let deep = chain(17, small);
    assert!(deep.len() == 1 && deep[0].contains("more than 16 levels deep"), "{deep:#?}");
    let large = format!("model l {{ param k = 1; output y = k{}; }}", " + k".repeat(50_000));
    let large = chain(8, &large);
    assert!(
        large.len() == 1 && large[0].contains("error[E0103]: written out, this model has more than 4000000"),
        "{large:#?}"
    );
}

const PLANT: &str = "model plant {
  input u[2];
  state x[2] = x0;
  param A[2, 2] = [[-1, 0], [0.5, -2]] in [-9, 9], gain[2] = 1, x0[2] = 0 per run;
  prior A[1,1] ~ normal(-1, 0.1);
  trim  { x = [1, 2]; u[1] = 0; }
  der(x) = A*x + [gain[1]*u[1], gain[2]*u[2]];
  output y[2] = x;
}";

#[test]
fn vectors_are_connected_whole() {
    let whole = compiled(
        "model m { input d; param k = 2; use \"p.fdm\" as one(u = [d, 2*d], gain = [k, 3]);
         use \"p.fdm\" as two(u = one.y - one.x[1]*one.x, A = [[k, 0], [0, -1]]); output y[2] = two.y, z = one.y[2]; }",
        &[("p.fdm", PLANT)],
    );
    let model = &whole.model;
    let params: Vec<String> = model
        .params
        .iter()
        .map(|p| {
            format!(
                "{} = {}{}{}",
                p.quantity.name,
                p.value,
                if p.fixed { " fixed" } else { "" },
                if p.prior.is_some() { " prior" } else { "" }
            )
        })
        .collect();
    let expected = [
        "k = 2",
        "one.A[1,1] = -1 prior",
        "one.A[2,1] = 0.5",
        "one.A[2,2] = -2",
        "one.gain[2] = 3 fixed",
        "one.x0[1] = 0",
        "one.x0[2] = 0",
        "two.A[2,2] = -1 fixed",
        "two.gain[1] = 1",
        "two.gain[2] = 1",
        "two.x0[1] = 0",
        "two.x0[2] = 0",
    ];
    assert_eq!(params, expected);
    assert_eq!((model.states.len(), model.trim.len()), (4, 4));
    let shown = crate::graph::show(&model.graph, model.states[0].rate, model);
    assert_eq!(shown, "one.x[1]*one.A[1,1] + d*k");
}

#[test]
fn shapes_are_checked_across_files() {
    let said = |connections: &str| {
        let text = format!("model m {{ input d; use \"p.fdm\" as p{connections}; output y[2] = p.y; }}");
        told(&text, &[("p.fdm", PLANT)])
    };
    let one = |connections: &str, part: &str| {
        let said = said(connections);
        assert!(said.len() == 1 && said[0].contains(part), "{said:#?}");
    };
    one("(u = [d, d, d])", "error[E0803]: `p.u` is [2], its value is [3]");
    one("(gain = 2)", "error[E0802]: nothing is connected to the input `u` of `p`");
    one("(u = d, A = [[1, 2], [3]])", "error[E0803]: the rows of a matrix are of one length");
    assert_eq!(said("(u = d)"), Vec::<String>::new());
}
