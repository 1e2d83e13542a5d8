//! What is of the effect's own: states, where they begin, lets and equations.

use super::Rewrite;
use super::values::number;
use crate::edit::Line;
use crate::extension::NewParam;
use crate::scales::{Beginning, rounded};
use crate::subject::vector_of;
use fdm_grammar::syntax::{Declaration, EffectLine, Expr, Role, Value};

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
