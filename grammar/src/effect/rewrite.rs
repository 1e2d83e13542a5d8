//! An effect at its place to edits of the model's text.

use super::candidate::{Candidate, Choice};
use super::definition::{Effect, Kind};
use super::dimension;
use super::edit::{Editor, Line};
use super::extension::{Extension, NewParam};
use super::names::Taken;
use super::scales::{Answers, Beginning, NAMED_REQUESTS, REQUESTS, Scales, rounded};
use super::subject::Subject;
use crate::diagnostic::{Code, Diagnostic};
use crate::gather;
use crate::source::Source;
use crate::syntax::{
    BinarySign, Declaration, EffectLine, Expr, ExprRef, Printer, Role, SlotKind, SyntaxTree, Tunable, Value,
};
use crate::unit::Unit;
use std::collections::HashMap;

/// See [`Candidate::apply`].
pub(super) fn apply(
    candidate: &Candidate,
    subject: &Subject,
    scales: &dyn Scales,
    choice: &Choice,
) -> Result<Extension, Diagnostic> {
    let effect = candidate.effect();
    if candidate.kind() == Kind::Variance {
        let message = format!("`{candidate}` is a noise that enters the model, not a term of its equations");
        return Err(Diagnostic::new(Code::Misfit, effect.tree().name.span, message));
    }
    let slots = effect.tree().slots.iter().map(|s| s.name.text.clone());
    let bound: HashMap<String, String> = slots.zip(candidate.targets().iter().cloned()).collect();
    let units = if subject.has_units() { dimension::infer(effect, subject, &bound) } else { HashMap::new() };
    let mut rewrite = Rewrite {
        candidate,
        effect,
        subject,
        scales,
        choice,
        units,
        taken: Taken::of(&subject.tree),
        names: bound.clone(),
        bound,
        known: HashMap::new(),
        params: Vec::new(),
        declared: Vec::new(),
        lines: Vec::new(),
        editor: Editor::new(subject.source.text(), &subject.tree),
    };
    rewrite.name();
    rewrite.values()?;
    rewrite.changes()?;
    rewrite.own_lines();
    Ok(rewrite.finish())
}

struct Rewrite<'a> {
    candidate: &'a Candidate,
    effect: &'a Effect,
    subject: &'a Subject,
    scales: &'a dyn Scales,
    choice: &'a Choice,
    units: HashMap<String, Unit>,
    taken: Taken,
    /// Slots to targets.
    bound: HashMap<String, String>,
    /// Slots and the effect's own names to what stands for them in expressions.
    names: HashMap<String, String>,
    /// Values of consts, params and nuisances.
    known: HashMap<String, f64>,
    params: Vec<NewParam>,
    declared: Vec<String>,
    lines: Vec<(Line, String)>,
    editor: Editor<'a>,
}

