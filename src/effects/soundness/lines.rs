//! Lines of an effect: every name declared once, every param with a null, every change possible.
//!
//! Names and functions in the expressions of an effect.
//!
//! Whether the conditions are tests, and whether an effect has something to estimate and changes something with it.

use super::{Check, What};
use crate::edit::is_reserved;
use crate::scales::{Answers, NAMED_REQUESTS, Nominal, REQUESTS, SPECIES};
use fdm_grammar::check::{function_form, function_names};
use fdm_grammar::diagnostic::{Code, Diagnostic, nearest};
use fdm_grammar::source::Span;
use fdm_grammar::syntax::{Declaration, EffectLine, Expr, ExprRef, Name, Role, Tunable, Value};
use fdm_grammar::unit::Unit;
use std::collections::{BTreeMap, HashMap};

impl<'a> Check<'a> {
    pub(super) fn declared(&mut self) {
        let tree = self.tree;
        for (k, slot) in tree.slots.iter().enumerate() {
            self.declare(&slot.name, What::Slot(k));
        }
        for (line, _) in &tree.lines {
            match line {
                EffectLine::Tunable(t) => self.declare(&t.declaration.name, What::Tunable),
                EffectLine::Own(role, list) => list.iter().for_each(|d| self.declare(&d.name, What::Own(*role))),
                _ => {}
            }
        }
    }

    pub(super) fn declare(&mut self, name: &'a Name, what: What) {
        if is_reserved(&name.text) || REQUESTS.iter().any(|(n, ..)| *n == name.text) {
            let message = format!("`{}` is a word or a function of the language and cannot be declared", name.text);
            self.tell(Code::ReservedName, name.span, message, "choose another name");
            self.names.insert(&name.text, (what, name.span));
        } else if let Some((_, first)) = self.names.get(name.text.as_str()) {
            let message = format!("`{}` is declared a second time", name.text);
            let found = Diagnostic::new(Code::DeclaredTwice, name.span, message).label(*first, "first declared here");
            self.findings.push(found);
        } else {
            self.names.insert(&name.text, (what, name.span));
        }
    }

    pub(super) fn lines(&mut self) {
        let tree = self.tree;
        let mut rewritten: BTreeMap<(&str, bool), Span> = BTreeMap::new();
        let mut equations: BTreeMap<&str, Span> = BTreeMap::new();
        for (line, span) in &tree.lines {
            match line {
                EffectLine::Tunable(t) => self.tunable(t),
                EffectLine::Own(role, list) => {
                    for d in list {
                        match (role, d.value) {
                            (_, Some(Value::Expr(e))) => self.expression(e, *role != Role::Let),
                            (Role::State, _) => {}
                            _ => {
                                let message = format!("the {} `{}` has no value", role.keyword(), d.name.text);
                                self.tell(Code::MissingValue, d.name.span, message, "write `= ...`");
                            }
                        }
                        self.unit(d);
                        if let (Role::Const, Some(Value::Expr(e))) = (role, d.value) {
                            self.number(e);
                        }
                        if let Some(shape) = d.shape {
                            let message = "an effect has no vectors".to_string();
                            self.tell(Code::Unsupported, shape.span, message, "declare one name for each element");
                        }
                    }
                }
                EffectLine::Equation(left, right) => {
                    self.equation(*left, &mut equations);
                    self.expression(*right, false);
                }
                EffectLine::Add(place, term) => {
                    if self.place(place, true) {
                        self.once((&place.name.text, place.derivative), *span, &mut rewritten);
                    }
                    self.expression(*term, false);
                }
                EffectLine::Replace(name, with) => {
                    if self.target(name).is_some() {
                        self.once((&name.text, false), *span, &mut rewritten);
                    }
                    self.expression(*with, false);
                }
                EffectLine::Noise(place, intensity) => {
                    self.place(place, false);
                    self.expression(*intensity, false);
                }
            }
        }
        let states: Vec<_> = self.names.iter().filter(|(_, (what, _))| *what == What::Own(Role::State)).collect();
        let missing: Vec<_> = states.into_iter().filter(|(n, _)| !equations.contains_key(**n)).collect();
        let missing: Vec<(String, Span)> = missing.into_iter().map(|(n, (_, span))| (n.to_string(), *span)).collect();
        for (name, span) in missing {
            let message = format!("the state `{name}` has no equation");
            self.tell(Code::MissingEquation, span, message, format!("`der({name}) = ...;`"));
        }
    }

