//! Vectors and matrices: what they mean, and what is told about them.

use crate::graph::show;
use crate::{Compiled, Source, compile};

fn told(text: &str) -> Vec<String> {
    let source = Source::new("m", text);
    let findings = match compile(&source) {
        Ok(compiled) => compiled.warnings,
        Err(findings) => findings,
    };
    findings.iter().map(|d| d.line(&source)).collect()
}

fn compiled(text: &str) -> Compiled {
    let compiled = compile(&Source::new("m", text)).unwrap_or_else(|_| panic!("{:#?}", told(text)));
    assert!(compiled.warnings.is_empty(), "{:#?}", told(text));
    compiled
}

/// `der(x) = ...` and `y = ...` of every state and output.
fn written(text: &str) -> Vec<String> {
    let model = compiled(text).model;
    let rates = model.states.iter().map(|s| (format!("der({})", s.quantity.name), s.rate));
    let outputs = model.outputs.iter().map(|o| (o.quantity.name.clone(), o.expr));
    rates.chain(outputs).map(|(name, e)| format!("{name} = {}", show(&model.graph, e, &model))).collect()
}

#[test]
fn a_matrix_equation_is_one_for_each_element_and_zeros_are_no_terms() {
    let said = written(
        "model m { input u; state x[3]; param a = -1, A[3, 3] = [[a, 1, 0], [0, -2, 0], [0.5, 0, 2*a]];
         param b[3] = [0, 1, 0]; der(x) = A*x + b*u; output y[2] = [[1, 0, 0], [0, 0, 1]]*x; }",
    );
    let expected = [
        "der(x[1]) = x[1]*a + x[2]*A[1,2]",
        "der(x[2]) = x[2]*A[2,2] + u*b[2]",
        "der(x[3]) = x[1]*A[3,1] + 2*x[3]*a",
        "y[1] = x[1]",
        "y[2] = x[3]",
    ];
    assert_eq!(said, expected);
}

#[test]
fn entries_of_a_param_are_params_and_what_is_said_of_all_holds_for_each() {
    let model = compiled(
        "model m { const g = 9.81 [1/s]; param a = 1 [1/s], A[2, 2] \"coefficients\" [1/s] = [[a, -1], [0, g]] in [-20, 20];
         param k[3] [1] = 1 fixed, l[2] [1] = [1, 2] in [0, [5, 6]] per run, m[2] [1/s] = [a, 3] fixed; state x[2] [m] = free;
         prior l ~ normal([1, 2], 0.1), A[1,2] ~ normal(-1, 1), x(0) ~ normal(0, 2); noise y = 0.1;
         trim { x = [1, 2]; } der(x) = A*x; output z [m/s^2] = sum(k)*dot(l, x)*m[2]*m[1], y[2] [m] = x; }",
    )
    .model;
    let params: Vec<String> = model
        .params
        .iter()
        .map(|p| {
            let words = [(p.fixed, " fixed"), (p.per_run, " per run"), (p.prior.is_some(), " prior")];
            let words: String = words.iter().filter(|(is, _)| *is).map(|(_, word)| *word).collect();
            format!("{} = {} in [{}, {}]{words}", p.quantity.name, p.value, p.lower, p.upper)
        })
        .collect();
    let expected = [
        "a = 1 in [-inf, inf]",
        "A[1,2] = -1 in [-20, 20] prior",
        "A[2,2] = 9.81 in [-20, 20]",
        "k[1] = 1 in [-inf, inf] fixed",
        "k[2] = 1 in [-inf, inf] fixed",
        "k[3] = 1 in [-inf, inf] fixed",
        "l[1] = 1 in [0, 5] per run prior",
        "l[2] = 2 in [0, 6] per run prior",
        "m[2] = 3 in [-inf, inf] fixed",
        "x[1](0) = 0 in [-inf, inf] per run prior",
        "x[2](0) = 0 in [-inf, inf] per run prior",
    ];
    assert_eq!(params, expected);
    assert_eq!((model.derived.len(), model.trim.len(), model.outputs[1].noise), (2, 2, Some(0.1)));
    assert_eq!(&*model.params[1].quantity.doc, "coefficients");
}