impl<'a> Rewrite<'a> {
    fn pool(&self) -> &'a SyntaxTree {
        &self.effect.tree().pool
    }

    fn misfit(&self, why: impl std::fmt::Display) -> Diagnostic {
        let message = format!("`{}` cannot be applied: {why}", self.candidate);
        Diagnostic::new(Code::Misfit, self.effect.tree().name.span, message)
    }

    /// Telling names: `tau_stick` for a param, `stick_delayed` for what follows the stick.
    fn name(&mut self) {
        let effect = self.effect;
        let targets = self.candidate.targets().to_vec();
        for (line, _) in &effect.tree().lines {
            match line {
                EffectLine::Tunable(t) => {
                    let local = &t.declaration.name.text;
                    let name = self.taken.give(&format!("{local}_{}", targets.join("_")));
                    self.new_name(local, name);
                }
                EffectLine::Own(role, list) => {
                    for d in list {
                        let (local, of) = (&d.name.text, self.followed(d));
                        let const_ = *role == Role::Const;
                        let name =
                            self.taken.give(&if const_ { format!("{local}_{of}") } else { format!("{of}_{local}") });
                        self.new_name(local, name);
                    }
                }
                _ => {}
            }
        }
    }

    /// The name of the model after which something of the effect's own is called: what a state begins as, or else the first.
    fn followed(&self, d: &Declaration) -> String {
        let begins = match d.value {
            Some(Value::Expr(e)) => match self.pool().expr(e) {
                Expr::Call(call, arguments) if call.text == "start" => match self.pool().expr(arguments[0]) {
                    Expr::Name(slot) => self.bound.get(slot),
                    _ => None,
                },
                _ => None,
            },
            _ => None,
        };
        begins.or(self.candidate.targets().first()).cloned().unwrap_or_default()
    }

    fn new_name(&mut self, local: &str, name: String) {
        self.declared.push(name.clone());
        self.names.insert(local.into(), name);
    }

    fn answers(&self) -> Answers<'_> {
        Answers { pool: self.pool(), bound: &self.bound, known: &self.known, scales: self.scales }
    }

    /// Values of consts, params and nuisances, in the order of the effect.
    fn values(&mut self) -> Result<(), Diagnostic> {
        let effect = self.effect;
        for (line, _) in &effect.tree().lines {
            match line {
                EffectLine::Own(Role::Const, list) => {
                    for d in list {
                        let Some(Value::Expr(e)) = d.value else { continue };
                        let value = self.answers().value(e);
                        let Some(value) = value.filter(|v| v.is_finite()) else {
                            return Err(self.misfit(format!("`{}` has no finite value here", d.name.text)));
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

    /// A value that came from data has few digits.
    fn answer(&self, e: ExprRef, value: f64) -> f64 {
        if asks(self.pool(), e) { rounded(value) } else { value }
    }

    /// From the unit that the effect writes to the one that the model needs.
    fn factor(&mut self, d: &Declaration) -> Result<f64, Diagnostic> {
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

    fn tunable(&mut self, t: &Tunable) -> Result<(), Diagnostic> {
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
            nuisance: t.nuisance,
            fixed: d.fixed.is_some(),
            per_run: d.per_run.is_some(),
            begins_as: None,
        });
        Ok(())
    }

    /// What a param is: its own words, or the effect's, with the names of the model.
    fn doc(&self, d: &Declaration) -> String {
        let Some(own) = &d.doc else { return self.candidate.doc() };
        self.bound_in_order().fold(own.text.clone(), |doc, (slot, target)| doc.replace(&format!("{{{slot}}}"), target))
    }

    fn bound_in_order(&self) -> impl Iterator<Item = (&'a str, &'a String)> {
        let slots = self.effect.tree().slots.iter().map(|s| s.name.text.as_str());
        slots.zip(self.candidate.targets())
    }

    /// ` [unit] "doc"`, as far as there is something to say.
    fn suffix(&self, d: &Declaration, doc: &str) -> String {
        let unit = self.units.get(&d.name.text).map_or(String::new(), |u| format!(" [{}]", u.text()));
        if doc.is_empty() { unit } else { format!("{unit} \"{doc}\"") }
    }

    /// An expression of the effect in the names of the model.
    fn print(&self, root: ExprRef) -> String {
        let mut pool = self.pool().clone();
        for (expr, _) in &mut pool.expressions {
            let rate = match expr {
                Expr::Call(call, arguments) if call.text == "der" => match self.pool().expr(arguments[0]) {
                    Expr::Name(slot) => self.names.get(&format!("der({slot})")).cloned(),
                    _ => None,
                },
                _ => None,
            };
            match (rate, &mut *expr) {
                (Some(rate), expr) => *expr = Expr::Name(rate),
                (None, Expr::Name(name)) => {
                    if let Some(other) = self.names.get(name) {
                        other.clone_into(name);
                    }
                }
                _ => {}
            }
        }
        Printer::new(&pool).expression(root)
    }

    /// How often a name, or the rate of a state, stands in the lines of the effect.
    fn mentions(&self, wanted: &str, rate: bool) -> usize {
        let pool = self.pool();
        let mut count = 0;
        let mut open: Vec<ExprRef> = Vec::new();
        for (line, _) in &self.effect.tree().lines {
            match line {
                EffectLine::Equation(_, e) | EffectLine::Add(_, e) | EffectLine::Replace(_, e) => open.push(*e),
                EffectLine::Own(Role::Let, list) => open.extend(list.iter().filter_map(|d| match d.value {
                    Some(Value::Expr(e)) => Some(e),
                    _ => None,
                })),
                _ => {}
            }
        }
        while let Some(e) = open.pop() {
            match pool.expr(e) {
                Expr::Name(name) => count += usize::from(!rate && name == wanted),
                Expr::Call(call, arguments) if call.text == "der" => {
                    let own = matches!(pool.expr(arguments[0]), Expr::Name(n) if n == wanted);
                    count += usize::from(rate && own);
                }
                expr => expr.each_operand(|o| open.push(o)),
            }
        }
        count
    }

    /// `add` and `replace` lines to edits, replaced uses first: they move along with the equations they stand in.
    fn changes(&mut self) -> Result<(), Diagnostic> {
        let effect = self.effect;
        let kinds = self.candidate.kinds();
        let is_output = |slot: &str| effect.slot(slot).is_some_and(|k| kinds[k] == SlotKind::Output);
        let lines = &effect.tree().lines;
        for (line, _) in lines {
            if let EffectLine::Replace(name, with) = line
                && !is_output(&name.text)
            {
                self.replace_uses(&name.text, *with)?;
            }
        }
        for slot in &effect.tree().slots {
            let slot = &slot.name.text;
            let added = lines.iter().find_map(|(l, _)| match l {
                EffectLine::Add(place, e) if place.derivative && place.name.text == *slot => Some(*e),
                _ => None,
            });
            if added.is_some() || self.mentions(slot, true) > 0 {
                self.rate(slot, added)?;
            }
        }
        for slot in &effect.tree().slots {
            let slot = &slot.name.text;
            let added = lines.iter().find_map(|(l, _)| match l {
                EffectLine::Add(place, e) if !place.derivative && place.name.text == *slot => Some(*e),
                _ => None,
            });
            let replaced = lines.iter().find_map(|(l, _)| match l {
                EffectLine::Replace(name, e) if name.text == *slot && is_output(slot) => Some(*e),
                _ => None,
            });
            if added.is_some() || replaced.is_some() {
                self.output(slot, added, replaced)?;
            }
        }
        Ok(())
    }

    /// Every use of an input, a state or a param becomes an expression.
    fn replace_uses(&mut self, slot: &str, with: ExprRef) -> Result<(), Diagnostic> {
        let target = self.bound[slot].clone();
        let state = self.subject.equation(&target).is_some();
        let uses = self.subject.uses(&target, state.then_some(target.as_str()));
        if uses.is_empty() {
            return Err(self.misfit(format!("nothing uses `{target}`")));
        }
        let text = self.print(with);
        let short = matches!(self.pool().expr(with), Expr::Name(_) | Expr::Number(_) | Expr::Call(..));
        let name = match self.pool().expr(with) {
            Expr::Name(_) => text,
            _ if uses.len() == 1 && short => text,
            _ if uses.len() == 1 => format!("({text})"),
            _ => {
                let name = self.taken.give(&format!("{target}_{}", self.effect.name()));
                self.declared.push(name.clone());
                self.lines.push((Line::Declare(Role::Let), format!("let {name} = {text};")));
                name
            }
        };
        for (span, _) in uses {
            self.editor.replace(span.range(), name.clone());
        }
        Ok(())
    }

    /// A term is added to the equation of a state, or what stands there gets a name.
    fn rate(&mut self, slot: &str, added: Option<ExprRef>) -> Result<(), Diagnostic> {
        let target = self.bound[slot].clone();
        let Some((right, statement)) = self.subject.equation(&target) else {
            return Err(self.misfit(format!("`{target}` has no equation of its own")));
        };
        let value = self.editor.value(statement, right);
        if self.mentions(slot, true) == 0 {
            if let Some(added) = added {
                self.append(right, value, added);
            }
            return Ok(());
        }
        let name = self.taken.give(&format!("{target}_rate"));
        self.declared.push(name.clone());
        self.names.insert(format!("der({slot})"), name.clone());
        let start = statement.start as usize;
        self.editor.replace(start..value.start, format!("let {name} = "));
        let term = added.map_or(String::new(), |e| self.term(e));
        self.editor.insert_behind(statement, &format!("der({target}) = {name}{term};"));
        Ok(())
    }

    /// ` + c*x` or ` - c*x` behind a value.
    fn append(&mut self, root: ExprRef, value: std::ops::Range<usize>, added: ExprRef) {
        let term = self.term(added);
        // an `if` without brackets would take the term into its last branch
        if matches!(self.subject.tree.expr(root), Expr::If(..)) {
            self.editor.replace(value.start..value.start, "(");
            self.editor.replace(value.end..value.end, format!("){term}"));
        } else {
            self.editor.replace(value.end..value.end, term);
        }
    }

    fn term(&self, added: ExprRef) -> String {
        let text = self.print(added);
        let (choice, sum) = match self.pool().expr(added) {
            Expr::If(..) => (true, false),
            Expr::Binary(sign, ..) => (false, matches!(sign, BinarySign::Add | BinarySign::Subtract)),
            _ => (false, false),
        };
        match text.strip_prefix('-') {
            Some(rest) if !sum && !choice => format!(" - {rest}"),
            None if !choice => format!(" + {text}"),
            _ => format!(" + ({text})"),
        }
    }

    /// The expression of an output is changed; where it is needed more than once it gets a name.
    fn output(&mut self, slot: &str, added: Option<ExprRef>, replaced: Option<ExprRef>) -> Result<(), Diagnostic> {
        let target = self.bound[slot].clone();
        let Some((_, declaration, statement)) = self.subject.declaration(&target) else {
            return Err(self.misfit(format!("`{target}` is not declared in this text")));
        };
        let Some(Value::Expr(root)) = declaration.value else {
            return Err(self.misfit(format!("`{target}` has no expression")));
        };
        let value = self.editor.value(statement, root);
        let mentions = self.mentions(slot, false);
        if let (Some(added), 0) = (added, mentions) {
            self.append(root, value, added);
            return Ok(());
        }
        let alone = replaced.is_some_and(|e| mentions == 1 && within(self.pool(), e, slot));
        let old = self.editor.take(&value);
        if alone {
            let argument = replaced.is_some_and(|e| is_argument(self.pool(), e, slot));
            let simple = matches!(self.subject.tree.expr(root), Expr::Name(_) | Expr::Call(..) | Expr::Number(_));
            self.names.insert(slot.into(), if simple || argument { old } else { format!("({old})") });
        } else if mentions > 0 {
            let name = if matches!(self.subject.tree.expr(root), Expr::Name(_)) {
                old
            } else {
                let name = self.taken.give(&format!("{target}_true"));
                self.declared.push(name.clone());
                self.lines.push((Line::Declare(Role::Let), format!("let {name} = {old};")));
                name
            };
            self.names.insert(slot.into(), name);
        }
        let new = match (replaced, added) {
            (Some(e), _) => self.print(e),
            (None, Some(e)) => format!("{}{}", self.names[slot], self.term(e)),
            (None, None) => return Ok(()),
        };
        self.editor.replace(value, new);
        if alone {
            self.names.insert(slot.into(), target);
        }
        Ok(())
    }

    /// The effect's own states, lets and equations.
    fn own_lines(&mut self) {
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
                    let Some(state) = super::subject::derived(self.pool(), *left) else { continue };
                    let text = format!("der({}) = {};", self.names[state], self.print(*right));
                    self.lines.push((Line::Equation, text));
                }
                _ => {}
            }
        }
    }

    /// A state, where it begins, what it is.
    fn state(&mut self, d: &Declaration) {
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
    fn beginning(&mut self, slot: &str, local: &str) -> String {
        let Some(target) = self.bound.get(slot).cloned() else { return String::new() };
        if let Some((Role::State, declaration, statement)) = self.subject.declaration(&target) {
            return match declaration.value {
                Some(Value::Expr(e)) => {
                    let range = self.editor.value(statement, e);
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
    fn free_beginning(&mut self, signal: &str, local: &str) -> String {
        let name = format!("{}(0)", self.names[local]);
        self.params.push(self.beginning_param(name, signal, local, 0.0));
        " = free".into()
    }

    fn beginning_param(&self, name: String, signal: &str, local: &str, value: f64) -> NewParam {
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
            nuisance: true,
            fixed: false,
            per_run: true,
            begins_as: Some(signal.into()),
        }
    }

    /// A param for the first value of a state, which differs from run to run.
    fn own_beginning(&mut self, signal: &str, local: &str, value: f64) -> String {
        let name = self.taken.give(&format!("{}_0", self.names[local]));
        self.declared.push(name.clone());
        let new = self.beginning_param(name.clone(), signal, local, value);
        let unit = new.unit.as_ref().map_or(String::new(), |u| format!(" [{}]", u.text()));
        let text = format!("param {name} = {}{unit} per run \"{}\";", number(value), new.doc);
        self.lines.push((Line::Declare(Role::Param), text));
        self.params.push(new);
        format!(" = {name}")
    }

    fn finish(mut self) -> Extension {
        let roles = [Role::State, Role::Param, Role::Const, Role::Let].map(Line::Declare);
        for line in roles.into_iter().chain([Line::Equation]) {
            let texts: Vec<String> = self.lines.iter().filter(|(l, _)| *l == line).map(|(_, t)| t.clone()).collect();
            self.editor.insert(line, &texts);
        }
        let base = &self.subject.source;
        let mut source = Source::new(base.name(), self.editor.finish());
        // the files that the model uses are those that it was compiled with
        gather(&mut source, &mut |name| {
            let text = base.find(name).map(|k| base.texts()[k].text().to_string());
            text.ok_or_else(|| "it was not there before".to_string())
        });
        Extension { source, params: self.params, declared: self.declared, base: self.subject.model.clone() }
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
            Expr::Call(name, _) if REQUESTS.iter().any(|(n, ..)| *n == name.text) => return true,
            expr => expr.each_operand(|o| open.push(o)),
        }
    }
    false
}

fn within(pool: &SyntaxTree, root: ExprRef, name: &str) -> bool {
    let mut open = vec![root];
    while let Some(e) = open.pop() {
        if matches!(pool.expr(e), Expr::Name(n) if n == name) {
            return true;
        }
        pool.expr(e).each_operand(|o| open.push(o));
    }
    false
}

/// Whether a name stands alone as an argument, where it needs no brackets.
fn is_argument(pool: &SyntaxTree, root: ExprRef, name: &str) -> bool {
    let is = |e: &ExprRef| matches!(pool.expr(*e), Expr::Name(n) if n == name);
    let mut open = vec![root];
    while let Some(e) = open.pop() {
        match pool.expr(e) {
            Expr::Call(_, arguments) if arguments.iter().any(is) => return true,
            expr => expr.each_operand(|o| open.push(o)),
        }
    }
    false
}

/// A number as people write it.
fn number(value: f64) -> String {
    match value {
        v if v == f64::INFINITY => "inf".into(),
        v if v == f64::NEG_INFINITY => "-inf".into(),
        v if v != 0.0 && !(1e-4..1e15).contains(&v.abs()) => format!("{v:e}"),
        v => v.to_string(),
    }
}