    /// Tells where one thing is changed a second time.
    pub(super) fn once(&mut self, what: (&'a str, bool), span: Span, rewritten: &mut BTreeMap<(&'a str, bool), Span>) {
        if let Some(first) = rewritten.insert(what, span) {
            let shown = if what.1 { format!("der({})", what.0) } else { what.0.to_string() };
            let found = Diagnostic::new(Code::NoRewrite, span, format!("`{shown}` is changed a second time"));
            self.findings.push(found.label(first, "first changed here").hint("join the two lines"));
        }
    }

    pub(super) fn tunable(&mut self, tunable: &Tunable) {
        let d = &tunable.declaration;
        let name = &d.name;
        let value = match d.value {
            Some(Value::Expr(e)) => {
                self.expression(e, true);
                true
            }
            Some(Value::Free(span)) => {
                let message = format!("`{}` is no state: only the start of a state is `free`", name.text);
                self.tell(Code::WrongAttribute, span, message, "give the value at which the effect vanishes");
                true
            }
            None => false,
        };
        if !tunable.nuisance && !value {
            let message = format!("`{}` has no null value, at which the effect vanishes", name.text);
            let form = format!(
                "`param {} = 0;`, or `nuisance {} try ...;` for what matters only beside it",
                name.text, name.text
            );
            self.tell(Code::NullMissing, name.span, message, form);
        }
        if tunable.nuisance && tunable.trials.is_empty() && !value {
            let message = format!("nothing is said that `{}` should be tried at", name.text);
            self.tell(Code::NullMissing, name.span, message, format!("`nuisance {} try 0.1, 1, 10;`", name.text));
        }
        self.unit(d);
        let limits = d.bounds.iter().flat_map(|b| [b.lower, b.upper]);
        for e in limits.chain(tunable.trials.iter().copied()) {
            self.expression(e, true);
            self.number(e);
        }
    }

    /// What is said about values must be numbers once the data have answered.
    pub(super) fn number(&mut self, e: ExprRef) {
        let bound: HashMap<String, String> =
            self.tree.slots.iter().map(|s| (s.name.text.clone(), s.name.text.clone())).collect();
        let own = self.names.iter().filter(|(_, (what, _))| matches!(what, What::Tunable | What::Own(Role::Const)));
        let known: HashMap<String, f64> = own.map(|(name, _)| (name.to_string(), 1.0)).collect();
        let answers = Answers { pool: &self.tree.pool, bound: &bound, known: &known, scales: &Nominal, subject: None };
        if answers.list(&[e]).is_empty() && self.findings.is_empty() {
            let message = "this is no number that the data could give".to_string();
            let hint = "numbers, `inf`, consts, `size(x)`, `scale(x, 0.1)`, `quantile(x, q)`, `speed(x, q)`, `step`, `duration`";
            self.tell(Code::NotConstant, self.tree.pool.span(e), message, hint);
        }
    }

    pub(super) fn unit(&mut self, d: &Declaration) {
        let Some(unit) = &d.unit else { return };
        if let Err(error) = Unit::parse(&unit.text) {
            let hint = error.nearest.map_or(String::new(), |near| format!("did you mean `{near}`?"));
            self.tell(Code::UnknownUnit, unit.span, error.message, hint);
        }
    }

