//! An effect that passed its checks: every name known, every param with a null value, every line possible.

use super::soundness;
use fdm_grammar::diagnostic::Diagnostic;
use fdm_grammar::syntax::{Class, EffectLine, EffectTree, Expr, ExprRef, Field, Tunable};

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

    /// What kind of explanation it is.
    pub fn class(&self) -> Class {
        self.tree.class
    }

    /// The fields in which it is at home; everywhere where there are none.
    pub fn fields(&self) -> &[Field] {
        &self.tree.fields
    }

    /// As it was written.
    pub fn tree(&self) -> &EffectTree {
        &self.tree
    }

    /// `input_delay(i: input)`
    pub fn signature(&self) -> String {
        let slot = |s: &fdm_grammar::syntax::Slot| {
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
        let mut mistakes = soundness::mistakes(&tree);
        let sound = mistakes.is_empty();
        findings.append(&mut mistakes);
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