#[test]
fn functions_of_vectors_and_matrices() {
    let said = |expression: &str, shape: &str| {
        let text = format!(
            "model m {{ input u[3], v[3], w[2]; param A[2, 2] = 1, C[3, 3] = [[1, 2, 0], [0, 1, 0], [0, 0, 4]];
             let use_all = sum(u) + sum(v) + sum(w) + sum(A*w) + sum(C*u); output y{shape} = {expression}; output all = use_all; }}"
        );
        let mut said = written(&text);
        said.pop();
        said.into_iter()
            .map(|s| s.split_once(" = ").map(|(_, e)| e.to_string()).unwrap_or_default())
            .collect::<Vec<_>>()
    };
    assert_eq!(said("dot(u, v)", ""), ["u[1]*v[1] + u[2]*v[2] + u[3]*v[3]"]);
    assert_eq!(said("transpose(u)*v", ""), said("dot(u, v)", ""));
    assert_eq!(said("cross(u, v)", "[3]"), ["u[2]*v[3] - u[3]*v[2]", "u[3]*v[1] - u[1]*v[3]", "u[1]*v[2] - u[2]*v[1]"]);
    assert_eq!(said("norm(w)", ""), ["hypot(w[1], w[2])"]);
    assert_eq!(said("A[1,:]*w", ""), ["w[1]*A[1,1] + w[2]*A[1,2]"]);
    assert_eq!(said("A[:, 2]", "[2]"), ["A[1,2]", "A[2,2]"]);
    assert_eq!(said("u[2:3] - 2*w", "[2]"), ["u[2] - 2*w[1]", "u[3] - 2*w[2]"]);
    assert_eq!(said("sin(w)", "[2]"), ["sin(w[1])", "sin(w[2])"]);
    assert_eq!(
        said("if t > 1 then w else [0, w[1]]", "[2]"),
        ["if 1 < t then w[1] else 0", "if 1 < t then w[2] else w[1]"]
    );
    assert_eq!(said("max(w, 0)", "[2]"), ["max(w[1], 0)", "max(w[2], 0)"]);
    assert_eq!(said("det(A)", ""), ["A[1,1]*A[2,2] - A[1,2]*A[2,1]"]);
    assert_eq!(said("inverse(C)*u", "[3]").len(), 3);
    assert_eq!(said("transpose(A)*A", "[2, 2]")[1], "A[1,1]*A[1,2] + A[2,1]*A[2,2]");
}

