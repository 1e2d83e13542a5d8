//! Blocks as the checker sees them: units of their states, initial values, arguments, names.

use crate::graph::{Leaf, show};
use crate::model::{Model, Origin};
use crate::{Compiled, Diagnostic, Source, compile};

fn compiled(statements: &str) -> Result<Compiled, Vec<Diagnostic>> {
    compile(&Source::new("m", format!("model m {{ {statements} }}")))
}

fn good(statements: &str) -> Model {
    match compiled(statements) {
        Ok(compiled) => {
            assert_eq!(compiled.warnings, [], "{statements}");
            compiled.model
        }
        Err(findings) => panic!("{statements}\n{findings:#?}"),
    }
}

fn told(statements: &str) -> Vec<String> {
    let source = Source::new("m", format!("model m {{ {statements} }}"));
    let findings = match compile(&source) {
        Ok(compiled) => compiled.warnings,
        Err(findings) => findings,
    };
    findings.iter().map(|f| f.line(&source)).collect()
}

fn states(model: &Model) -> Vec<(String, String, String)> {
    let shown = |e| show(&model.graph, e, model);
    model.states.iter().map(|s| (s.quantity.name.clone(), shown(s.rate), shown(s.initial))).collect()
}

#[test]
fn a_lag_is_a_state_at_rest() {
    let m = good(
        "input u [V]; param T = 0.5 [s], k = 2 [1]; output y [V] = k*lag(u, T), z [V] = lag(u, T) - washout(u, T);",
    );
    assert_eq!(states(&m), [("lag_u".into(), "(u - lag_u)/T".into(), "initial(u)".into())]);
    assert_eq!(m.params.last().map(|p| (p.origin, p.fixed)), Some((Origin::FirstSample(0), true)));
    let m = good("state x [m] = x0; param x0 = 1 [m], T = 2 [s]; der(x) = -x/T; output y [m] = lag(2*x + 1, T);");
    assert_eq!(states(&m)[1], ("lag_1".into(), "(1 + 2*x - lag_1)/T".into(), "1 + 2*x0".into()));
    let m = good("state x = free; param T = 2; der(x) = -x; output y = lag(lag(x, T), 3*T);");
    let names: Vec<_> = m.states.iter().map(|s| s.quantity.name.as_str()).collect();
    assert_eq!(names, ["x", "lag_x", "lag_lag_x"]);
    assert_eq!(states(&m)[2].2, "x(0)");
}

#[test]
fn names_of_blocks_are_free() {
    let m =
        good("input u; state lag_u = 1; param T = 1; der(lag_u) = -lag_u; output y = lag(u, T) + lag_u + lag(u, 2*T);");
    let names: Vec<_> = m.states.iter().map(|s| s.quantity.name.as_str()).collect();
    assert_eq!(names, ["lag_u", "lag_u_2", "lag_u_3"]);
}

