//! Texts of models that grow: large ones as somebody could write them, and deep ones that would swell if anything were done twice.

use std::fmt::Write;

/// A family of models and the size of one of them.
pub(crate) struct Family {
    /// What it is.
    pub(crate) name: &'static str,
    /// The text of a model of a size.
    pub(crate) text: fn(usize) -> String,
}

/// Models of which everything grows with the size.
pub(crate) const FAMILIES: [Family; 16] = [
    Family { name: "tanks in a row", text: tanks },
    Family { name: "banded, four parameters for each state", text: banded },
    Family { name: "sum of products with a parameter each", text: sum },
    Family { name: "chain of lets", text: |n| lets(n, "a{k} + x*c{j}") },
    Family { name: "lets that double", text: |n| lets(n, "a{k}*a{k} + a{k}") },
    Family { name: "lets that use two before them", text: fibonacci },
    Family { name: "Horner", text: |n| lets(n, "1 + x*a{k}") },
    Family { name: "powers of powers", text: |n| lets(n, "a{k}^3") },
    Family { name: "powers with a parameter", text: |n| lets(n, "(1 + a{k}^2)^c0") },
    Family { name: "min and max", text: |n| lets(n, "min(max(a{k}, x - {k}), x + {k})") },
    Family { name: "nested ifs", text: |n| lets(n, "if x > {k} then a{k} + 1 else a{k}*x") },
    Family { name: "deep quotients", text: |n| lets(n, "1/(1 + x/(2 + a{k}))") },
    Family { name: "sines of sines", text: |n| lets(n, "sin(a{k}) + x") },
    Family { name: "absolute values", text: |n| lets(n, "abs(a{k} - {k})*a{k}") },
    Family { name: "negations", text: |n| lets(n, "-(x - a{k})") },
    Family { name: "continued sum of squares", text: |n| lets(n, "sqrt(a{k}^2 + x^2 + {k})") },
];

/// Tanks that flow into each other, a parameter for each pipe.
pub(crate) fn tanks(n: usize) -> String {
    let mut text = String::from("model tanks { input u;\n");
    for k in 0..n {
        let before = if k == 0 { "u".to_string() } else { format!("k{}*sqrt(abs(h{0}))", k - 1) };
        let _ = writeln!(text, "state h{k} = 1; param k{k} = 0.1; der(h{k}) = {before} - k{k}*sqrt(abs(h{k}));");
    }
    let _ = writeln!(text, "output y = h{}; }}", n - 1);
    text
}

/// Every state depends on itself and its neighbours, with a coefficient each and one of the input.
pub(crate) fn banded(n: usize) -> String {
    let mut text = String::from("model banded { input u;\n");
    for k in 0..n {
        let (left, right) = ((k + n - 1) % n, (k + 1) % n);
        let _ = writeln!(
            text,
            "state x{k} = 0; param a{k} = -2, b{k} = 0.5, c{k} = 0.3, d{k} = 1;\n\
             der(x{k}) = a{k}*x{k} + b{k}*x{left} + c{k}*sin(x{right}) + d{k}*u;"
        );
    }
    let _ = writeln!(text, "output y = x0, z = x{}; }}", n / 2);
    text
}

/// Every state depends on all others by a coefficient that is a number: n by n terms.
pub(crate) fn full(n: usize) -> String {
    let mut text = String::from("model full { input u; param a = -1;\n");
    for i in 0..n {
        let terms: Vec<String> = (0..n).map(|j| format!("{}*x{j}", (i * 7 + j * 3) % 11 + 1)).collect();
        let _ = writeln!(text, "state x{i} = 0; der(x{i}) = a*x{i} + u + 1e-4*({});", terms.join(" + "));
    }
    text + "output y = x0; }"
}

/// One product of n factors, a parameter in each.
pub(crate) fn product(n: usize) -> String {
    let params: Vec<String> = (0..n).map(|k| format!("p{k} = 1")).collect();
    let factors: Vec<String> = (0..n).map(|k| format!("(x + p{k})")).collect();
    format!(
        "model product {{ state x = 0; param {}; der(x) = {}; output y = x; }}",
        params.join(", "),
        factors.join("*")
    )
}

/// A chain of lets that takes in another of `params` parameters at each place.
pub(crate) fn fed(n: usize, params: usize) -> String {
    let names: Vec<String> = (0..params).map(|k| format!("p{k} = 1")).collect();
    let mut text = format!("model fed {{ state x = 0; param {}; let a0 = x;\n", names.join(", "));
    for k in 0..n {
        let _ = writeln!(text, "let a{} = a{k}*sin(x + {k}) + p{};", k + 1, k % params);
    }
    text + &format!("der(x) = a{n}; output y = x; }}")
}

/// A chain of least and greatest values, of another parameter at each place.
pub(crate) fn clipped(n: usize, params: usize) -> String {
    let names: Vec<String> = (0..params).map(|k| format!("p{k} = 1")).collect();
    let mut text = format!("model clipped {{ state x = 0; param {}; let a0 = x;\n", names.join(", "));
    for k in 0..n {
        let _ = writeln!(text, "let a{} = min(max(a{k}, p{}), {k}*x);", k + 1, k % params);
    }
    text + &format!("der(x) = a{n}; output y = x; }}")
}

/// One sum of n terms.
fn sum(n: usize) -> String {
    let params: Vec<String> = (0..n).map(|k| format!("p{k} = 1")).collect();
    let terms: Vec<String> = (0..n).map(|k| format!("p{k}*u^{}", k % 5 + 1)).collect();
    format!(
        "model sum {{ input u; state x = 0; param {}; der(x) = {} - x; output y = x; }}",
        params.join(", "),
        terms.join(" + ")
    )
}

/// Lets that depend on each other in a row; `{k}` stands for the number of the one before, `{j}` for that of a constant.
fn lets(n: usize, next: &str) -> String {
    let mut text = String::from("model chain { state x = 0.5; param c0 = 0.1, c1 = 0.2, c2 = 0.3; let a0 = x*c0;\n");
    for k in 0..n {
        let next = next.replace("{k}", &k.to_string()).replace("{j}", &(k % 3).to_string());
        let _ = writeln!(text, "let a{} = {next};", k + 1);
    }
    text + &format!("der(x) = -c1*a{n} + c2; output y = x; }}")
}

fn fibonacci(n: usize) -> String {
    let mut text = String::from("model two { state x = 0.5; param c = 0.1, d = 1; let a0 = x; let a1 = x*c;\n");
    for k in 0..n {
        let _ = writeln!(text, "let a{} = d*a{k} + sin(a{});", k + 2, k + 1);
    }
    text + &format!("der(x) = -a{}; output y = x; }}", n + 1)
}
