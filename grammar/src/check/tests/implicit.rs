//! Equations implicit in the derivatives: what they are solved to, and what cannot be solved.

use super::{checked, told};
use crate::Model;
use crate::graph::{Leaf, Node};
use crate::op::Op;

fn model(text: &str) -> Model {
    checked(text).unwrap_or_else(|e| panic!("{text}: {e:?}")).0
}

/// All rates where states are 1.1, 1.2, ..., inputs 0.7, 0.8, ... and params at their start values.
fn rates(model: &Model) -> Vec<f64> {
    model.states.iter().map(|s| value(model, s.rate)).collect()
}

fn value(model: &Model, e: crate::op::ExprId) -> f64 {
    model.graph.evaluate(e, |leaf| match leaf {
        Leaf::State(k) => 1.1 + 0.1 * f64::from(k),
        Leaf::Input(k) => 0.7 + 0.1 * f64::from(k),
        Leaf::Param(k) => model.params[k as usize].value,
        Leaf::Time => 0.3,
        Leaf::Delayed(k) => 0.01 * f64::from(k),
    })
}

fn near(got: &[f64], want: &[f64]) {
    let same = got.len() == want.len() && got.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-13 * b.abs().max(1.0));
    assert!(same, "{got:?} {want:?}");
}

#[test]
fn coupled_equations_are_solved_and_others_stay() {
    let m = model(
        "model m { input L, N; state p, r, phi; param Ixx = 2, Izz = 5, Ixz = 0.5;
        Ixx*der(p) - Ixz*der(r) = L - p*r; Izz*der(r) - Ixz*der(p) = N; der(phi) = p + tan(phi)*r;
        output y = p, ay = der(r)*3 - p, z = phi; }",
    );
    let (p, r, phi): (f64, f64, f64) = (1.1, 1.2, 1.3);
    let (l, n) = (0.7 - p * r, 0.8);
    let det = 2.0 * 5.0 - 0.25;
    let want = [(5.0 * l + 0.5 * n) / det, (2.0 * n + 0.5 * l) / det, p + phi.tan() * r];
    near(&rates(&m), &want);
    near(&[value(&m, m.outputs[1].expr)], &[3.0 * want[1] - p]);
    assert!(m.graph.nodes().iter().all(|n| !matches!(n, Node::Leaf(Leaf::State(k)) if *k > 2)));
}

#[test]
fn derivatives_stand_anywhere_where_they_can_be_solved_for() {
    let m = model(
        "model m { input F; state v = 1, w, x, y, z; param m = 2, k = 3; let a = der(v); let momentum = m*v*x;
        F - k*v = a*m; (der(w) + 1)/k = -(2*a - der(w)*m); der(momentum) = F; 0 = der(y) - sqrt(der(w)^2 + 1) + k*der(y);
        if v > 0 then 2*der(z) else der(z) = a; output o = v, l = w, n = x, q = y + z; }",
    );
    let (v, x, f, mass, k): (f64, f64, f64, f64, f64) = (1.1, 1.3, 0.7, 2.0, 3.0);
    let a = (f - k * v) / mass;
    // (w + 1)/3 = -2a + 2w
    let w = (1.0 / k + 2.0 * a) / (mass - 1.0 / k);
    // m (a x + v x') = F
    let xdot = (f / mass - a * x) / v;
    near(&rates(&m), &[a, w, xdot, (w * w + 1.0).sqrt() / (1.0 + k), a / 2.0]);
}