/// The response of a transfer function at s, from its states' equations, must be the ratio of its polynomials.
fn ratio(statements: &str, numerator: &[f64], denominator: &[f64]) {
    let m = good(statements);
    let n = m.states.len();
    let leaf = |x: Vec<f64>, u: f64| {
        let m = &m;
        move |l: Leaf| match l {
            Leaf::State(k) => x[k as usize],
            Leaf::Input(_) => u,
            Leaf::Param(k) if m.params[k as usize].is_recorded() => 3.0,
            Leaf::Param(k) => m.params[k as usize].value,
            _ => f64::NAN,
        }
    };
    // d = c (s - a)^-1 b for s = 0.7 by elimination
    let s = 0.7;
    let unit = |j: usize| (0..n).map(|i| f64::from(u8::from(i == j))).collect::<Vec<f64>>();
    let rate = |i: usize, x: Vec<f64>, u: f64| m.graph.evaluate(m.states[i].rate, leaf(x, u));
    let output = |x: Vec<f64>, u: f64| m.graph.evaluate(m.outputs[0].expr, leaf(x, u));
    let mut a: Vec<Vec<f64>> = (0..n)
        .map(|i| {
            let row = (0..n).map(|j| f64::from(u8::from(i == j)) * s - rate(i, unit(j), 0.0));
            row.chain([rate(i, vec![0.0; n], 1.0)]).collect()
        })
        .collect();
    for k in 0..n {
        let pivot = (k..n).max_by(|i, j| a[*i][k].abs().total_cmp(&a[*j][k].abs())).unwrap();
        a.swap(k, pivot);
        for i in (0..n).filter(|i| *i != k) {
            let f = a[i][k] / a[k][k];
            (k..=n).for_each(|j| a[i][j] -= f * a[k][j]);
        }
    }
    let x: Vec<f64> = (0..n).map(|i| a[i][n] / a[i][i]).collect();
    let polynomial = |c: &[f64]| c.iter().fold(0.0, |sum, c| sum * s + c);
    let (got, want) = (output(x, 1.0), polynomial(numerator) / polynomial(denominator));
    assert!((got - want).abs() < 1e-12 * want.abs().max(1.0), "{statements}: {got} instead of {want}");
    // at rest with the input 3
    let x0: Vec<f64> =
        m.states.iter().map(|s| m.graph.evaluate(s.initial, leaf(vec![f64::NAN; n], f64::NAN))).collect();
    if denominator[denominator.len() - 1] != 0.0 {
        for i in 0..n {
            let moves = rate(i, x0.clone(), 3.0);
            assert!(moves.abs() < 1e-12, "{statements}: state {i} moves by {moves} from {x0:?}");
        }
    }
}

#[test]
fn blocks_have_their_transfer_functions() {
    ratio("input u; param T = 0.4; output y = lag(u, T);", &[1.0], &[0.4, 1.0]);
    ratio("input u; param T = 0.4; output y = washout(u, T);", &[0.4, 0.0], &[0.4, 1.0]);
    ratio("input u; param T = 0.4, S = 2; output y = leadlag(u, S, T);", &[2.0, 1.0], &[0.4, 1.0]);
    ratio("input u; param w = 3, z = 0.2; output y = second_order(u, w, z);", &[9.0], &[1.0, 1.2, 9.0]);
    ratio("input u; output y = tf(u, [2], [4]);", &[2.0], &[4.0]);
    ratio("input u; output y = tf(u, [2], [0.5, 1]);", &[2.0], &[0.5, 1.0]);
    ratio(
        "input u; param k = 2, p = 3; output y = tf(u, [k, -1, p], [p, 2*k, 7]);",
        &[2.0, -1.0, 3.0],
        &[3.0, 4.0, 7.0],
    );
    ratio("input u; output y = tf(u, [0, 1, 0, 5], [1, 2, 0, 3, 4]);", &[1.0, 0.0, 5.0], &[1.0, 2.0, 0.0, 3.0, 4.0]);
    ratio("input u; output y = tf(2*u, 1, [1, 0]);", &[2.0], &[1.0, 0.0]);
    ratio("input u; output y = tf(u, [3, 1], [1, 0, 0]);", &[3.0, 1.0], &[1.0, 0.0, 0.0]);
    ratio("input u; output y = lag(tf(u, [1, 3], [2, 1]), 0.1);", &[1.0, 3.0], &[0.2, 2.1, 1.0]);
}

