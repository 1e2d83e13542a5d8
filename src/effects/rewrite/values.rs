//! Numbers of an effect at its place: consts, params with bounds and trials, and what stands behind their names.
//!
//! What is of the effect's own: states, where they begin, lets and equations.

use super::Rewrite;
use crate::candidate::NewParam;
use crate::edit::Line;
use crate::scales::{Answers, Beginning, NAMED_REQUESTS, REQUESTS, rounded};
use crate::subject::vector_of;
use fdm_grammar::diagnostic::{Code, Diagnostic};
use fdm_grammar::syntax::{Declaration, EffectLine, Expr, ExprRef, Role, SyntaxTree, Tunable, Value};
use fdm_grammar::unit::Unit;

impl<'a> Rewrite<'a> {
    pub(super) fn answers(&self) -> Answers<'_> {
        let subject = Some(self.subject);
        Answers { pool: self.pool(), bound: &self.bound, known: &self.known, scales: self.scales, subject }
    }

    /// Values of consts, params and nuisances, in the order of the effect.
    pub(super) fn values(&mut self) -> Result<(), Diagnostic> {
        let effect = self.effect;
        for (line, _) in &effect.tree().lines {
            match line {
                EffectLine::Own(Role::Const, list) => {
                    for d in list {
                        let Some(Value::Expr(e)) = d.value else { continue };
                        let value = self.answers().value(e);
                        let Some(value) = value.filter(|v| v.is_finite()) else {
                            return Err(self.misfit(format!(
                                "`{}` has no finite value here{}",
                                d.name.text,
                                self.below_zero(e)
                            )));
                        };
                        let factor = self.factor(d)?;
                        let value = self.answer(e, value * factor);
                        self.known.insert(d.name.text.clone(), value);
                        let doc = d.doc.as_ref().map_or(String::new(), |_| self.doc(d));
                        let text =
                            format!("const {} = {}{}", self.names[&d.name.text], number(value), self.suffix(d, &doc));
                        self.lines.push((Line::Declare(Role::Const), text + ";"));
                    }
                }
                EffectLine::Tunable(t) => self.tunable(t)?,
                _ => {}
            }
        }
        Ok(())
    }

    /// Why there is no value, where a signal that must not be below zero is.
    fn below_zero(&self, root: ExprRef) -> String {
        let Expr::Call(name, arguments) = self.pool().expr(root) else { return String::new() };
        match arguments.first().map(|a| self.pool().expr(*a)) {
            Some(Expr::Name(slot)) if name.text == "positive" => {
                format!(": {} is below zero in these records", self.bound.get(slot).unwrap_or(slot))
            }
            _ => String::new(),
        }
    }

    /// A value that came from data has few digits.
    pub(super) fn answer(&self, e: ExprRef, value: f64) -> f64 {
        if asks(self.pool(), e) { rounded(value) } else { value }
    }

    /// From the unit that the effect writes to the one that the model needs.
    pub(super) fn factor(&mut self, d: &Declaration) -> Result<f64, Diagnostic> {
        let Some(written) = &d.unit else { return Ok(1.0) };
        let unit = match Unit::parse(&written.text) {
            Ok(unit) => unit,
            Err(error) => {
                return Err(Diagnostic::new(Code::UnknownUnit, written.span, error.message));
            }
        };
        if !self.subject.has_units() {
            return Ok(1.0);
        }
        let name = &d.name.text;
        match self.units.get(name) {
            None => {
                self.units.insert(name.clone(), unit);
                Ok(1.0)
            }
            Some(needed) => match unit.conversion(needed) {
                Some((scale, _)) => Ok(scale),
                None => {
                    let why = format!("`{name}` is in {unit}, and in {needed} where it is used");
                    Err(self.misfit(why))
                }
            },
        }
    }

    pub(super) fn tunable(&mut self, t: &Tunable) -> Result<(), Diagnostic> {
        let d = &t.declaration;
        let local = d.name.text.clone();
        let factor = self.factor(d)?;
        let scaled = |this: &Self, e: ExprRef| this.answers().value(e).map(|v| this.answer(e, v * factor));
        let mut trials: Vec<f64> = self.answers().list(&t.trials).into_iter().map(|v| v * factor).collect();
        if t.trials.iter().any(|e| asks(self.pool(), *e)) {
            trials.iter_mut().for_each(|v| *v = rounded(*v));
        }
        let null = match d.value {
            Some(Value::Expr(e)) => scaled(self, e).filter(|v| !v.is_nan()),
            _ => trials.first().copied(),
        };
        let Some(null) = null else {
            return Err(self.misfit(format!("`{local}` has no value here")));
        };
        let limits = d.bounds.map(|b| (scaled(self, b.lower), scaled(self, b.upper)));
        let (mut lower, mut upper) = match limits {
            Some((Some(lower), Some(upper))) => (lower, upper),
            _ => (f64::NEG_INFINITY, f64::INFINITY),
        };
        if lower.partial_cmp(&upper) != Some(std::cmp::Ordering::Less) {
            return Err(self.misfit(format!("the bounds [{lower}, {upper}] of `{local}` leave no room")));
        }
        if trials.is_empty() && lower.is_finite() && upper.is_finite() && !t.nuisance {
            trials = default_trials(null, lower, upper);
        }
        let start = self.choice.get(&local).copied();
        let start = start.or(trials.first().copied()).unwrap_or(null);
        if !start.is_finite() {
            return Err(self.misfit(format!("`{local}` needs a finite value to start from")));
        }
        lower = lower.min(start);
        upper = upper.max(start);
        self.known.insert(local.clone(), start);
        let doc = self.doc(d);
        let mut text = format!("param {} = {}", self.names[&local], number(start));
        if d.bounds.is_some() {
            text += &format!(" in [{}, {}]", number(lower), number(upper));
        }
        text += &self.suffix(d, &doc);
        text += if d.fixed.is_some() { " fixed" } else { "" };
        text += if d.per_run.is_some() { " per run" } else { "" };
        self.lines.push((Line::Declare(Role::Param), text + ";"));
        self.params.push(NewParam {
            name: self.names[&local].clone(),
            unit: self.units.get(&local).cloned(),
            local,
            doc,
            null,
            start,
            lower,
            upper,
            trials,
            positive: t.positive,
            nuisance: t.nuisance,
            fixed: d.fixed.is_some(),
            per_run: d.per_run.is_some(),
            begins_as: None,
        });
        Ok(())
    }

    /// What a param is: its own words, or the effect's, with the names of the model.
    pub(super) fn doc(&self, d: &Declaration) -> String {
        let Some(own) = &d.doc else { return self.candidate.doc() };
        self.bound_in_order().fold(own.text.clone(), |doc, (slot, target)| doc.replace(&format!("{{{slot}}}"), target))
    }

    pub(super) fn bound_in_order(&self) -> impl Iterator<Item = (&'a str, &'a String)> {
        let slots = self.effect.tree().slots.iter().map(|s| s.name.text.as_str());
        slots.zip(self.candidate.targets())
    }

    /// ` [unit] "doc"`, as far as there is something to say.
    pub(super) fn suffix(&self, d: &Declaration, doc: &str) -> String {
        let unit = self.units.get(&d.name.text).map_or(String::new(), |u| format!(" [{}]", u.text()));
        if doc.is_empty() { unit } else { format!("{unit} \"{doc}\"") }
    }
}

