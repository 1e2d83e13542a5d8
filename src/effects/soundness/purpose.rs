//! Whether the conditions are tests, and whether an effect has something to estimate and changes something with it.

use super::{Check, What};
use fdm_grammar::diagnostic::{Code, nearest};
use fdm_grammar::source::Span;
use fdm_grammar::syntax::{EffectLine, Expr, ExprRef, Name, Tunable, Value};

impl<'a> Check<'a> {
    /// Tests are made of the [`TESTS`], comparisons of slots, `and`, `or` and `not`.
    pub(super) fn conditions(&mut self) {
        let pool = &self.tree.pool;
        for condition in &self.tree.conditions {
            let mut open = vec![condition.test];
            while let Some(e) = open.pop() {
                let span = pool.span(e);
                match pool.expr(e) {
                    Expr::Name(name) => self.slot(name, span),
                    Expr::Call(name, arguments) => {
                        let (word, n) = (name.text.as_str(), arguments.len());
                        match TESTS.iter().find(|test| test.word == word) {
                            Some(test) if test.arguments == n => open.extend(arguments),
                            Some(test) => {
                                let plural = if n == 1 { "" } else { "s" };
                                let message = format!("`{word}` does not take {n} argument{plural}");
                                self.tell(Code::ArgumentCount, span, message, format!("`{}`", test.form));
                            }
                            None => {
                                let hint = match nearest(word, TESTS.iter().map(|test| test.word)) {
                                    Some(near) => format!("did you mean `{near}`?"),
                                    None => forms(),
                                };
                                let message = format!("the test `{word}` does not exist");
                                self.tell(Code::UnknownFunction, name.span, message, hint);
                            }
                        }
                    }
                    Expr::Unary(fdm_grammar::syntax::UnarySign::Not, a) => open.push(*a),
                    Expr::Binary(sign, a, b, _) if is_test(*sign) => open.extend([*b, *a]),
                    _ => self.tell(Code::WantedCondition, span, "this is no test".into(), forms()),
                }
            }
        }
    }

    fn slot(&mut self, name: &str, span: Span) {
        match self.names.get(name) {
            Some((What::Slot(_), _)) => {}
            Some(_) => {
                let message = format!("`{name}` is the effect's own; a test is about the model");
                self.tell(Code::WrongName, span, message, "");
            }
            None => self.unknown(name, span),
        }
    }

    /// An effect has something to estimate, and changes something with it.
    pub(super) fn purpose(&mut self) {
        let tree = self.tree;
        let params: Vec<&Tunable> = tree
            .lines
            .iter()
            .filter_map(|(l, _)| if let EffectLine::Tunable(t) = l { Some(t) } else { None })
            .collect();
        if !params.iter().any(|t| !t.nuisance) {
            let message =
                format!("the effect `{}` has no param, and so no null value at which it vanishes", tree.name.text);
            self.tell(Code::NullMissing, tree.name.span, message, "`param c = 0;`");
        }
        let changes =
            |l: &EffectLine| matches!(l, EffectLine::Add(..) | EffectLine::Replace(..) | EffectLine::Noise(..));
        if !tree.lines.iter().any(|(l, _)| changes(l)) {
            let message = format!("the effect `{}` changes nothing", tree.name.text);
            let hint = "`add der(x) += ...;`, `replace i with ...;` or `noise der(x) = ...;`";
            return self.tell(Code::NoRewrite, tree.name.span, message, hint);
        }
        let mut used = vec![false; tree.pool.expressions.len()];
        let mut mark = |root: ExprRef| {
            let mut open = vec![root];
            while let Some(e) = open.pop() {
                used[e.0 as usize] = true;
                tree.pool.expr(e).each_operand(|o| open.push(o));
            }
        };
        for (line, _) in &tree.lines {
            match line {
                EffectLine::Equation(_, e)
                | EffectLine::Add(_, e)
                | EffectLine::Replace(_, e)
                | EffectLine::Noise(_, e) => {
                    mark(*e);
                }
                EffectLine::Own(_, list) => list.iter().for_each(|d| {
                    if let Some(Value::Expr(e)) = d.value {
                        mark(e);
                    }
                }),
                EffectLine::Tunable(_) => {}
            }
        }
        let mentioned = |name: &str| {
            tree.pool
                .expressions
                .iter()
                .zip(&used)
                .any(|((e, _), used)| *used && matches!(e, Expr::Name(n) if n == name))
        };
        let idle: Vec<Name> =
            params.iter().map(|t| &t.declaration.name).filter(|n| !mentioned(&n.text)).cloned().collect();
        for name in idle {
            let message = format!("`{}` is not used: nothing changes with it", name.text);
            self.tell(Code::NoRewrite, name.span, message, "use it in a line of the effect");
        }
    }
}

/// A function of which conditions are made.
struct Test {
    word: &'static str,
    arguments: usize,
    /// How it is written.
    form: &'static str,
}

const TESTS: [Test; 12] = [
    Test { word: "depends", arguments: 2, form: "depends(der(x), z)" },
    Test { word: "known", arguments: 1, form: "known(der(x))" },
    Test { word: "der", arguments: 1, form: "known(der(x))" },
    Test { word: "shared", arguments: 1, form: "shared(i)" },
    Test { word: "power", arguments: 2, form: "power(i, x)" },
    Test { word: "intensive", arguments: 1, form: "intensive(x)" },
    Test { word: "temperature", arguments: 1, form: "temperature(x)" },
    Test { word: "unitless", arguments: 1, form: "unitless(x)" },
    Test { word: "alike", arguments: 2, form: "alike(x, z)" },
    Test { word: "consumes", arguments: 2, form: "consumes(p, x)" },
    Test { word: "produces", arguments: 2, form: "produces(p, x)" },
    Test { word: "turns", arguments: 1, form: "turns(p)" },
];

/// All of them in a sentence.
fn forms() -> String {
    let own = TESTS.iter().filter(|test| test.word != "der").map(|test| format!("`{}`", test.form));
    format!(
        "tests are {}, `x == z`, `x < z` (x stands before z), `and`, `or`, `not`",
        own.collect::<Vec<_>>().join(", ")
    )
}

fn is_test(sign: fdm_grammar::syntax::BinarySign) -> bool {
    use fdm_grammar::syntax::BinarySign::*;
    matches!(sign, Equal | NotEqual | Less | Greater | And | Or)
}