    pub(super) fn equation(&mut self, left: ExprRef, equations: &mut BTreeMap<&'a str, Span>) {
        let pool = &self.tree.pool;
        let span = pool.span(left);
        let state = match pool.expr(left) {
            Expr::Call(name, arguments) if name.text == "der" && arguments.len() == 1 => {
                match pool.expr(arguments[0]) {
                    Expr::Name(state) => Some(state.as_str()),
                    _ => None,
                }
            }
            _ => None,
        };
        let Some(state) = state else {
            let message = "the left side of an equation is the derivative of a state of the effect".to_string();
            return self.tell(Code::NotADerivative, span, message, "`der(m) = ...;`");
        };
        match self.names.get(state).map(|(what, _)| *what) {
            Some(What::Own(Role::State)) => {
                if let Some(first) = equations.insert(state, span) {
                    let message = format!("the state `{state}` has a second equation");
                    let found = Diagnostic::new(Code::TwoEquations, span, message);
                    self.findings.push(found.label(first, "its first equation"));
                }
            }
            Some(What::Slot(_)) => {
                let message = format!("the equation of `{state}` is the model's");
                let hint = format!("`add der({state}) += ...;` adds to it");
                self.tell(Code::NotADerivative, span, message, hint);
            }
            Some(_) => {
                let message = format!("`{state}` is no state");
                self.tell(Code::NotADerivative, span, message, format!("declare it as `state {state};`"));
            }
            None => self.unknown(state, span),
        }
    }
}

impl<'a> Check<'a> {
    /// Names and functions below a root; `asked` where numbers and requests stand, not an equation.
    pub(super) fn expression(&mut self, root: ExprRef, asked: bool) {
        let pool = &self.tree.pool;
        let mut open = vec![root];
        while let Some(e) = open.pop() {
            let span = pool.span(e);
            match pool.expr(e) {
                Expr::Name(name) => self.name(name, span, asked),
                Expr::Call(name, arguments) => {
                    self.call(name, arguments, span, asked);
                    open.extend(arguments);
                }
                Expr::Unary(_, a) => open.push(*a),
                Expr::Binary(_, a, b, _) => open.extend([*b, *a]),
                Expr::If(c, a, b) => open.extend([*b, *a, *c]),
                Expr::Vector(_) | Expr::Element(..) => {
                    self.tell(Code::Unsupported, span, "an effect has no vectors".into(), "");
                }
                Expr::Number(_) => {}
            }
        }
    }

    pub(super) fn name(&mut self, name: &str, span: Span, asked: bool) {
        let known = self.names.contains_key(name)
            || matches!(name, "t" | "pi" | "inf")
            || asked && NAMED_REQUESTS.contains(&name);
        if known {
            return;
        }
        if NAMED_REQUESTS.contains(&name) {
            let message = format!("`{name}` is asked of the data, and is no part of an equation");
            return self.tell(
                Code::WrongName,
                span,
                message,
                format!("`const {name}_0 = {name};` makes a number of it"),
            );
        }
        self.unknown(name, span);
    }

    pub(super) fn call(&mut self, name: &Name, arguments: &[ExprRef], span: Span, asked: bool) {
        let given = arguments.len();
        if let Some((_, count, form)) = REQUESTS.iter().find(|(n, ..)| *n == name.text) {
            if !asked {
                let message = format!("`{}` is asked of the data, and is no part of an equation", name.text);
                let hint = format!("`const k = {form};` makes a number of it");
                self.tell(Code::WrongName, name.span, message, hint);
            } else if given != *count {
                let message = format!("`{}` takes {count} arguments, not {given}", name.text);
                self.tell(Code::ArgumentCount, span, message, format!("`{form}`"));
            }
            return;
        }
        let species =
            SPECIES.iter().find(|(n, ..)| *n == name.text).map(|(_, count, form)| (*count, false, (*form).to_string()));
        match species.or_else(|| function_form(&name.text)) {
            Some((least, more, form)) if given < least || given > least && !more => {
                let message = format!("`{}` takes {least} arguments, not {given}", name.text);
                self.tell(Code::ArgumentCount, span, message, format!("`{form}`"));
            }
            Some(_) => {}
            None => {
                let own = SPECIES.iter().chain(REQUESTS.iter().filter(|_| asked)).map(|(n, ..)| *n);
                let names = function_names().chain(own);
                let hint = match nearest(&name.text, names) {
                    Some(near) => format!("did you mean `{near}`?"),
                    None if self.names.contains_key(name.text.as_str()) => "a product is written with `*`".into(),
                    None => String::new(),
                };
                self.tell(
                    Code::UnknownFunction,
                    name.span,
                    format!("the function `{}` does not exist", name.text),
                    hint,
                );
            }
        }
    }
}

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
