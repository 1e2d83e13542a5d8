//! Whether the conditions are tests, and whether an effect has something to estimate and changes something with it.

use super::{Check, What};
use crate::diagnostic::{Code, nearest};
use crate::source::Span;
use crate::syntax::{EffectLine, Expr, ExprRef, Name, Tunable, Value};

impl<'a> Check<'a> {
    /// Tests are made of `depends`, `known`, `shared`, `power`, `consumes`, `produces`, comparisons of slots, `and`, `or` and `not`.
    pub(super) fn conditions(&mut self) {
        let pool = &self.tree.pool;
        for condition in &self.tree.conditions {
            let mut open = vec![condition.test];
            while let Some(e) = open.pop() {
                let span = pool.span(e);
                match pool.expr(e) {
                    Expr::Name(name) => self.slot(name, span),
                    Expr::Call(name, arguments) => match (name.text.as_str(), arguments.len()) {
                        ("depends" | "consumes" | "produces" | "power", 2) | ("known" | "shared" | "der", 1) => {
                            open.extend(arguments)
                        }
                        (word @ ("depends" | "consumes" | "produces" | "power" | "known" | "shared" | "der"), n) => {
                            let form = match word {
                                "depends" => "depends(der(x), z)",
                                "consumes" => "consumes(p, x)",
                                "produces" => "produces(p, x)",
                                "shared" => "shared(i)",
                                "power" => "power(i, x)",
                                _ => "known(der(x))",
                            };
                            let plural = if n == 1 { "" } else { "s" };
                            let message = format!("`{word}` does not take {n} argument{plural}");
                            self.tell(Code::ArgumentCount, span, message, format!("`{form}`"));
                        }
                        (word, _) => {
                            let hint = match nearest(
                                word,
                                ["depends", "consumes", "produces", "power", "known", "shared", "der"],
                            ) {
                                Some(near) => format!("did you mean `{near}`?"),
                                None => CONDITION_FORMS.into(),
                            };
                            let message = format!("the test `{word}` does not exist");
                            self.tell(Code::UnknownFunction, name.span, message, hint);
                        }
                    },
                    Expr::Unary(crate::syntax::UnarySign::Not, a) => open.push(*a),
                    Expr::Binary(sign, a, b, _) if is_test(*sign) => open.extend([*b, *a]),
                    _ => self.tell(Code::WantedCondition, span, "this is no test".into(), CONDITION_FORMS),
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

const CONDITION_FORMS: &str = "tests are `depends(der(x), z)`, `known(der(x))`, `shared(i)`, `power(i, x)`, `consumes(p, x)`, `produces(p, x)`, `x == z`, `x < z` (x stands before z), `and`, `or`, `not`";

fn is_test(sign: crate::syntax::BinarySign) -> bool {
    use crate::syntax::BinarySign::*;
    matches!(sign, Equal | NotEqual | Less | Greater | And | Or)
}
