//! An effect that passed its checks: every name known, every param with a null value, every line possible.

use super::names::is_reserved;
use super::scales::{Answers, NAMED_REQUESTS, Nominal, REQUESTS};
use crate::check::{function_form, function_names};
use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::source::Span;
use crate::syntax::{Declaration, EffectLine, EffectTree, Expr, ExprRef, Name, Place, Role, SlotKind, Tunable, Value};
use crate::unit::Unit;
use std::collections::{BTreeMap, HashMap};

/// What a search can do with an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Its first param has no finite range: the response is differentiated at the null value and the size left free.
    Smooth,
    /// Its first param is bounded, or tried at given values: the response is compared with that at the null.
    Finite,
    /// It is no equation but a noise that enters one (`noise der(x) = q;`): its param is an intensity.
    Variance,
}

/// An effect of a catalogue.
#[derive(Debug, Clone)]
pub struct Effect {
    pub(super) tree: EffectTree,
}

impl Effect {
    /// Its name; several effects may share one when they attach to different kinds of things.
    pub fn name(&self) -> &str {
        &self.tree.name.text
    }

    /// What it is, with `{x}` for the name that the slot `x` stands for; empty when nothing is said.
    pub fn doc(&self) -> &str {
        self.tree.doc.as_ref().map_or("", |d| &d.text)
    }

    /// As it was written.
    pub fn tree(&self) -> &EffectTree {
        &self.tree
    }

    /// `input_delay(i: input)`
    pub fn signature(&self) -> String {
        let slot = |s: &crate::syntax::Slot| {
            let kinds: Vec<_> = s.kinds.iter().map(|k| k.word()).collect();
            format!("{}: {}", s.name.text, kinds.join(" | "))
        };
        format!("{}({})", self.name(), self.tree.slots.iter().map(slot).collect::<Vec<_>>().join(", "))
    }

    /// What a search can do with it.
    pub fn kind(&self) -> Kind {
        if self.tree.lines.iter().any(|(line, _)| matches!(line, EffectLine::Noise(..))) {
            return Kind::Variance;
        }
        let first = self.tunables().find(|t| !t.nuisance);
        let finite = first.is_some_and(|t| !t.trials.is_empty() || bounded(&self.tree, t));
        if finite { Kind::Finite } else { Kind::Smooth }
    }

    pub(super) fn tunables(&self) -> impl Iterator<Item = &Tunable> {
        self.tree.lines.iter().filter_map(|(line, _)| match line {
            EffectLine::Tunable(t) => Some(t),
            _ => None,
        })
    }

    pub(super) fn slot(&self, name: &str) -> Option<usize> {
        self.tree.slots.iter().position(|s| s.name.text == name)
    }

    /// Checks an effect as written.
    pub(super) fn check(tree: EffectTree, findings: &mut Vec<Diagnostic>) -> Option<Self> {
        let mut check = Check { tree: &tree, names: BTreeMap::new(), findings: Vec::new() };
        check.declared();
        check.lines();
        check.conditions();
        check.purpose();
        let sound = check.findings.is_empty();
        findings.append(&mut check.findings);
        sound.then_some(Self { tree })
    }
}

/// Both bounds are written and neither is `inf`.
fn bounded(tree: &EffectTree, tunable: &Tunable) -> bool {
    let infinite = |e: ExprRef| {
        let name = |e: ExprRef| matches!(tree.pool.expr(e), Expr::Name(n) if n == "inf");
        name(e) || matches!(tree.pool.expr(e), Expr::Unary(_, a) if name(*a))
    };
    tunable.declaration.bounds.is_some_and(|b| !infinite(b.lower) && !infinite(b.upper))
}

/// What a name is in an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum What {
    Slot(usize),
    Tunable,
    Own(Role),
}

struct Check<'a> {
    tree: &'a EffectTree,
    names: BTreeMap<&'a str, (What, Span)>,
    findings: Vec<Diagnostic>,
}

impl<'a> Check<'a> {
    fn tell(&mut self, code: Code, span: Span, message: String, hint: impl Into<String>) {
        let hint = hint.into();
        let found = Diagnostic::new(code, span, message);
        self.findings.push(if hint.is_empty() { found } else { found.hint(hint) });
    }