#[test]
fn a_chain_of_fifty_masses_and_a_full_matrix() {
    let n = 50;
    let list = |f: &dyn Fn(usize) -> String| (0..n).map(f).collect::<Vec<_>>();
    let chain = list(&|k| {
        let next = if k + 1 < n { format!(" - c*der(x{})", k + 1) } else { String::new() };
        let before = if k > 0 { format!(" - c*der(x{})", k - 1) } else { String::new() };
        format!("m{k}*der(x{k}){next}{before} = -x{k};")
    });
    let (states, params) =
        (list(&|k| format!("x{k}")).join(", "), list(&|k| format!("m{k} = {}", 3 + k % 7)).join(", "));
    let text = format!(
        "model m {{ state {states}; param {params}, c = 0.3; {} output y = {}; }}",
        chain.join(" "),
        list(&|k| format!("x{k}")).join(" + ")
    );
    let m = model(&text);
    assert!(m.graph.nodes().len() < 3000, "{} nodes", m.graph.nodes().len());
    let got = rates(&m);
    for k in 0..n {
        let near = |j: Option<usize>| j.and_then(|j| got.get(j)).map_or(0.0, |r| 0.3 * r);
        let left = (3 + k % 7) as f64 * got[k] - near(k.checked_sub(1)) - near(Some(k + 1));
        assert!((left + 1.1 + 0.1 * k as f64).abs() < 1e-10, "{k}: {left}");
    }
    let full = list(&|k| {
        let sum = list(&|j| format!("{}*der(x{j})", if j == k { 60.0 } else { ((7 * k + 3 * j) % 11) as f64 / 11.0 }));
        format!("{} = -c*x{k};", sum.join(" + "))
    });
    let text = format!("model m {{ state {states}; param c = 0.3; {} output y = x0; }}", full.join(" "));
    let m = model(&text);
    assert!(m.graph.nodes().len() < 20_000, "{} nodes", m.graph.nodes().len());
    let got = rates(&m);
    for k in 0..n {
        let left: f64 = (0..n).map(|j| if j == k { 60.0 } else { ((7 * k + 3 * j) % 11) as f64 / 11.0 } * got[j]).sum();
        assert!((left + 0.3 * (1.1 + 0.1 * k as f64)).abs() < 1e-10, "{k}: {left}");
    }
}

#[test]
fn what_is_explicit_keeps_its_form() {
    let m = model("model m { state x, v; param m = 2; der(x) = v/3; m*der(v) = -x; output y = x; }");
    assert!(matches!(m.graph.node(m.states[0].rate), Node::Apply(Op::Div, _)));
    assert!(matches!(m.graph.node(m.states[1].rate), Node::Apply(Op::Div, _) | Node::Apply(Op::Neg, _)));
}

#[test]
fn what_cannot_be_solved_is_told_with_its_equations() {
    const LINEAR: &str =
        "derivatives that are solved for stand in sums, each times or divided by what holds none of them";
    const FEWER: &str = "as many equations as derivatives are needed: remove one";
    const START: &str = "choose other start values of params and states";
    let table: &[(&str, &[String])] = &[
        ("der(x)^2 = u; der(y) = x;", &[format!("2:1 E0409 this equation is not linear in `der(x)`; {LINEAR}")]),
        ("sin(der(x)) = u; der(y) = x;", &[format!("2:1 E0409 this equation is not linear in `der(x)`; {LINEAR}")]),
        (
            "der(x)*der(y) = u; der(y) + der(x) = x;",
            &[format!("2:1 E0409 this equation is not linear in `der(x)`, `der(y)`; {LINEAR}")],
        ),
        (
            "if der(x) > 0 then der(x) else 2*der(x) = u; der(y) = x;",
            &[format!("2:1 E0409 this equation is not linear in `der(x)`; {LINEAR}")],
        ),
        (
            "der(x) + der(y) = u; 2*der(x) = -2*der(y) + x;",
            &["2:22 E0408 the equations for `der(x)`, `der(y)` do not determine them: their determinant is zero; \
               an equation is a multiple of others"
                .into()],
        ),
        (
            "der(x) + a*der(y) = u; der(x)/2 = y - 2*der(y);",
            &[format!(
                "2:24 E0408 the equations for `der(x)`, `der(y)` do not determine them at the start values: \
                 their determinant is zero; {START}"
            )],
        ),
        (
            "a*der(x) = u; 3*der(x) = u;",
            &[
                "1:22 E0401 the state `y` has no equation; `der(y) = ...;`".into(),
                format!("2:15 E0402 2 equations determine `der(x)`; {FEWER}"),
            ],
        ),
        (
            "a*der(x) + der(y) = u;",
            &["1:22 E0408 1 equation determines 2 derivatives: `der(x)`, `der(y)`; one equation is needed for each state"
                .into()],
        ),
        (
            "der(x) = u; 2*der(y) = x; der(x) - der(y) = 3;",
            &[format!("2:27 E0408 3 equations determine 2 derivatives: `der(x)`, `der(y)`; {FEWER}")],
        ),
        (
            "der(x) - der(x) = u; der(y) = x;",
            &["2:1 E0408 `der(x)` is multiplied with zero in its equation; an equation is a multiple of others".into()],
        ),
        (
            "(a - 4)*der(x) = u; der(y) = x;",
            &[format!("2:1 E0408 `der(x)` is multiplied with zero in its equation at the start values; {START}")],
        ),
        (
            "x*der(x) = u; der(y) = x;",
            &[format!("2:1 E0408 `der(x)` is multiplied with zero in its equation at the start values; {START}")],
        ),
        (
            "der(x) = u + 0.5*delay(der(x), 1); der(y) = delay(der(x), 1);",
            &["2:1 E0405 `der(x)` depends on derivatives at earlier times, which depend on `der(x)`; such an equation \
               (a neutral delay equation) cannot be simulated; delay states instead"
                .into()],
        ),
        (
            "der(x) = der(der(y)); der(y) = x;",
            &["2:10 E0405 this is the derivative of something that contains a derivative already; make the first \
               derivative a `state` of its own"
                .into()],
        ),
        ("der(x) = a*der(y) + u; der(x) = 2*der(y);", &[]),
        ("der(x)*x = 1; der(y) = x;".trim_start(), &[format!("2:1 E0408 `der(x)` is multiplied with zero in its equation at the start values; {START}")]),
    ];
    for (equations, want) in table {
        let text =
            format!("model why {{ state x, y; input u; param a = 4; output o = x, p = y + u*a;\n{equations}\n}}");
        assert_eq!(told(&text), *want, "{equations}");
    }
}