/// Steps on the way from the null to the farther bound.
fn default_trials(null: f64, lower: f64, upper: f64) -> Vec<f64> {
    let far = if !null.is_finite() || (upper - null).abs() >= (null - lower).abs() { upper } else { lower };
    let near = if null.is_finite() { null } else { lower };
    [0.03, 0.1, 0.3, 1.0].map(|f| rounded(near + f * (far - near))).to_vec()
}

/// Whether an expression asks anything of the data.
fn asks(pool: &SyntaxTree, root: ExprRef) -> bool {
    let mut open = vec![root];
    while let Some(e) = open.pop() {
        match pool.expr(e) {
            Expr::Name(name) if NAMED_REQUESTS.contains(&name.as_str()) => return true,
            // that is no number of the data, and keeps its digits
            Expr::Call(name, _) if name.text == "absolute_zero" => {}
            Expr::Call(name, _) if REQUESTS.iter().any(|(n, ..)| *n == name.text) => return true,
            expr => expr.each_operand(|o| open.push(o)),
        }
    }
    false
}

/// A number as people write it.
pub(super) fn number(value: f64) -> String {
    match value {
        v if v == f64::INFINITY => "inf".into(),
        v if v == f64::NEG_INFINITY => "-inf".into(),
        v if v != 0.0 && !(1e-4..1e15).contains(&v.abs()) => format!("{v:e}"),
        v => v.to_string(),
    }
}

