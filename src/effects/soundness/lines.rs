//! Lines of an effect: every name declared once, every param with a null, every change possible.

use super::{Check, What};
use crate::names::is_reserved;
use crate::scales::{Answers, Nominal, REQUESTS};
use fdm_grammar::diagnostic::{Code, Diagnostic};
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