#[test]
fn units_go_through_blocks() {
    good(
        "input d [deg]; param T = 0.1 [s], w = 3 [rad/s], z = 0.7 [1], K = 2 [1/s];
         output a [deg] = lag(d, T) + leadlag(d, 2*T, T) + washout(d, 0.3) + second_order(d, w, z),
                b [deg/s] = K*lag(lag(d, T), 0.2), c [deg] = tf(d, [w^2], [1, 2*z*w, w^2]),
                e [deg*s] = tf(d, [1], [1, 0]), f [deg/s] = tf(d, [K], [T, 1]), g [deg] = tf(d, [1], [0.5, 1]);",
    );
    // a circle through blocks keeps its units
    good(
        "input d [deg]; param T = 0.1 [s], k = 0.5 [1]; state x [deg] = 0;
         let e = d - k*lag(x, T); der(x) = e/T; output y [deg] = lag(e, T);",
    );
    let one = |statements: &str, part: &str| {
        let told = told(&format!("input d [deg]; param T = 0.1 [s], a = 1 [m], z = 1 [1]; {statements}"));
        assert!(told.len() == 1 && told[0].contains(part), "{statements}: {told:?}");
    };
    one("output y [deg] = z*T*lag(d, a)/T;", "the time constant of `lag` is in m, and must be in s");
    one("output y [deg] = a*T*z*second_order(d, T, z)/a/T;", "the frequency of `second_order` is in s, and must be in");
    one("output y [m] = a*T/T*z - lag(d, T);", "m and deg cannot be subtracted");
    one("output y [deg/s] = a/a*z*tf(d, [1], [T, T]);", "is in s, where");
}

#[test]
fn faulty_blocks_are_told() {
    let one = |statements: &str, part: &str| {
        let told = told(&format!("input u; param T = 1; {statements}"));
        assert!(told.len() == 1 && told[0].contains(part), "{statements}: {told:?}");
    };
    one(
        "param S = 0; output y = lag(T*u, S);",
        "the time constant of `lag` is 0 at the start values of the params, and must be above 0",
    );
    one("output y = T*lag(u, 0);", "the time constant of `lag` is 0, and must be above 0");
    one("output y = T*lag(u);", "`lag` takes 2 arguments, 1 given; `lag(x, T)`");
    one("output y = T*tf(u, [1, 0], [1]);", "the numerator has degree 1, the denominator 0");
    one("output y = T*tf(u, [1], [0, 1]);", "the leading coefficient of the denominator is 0");
    one(
        "param a = 0; output y = T*tf(u, [1], [a, 1]);",
        "is 0 at the start values of the params, and must be other than 0",
    );
    one(
        "output x = u*T, y = measured(lag(u, T));",
        "taken by its name; a record through a block is written the other way round: `lag(measured(y), ...)`",
    );
    one("let e = u - lag(f, T); let f = e + lag(e, T); output y = f;", "what this block has at rest depends on itself");
    one("output y = initial(u)*T;", "`initial(...)` stands in the initial value of a state only");
    one("state x = initial(z), z = initial(x); der(x) = u*T; der(z) = 0; output y = x + z;", "depends on itself");
    one("param p = lag(u, T); output y = p;", "the param `p` cannot depend on the state `lag_u`");
    one("output y = T*lagg(u, 1);", "`lagg` is not a function; did you mean `lag`?");
}

#[test]
fn the_beginning_is_found_through_everything() {
    let m = good(
        "input u; param a = 2, tau = 0.1; state x = initial(z + a), z = initial(lag(u, a)), w = initial(delay(u + x + t, tau));
         der(x) = -x; der(z) = -z; der(w) = -w; output y = x + z + w;",
    );
    let value = |k: usize| {
        m.graph.evaluate(m.states[k].initial, |l| match l {
            Leaf::Param(k) if m.params[k as usize].is_recorded() => 5.0,
            Leaf::Param(k) => m.params[k as usize].value,
            _ => f64::NAN,
        })
    };
    assert_eq!([value(0), value(1), value(2), value(3)], [7.0, 5.0, 11.9, 5.0]);
    // a long chain against the order of the text
    let chain: String = (0..2000).map(|k| format!("state x{k} = initial(x{}); der(x{k}) = -x{k}; ", k + 1)).collect();
    let m = good(&format!("{chain} param p = 3; state x2000 = p; der(x2000) = -x2000; output y = x0;"));
    assert_eq!(show(&m.graph, m.states[0].initial, &m), "p");
}