impl<'a> Rewrite<'a> {
    /// The effect's own states, lets and equations.
    pub(super) fn own_lines(&mut self) {
        let effect = self.effect;
        for (line, _) in &effect.tree().lines {
            match line {
                EffectLine::Own(Role::State, list) => list.iter().for_each(|d| self.state(d)),
                EffectLine::Own(Role::Let, list) => {
                    for d in list {
                        let Some(Value::Expr(e)) = d.value else { continue };
                        let text = format!("let {} = {};", self.names[&d.name.text], self.print(e));
                        self.lines.push((Line::Declare(Role::Let), text));
                    }
                }
                EffectLine::Equation(left, right) => {
                    let Some(state) = crate::subject::derived(self.pool(), *left) else { continue };
                    let text = format!("der({}) = {};", self.names[state], self.print(*right));
                    self.lines.push((Line::Equation, text));
                }
                _ => {}
            }
        }
    }

    /// A state, where it begins, what it is.
    pub(super) fn state(&mut self, d: &Declaration) {
        let name = self.names[&d.name.text].clone();
        let begins = match d.value {
            Some(Value::Expr(e)) => match self.pool().expr(e) {
                Expr::Call(call, arguments) if call.text == "start" => match self.pool().expr(arguments[0]) {
                    Expr::Name(slot) => self.beginning(slot, &d.name.text),
                    _ => String::new(),
                },
                _ => format!(" = {}", self.print(e)),
            },
            Some(Value::Free(_)) => " = free".into(),
            None => String::new(),
        };
        let doc = d.doc.as_ref().map_or(String::new(), |_| self.doc(d));
        let text = format!("state {name}{begins}{};", self.suffix(d, &doc));
        self.lines.push((Line::Declare(Role::State), text));
    }

    /// Where a state begins that follows a signal: as a state of the model does, or with what was recorded first.
    pub(super) fn beginning(&mut self, slot: &str, local: &str) -> String {
        let Some(target) = self.bound.get(slot).cloned() else { return String::new() };
        if let Some((Role::State, declaration, statement)) = self.subject.declaration(vector_of(&target)) {
            return match declaration.value {
                Some(Value::Expr(e)) => {
                    let range = match (self.subject.element(&target), self.subject.tree.expr(e)) {
                        (Some(element), Expr::Vector(list)) if list.len() == element.length => {
                            self.subject.tree.span(list[element.index]).range()
                        }
                        _ => self.editor.value(statement, e),
                    };
                    format!(" = {}", &self.subject.source.text()[range])
                }
                Some(Value::Free(_)) => self.free_beginning(&target, local),
                None => String::new(),
            };
        }
        match self.scales.beginning(&target) {
            Beginning::Same(0.0) => String::new(),
            Beginning::Same(value) => format!(" = {}", number(rounded(value))),
            Beginning::Varies(value) => self.own_beginning(&target, local, rounded(value)),
        }
    }

    /// The start of a state that follows one whose own start is estimated is estimated, too.
    pub(super) fn free_beginning(&mut self, signal: &str, local: &str) -> String {
        let name = format!("{}(0)", self.names[local]);
        self.params.push(self.beginning_param(name, signal, local, 0.0));
        " = free".into()
    }

    pub(super) fn beginning_param(&self, name: String, signal: &str, local: &str, value: f64) -> NewParam {
        NewParam {
            local: name.clone(),
            name,
            doc: format!("{signal} at the beginning of a run"),
            unit: self.units.get(local).cloned(),
            null: value,
            start: value,
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
            trials: Vec::new(),
            positive: false,
            nuisance: true,
            fixed: false,
            per_run: true,
            begins_as: Some(signal.into()),
        }
    }

    /// A param for the first value of a state, which differs from run to run.
    pub(super) fn own_beginning(&mut self, signal: &str, local: &str, value: f64) -> String {
        let name = self.taken.give(&format!("{}_0", self.names[local]));
        self.declared.push(name.clone());
        let new = self.beginning_param(name.clone(), signal, local, value);
        let unit = new.unit.as_ref().map_or(String::new(), |u| format!(" [{}]", u.text()));
        let text = format!("param {name} = {}{unit} per run \"{}\";", number(value), new.doc);
        self.lines.push((Line::Declare(Role::Param), text));
        self.params.push(new);
        format!(" = {name}")
    }
}