#[test]
fn units_of_both_sides_are_compared() {
    let text = |right: &str| {
        format!(
            "model why {{ input F [N]; state v [m/s], x; param m = 2 [kg], c = 1 [kg/s]; m*der(v) = {right}; der(x) = v; \
             output a [m/s^2] = der(v), y = x*1; }}"
        )
    };
    assert!(told(&text("F - c*v")).iter().all(|f| !f.contains("E06")), "{:?}", told(&text("F - c*v")));
    let wrong = told(&text("c"));
    assert!(wrong.iter().any(|f| f.contains("E0602 the left side is in")), "{wrong:?}");
    let output = told(&text("F").replace("[m/s^2]", "[m/s]"));
    assert!(output.iter().any(|f| f.contains("E0602 `a` is declared in m/s, its value is in")), "{output:?}");
}

#[test]
fn coupled_sets_and_their_work_have_limits() {
    let n = 300;
    let names: Vec<String> = (0..n).map(|k| format!("x{k}")).collect();
    let ring: Vec<String> = (0..n).map(|k| format!("2*der(x{k}) - der(x{}) = 1;", (k + 1) % n)).collect();
    let text = format!("model why {{ state {}; {} output y = x0; }}", names.join(", "), ring.join(" "));
    let found = told(&text);
    assert!(found[0].contains("E0103 300 equations are coupled by `der(x0)`, `der(x1)`"), "{found:?}");
    let found = told(&full(64));
    assert!(
        found[0].contains("solving them takes more than 62500 products, each with derivatives by 64 names"),
        "{found:?}"
    );
}

/// A full matrix with a param in every column.
fn full(n: usize) -> String {
    let list = |f: &dyn Fn(usize) -> String| (0..n).map(f).collect::<Vec<_>>();
    let rows = list(&|k| {
        let sum = list(&|j| format!("(p{j} + {})*der(x{j})", if j == k { 99 } else { 1 + (7 * k + 3 * j) % 13 }));
        format!("{} = 1;", sum.join(" + "))
    });
    let (states, params) = (list(&|k| format!("x{k}")).join(", "), list(&|k| format!("p{k} = 1")).join(", "));
    format!("model why {{ state {states}; param {params}; {} output y = x0; }}", rows.join(" "))
}

#[test]
fn the_largest_set_has_its_derivatives_in_time() {
    for n in [20, 40] {
        let (m, took) = crate::stopwatch::timed(|| crate::compile(&crate::Source::new("m", full(n))).unwrap());
        assert!(m.model.graph.nodes().len() < 800_000, "{n}: {} nodes", m.model.graph.nodes().len());
        assert!(took < std::time::Duration::from_secs(20), "{n}: {took:?}");
    }
}
