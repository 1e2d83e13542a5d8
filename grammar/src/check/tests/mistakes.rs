//! Names, declarations, equations, delays, kinds: each mistake with its place, sentence and hint.

use super::told;

/// Findings about statements on line 2 of a model that is otherwise complete.
fn same(table: &[(&str, &[&str])]) {
    for (statements, want) in table {
        let text =
            format!("model m {{ state x; input u; param a = 1; der(x) = a*u - x; output y = x;\n{statements}\n}}");
        assert_eq!(told(&text), *want, "{statements}");
    }
}

#[test]
fn names_and_functions() {
    same(&[
        ("let z = alhpa; output w = z;", &["2:9 E0201 `alhpa` is not declared"]),
        ("state x;", &["2:7 E0202 `x` is declared a second time; remove one of them or choose another name"]),
        ("param sin = 1;", &["2:7 E0203 `sin` is a function and cannot be declared; choose another name"]),
        (
            "param t = 1;",
            &["2:7 E0203 `t` is the time since the run began and cannot be declared; choose another name"],
        ),
        ("output w = foo(x);", &["2:12 E0204 `foo` is not a function"]),
        ("output w = ln(x);", &["2:12 E0204 `ln` is not a function; write `log(x)`"]),
        ("output w = sinn(x);", &["2:12 E0204 `sinn` is not a function; did you mean `sin`?"]),
        ("output w = sin(x, u);", &["2:12 E0205 `sin` takes 1 argument, 2 given; `sin(x)`"]),
        ("output w = clip(x);", &["2:12 E0205 `clip` takes 3 arguments, 1 given; `clip(x, lower, upper)`"]),
        (
            "output w = lag(x, 1);",
            &[
                "2:12 E0405 `lag` belongs to the language, but this version does not compile it yet; write its equations with a `state`",
            ],
        ),
        ("output w = a(x);", &["2:12 E0204 `a` is not a function; a product is written with a sign: `a*(...)`"]),
        (
            "let p = q; let q = r + 1; let r = p; output w = p;",
            &[
                "2:5 E0206 definitions refer to each other in a circle: `p` -> `q` -> `r` -> `p`; break it with a `state`, whose equation may refer to itself",
            ],
        ),
        (
            "let p = p; output w = p;",
            &[
                "2:5 E0206 `p` is defined by itself; a definition holds at all times: give the new value a name of its own; what changes with time is a `state`",
            ],
        ),
    ]);
}

#[test]
fn declarations() {
    same(&[
        (
            "param b; output w = b;",
            &[
                "2:7 E0301 the param `b` has no start value; `param b = 1;` gives the value from which the estimation starts",
            ],
        ),
        ("const c; output w = c;", &["2:7 E0301 the const `c` has no value; `const c = ...;`"]),
        ("let c; output w = c;", &["2:5 E0301 the let `c` has no value; `let c = ...;`"]),
        ("output w;", &["2:8 E0301 the output `w` has no expression; `output w = ...;` says what is measured"]),
        (
            "input v = 1; output w = v;",
            &[
                "2:7 E0302 the input `v` cannot have a value: it is read from the record; `const v = ...;` for a constant, `let v = ...;` for a signal that is computed",
            ],
        ),
        (
            "input v = free; output w = v;",
            &["2:11 E0306 `free` cannot be given for the input `v`; it is for initial values: `state x = free;`"],
        ),
        ("param b = 1 in [2, 0]; output w = b;", &["2:13 E0303 the bounds [2, 0] of `b` leave no room; `in [0, 2]`"]),
        (
            "param b = 1 in [0, u]; output w = b;",
            &["2:20 E0303 the bounds of `b` cannot depend on the input `u`; bounds are made of numbers and consts"],
        ),
        (
            "param b = 5 in [0, 1]; output w = b;",
            &["2:11 E0304 `b` starts at 5, outside its bounds [0, 1]; start inside the bounds or widen them"],
        ),
        (
            "const c = 2*a; output w = c;",
            &["2:13 E0305 the const `c` cannot depend on the param `a`; `let c = ...;` may depend on anything"],
        ),
        (
            "param b = 2*u; output w = b;",
            &["2:13 E0305 the param `b` cannot depend on the input `u`; `let b = ...;` may depend on anything"],
        ),
        (
            "state z = u; der(z) = 0; output w = z;",
            &[
                "2:11 E0305 the initial value of `z` cannot depend on the input `u`; it may depend on params; `state z = free` estimates it",
            ],
        ),
        (
            "state z = t; der(z) = 0; output w = z;",
            &[
                "2:11 E0305 the initial value of `z` cannot depend on the time `t`; it may depend on params; `state z = free` estimates it",
            ],
        ),
        (
            "state z in [0, 1]; der(z) = 0; output w = z;",
            &[
                "2:9 E0306 bounds cannot be given for the state `z`; bound its initial value: `param z0 = 0 in [lower, upper]; state z = z0;`",
            ],
        ),
        (
            "let c = free; output w = c;",
            &["2:9 E0306 `free` cannot be given for the let `c`; it is for initial values: `state x = free;`"],
        ),
        (
            "param b = 1 fixed per run; output w = b;",
            &["2:19 E0306 `b` cannot be fixed and have a value of its own in each run; remove `fixed` or `per run`"],
        ),
        (
            "param b = 2*a in [0, 1]; output w = b;",
            &[
                "2:15 E0306 bounds cannot be given for `b`, which other params define; give it for the params in the definition, or make the start value a number",
            ],
        ),
        ("param b = 1 in [0, inf]; output w = b;", &[]),
    ]);
}

