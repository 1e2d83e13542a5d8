//! Behaviour of the whole room: trees of good texts here, findings about bad ones and limits beside it.
#![allow(clippy::unwrap_used)]

mod limits;
mod slips;

use super::*;
use crate::source::Source;

const PITCH: &str = r#"model pitch_eqv "HFB 320 equivalent pitch model" {
  time [s];
  input  stick  "pitch stick"                [deg];
  state  q      "pitch rate"                 [deg/s]  = q0;
  state  z                                   [deg/s^2], w = free;  // initial value 0 when not given
  param  q0     = 0          [deg/s]   per run;
  param  omega  = 2.0 in [0.1, 20]  [rad/s];
  param  K      = 1.5        [1/s^2],  Ts = 0.4 [s] fixed;
  param  tau    = 0.1 in [0, 0.5]  [s] "effective time delay";
  const  g      = 9.80665    [m/s^2];
  let    damping = 2*zeta*omega;
  der(q) = z; /* between */
  der(z) = -damping*z - omega^2*q + K*(stick + Ts*der(stick));
  output q_m "measured pitch rate" [deg/s] = delay(q, tau);
}
"#;

/// An expression with all brackets, from the tree of `der(x) = TEXT;`.
fn bracketed(text: &str) -> String {
    let source = Source::new("m", format!("model m {{ der(x) = {text}; }}"));
    let tree = parse(&source).unwrap_or_else(|f| panic!("{text}: {f:?}"));
    let StatementKind::Equation(_, right) = tree.statements[0].kind else { panic!("no equation") };
    show(&tree, right)
}

fn show(tree: &SyntaxTree, e: ExprRef) -> String {
    let s = |e: &ExprRef| show(tree, *e);
    match tree.expr(e) {
        Expr::Number(v) => v.to_string(),
        Expr::Name(n) => n.clone(),
        Expr::Unary(sign, a) => format!("({sign:?} {})", s(a)),
        Expr::Binary(sign, a, b, _) => format!("({sign:?} {} {})", s(a), s(b)),
        Expr::Call(f, args) => format!("{}({})", f.text, args.iter().map(s).collect::<Vec<_>>().join(", ")),
        Expr::If(c, a, b) => format!("(if {} {} {})", s(c), s(a), s(b)),
        Expr::Vector(list) => format!("[{}]", list.iter().map(s).collect::<Vec<_>>().join(", ")),
        Expr::Element(name, slices) => format!("{}{slices:?}", name.text),
    }
}

#[test]
fn a_model_is_read_exactly_as_written() {
    let source = Source::new("m", PITCH);
    let tree = parse(&source).unwrap();
    assert_eq!((tree.name.text.as_str(), tree.statements.len()), ("pitch_eqv", 13));
    assert_eq!(tree.doc.as_ref().unwrap().text, "HFB 320 equivalent pitch model");
    assert!(tree.suspended.is_empty());
    assert!(matches!(&tree.statements[0].kind, StatementKind::Time(u) if u.text == "s"));
    let StatementKind::Declare(Role::State, names) = &tree.statements[3].kind else { panic!() };
    assert_eq!(names.len(), 2);
    assert_eq!((names[0].name.text.as_str(), names[0].unit.as_ref().unwrap().text.as_str()), ("z", "deg/s^2"));
    assert!(matches!(names[1].value, Some(Value::Free(s)) if source.slice(s) == "free"));
    assert_eq!(source.slice(names[1].span), "w = free");
    let StatementKind::Declare(Role::Param, names) = &tree.statements[5].kind else { panic!() };
    let bounds = names[0].bounds.unwrap();
    assert_eq!(source.slice(bounds.span), "in [0.1, 20]");
    assert_eq!(tree.expr(bounds.upper), &Expr::Number(20.0));
    assert_eq!(source.slice(tree.statements[10].span), "der(q) = z;");
}

