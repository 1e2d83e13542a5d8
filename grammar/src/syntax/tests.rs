//! Behaviour of the whole room: trees of good texts, findings about bad ones, limits.

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

/// The findings about a text, one line each: place as `line:column`, code, message, hint.
fn findings(text: &str) -> Vec<String> {
    let source = Source::new("m", text);
    parse_recovering(&source).1.iter().map(|d| d.line(&source)).collect()
}

/// Findings about one statement in an otherwise good model; its first column is 1.
fn slip(statement: &str) -> String {
    findings(&format!("model m {{\n{statement}\n}}")).join(" | ").replace("m:2:", "")
}

#[test]
fn show_all() {
    for s in SLIPS {
        println!("({s:?}, {:?}),", slip(s));
    }
}

const SLIPS: &[&str] = &[
    "state x = 3",
    "state x",
    "param a = 1\nparam b = 2;",
    "der(x) = -x\nder(y) = 3;",
    "der(x) = ;",
    "der(x) = (a + );",
    "der(x) = a b;",
    "der(x) = 2 x;",
    "der(x) = 2x;",
    "der(x) = 1e;",
    "der(x) = 1e400;",
    "der(x) := 3;",
    "der(x) == 3;",
    "param a == 3;",
    "param a := 3;",
    "x' = 3;",
    "xdot := 3;",
    "der(x) = a**2;",
    "param x 3;",
    "param x -3;",
    "param x [m;",
    "param x [m\n  = 3;",
    "stat x;",
    "paramter a = 3;",
    "parameter a = 3;",
    "outptu y = x;",
    "der(x) = if a then b;",
    "der(x) = if a b else c;",
    "der(x) = if a = b then c else d;",
    "param a = 1,5;",
    "der(x) = a && b;",
    "der(x) = a || b;",
    "der(x) = !a;",
    "noise q = 0.02;",
    "trim { u = 1; v = 2; }",
    "trim { u = 1; v = 2; } state x;",
    "use \"actuator.fdm\" as act(x = dlon, T = T_act);",
    "effect f(i: input) \"doc\" { param tau = 0; replace i with delay(i, tau); }",
    "param a = 1 in [0, 1] in [0, 2];",
    "param a = 1 = 2;",
    "param a \"x\" \"y\";",
    "param a fixed fixed;",
    "param a per;",
    "param a per rin;",
    "param a = 1 fixd;",
    "der(x) = a < b < c;",
    "der(x) = @@ # ;",
    "der(x) = a ? b : c;",
    "param in = 3;",
    "param noise = 3;",
    "der(x) = sin(time);",
    "der(x) = K*noise;",
    "param a \"abc;\nstate y;",
    "/* abc",
    "der(x) = (a + b;",
    "der(x) = (a + b];",
    "der(x) = a + b);",
    "param a in [0 1];",
    "param a in (0, 1);",
    "param a in 0, 1;",
    "param a in [0, 1, 2];",
    "x;",
    "x + 1;",
    "3;",
    "der(x) = 3 \"doc\";",
    "der(x) = y[2];",
    "state x[3];",
    "param A = [[1, 2], [3, 4]];",
    "param a,;",
    "param;",
    "param , a;",
    "time;",
    "time s;",
    "time [s",
    "der(x) = a.b;",
    "der(x) += 3;",
    "f(a b) = 3;",
    "f(a, ) = 3;",
    "der(x) = a <= ;",
    "end;",
    "equation",
    "state x; state y\n state z; let let = 3;",
    "der x = 3;",
    "der(x) = x.^2;",
    "der(x) = x²;",
    "der(x) = a − b;",
    "}",
    "state x;\n}\nstate y;",
    "} model b { }",
    "};",
    ";;",
    "param a = 3 }",
    "param a = {1, 2};",
    "tirm { u = 1; v = 2; }",
    "der(x) = 'a';",
    "(((",
    ")))",
    "der(x) = a then b;",
    "der(x) = if;",
    "der(x) = free;",
    "param a = \n state b;",
    "param a = 1\n\n   \nfoo = 3;",
    "let x = a\n  + b\n  c = 3;",
    "let x = \"a\";",
    "output y = delay(x tau);",
    "const g 9.81 [m/s^2];",
    "param b = 1 in [0, 1] [m] \"doc\" fixed per run extra;",
];

#[test]
fn frames() {
    for s in [
        "",
        "  // only\n",
        "/* x",
        "state x;",
        "model",
        "model {}",
        "model m",
        "model m {",
        "model m { state x;",
        "modle m { state x; }",
        "model m \"doc {",
        "model 3 {}",
        "model m-n { state x; }",
        "model in { }",
        "model m \"a\" \"b\" {}",
        "\u{0}\u{1}\u{2} ab \u{fffd} ;{{{",
        "foo bar baz",
        "model a {} model b {}",
        "model a { state x;\nmodel b { state y; }",
        "effect f(i: input) { }",
        "\u{feff}model m {}",
        "junk\nmodel m {}",
        "model m state x; der(x) = 1; }",
        "#include x\nmodel m { }",
        "model m { trim { u = 1; ",
        "<html><body>Not found</body></html>",
        "time,x,y\n0,1,2\n",
    ] {
        println!("{s:?} => {:#?}", findings(s));
    }
}