#[test]
fn equations() {
    same(&[
        ("state z; output w = z;", &["2:7 E0401 the state `z` has no equation; `der(z) = ...;`"]),
        (
            "der(x) = 1;",
            &["2:1 E0402 the state `x` has a second equation; add the right sides or remove one of the equations"],
        ),
        (
            "x = 1;",
            &[
                "2:1 E0403 the left side of an equation is the derivative of a state; `x` is a state; write `der(x) = ...;`",
            ],
        ),
        (
            "y = 1;",
            &[
                "2:1 E0403 the left side of an equation is the derivative of a state; `y` is an output; give the value where it is declared: `output y = ...;`",
            ],
        ),
        (
            "let c = 1; c = 2; output w = c;",
            &[
                "2:12 E0403 the left side of an equation is the derivative of a state; `c` is a let; give the value where it is declared: `let c = ...;`",
            ],
        ),
        (
            "q = 1; output w = q;",
            &[
                "2:1 E0403 the left side of an equation is the derivative of a state; `q` is not declared; `param q = ...;` or `const q = ...;` gives a number a name",
            ],
        ),
        (
            "der(u) = 1;",
            &[
                "2:1 E0403 `u` is an input; only a state has an equation; remove the equation: the values come from the record",
            ],
        ),
        ("der(xx) = 1;", &["2:5 E0201 `xx` is not declared; did you mean `x`?"]),
        (
            "2*der(x) = 1;",
            &[
                "2:1 E0405 an equation is solved for one derivative; other left sides are not compiled yet; solve it by hand: `der(x) = ...;`",
            ],
        ),
        (
            "x + u = 1;",
            &[
                "2:1 E0403 the left side of an equation is the derivative of a state; write `der(x) = ...;`, or `let name = ...;` for a definition",
            ],
        ),
        ("der(x, u) = 1;", &["2:1 E0205 `der` takes 1 argument, 2 given; `der(x)`"]),
        ("der(2*x) = 1;", &["2:1 E0403 `der` is taken of a state, by its name; declare a `state` for this quantity"]),
        (
            "output w = der(u);",
            &[
                "2:12 E0405 the derivative of the input `u` is not compiled yet; record the derivative as an input of its own, or filter the input with a state",
            ],
        ),
        (
            "output w = der(x);",
            &[
                "2:12 E0405 `der(...)` stands on the left side of an equation only; name the right side of its equation: `let x_dot = ...; der(x) = x_dot;`",
            ],
        ),
    ]);
}

#[test]
fn delays() {
    same(&[
        (
            "output w = delay(x, u);",
            &["2:21 E0406 a delay must not change during the run; it may depend on params, consts and numbers only"],
        ),
        ("output w = delay(x, -1);", &["2:21 E0406 a delay of -1 would look into the future; a delay is 0 or more"]),
        (
            "param d = -1; output w = delay(x, d);",
            &["2:7 E0406 `d` is a delay and cannot be negative, it starts at -1; start at 0 or above"],
        ),
        (
            "param d = 1 in [-1, 1]; output w = delay(x, d);",
            &["2:13 E0406 `d` is a delay and cannot be negative, its lower bound is -1; `in [0, 1]`"],
        ),
        (
            "output w = delay(x, a - 2);",
            &["2:21 E0406 this delay is -1 at the start values of the params; a delay is 0 or more"],
        ),
        (
            "state z; param d = -2; der(z) = -delay(z, d); output w = z;",
            &["2:16 E0406 `d` is a delay and cannot be negative, it starts at -2; start at 0 or above"],
        ),
        (
            "state z; der(z) = -delay(z, abs(z)); output w = z;",
            &["2:29 E0406 a delay must not change during the run; it may depend on params, consts and numbers only"],
        ),
    ]);
}