#[test]
fn shapes_that_do_not_fit_are_told() {
    let one = |statements: &str, part: &str| {
        let text = format!(
            "model m {{ input u[2]; state x[3]; param A[3, 3] = 1; param k = 1; der(x) = k*A*x; output z[2] = u; output v[3] = x; {statements} }}"
        );
        let said = told(&text);
        assert!(said.len() == 1 && said[0].contains(part), "{statements}: {said:#?}");
    };
    one(
        "output y[3] = A*u;",
        "error[E0803]: `A` is [3, 3], `u` is [2]: the columns on the left are not the rows on the right",
    );
    one("output y[3] = x + u;", "error[E0803]: `x` is [3], `u` is [2]; both must have the same shape");
    one("output y[3] = x + 1;", "error[E0803]: `x` is [3], `1` is a number");
    one("output y[3] = x + transpose(x);", "`transpose(...)` turns rows into columns");
    one("output y = dot(x, u);", "error[E0803]: `dot` takes two vectors of one length: `x` is [3], `u` is [2]");
    one("output y = x*x;", "error[E0803]: `x` is [3], `x` is [3]: vectors have several products; `dot(a, b)`");
    one("output y = x;", "error[E0803]: `y` is a number, its value is [3]; `y[3]` behind its role");
    one("output y[2] = x;", "error[E0803]: `y` is [2], its value is [3]");
    one("output y = x[4];", "error[E0804]: `x` is [3] and has no index 4 there; it counts from 1 to 3");
    one("output y = x[0];", "error[E0804]");
    one("output y = A[1];", "error[E0803]: `A` is [3, 3]: 2 indices are needed, 1 given; `A[1,2]`, `A[1,:]`");
    one("output y = A[3:2,1];", "error[E0804]: the range 3:2 is empty");
    one("output y = k[1];", "error[E0803]: `k` is a number and has no elements");
    one("output y = xx[1];", "error[E0201]: `xx` is not declared; did you mean `x`?");
    one("output y = 1/x;", "error[E0803]: `x` is [3], by which nothing is divided");
    one("output y[3] = x^2;", "error[E0803]: `x` is [3], and powers are of numbers");
    one("output y = if x > 0 then 1 else 0;", "error[E0803]: `x` is [3], and comparisons are of numbers");
    one(
        "output y[2, 2] = [[1, 2], [3]];",
        "error[E0803]: the rows of a matrix are of one length: `[1, 2]` is [2], `[3]` is [1]",
    );
    one("output y[2] = [u, 1];", "error[E0803]: the elements are neither all numbers nor all rows");
    one(
        "output y[3, 3] = inverse([[1, 2, 3], [4, 5, 6]]);",
        "error[E0803]: `inverse` takes a square matrix up to [3, 3]",
    );
    one("output y[2, 2] = inverse([[1, 0], [2, 0]]);", "error[E0407]: this matrix has no inverse");
    one("output y = sum(x, x);", "error[E0205]: `sum` takes 1 argument, 2 given; `sum(x)`");
    one(
        "param B[2, 2] = [[1, 2, 3], [4, 5, 6]]; output y[2] = B*u;",
        "error[E0803]: `B` is [2, 2], its value is [2, 3]",
    );
    one(
        "param B[2] = [k, 0]; prior B[2] ~ normal(0, 1); output y = dot(B, u);",
        "error[E0207]: `B[2]` is 0 by the structure of `B`",
    );
    one("noise z[3] = 1;", "error[E0804]: `z` is [2] and has no index 3 there");
    one("noise z = [1, 2, 3];", "error[E0803]: `z` is [2], its value is [3]");
    one("state w[2]; output y[2] = w;", "error[E0401]: the state `w` has no equation; `der(w) = ...;`");
    one("state w[2]; der(w[1]) = k; output y[2] = w;", "error[E0401]: the state `w[2]` has no equation");
    one("state w[2]; der(w) = x; output y[2] = w;", "error[E0803]: `der(w)` is [2], `x` is [3]");
    one("state w[2]; der(w + x) = x; output y[2] = w;", "error[E0803]: `w` is [2], `x` is [3]");
    one("param x = 1;", "error[E0202]: `x` is declared a second time");
    one("param u[3] = 1;", "error[E0202]: `u` is declared a second time");
    one("param t[3] = 1;", "error[E0203]: `t` has a meaning of its own");
    one("param B[0] = 1;", "error[E0804]: `B[0]` has no elements");
    one("param B[600, 600] = 1; output y = B[1,1];", "error[E0103]: `B` has more elements than the limit of 262144");
    one("param B[2, 3] = 1;", "warning[W0702]: the param `B` is not used");
    one("param B[2] = [1, ten]; output y = dot(B, u);", "error[E0201]: `ten` is not declared");
}

#[test]
fn units_hold_for_all_elements() {
    let said = told(
        "model m { input u[2] [deg]; state x[2] [m]; param A[2, 2] [1/s] = 1, B[2, 2] [m/s] = 1; der(x) = A*x + B*u;
         output y[2] [m] = x; }",
    );
    assert_eq!(said.len(), 1, "{said:#?}");
    assert!(said[0].contains("error[E0602]"), "{said:#?}");
}

#[test]
fn what_is_written_out_is_limited() {
    let said = told("model m { param A[500, 500] = 1, B[500, 500] = 1, C[500, 500] = 1; output y = (A*B*C)[1]; }");
    assert!(!said.is_empty());
    let said = told("model m { param A[500, 500] = 1, B[500, 500] = 1; let C[500, 500] = A*B; output y = C[1,1]; }");
    assert!(said.len() == 1 && said[0].contains("written out, this model has more than 4000000"), "{said:#?}");
    let said = told("model m { input u[200000]; let C[2, 2] = u*transpose(u); output y = C[1,1]; }");
    assert!(
        said.len() == 1 && said[0].contains("this product is [200000, 200000], more elements than the limit"),
        "{said:#?}"
    );
    let long = format!("model m {{ param A[500, 500] \"{}\" = 1; output y = A[1,1]; }}", "x".repeat(5000));
    let said = told(&long);
    assert!(said.len() == 1 && said[0].contains("256 MiB"), "{said:#?}");
}

#[test]
fn products_of_products_do_not_swell() {
    let names = ["A"; 12].join("*");
    let text = format!("model m {{ param A[4, 4] = 0.1; state x[4] = 1; der(x) = {names}*x; output y[4] = x; }}");
    let model = compiled(&text).model;
    assert!(model.graph.nodes().len() < 30_000, "{}", model.graph.nodes().len());
}
