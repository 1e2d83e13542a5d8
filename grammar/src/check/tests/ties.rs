//! Ties on and off, and what is told about those that cannot be.

use super::{good, told};
use crate::graph::show;

#[test]
fn a_tied_param_gives_way_to_what_it_is_tied_to() {
    let open = good(
        "param a = 1 in [0, 6], b = 2 in [-5, 5], c = 3 per run, d = 4 per run, e = 5;
         tie a = 2*b, d = a + c; tie e = b; prior b ~ normal(1, 1);
         output y = a + 10*b + 100*c + 1000*d + e;",
    );
    assert_eq!(open.tied_names().collect::<Vec<_>>().len(), 3);
    assert_eq!(open.params.len(), 5);
    let names = |m: &crate::Model| m.params.iter().map(|p| p.quantity.name.clone()).collect::<Vec<_>>();
    let tied = open.tied(&[]);
    assert_eq!(names(&tied), ["b", "c"]);
    assert_eq!((tied.params[0].lower, tied.params[0].upper), (0.0, 3.0), "bounds of both");
    assert!(tied.params[0].prior.is_some());
    let derived: Vec<_> =
        tied.derived.iter().map(|d| (d.quantity.name.as_str(), show(&tied.graph, d.expr, &tied), d.tied)).collect();
    assert_eq!(derived, [("a", "2*b".to_string(), true), ("d", "2*b + c".into(), true), ("e", "b".into(), true)]);
    let value = |m: &crate::Model| {
        m.graph.evaluate(m.outputs[0].expr, |l| match l {
            crate::graph::Leaf::Param(k) => m.params[k as usize].value,
            _ => f64::NAN,
        })
    };
    assert_eq!(value(&tied), 4.0 + 20.0 + 300.0 + 7000.0 + 2.0);
    let half = open.tied(&["a"]);
    assert_eq!(names(&half), ["a", "b", "c"]);
    assert_eq!(value(&half), 1.0 + 20.0 + 300.0 + 4000.0 + 2.0);
    assert_eq!(value(&open.tied(&["a", "d", "e"])), 4326.0);
}

#[test]
fn faulty_ties_are_told() {
    let one = |statements: &str, part: &str| {
        let told = told(&format!("model m {{ input u; param a = 1, b = 2; {statements} output y = a*b*u; }}"));
        assert!(told.len() == 1 && told[0].contains(part), "{statements}: {told:?}");
    };
    one("tie a = a;", "`a` is defined by itself; remove one of the ties");
    one("tie a = b, b = 2*a;", "`a` -> `b` -> `a`; remove one of the ties");
    one("tie a = u;", "what the param `a` is tied to cannot depend on the input `u`");
    one("tie u = a;", "a tie holds between params; `u` is declared as input");
    one("tie c = a;", "`c` is not declared");
    one("tie a = b, a = 2;", "`a` is tied a second time");
    one("param c = 2*a; output z = c; tie c = b;", "`c` is defined by other params already");
    one("param c = 2 fixed; output z = c; tie c = b;", "`c` is fixed, so that it cannot be tied");
    one("param c = 2 in [0, 3]; output z = c; tie c = 2*b;", "`c` starts at 4 by this tie, outside its bounds [0, 3]");
    one("param c = 2; output z = c; tie c = 1/(b - 2);", "is not finite at the start values");
    one("param c = 2 per run; output z = c; tie a = c;", "one value for all runs");
    one(
        "param c = 2 [m], d = 1 [s]; output z [m*s] = c*d; tie c = d;",
        "`c` is declared in m, what it is tied to is in s",
    );
    one("prior a ~ normal(1, 1); tie a = b;", "the prior of `a` is not used while it is tied");
}
