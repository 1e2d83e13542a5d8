//! An effect at its place to edits of the model's text.
//!
//! **In** a candidate, the model's text, answers about the data, chosen values. **Out** an [`Extension`], or why it cannot be
//! written. **Never** touches what does not change. **Start** at [`apply`]: names, then numbers (`values`), changed equations
//! (`terms`), and what the effect brings itself (`states`).

mod terms;
mod values;

use crate::candidate::{Candidate, Choice};
use crate::candidate::{Extension, NewParam};
use crate::conditions::{Effect, Kind};
use crate::dimension;
use crate::edit::Taken;
use crate::edit::{Editor, Line};
use crate::scales::{Scales, rounded};
use crate::subject::Subject;
use crate::turnover::Turnover;
use fdm_grammar::diagnostic::{Code, Diagnostic};
use fdm_grammar::syntax::{Declaration, EffectLine, Expr, ExprRef, Printer, Role, SlotKind, SyntaxTree, Value};
use fdm_grammar::unit::Unit;
use std::collections::HashMap;
use values::number;

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
    rewrite.species()?;
    rewrite.changes()?;
    rewrite.own_lines();
    Ok(rewrite.finish())
}

/// Part of its greatest amount below which nothing is divided by a species.
const LEAST_AMOUNT: f64 = 1e-6;

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
        // no brackets in names: drag_x2 of x[2]
        let plain = |name: &str| name.replace(['[', ']'], "");
        let targets: Vec<String> = self.candidate.targets().iter().map(|t| plain(t)).collect();
        for (line, _) in &effect.tree().lines {
            match line {
                EffectLine::Tunable(t) => {
                    let local = &t.declaration.name.text;
                    let name = self.taken.give(&format!("{local}_{}", targets.join("_")));
                    self.new_name(local, name);
                }
                EffectLine::Own(role, list) => {
                    for d in list {
                        let (local, of) = (&d.name.text, plain(&self.followed(d)));
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

    /// `consumed(p)` and `made(p)`: the product of the species that a rate takes, which it may be divided by, and of those that it makes.
    fn species(&mut self) -> Result<(), Diagnostic> {
        for (slot, kind) in self.effect.tree().slots.iter().zip(self.candidate.kinds()) {
            if *kind != SlotKind::Param {
                continue;
            }
            let (slot, subject) = (&slot.name.text, self.subject);
            let [consumed, made] =
                [Turnover::Consumed, Turnover::Produced].map(|turnover| subject.species(&self.bound[slot], turnover));
            let mut least = Vec::new();
            for x in &consumed {
                let Some(greatest) = self.answers().greatest_of_positive(x) else {
                    return Err(self.misfit(format!("{x} is below zero in these records")));
                };
                least.push(format!("max({x}, {})", number(rounded(LEAST_AMOUNT * greatest))));
            }
            let product = |factors: &[String]| match factors {
                [] => "1".to_string(),
                [one] => one.clone(),
                many => format!("({})", many.join("*")),
            };
            let made: Vec<String> = made.into_iter().map(String::from).collect();
            self.names.insert(format!("consumed({slot})"), product(&least));
            self.names.insert(format!("made({slot})"), product(&made));
        }
        Ok(())
    }

    fn new_name(&mut self, local: &str, name: String) {
        self.declared.push(name.clone());
        self.names.insert(local.into(), name);
    }

    /// An expression of the effect in the names of the model.
    fn print(&self, root: ExprRef) -> String {
        let mut pool = self.pool().clone();
        for (expr, _) in &mut pool.expressions {
            let written = match expr {
                Expr::Call(call, arguments) => match arguments.first().map(|e| self.pool().expr(*e)) {
                    Some(Expr::Name(slot)) => self.names.get(&format!("{}({slot})", call.text)).cloned(),
                    _ => None,
                },
                _ => None,
            };
            match (written, &mut *expr) {
                (Some(written), expr) => *expr = Expr::Name(written),
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

    fn finish(mut self) -> Extension {
        let roles = [Role::State, Role::Param, Role::Const, Role::Let].map(Line::Declare);
        for line in roles.into_iter().chain([Line::Equation]) {
            let texts: Vec<String> = self.lines.iter().filter(|(l, _)| *l == line).map(|(_, t)| t.clone()).collect();
            self.editor.insert(line, &texts);
        }
        let source = self.subject.with_text(self.editor.finish());
        Extension { source, params: self.params, declared: self.declared, base: self.subject.model.clone() }
    }
}