#[test]
fn values_that_are_not_finite() {
    same(&[
        (
            "const c = 1/0; output w = c;",
            &[
                "2:11 E0407 this value is infinite; look for a division by zero, an overflow, or a root or logarithm of a negative number",
            ],
        ),
        (
            "output w = x*log(-1);",
            &[
                "2:14 E0407 this value is not defined; look for a division by zero, an overflow, or a root or logarithm of a negative number",
            ],
        ),
        (
            "param b = inf; output w = b;",
            &[
                "2:11 E0407 this value is infinite; look for a division by zero, an overflow, or a root or logarithm of a negative number",
            ],
        ),
        (
            "param b = 1/(a - 1); output w = b;",
            &["2:11 E0407 the param `b` is not finite at the start values of the params; choose other start values"],
        ),
    ]);
}

#[test]
fn conditions_and_numbers() {
    same(&[
        (
            "output w = if x then 1 else 0;",
            &["2:15 E0501 a condition is needed here, this is a number; compare it with something, such as `x > 0`"],
        ),
        (
            "output w = x + (u > 0);",
            &[
                "2:17 E0502 a number is needed here, this is a condition; `if condition then 1 else 0` makes it a number",
            ],
        ),
        (
            "output w = x < 1 and u;",
            &["2:22 E0501 a condition is needed here, this is a number; compare it with something, such as `x > 0`"],
        ),
        (
            "let c = x > 0; output w = c;",
            &["2:9 E0502 a number is needed here, this is a condition; `if condition then 1 else 0` makes it a number"],
        ),
    ]);
}

#[test]
fn warnings() {
    same(&[
        ("const c = 1;", &["2:7 W0702 the const `c` is not used; remove it or use it in an equation"]),
        (
            "param b = 1; state z; der(z) = b; ",
            &[
                "2:7 W0703 no output depends on `b`, so it cannot be estimated; make it `fixed` or add an output that depends on it",
            ],
        ),
        (
            "state z = free; der(z) = z;",
            &[
                "2:11 W0703 no output depends on `z(0)`, so it cannot be estimated; give the state an initial value or add an output that depends on it",
            ],
        ),
        ("input v;", &["2:7 W0702 the input `v` is not used; remove it or use it in an equation"]),
    ]);
}

#[test]
fn second_places_are_labelled() {
    let source = "model m { state x; der(x) = 1; output y = x; let x = 2; der(x) = 3; }";
    let findings = super::checked(source).expect_err("two mistakes");
    let places: Vec<_> =
        findings.iter().map(|f| (&source[f.span.range()], &source[f.labels[0].span.range()])).collect();
    assert_eq!(places, [("x", "x"), ("der(x)", "der(x)")]);
    assert!(findings.iter().all(|f| f.labels[0].span < f.span), "the first place explains the second");
}

#[test]
fn a_model_needs_an_output() {
    let want = "1:7 E0404 the model `m` has no output; `output y = ...;` says what is measured";
    assert_eq!(told("model m { state x; der(x) = 1; }"), [want]);
}

#[test]
fn all_mistakes_are_told_at_once_and_only_once() {
    let text = "model m {
  state v [m/s], v [m/s];
  input u [furlongs];
  param k = 3 in [0, 1], c;
  let d = c*alhpa + alhpa*v, e = d*u;
  der(v) = e - k*sinn(v);
  der(w) = 1;
  output y [m/s] = v + d;
}";
    let codes: Vec<String> = told(text).iter().map(|l| l.split(' ').take(2).collect::<Vec<_>>().join(" ")).collect();
    let want = ["2:18 E0202", "3:12 E0601", "4:13 E0304", "4:26 E0301", "5:13 E0201", "6:18 E0204", "7:7 E0201"];
    assert_eq!(codes, want, "what depends on a mistake is silent");
}

#[test]
fn statements_that_could_not_be_read_have_no_consequences() {
    let source = crate::Source::new("m", "model m { param K = = 2; state x; der(x) = K*x; output y = x; der(z) = ; }");
    let (tree, findings) = crate::syntax::parse_recovering(&source);
    let tree = tree.expect("a partial tree");
    assert!(!findings.is_empty());
    assert_eq!(crate::check::check(&tree).map(|(m, _)| m.name), Err(Vec::new()), "K and z are excused");
}
