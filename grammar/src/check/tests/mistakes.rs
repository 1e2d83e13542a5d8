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
            &["2:1 E0402 2 equations determine `der(x)`; as many equations as derivatives are needed: remove one"],
        ),
        (
            "x + u = 1;",
            &[
                "2:1 E0403 the left side of an equation is the derivative of a state; write `der(x) = ...;`, or `let name = ...;` for a definition",
            ],
        ),
        ("der(x, u) = 1;", &["2:1 E0205 `der` takes 1 argument, 2 given; `der(x)`"]),
        (
            "der(2*x) = 1;",
            &["2:1 E0402 2 equations determine `der(x)`; as many equations as derivatives are needed: remove one"],
        ),
        (
            "der(2*u) = 1;",
            &["2:1 E0403 no state is in this derivative; an equation says how states change: `der(x) = ...;`"],
        ),
        ("output w = der(u);", &[]),
        ("output w = der(x) + der(x*u + t);", &[]),
        ("output w = der(a);", &["2:12 E0207 `a` is a param: it does not change, so that its derivative is zero"]),
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
            &["2:13 E0406 `d` delays a state and cannot be negative, its lower bound is -1; `in [0, 1]`"],
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

#[test]
fn records() {
    same(&[
        ("output w = measured(y);", &[]),
        ("output w = measured(x)*delay(measured(y), a);", &[]),
        (
            "output w = measured(2*x);",
            &[
                "2:12 E0207 `measured` is the record of an output, taken by its name; `output y = ...;` names the expression, `measured(y)` is its record",
            ],
        ),
        ("output w = measured(q);", &["2:21 E0201 `q` is not declared"]),
        ("output w = measured(u);", &["2:12 E0207 `u` is an input, which is recorded anyway; write `u`"]),
        (
            "output w = measured(a);",
            &["2:12 E0207 `a` is a param; only outputs have a record; `measured(y)` is the record of the output `y`"],
        ),
        ("output w = measured(x, y);", &["2:12 E0205 `measured` takes 1 argument, 2 given; `measured(y)`"]),
        (
            "output w = x, v = measured(x);",
            &["2:19 E0207 the state `x` is measured by several outputs: `y`, `w`; name one: `measured(y)`"],
        ),
        (
            "state z; der(z) = -measured(z); output w = 2*z;",
            &[
                "2:20 E0207 no output is the state `z` itself, so that its record is not known; name an output, or add `output z_m = z;`",
            ],
        ),
        (
            "output w = x - 2*measured(w);",
            &[
                "2:8 W0704 the output `w` contains its own record, so that it is compared with itself; use the simulated value there, or the record of another output",
            ],
        ),
        ("output w = x - delay(measured(w), 1);", &[]),
        (
            "state z = measured(y); der(z) = a*z; output w = z;",
            &[
                "2:11 E0305 the initial value of `z` cannot depend on the record of `y`; it may depend on params; `state z = free` estimates it",
            ],
        ),
        (
            "output w = delay(x, measured(y));",
            &["2:21 E0406 a delay must not change during the run; it may depend on params, consts and numbers only"],
        ),
        ("param measured = 1;", &["2:7 E0203 `measured` is a function and cannot be declared; choose another name"]),
    ]);
}