#[test]
fn precedence_is_that_of_mathematics() {
    let cases = [
        ("-x^2", "(Minus (Power x 2))"),
        ("x^-2", "(Power x (Minus 2))"),
        ("x^-y^2*z", "(Multiply (Power x (Minus (Power y 2))) z)"),
        ("2^3^x", "(Power 2 (Power 3 x))"),
        ("-a*b", "(Multiply (Minus a) b)"),
        ("a - b - c", "(Subtract (Subtract a b) c)"),
        ("a / b * c", "(Multiply (Divide a b) c)"),
        ("a--+b", "(Subtract a (Minus (Plus b)))"),
        ("a*(b + c)*d", "(Multiply (Multiply a (Add b c)) d)"),
        ("not a < b and c or d", "(Or (And (Not (Less a b)) c) d)"),
        ("a or b and not c", "(Or a (And b (Not c)))"),
        ("a + 1 <= 2*b", "(LessEqual (Add a 1) (Multiply 2 b))"),
        ("(a < b) == (c < d)", "(Equal (Less a b) (Less c d))"),
        ("f() + g(a, b + c, h(d))", "(Add f() g(a, (Add b c), h(d)))"),
        ("if a then b else c + d", "(if a b (Add c d))"),
        ("1 + if a then b else c + d", "(Add 1 (if a b (Add c d)))"),
        ("(if a then b else c) + d", "(Add (if a b c) d)"),
        ("if a then b else if c then d else e", "(if a b (if c d e))"),
        ("if a then if b then c else d else e", "(if a (if b c d) e)"),
        ("if a then b else -if c then d else e", "(if a b (Minus (if c d e)))"),
        ("1e-3 + 2. + .5 + 1.5E+2", "(Add (Add (Add 0.001 2) 0.5) 150)"),
        ("2.*x", "(Multiply 2 x)"),
        ("α_1 + notx + iffy + orb", "(Add (Add (Add α_1 notx) iffy) orb)"),
    ];
    for (text, tree) in cases {
        assert_eq!(bracketed(text), tree, "{text}");
    }
}

#[test]
fn spans_cover_the_text_of_their_expressions() {
    let cases = [
        ("a*(b + c)", "a*(b + c)", "*"),
        ("(a + b) * c", "(a + b) * c", "*"),
        ("-x ^ 2 - f( y )", "-x ^ 2 - f( y )", "-"),
        ("((a)) < ((b))", "((a)) < ((b))", "<"),
    ];
    for (text, whole, sign) in cases {
        let source = Source::new("m", format!("model m {{ der(x) = {text}; }}"));
        let tree = parse(&source).unwrap();
        let StatementKind::Equation(left, right) = tree.statements[0].kind else { panic!() };
        assert_eq!((source.slice(tree.span(left)), source.slice(tree.span(right))), ("der(x)", whole));
        let Expr::Binary(.., sign_span) = tree.expr(right) else { panic!() };
        assert_eq!(source.slice(*sign_span), sign, "{text}");
    }
    let source = Source::new("m", "model m { der(x) = 1 + if a then b else if c then d else (e); }");
    let tree = parse(&source).unwrap();
    let texts: Vec<_> = tree.expressions.iter().map(|(_, s)| source.slice(*s)).collect();
    let ifs: Vec<_> = texts.into_iter().filter(|t| t.starts_with("if")).collect();
    assert_eq!(ifs, ["if c then d else (e)", "if a then b else if c then d else (e)"]);
}

#[test]
fn operands_stand_before_the_expressions_that_use_them() {
    let source = Source::new("m", PITCH);
    for (k, (expr, _)) in parse(&source).unwrap().expressions.iter().enumerate() {
        let operands = match expr {
            Expr::Number(_) | Expr::Name(_) => vec![],
            Expr::Unary(_, a) => vec![*a],
            Expr::Binary(_, a, b, _) => vec![*a, *b],
            Expr::Call(_, args) => args.clone(),
            Expr::If(c, a, b) => vec![*c, *a, *b],
            Expr::Vector(list) => list.clone(),
            Expr::Element(..) => vec![],
        };
        assert!(operands.iter().all(|o| (o.0 as usize) < k));
    }
}

#[test]
fn the_grammar_reserves_exactly_the_words_of_the_table() {
    for (word, purpose) in WORDS {
        let source = Source::new("m", format!("model m {{ param {word} = 1, {word}_1 = 2; }}"));
        let reserved = parse(&source).is_err();
        assert_eq!(reserved, *purpose != WordUse::Value, "{word}");
    }
    let statements: Vec<_> = words_for(&[WordUse::Statement]).collect();
    // `known` is a name where no other name follows: a condition of effects is called so
    assert!(Role::ALL.iter().all(|r| *r == Role::Known || statements.contains(&r.keyword())));
    let source = Source::new("m", "model m { known T0 per run; param known = 1; output y = known*T0; }");
    assert!(crate::compile(&source).is_ok());
}