    fn declared(&mut self) {
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

    fn declare(&mut self, name: &'a Name, what: What) {
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

    fn lines(&mut self) {
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

    /// The same thing is changed once.
    fn once(&mut self, what: (&'a str, bool), span: Span, rewritten: &mut BTreeMap<(&'a str, bool), Span>) {
        if let Some(first) = rewritten.insert(what, span) {
            let shown = if what.1 { format!("der({})", what.0) } else { what.0.to_string() };
            let found = Diagnostic::new(Code::NoRewrite, span, format!("`{shown}` is changed a second time"));
            self.findings.push(found.label(first, "first changed here").hint("join the two lines"));
        }
    }

    fn tunable(&mut self, tunable: &Tunable) {
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
    fn number(&mut self, e: ExprRef) {
        let bound: HashMap<String, String> =
            self.tree.slots.iter().map(|s| (s.name.text.clone(), s.name.text.clone())).collect();
        let own = self.names.iter().filter(|(_, (what, _))| matches!(what, What::Tunable | What::Own(Role::Const)));
        let known: HashMap<String, f64> = own.map(|(name, _)| (name.to_string(), 1.0)).collect();
        let answers = Answers { pool: &self.tree.pool, bound: &bound, known: &known, scales: &Nominal };
        if answers.list(&[e]).is_empty() && self.findings.is_empty() {
            let message = "this is no number that the data could give".to_string();
            let hint = "numbers, `inf`, consts, `size(x)`, `scale(x, 0.1)`, `quantile(x, q)`, `speed(x, q)`, `step`, `duration`";
            self.tell(Code::NotConstant, self.tree.pool.span(e), message, hint);
        }
    }

    fn unit(&mut self, d: &Declaration) {
        let Some(unit) = &d.unit else { return };
        if let Err(error) = Unit::parse(&unit.text) {
            let hint = error.nearest.map_or(String::new(), |near| format!("did you mean `{near}`?"));
            self.tell(Code::UnknownUnit, unit.span, error.message, hint);
        }
    }

    fn equation(&mut self, left: ExprRef, equations: &mut BTreeMap<&'a str, Span>) {
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

    /// The slot that a name is; what it is instead is told.
    fn target(&mut self, name: &Name) -> Option<&'a [SlotKind]> {
        match self.names.get(name.text.as_str()).map(|(what, _)| *what) {
            Some(What::Slot(k)) => Some(&self.tree.slots[k].kinds),
            Some(_) => {
                let message = format!("`{}` is the effect's own; what is changed belongs to the model", name.text);
                self.tell(Code::WrongName, name.span, message, "");
                None
            }
            None => {
                self.unknown(&name.text, name.span);
                None
            }
        }
    }

    fn place(&mut self, place: &Place, outputs: bool) -> bool {
        let Some(kinds) = self.target(&place.name) else { return false };
        let name = &place.name.text;
        let wanted = if place.derivative { SlotKind::State } else { SlotKind::Output };
        if kinds.iter().all(|k| *k == wanted) && (place.derivative || outputs) {
            return true;
        }
        let (message, hint) = if place.derivative {
            (format!("`{name}` is not always a state"), format!("declare it as `{name}: state`"))
        } else if kinds.contains(&SlotKind::State) || !outputs {
            (format!("`{name}` is not a place for this"), format!("write `der({name})` for its equation"))
        } else {
            (format!("`{name}` is not always an output"), format!("`replace {name} with ...;` changes its uses"))
        };
        self.tell(Code::WrongName, place.name.span, message, hint);
        false
    }

    /// Names and functions below a root; `asked` where numbers and requests stand, not an equation.
    fn expression(&mut self, root: ExprRef, asked: bool) {
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

    fn name(&mut self, name: &str, span: Span, asked: bool) {
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

    fn unknown(&mut self, name: &str, span: Span) {
        let near = nearest(name, self.names.keys().copied());
        let hint = match near {
            Some(near) => format!("did you mean `{near}`?"),
            None => "an effect knows its slots and what it declares itself".into(),
        };
        self.tell(Code::UnknownName, span, format!("`{name}` is not declared"), hint);
    }

    fn call(&mut self, name: &Name, arguments: &[ExprRef], span: Span, asked: bool) {
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
        match function_form(&name.text) {
            Some((least, more, form)) if given < least || given > least && !more => {
                let message = format!("`{}` takes {least} arguments, not {given}", name.text);
                self.tell(Code::ArgumentCount, span, message, format!("`{form}`"));
            }
            Some(_) => {}
            None => {
                let names = function_names().chain(REQUESTS.iter().filter(|_| asked).map(|(n, ..)| *n));
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

    /// Tests are made of `depends`, `known`, comparisons of slots, `and`, `or` and `not`.
    fn conditions(&mut self) {
        let pool = &self.tree.pool;
        for condition in &self.tree.conditions {
            let mut open = vec![condition.test];
            while let Some(e) = open.pop() {
                let span = pool.span(e);
                match pool.expr(e) {
                    Expr::Name(name) => self.slot(name, span),
                    Expr::Call(name, arguments) => match (name.text.as_str(), arguments.len()) {
                        ("depends", 2) | ("known" | "der", 1) => open.extend(arguments),
                        (word @ ("depends" | "known" | "der"), n) => {
                            let form = if word == "depends" { "depends(der(x), z)" } else { "known(der(x))" };
                            let plural = if n == 1 { "" } else { "s" };
                            let message = format!("`{word}` does not take {n} argument{plural}");
                            self.tell(Code::ArgumentCount, span, message, format!("`{form}`"));
                        }
                        (word, _) => {
                            let hint = match nearest(word, ["depends", "known", "der"]) {
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
    fn purpose(&mut self) {
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

const CONDITION_FORMS: &str =
    "tests are `depends(der(x), z)`, `known(der(x))`, `x == z`, `x < z` (x stands before z), `and`, `or`, `not`";

fn is_test(sign: crate::syntax::BinarySign) -> bool {
    use crate::syntax::BinarySign::*;
    matches!(sign, Equal | NotEqual | Less | Greater | And | Or)
}
