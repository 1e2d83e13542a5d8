//! What people get wrong, and what they are told.

use super::super::parse_recovering;
use crate::source::Source;

/// The findings about a text: `line:column: code: message; hint`, separated by ` | `.
fn findings(text: &str) -> String {
    let source = Source::new("m", text);
    let lines = parse_recovering(&source).1.into_iter().map(|d| d.line(&source));
    lines.map(|l| l[2..].replacen("error[", "", 1).replacen(']', "", 1)).collect::<Vec<_>>().join(" | ")
}

/// The findings about a statement in an otherwise good model; lines count from the statement's first.
fn slip(statement: &str) -> String {
    let text = format!("model m {{ state x;\n{statement}\n}}");
    let mut lines = findings(&text);
    for line in 2..9 {
        lines = lines.replace(&format!("| {line}:"), &format!("| {}:", line - 1));
        if lines.starts_with(&format!("{line}:")) {
            lines = format!("{}{}", line - 1, &lines[1..]);
        }
    }
    lines
}

fn same(table: &[(&str, &str)], told: fn(&str) -> String) {
    let wrong = table.iter().map(|(text, want)| (text, want, told(text))).filter(|(_, want, told)| *want != told);
    let wrong: Vec<String> = wrong.map(|(text, want, told)| format!("{text}\n  want {want}\n  told {told}")).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn slips_in_statements_are_told_in_words() {
    same(SLIPS, slip);
}

#[test]
fn slips_around_statements_are_told_in_words() {
    same(FRAMES, findings);
}

#[rustfmt::skip]
const SLIPS: &[(&str, &str)] = &[
    ("state x", "1:8: E0101: expected `;` after the declaration of `x`"),
    ("param a = 1\nparam b = 2;", "1:12: E0101: expected `;` after the declaration of `a`"),
    ("der(x) = -x\nder(y) = 3;", "1:12: E0101: expected `;` after the equation of `x`"),
    ("der(x) = ;", "1:10: E0101: expected an expression, found `;`"),
    ("der(x) = (a + );", "1:15: E0101: expected an expression, found `)`"),
    ("der(x) = a b;", "1:12: E0101: expected `;` after the equation of `x`, found `b`; a product is written `a*b`, a call `a(b)`"),
    ("der(x) = 2 x;", "1:12: E0101: expected `;` after the equation of `x`, found `x`; a product is written `2*x`"),
    ("der(x) = 2x;", "1:10: E0101: `2x` is neither a number nor a name; a product is written `2*x`"),
    ("der(x) = 1e;", "1:10: E0105: the number `1e` lacks the digits of its exponent; an exponent is written `1e-3`"),
    ("der(x) = 1e400;", "1:10: E0105: the number `1e400` is too large; the largest number is about 1.8e308"),
    ("der(x) := 3;", "1:8: E0101: expected `=`, found `:=`; equations and values are written with a single `=`"),
    ("der(x) == 3;", "1:8: E0101: expected `=`, found `==`; equations and values are written with a single `=`; `==` compares"),
    ("param a == 3;", "1:9: E0101: expected `=`, found `==`; equations and values are written with a single `=`; `==` compares"),
    ("param a := 3;", "1:9: E0101: expected `;` after the declaration of `a`, found `:=`; equations and values are written with a single `=`"),
    ("x' = 3;", "1:2: E0101: expected `=`, found `'`; a derivative is written `der(x)`"),
    ("xdot := 3;", "1:6: E0101: expected `=`, found `:=`; equations and values are written with a single `=`"),
    ("der(x) = a**2;", "1:11: E0101: expected an expression, found `**`; a power is written with `^`"),
    ("param x 3;", "1:9: E0101: expected `;` after the declaration of `x`, found `3`; a value is written `x = 3`"),
    ("param x -3;", "1:9: E0101: expected `;` after the declaration of `x`, found `-`; a value is written `x = -3`"),
    ("param x [m;", "1:9: E0104: this `[` is not closed in its statement; write `]` where it ends"),
    ("param x [m\n  = 3;", "1:9: E0104: this `[` is not closed in its statement; write `]` where it ends"),
    ("stat x;", "1:1: E0101: no statement begins with `stat`; did you mean `state`?"),
    ("paramter a = 3;", "1:1: E0101: no statement begins with `paramter`; did you mean `param`?"),
    ("parameter a = 3;", "1:1: E0101: no statement begins with `parameter`; did you mean `param`?"),
    ("outptu y = x;", "1:1: E0101: no statement begins with `outptu`; did you mean `output`?"),
    ("der(x) = if a then b;", "1:21: E0101: expected `else`, found `;`; a choice is written `if c then a else b`"),
    ("der(x) = if a b else c;", "1:15: E0101: expected `then`, found `b`; a choice is written `if c then a else b`"),
    ("der(x) = if a = b then c else d;", "1:15: E0101: expected `then`, found `=`; a comparison is written with `==`"),
    ("param a = 1,5;", "1:13: E0101: expected a name, found `5`; a decimal fraction is written with a point: `1.5`"),
    ("der(x) = a && b;", "1:12: E0101: expected `;` after the equation of `x`, found `&&`; write `and`"),
    ("der(x) = a || b;", "1:12: E0101: expected `;` after the equation of `x`, found `||`; write `or`"),
    ("der(x) = !a;", "1:10: E0101: expected an expression, found `!`; write `not`"),
    ("noise q = 0.02, p = 1;", ""),
    ("prior a ~ normal(1, 2), x(0) ~ normal(3, 4);", ""),
    ("noise der(q) = 0.02, der(x[1]) = a*b;", ""),
    ("noise der(q) 0.02;", "1:14: E0101: expected `=`, found `0.02`; noise in an equation is written `noise der(x) = intensity`"),
    ("noise der(q) ~ normal(0, 1);", "1:14: E0101: expected `=`, found `~`; noise in an equation is written `noise der(x) = intensity`"),
    ("noise 0.02;", "1:7: E0101: expected a name, found `0.02`"),
    ("noise q ~ normal(0, 1);", "1:9: E0101: expected `=`, found `~`; known noise is written `noise y = deviation`"),
    ("noise q 0.02;", "1:9: E0101: expected `=`, found `0.02`; known noise is written `noise y = deviation`"),
    ("noise q;", "1:8: E0101: expected `=`, found `;`; known noise is written `noise y = deviation`"),
    ("noise q = 1 [m];", "1:13: E0101: expected `,` or `;`, found `[m]`; units stand in declarations only"),
    ("prior a = normal(1, 2);", "1:9: E0101: expected `~`, found `=`; a prior is written `prior a ~ normal(mean, deviation)`"),
    ("prior a;", "1:8: E0101: expected `~`, found `;`; a prior is written `prior a ~ normal(mean, deviation)`"),
    ("prior;", "1:6: E0101: expected an expression, found `;`"),
    ("prior a ~;", "1:10: E0101: expected an expression, found `;`"),
    ("prior a ~ normal(1, 2) b;", "1:24: E0101: expected `,` or `;`, found `b`; a product is written `(...)*b`"),
    ("prior a normal(1, 2);", "1:9: E0101: expected `~`, found `normal`; a prior is written `prior a ~ normal(mean, deviation)`"),
    ("a ~ normal(1, 2);", "1:3: E0101: expected `=`, found `~`; what is measured is written `output y = ...`, what is known before `prior a ~ normal(mean, deviation)`"),
    ("proir a ~ normal(1, 2);", "1:1: E0101: no statement begins with `proir`; did you mean `prior`?"),
    ("param noise = 3 prior a ~ normal(1, 2);", "1:7: E0203: `noise` is a word of the language and cannot be a name; choose another name"),
    ("trim { u = 1; v = 2; }", ""),
    ("trim { u = 1; v = 2; } state x;", ""),
    ("trim { u = 1; v = 2; }; state x;", ""),
    ("trim { u = if a < 1 then 2 else 3; v = (2); } state x;", ""),
    ("trim { u = 1; v = 2*a } state x;", "1:23: E0101: expected `;` after the trim of `v`, found `}`"),
    ("trim { u = 1, v = 2; }", "1:13: E0101: expected `;` after the trim of `u`, found `,`"),
    ("trim u = 1;", "1:6: E0101: expected `{`, found `u`; a trim is written `trim { x = value; u = value; }`"),
    ("trim { } state x;", "1:8: E0101: expected a name, found `}`"),
    ("trim { u = (1; v = 2; } state x;", "1:12: E0104: `(` is closed by `}`"),
    ("trim { u = 1 }; state x;", "1:14: E0101: expected `;` after the trim of `u`, found `}`"),
    ("trim { u [m] = 1; }", "1:10: E0101: expected `=`, found `[m]`; a trim is written `trim { x = value; u = value; }`"),
    ("trim { der(u) = 1; }", "1:11: E0101: expected `=`, found `(`; a trim is written `trim { x = value; u = value; }`"),
    ("trim { u == 1; }", "1:10: E0101: expected `=`, found `==`; equations and values are written with a single `=`; `==` compares"),
    ("trim { 3 = 1; }", "1:8: E0101: expected a name, found `3`"),
    ("param trim = 3;", "1:7: E0203: `trim` is a word of the language and cannot be a name; choose another name"),
    ("trim { u = 1; v = 2;\n state x;", "1:6: E0104: this `{` is not closed in its statement; write `}` where it ends"),
    ("use \"actuator.fdm\" as act(x = dlon, T = T_act);", ""),
    ("effect f(i: input) \"doc\" { param tau = 0; replace i with delay(i, tau); }", "1:1: E0101: `effect` cannot stand inside a model; effects stand in a file of their own"),
    ("param a = 1 in [0, 1] in [0, 2];", "1:23: E0306: `a` has bounds twice; leave one of them out"),
    ("param a = 1 = 2;", "1:13: E0306: `a` has a second value; leave one of them out"),
    ("param a \"x\" \"y\";", "1:13: E0306: `a` has a second doc string; leave one of them out"),
    ("param a fixed fixed;", "1:15: E0306: `a` has `fixed` twice; leave one of them out"),
    ("param a per;", "1:12: E0101: expected `run`, found `;`; a value for each run is marked `per run`"),
    ("param a per rin;", "1:13: E0101: expected `run`, found `rin`; did you mean `run`?"),
    ("param a = 1 fixd;", "1:13: E0101: expected `;` after the declaration of `a`, found `fixd`; did you mean `fixed`?"),
    ("der(x) = a < b < c;", "1:16: E0101: a comparison of a comparison has no meaning; join comparisons with `and`: `a < b and b < c`"),
    ("der(x) = @@ # ;", "1:10: E0101: the characters `@@` cannot stand here | 1:13: E0101: the character `#` cannot stand here; a comment begins with `//`"),
    ("der(x) = a ? b : c;", "1:12: E0101: the character `?` cannot stand here; a choice is written `if c then a else b`"),
    ("param in = 3;", "1:7: E0203: `in` is a word of the language and cannot be a name; choose another name"),
    ("param noise = 3;", "1:7: E0203: `noise` is a word of the language and cannot be a name; choose another name"),
    ("der(x) = sin(time);", "1:14: E0101: expected an expression, found `time`; the time since the run began is `t`"),
    ("der(x) = K*noise;", "1:12: E0101: expected an expression, found `noise`; `noise` is a word of the language; give the quantity another name"),
    ("param a \"abc;\nstate y;", "1:9: E0104: this string is not closed on its line; write `\"` at its end"),
    ("/* abc", "1:1: E0104: this comment is not closed; write `*/` at its end"),
    ("der(x) = (a + b;", "1:10: E0104: this `(` is not closed in its statement; write `)` where it ends"),
    ("der(x) = (a + b];", "1:10: E0104: `(` is closed by `]`"),
    ("der(x) = a + b);", "1:15: E0101: expected `;` after the equation of `x`, found `)`; no `(` is open here"),
    ("param a in [0 1];", "1:15: E0101: expected `,`, found `1`; bounds are written `in [lower, upper]`"),
    ("param a in (0, 1);", "1:12: E0101: expected `[`, found `(`; bounds are written `in [lower, upper]`"),
    ("param a in 0, 1;", "1:12: E0101: expected `[`, found `0`; bounds are written `in [lower, upper]`"),
    ("param a in [0, 1, 2];", "1:17: E0101: expected `]`, found `,`; bounds are written `in [lower, upper]`"),
    ("x;", "1:2: E0101: expected `=`, found `;`; an equation is written `der(x) = ...;`"),
    ("x + 1;", "1:6: E0101: expected `=`, found `;`; an equation is written `der(x) = ...;`"),
    ("3;", "1:2: E0101: expected `=`, found `;`; an equation is written `der(x) = ...;`"),
    ("der(x) = 3 \"doc\";", "1:12: E0101: expected `;` after the equation of `x`, found `\"doc\"`; doc strings stand in declarations"),
    ("der(x) = y [2];", "1:12: E0101: expected `;` after the equation of `x`, found `[2]`; an index stands directly behind a name: `x[2]`"),
    ("param a = 1 [m] [3];", "1:17: E0306: the size of `a` does not stand behind its name; `a[3]`; a pure number has the unit `[1]`"),
    ("der(x) = y[99999999999];", "1:10: E0105: the index 99999999999 is too large"),
    ("param A = [[1, 2], [3, 4];", "1:11: E0104: this `[` is not closed in its statement; write `]` where it ends"),
    ("param A = [1, 2; 3, 4];", "1:11: E0104: this `[` is not closed in its statement; write `]` where it ends | 1:19: E0101: expected `=`, found `,`; a decimal fraction is written with a point: `3.4`"),
    ("tie Lq;", "1:7: E0101: expected `=`, found `;`; a tie is written `tie a = b`"),
    ("use act(x = u);", "1:8: E0101: expected `as`, found `(`; a submodel is used by `use \"file.fdm\" as name(input = expression)`"),
    ("use \"a.fdm\";", "1:12: E0101: expected `as`, found `;`; a submodel is used by `use \"file.fdm\" as name(input = expression)`"),
    ("table CL = linear { 1: 2 };", "1:10: E0101: expected `(`, found `=`; a table is written `table NAME(x) = linear { x1: y1, x2: y2 }`"),
    ("table CL(a) = linear { 1, 2 };", "1:25: E0101: expected `:`, found `,`; a point is written `x: y`"),
    ("table CL(a) = linear { };", "1:24: E0101: expected an expression, found `}`"),
    ("param a,;", "1:9: E0101: expected a name, found `;`"),
    ("param;", "1:6: E0101: expected a name, found `;`"),
    ("param , a;", "1:7: E0101: expected a name, found `,`"),
    ("time;", "1:5: E0101: expected a unit such as `[s]`, found `;`"),
    ("time s;", "1:6: E0101: expected a unit such as `[s]`, found `s`"),
    ("time [s", "1:6: E0104: this `[` is not closed in its statement; write `]` where it ends"),
    ("der(x) = a .b;", "1:12: E0101: expected `;` after the equation of `x`, found `.`; a part of a submodel is written without spaces: `act.y`"),
    ("der(x) += 3;", "1:8: E0101: expected an expression, found `+=`; an equation is written `left = right`"),
    ("f(a b) = 3;", "1:5: E0101: expected `,` or `)`, found `b`; arguments are separated by `,`; a product is written `a*b`"),
    ("f(a, ) = 3;", "1:6: E0101: expected an expression, found `)`"),
    ("der(x) = a <= ;", "1:15: E0101: expected an expression, found `;`"),
    ("end;", "1:1: E0101: no statement begins with `end`; a model ends with `}`"),
    ("equation", "1:1: E0101: no statement begins with `equation`; there are no sections: declarations and equations stand in any order"),
    ("state x; state y\n state z; let let = 3;", "1:17: E0101: expected `;` after the declaration of `y` | 2:15: E0203: `let` is a word of the language and cannot be a name; choose another name"),
    ("der x = 3;", "1:5: E0101: expected `=`, found `x`; a derivative is written `der(x)`"),
    ("der(x) = x.^2;", "1:11: E0101: expected `;` after the equation of `x`, found `.^`; a power is written with `^`"),
    ("der(x) = x²;", "1:11: E0101: the character `²` cannot stand here; a square is written `x^2`"),
    ("der(x) = a − b;", "1:12: E0101: the character `−` cannot stand here; the minus sign is `-`"),
    ("}", "2:1: E0101: the model ends before this `}`: its brace is closed already; nothing but comments may follow the `}` that closes the model"),
    ("state x;\n}\nstate y;", "3:1: E0101: the model ends before this `state`: its brace is closed already; nothing but comments may follow the `}` that closes the model"),
    ("} model b { }", "1:3: E0101: a second model begins here; a text holds one model; put it into a file of its own"),
    ("};", "2:1: E0101: the model ends before this `}`: its brace is closed already; nothing but comments may follow the `}` that closes the model"),
    (";;", ""),
    ("param a = 3 }", "1:12: E0101: expected `;` after the declaration of `a` | 2:1: E0101: the model ends before this `}`: its brace is closed already; nothing but comments may follow the `}` that closes the model"),
    ("param a = {1, 2};", "1:11: E0101: expected an expression, found `{`; expressions are grouped with `(` and `)`"),
    ("tirm { u = 1; v = 2; }", "1:1: E0101: no statement begins with `tirm`; did you mean `trim`?"),
    ("der(x) = 'a';", "1:10: E0101: expected an expression, found `'`; a derivative is written `der(x)`"),
    ("(((", "1:3: E0104: this `(` is not closed in its statement; write `)` where it ends"),
    (")))", "1:1: E0101: expected an expression, found `)`"),
    ("der(x) = a then b;", "1:12: E0101: expected `;` after the equation of `x`, found `then`"),
    ("der(x) = if;", "1:12: E0101: expected an expression, found `;`"),
    ("der(x) = free;", "1:10: E0101: expected an expression, found `free`; `free` is a word of the language; give the quantity another name"),
    ("param a = \n state b;", "1:10: E0101: expected an expression, found `state`"),
    ("param a = 1\n\n   \nfoo = 3;", "1:12: E0101: expected `;` after the declaration of `a`"),
    ("let x = a\n  + b\n  c = 3;", "2:6: E0101: expected `;` after the declaration of `x`"),
    ("let x = \"a\";", "1:9: E0101: expected an expression, found `\"a\"`"),
    ("output y = delay(x tau);", "1:20: E0101: expected `,` or `)`, found `tau`; arguments are separated by `,`; a product is written `x*tau`"),
    ("const g 9.81 [m/s^2];", "1:9: E0101: expected `;` after the declaration of `g`, found `9.81`; a value is written `g = 9.81`"),
    ("param b = 1 in [0, 1] [m] \"doc\" fixed per run extra;", "1:47: E0101: expected `;` after the declaration of `b`, found `extra`"),
];

#[rustfmt::skip]
const FRAMES: &[(&str, &str)] = &[
    ("", "1:1: E0101: the text holds no model; a model is written `model NAME { ... }`"),
    ("  // only\n", "1:1: E0101: the text holds no model; a model is written `model NAME { ... }`"),
    ("/* x", "1:1: E0104: this comment is not closed; write `*/` at its end"),
    ("state x;", "1:1: E0101: expected `model NAME {`, found `state`; a model is written `model NAME { ... }`"),
    ("model", "1:6: E0101: expected a name, found the end of the text"),
    ("model {}", "1:7: E0101: expected a name, found `{`"),
    ("model m", "1:8: E0101: expected `{`, found the end of the text"),
    ("model m {", "1:9: E0104: this brace is not closed; write `}` behind the last statement of the model"),
    ("model m { state x;", "1:9: E0104: this brace is not closed; write `}` behind the last statement of the model"),
    ("modle m { state x; }", "1:1: E0101: no statement begins with `modle`; did you mean `model`?"),
    ("model m \"doc {", "1:9: E0104: this string is not closed on its line; write `\"` at its end"),
    ("model 3 {}", "1:7: E0101: expected a name, found `3`"),
    ("model m-n { state x; }", "1:8: E0101: expected `{`, found `-`; a name consists of letters, digits and `_`"),
    ("model in { }", "1:7: E0203: `in` is a word of the language and cannot be a name; choose another name"),
    ("model m \"a\" \"b\" {}", "1:13: E0101: expected `{`, found `\"b\"`"),
    ("\0\u{1}\u{2} ab � ;{{{", "1:1: E0101: expected `model NAME {`, found `\\u{0}\\u{1}\\u{2}`; a model is written `model NAME { ... }`"),
    ("foo bar baz", "1:1: E0101: expected `model NAME {`, found `foo`; a model is written `model NAME { ... }`"),
    ("model a {} model b {}", "1:12: E0101: a second model begins here; a text holds one model; put it into a file of its own"),
    ("model a { state x;\nmodel b { state y; }", "1:9: E0104: this brace is not closed; write `}` behind the last statement of the model | 2:1: E0101: a second model begins here; a text holds one model; put it into a file of its own"),
    ("effect f(i: input) { }", "1:1: E0101: these are effects, not a model; a file of effects is given with `--effects`; `fdm check` checks one by itself"),
    ("// of ours\n/* and more */ effect f(i: input) { }\neffect g(i: input) { }", "2:16: E0101: these are effects, not a model; a file of effects is given with `--effects`; `fdm check` checks one by itself"),
    ("\u{feff}model m {}", ""),
    ("junk\nmodel m {}", "1:1: E0101: expected `model NAME {`, found `junk`; a model is written `model NAME { ... }`"),
    ("model m state x; der(x) = 1; }", "1:9: E0101: expected `{`, found `state`"),
    ("#include x\nmodel m { }", "1:1: E0101: expected `model NAME {`, found `#`; a comment begins with `//`"),
    ("model m { trim { u = 1;\n der(x) = 1; }", "1:9: E0104: this brace is not closed; write `}` behind the last statement of the model | 2:5: E0101: expected `=`, found `(`; a trim is written `trim { x = value; u = value; }`"),
    ("model m { state x; trim { u = 1;\n output y = x; }", "1:25: E0104: this `{` is not closed in its statement; write `}` where it ends"),
    ("model m { trim { u = 1; ", "1:9: E0104: this brace is not closed; write `}` behind the last statement of the model | 1:16: E0104: this `{` is not closed in its statement; write `}` where it ends"),
    ("<html><body>Not found</body></html>", "1:1: E0101: expected `model NAME {`, found `<`; a model is written `model NAME { ... }`"),
    ("time,x,y\n0,1,2\n", "1:1: E0101: this looks like a table of data, not like a model; a record is given with `--data`"),
];

#[test]
fn other_statements_stay_readable() {
    let text = "model m {\n state x = 1\n param a 3;\n der(x) = -b*x;\n const c = (2;\n output y = x;\n tie d e;\n}";
    let source = Source::new("m", text);
    let (tree, found) = parse_recovering(&source);
    assert_eq!(found.len(), 4, "{found:?}");
    let tree = tree.unwrap();
    assert_eq!(tree.statements.len(), 3);
    assert_eq!(tree.suspended, ["a", "c", "const", "d", "e", "param", "tie"]);
    assert_eq!(tree.expressions.len(), 7 + 1);
}

#[test]
fn words_in_open_strings_and_comments_are_suspended() {
    let suspended = |text: &str| parse_recovering(&Source::new("m", text)).0.unwrap().suspended;
    assert_eq!(suspended("model m { state x; /* param a = 3;\n output y_1; }"), ["a", "output", "param", "y_1"]);
    assert_eq!(suspended("model m {\n state x \"doc; param b;\n der(x) = 1; }"), ["b", "doc", "param", "state", "x"]);
}

#[test]
fn findings_stop_at_twenty_and_stand_in_order() {
    let text = format!("model m {{ {} ", "param ?;\n".repeat(1000));
    let (tree, found) = parse_recovering(&Source::new("m", text));
    assert_eq!((found.len(), tree.unwrap().suspended), (21, vec!["param".to_string()]));
    assert!(found[20].message.starts_with("981 more mistakes"), "{}", found[20].message);
    assert!(found.is_sorted_by_key(|f| f.span));
}

#[test]
fn a_repeated_attribute_keeps_the_first_and_the_statement() {
    let (tree, found) = parse_recovering(&Source::new("m", "model m { param a [s] = 1 [m] = 2; }"));
    assert_eq!((found.len(), found[0].labels.len()), (2, 1));
    let crate::syntax::StatementKind::Declare(_, names) = &tree.unwrap().statements[0].kind else { panic!() };
    assert_eq!(names[0].unit.as_ref().unwrap().text, "s");
}