#[test]
fn texts_of_windows_and_of_other_scripts_are_read() {
    let text = "\u{feff}model ω_1 {\r\n  state α \"Größe\" [µm/°C],\r\n    x\u{302}; // ü\r\n  der(α) = −x̂;\r\n}\r\n"
        .replace('−', "-");
    let source = Source::new("m", text);
    let tree = parse(&source).unwrap();
    let StatementKind::Declare(_, names) = &tree.statements[0].kind else { panic!() };
    assert_eq!((tree.name.text.as_str(), names[0].unit.as_ref().unwrap().text.as_str()), ("ω_1", "µm/°C"));
    assert_eq!(source.slice(tree.statements[1].span), "der(α) = -x̂;");
}

#[test]
fn the_rest_of_the_language_is_read_and_written_back() {
    let statements = [
        "tie Lq = Mp, act.T = 2*b;",
        "table CL(alpha [rad]) \"lift\" [1] = linear { -0.2: -0.9, 0: CL0, 0.3: 1.6 };",
        "use \"actuator.fdm\" as act(x = dlon + 1, T = T_act);",
        "use \"actuator.fdm\" as act;",
        "state x[3] = [1, 0, x0] [m/s], y [1];",
        "param A[3, 3] = [[a, 1, 0], [0, -0.5, 0], [0, 0, 1e-9]] in [-5, 5] [1/s] fixed, b[1, 2] = 0;",
        "der(x) = A*x + B*u + x[2]*A[1:2, :] + act.y*act.inner.z[3];",
        "noise y[2] = 0.1, y = 0.2;",
        "noise der(x) = q, der(act.z[2]) = sqrt(2*s^2/L);",
        "trim { x[1] = 2; act.y = u; }",
        "prior a ~ normal(-0.7, 0.1), x(0) ~ normal(0, 2);",
        "output y \"seen\" = tf(x, [b1, b0], [1, a1, a0]) [m];",
    ];
    for statement in statements {
        let source = Source::new("m", format!("model m {{ {statement} }}"));
        let tree = parse(&source).unwrap_or_else(|f| panic!("{statement}: {f:?}"));
        let printed = Printer::with_source(&tree, &source).statement(&tree.statements[0]);
        assert_eq!(printed, statement);
    }
}

#[test]
fn what_is_printed_means_what_was_read() {
    let texts = [
        "-x^2",
        "(-x)^2",
        "x^-y^2*z",
        "(2^3)^x",
        "2^3^x",
        "-a*b",
        "-(a*b)",
        "a - (b - c)",
        "a/(b*c)",
        "a/b*c",
        "a - -b",
        "not (a < b and c)",
        "(a < b) == (c < d)",
        "(if c then a else b) + 1",
        "if c then a else if d then b else e",
        "if (if a then b else c) then d else e",
        "f(a, [b, [c]])",
        "(a or b) and c",
        "-(-x)",
        "2*-x",
        "(a + b)*-(c + d)",
        "x[2]^y[1]",
        "-(x^2)^3",
        "(not a) == b",
    ];
    for text in texts.into_iter() {
        let source = Source::new("m", format!("model m {{ der(x) = {text}; }}"));
        let tree = parse(&source).unwrap_or_else(|f| panic!("{text}: {f:?}"));
        let StatementKind::Equation(_, right) = tree.statements[0].kind else { panic!("no equation") };
        let printed = Printer::new(&tree).expression(right);
        assert_eq!(bracketed(&printed), bracketed(text), "{text} was printed as {printed}");
    }
}

#[test]
fn brackets_behind_a_space_are_units_and_behind_a_name_indices() {
    let source = Source::new("m", "model m { param a = b [1], c = b[1], d = b[m], e [m] = (b) [2]; }");
    let findings = parse(&source).unwrap_err();
    assert_eq!(findings.len(), 1, "{findings:?}");
    let source = Source::new("m", "model m { param a = b [1], c = b[1], d = b[m], e [m] = (b); }");
    let tree = parse(&source).unwrap();
    let printed = Printer::new(&tree).statement(&tree.statements[0]);
    assert_eq!(printed, "param a = b [1], c = b[1], d = b [m], e = b [m];");
}