#[test]
fn priors_and_noise() {
    same(&[
        ("prior a ~ normal(1, 0.1); noise y = 2*0.01;", &[]),
        ("state z = free; der(z) = a; output w = z; prior z(0) ~ normal(0, 1);", &[]),
        ("prior b ~ normal(1, 0.1);", &["2:7 E0201 `b` is not declared"]),
        ("prior aa ~ normal(1, 0.1);", &["2:7 E0201 `aa` is not declared; did you mean `a`?"]),
        (
            "prior u ~ normal(1, 0.1);",
            &[
                "2:7 E0207 `u` is an input; a prior is known of a param or of an initial value; `prior a ~ normal(1, 0.1);` where `a` is a param",
            ],
        ),
        (
            "prior x ~ normal(1, 0.1);",
            &[
                "2:7 E0207 `x` is a state; a prior is known of a param or of an initial value; `prior x(0) ~ ...` is about its initial value",
            ],
        ),
        (
            "prior x(0) ~ normal(1, 0.1);",
            &[
                "2:7 E0207 the initial value of `x` is not estimated by itself, so that it has no prior; `state x = free;` estimates it; a param that it is made of has its own prior",
            ],
        ),
        (
            "prior 2*a ~ normal(1, 0.1);",
            &[
                "2:7 E0207 a prior is known of a param or of an initial value; `prior a ~ normal(1, 0.1);`, `prior x(0) ~ normal(1, 0.1);`",
            ],
        ),
        (
            "prior x(1) ~ normal(1, 0.1);",
            &[
                "2:7 E0207 a prior is known of a param or of an initial value; `prior a ~ normal(1, 0.1);`, `prior x(0) ~ normal(1, 0.1);`",
            ],
        ),
        (
            "param b = 2*a; output w = b; prior b ~ normal(1, 0.1);",
            &[
                "2:36 E0207 `b` is defined by other params, so that it has no prior of its own; give priors for the params in its definition",
            ],
        ),
        (
            "param b = 2 fixed; output w = b; prior b ~ normal(1, 0.1);",
            &["2:40 W0702 the prior of `b` is not used while it is fixed; remove `fixed`, or the prior"],
        ),
        (
            "prior a ~ normal(1, 0);",
            &[
                "2:21 E0302 the deviation of the prior of `a` is 0, and must be above 0; what is known exactly is a value: `param a = ... fixed;`",
            ],
        ),
        (
            "prior a ~ normal(1, -1);",
            &[
                "2:21 E0302 the deviation of the prior of `a` is -1, and must be above 0; what is known exactly is a value: `param a = ... fixed;`",
            ],
        ),
        (
            "prior a ~ normal(1, 1/0);",
            &[
                "2:21 E0407 this value is infinite; look for a division by zero, an overflow, or a root or logarithm of a negative number",
            ],
        ),
        (
            "prior a ~ normal(a, 1);",
            &[
                "2:18 E0305 the mean of the prior of `a` cannot depend on the param `a`; it is made of numbers and consts",
            ],
        ),
        (
            "prior a ~ normal(1, u);",
            &[
                "2:21 E0305 the deviation of the prior of `a` cannot depend on the input `u`; it is made of numbers and consts",
            ],
        ),
        ("prior a ~ normal(1);", &["2:11 E0205 `normal` takes 2 arguments, 1 given; `normal(mean, deviation)`"]),
        (
            "prior a ~ normall(1, 2);",
            &["2:11 E0204 `normall` is not a distribution that priors have; did you mean `normal`?"],
        ),
        (
            "prior a ~ gauss(1, 2);",
            &["2:11 E0204 `gauss` is not a distribution that priors have; write `normal(mean, deviation)`"],
        ),
        (
            "prior a ~ uniform(1, 2);",
            &[
                "2:11 E0204 `uniform` is not a distribution that priors have; bounds hold what is equally likely: `param a = 1 in [0, 2];`",
            ],
        ),
        (
            "prior a ~ beta(1, 2);",
            &["2:11 E0204 `beta` is not a distribution that priors have; priors are `normal(mean, deviation)`"],
        ),
        ("prior a ~ 3;", &["2:11 E0207 a prior is a distribution; `normal(mean, deviation)`"]),
        (
            "prior a ~ normal(1, 2), a ~ normal(1, 2);",
            &["2:25 E0202 the prior of `a` is given a second time; remove one of them"],
        ),
        ("prior a ~ normal(1, b);", &["2:21 E0201 `b` is not declared"]),
        (
            "prior a ~ normal(1, 2 > 1);",
            &[
                "2:21 E0502 a number is needed here, this is a condition; `if condition then 1 else 0` makes it a number",
            ],
        ),
        ("noise der(x) = 2*a;", &[]),
        ("noise der(xx) = 1;", &["2:11 E0201 `xx` is not declared; did you mean `x`?"]),
        (
            "noise der(y) = 1;",
            &["2:11 E0207 `y` is an output; `der` is of states; `noise y = 0.1;` is the noise of its measurement"],
        ),
        (
            "noise der(u) = 1;",
            &["2:11 E0207 `u` is an input; `der` is of states; noise enters the equations of states"],
        ),
        (
            "noise der(x) = 0;",
            &[
                "2:16 E0302 the noise of `der(x)` is 0, and must be above 0; without this statement no noise enters the equation; a param in its place is estimated",
            ],
        ),
        (
            "noise der(x) = 0.1*u;",
            &[
                "2:20 E0305 the noise of `der(x)` cannot depend on the input `u`; it is made of numbers, consts and params",
            ],
        ),
        (
            "noise der(x) = 1; noise der(x) = 2;",
            &["2:29 E0202 the process noise of `x` is given a second time; remove one of them"],
        ),
        ("noise yy = 1;", &["2:7 E0201 `yy` is not declared; did you mean `y`?"]),
        (
            "noise x = 1;",
            &["2:7 E0207 `x` is a state; noise is known of outputs; `noise y = 0.1;` where `y` is an output"],
        ),
        (
            "noise u = 1;",
            &["2:7 E0207 `u` is an input; noise is known of outputs; `noise y = 0.1;` where `y` is an output"],
        ),
        (
            "noise y = 0;",
            &["2:11 E0302 the noise of `y` is 0, and must be above 0; without this statement the noise is estimated"],
        ),
        ("noise y = a;", &[]),
        ("param s = 0.1; input column; noise y = s*abs(y) + 0.01*exp(-t) + column;", &[]),
        ("noise y = 0.1*abs(yy);", &["2:19 E0201 `yy` is not declared; did you mean `y`?"]),
        ("noise y = 1; noise y = 2;", &["2:20 E0202 the noise of `y` is given a second time; remove one of them"]),
        ("const s = 0.1; noise y = s;", &[]),
    ]);
}
