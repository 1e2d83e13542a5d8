//! Where an effect does not fit: the tests behind `unless` and `when`.
//!
//! An effect that passed its checks: every name known, every param with a null value, every line possible.

use super::subject::{Subject, Target};
use super::turnover::Turnover;
use crate::soundness;
use fdm_grammar::diagnostic::Diagnostic;
use fdm_grammar::graph::Leaf;
use fdm_grammar::syntax::{
    BinarySign, Class, EffectLine, EffectTree, Expr, ExprRef, Field, SlotKind, Tunable, UnarySign,
};
use fdm_grammar::unit::Unit;

/// What a node of a test is.
#[derive(Debug, Clone, Copy)]
enum Part {
    Truth(bool),
    /// The thing that a slot stands for, by slot.
    Thing(usize),
    /// The rate of that state.
    Rate(usize),
    /// Nothing that has a meaning; the definition was checked, so this is a function of slots that cannot be.
    Nothing,
}

/// Whether all conditions of an effect are met by these targets, one for each slot.
pub(super) fn fits(effect: &Effect, subject: &Subject, targets: &[&Target]) -> bool {
    let tree = effect.tree();
    let used = |slot: usize| {
        let name = &targets[slot].name;
        let own = (targets[slot].kind == SlotKind::State).then_some(name.as_str());
        targets[slot].kind == SlotKind::Output || !subject.uses(name, own).is_empty()
    };
    let replaced = tree.lines.iter().filter_map(|(line, _)| match line {
        EffectLine::Replace(name, _) => effect.slot(&name.text),
        _ => None,
    });
    // what nothing uses cannot be replaced
    if !replaced.into_iter().all(used) {
        return false;
    }
    tree.conditions.iter().all(|condition| {
        let mut parts: Vec<Part> = Vec::with_capacity(condition.test.0 as usize + 1);
        for k in 0..=condition.test.0 {
            let part = node(effect, subject, targets, ExprRef(k), &parts);
            parts.push(part);
        }
        match parts[condition.test.0 as usize] {
            Part::Truth(holds) => holds != condition.unless,
            _ => true,
        }
    })
}

fn node(effect: &Effect, subject: &Subject, targets: &[&Target], e: ExprRef, parts: &[Part]) -> Part {
    let at = |e: &ExprRef| parts[e.0 as usize];
    let truth = |e: &ExprRef| matches!(at(e), Part::Truth(true));
    let of_one = |a: &ExprRef, holds: &dyn Fn(&str) -> bool| match at(a) {
        Part::Thing(k) => Part::Truth(holds(&targets[k].name)),
        _ => Part::Nothing,
    };
    let of_two = |a: &ExprRef, b: &ExprRef, holds: &dyn Fn(&str, &str) -> bool| match (at(a), at(b)) {
        (Part::Thing(a), Part::Thing(b)) => Part::Truth(holds(&targets[a].name, &targets[b].name)),
        _ => Part::Nothing,
    };
    match effect.tree().pool.expr(e) {
        Expr::Name(name) => effect.slot(name).map_or(Part::Nothing, Part::Thing),
        Expr::Unary(UnarySign::Not, a) => Part::Truth(!truth(a)),
        Expr::Binary(BinarySign::And, a, b, _) => Part::Truth(truth(a) && truth(b)),
        Expr::Binary(BinarySign::Or, a, b, _) => Part::Truth(truth(a) || truth(b)),
        Expr::Binary(sign, a, b, _) => {
            let order = |p: Part| match p {
                Part::Thing(k) | Part::Rate(k) => Some((targets[k].order, matches!(p, Part::Rate(_)))),
                _ => None,
            };
            let (Some(a), Some(b)) = (order(at(a)), order(at(b))) else { return Part::Nothing };
            match sign {
                BinarySign::Equal => Part::Truth(a == b),
                BinarySign::NotEqual => Part::Truth(a != b),
                BinarySign::Less => Part::Truth(a < b),
                BinarySign::Greater => Part::Truth(a > b),
                _ => Part::Nothing,
            }
        }
        Expr::Call(name, arguments) => match (name.text.as_str(), &arguments[..]) {
            ("der", [a]) => match at(a) {
                Part::Thing(k) => Part::Rate(k),
                _ => Part::Nothing,
            },
            ("known", [a]) => match at(a) {
                Part::Rate(k) | Part::Thing(k) => Part::Truth(is_known(subject, &targets[k].name)),
                _ => Part::Nothing,
            },
            ("shared", [a]) => of_one(a, &|x| is_shared(subject, x)),
            ("temperature", [a]) => of_one(a, &|x| subject.unit(x).is_some_and(|u| u.dimension == TEMPERATURE)),
            ("intensive", [a]) => of_one(a, &|x| subject.unit(x).is_some_and(|u| is_intensive(&u))),
            ("unitless", [a]) => of_one(a, &|x| subject.unit(x).is_none_or(|u| u.dimension == [0; 7])),
            ("power", [i, x]) => of_two(i, x, &|i, x| is_power(subject, i, x)),
            ("alike", [a, b]) => of_two(a, b, &|a, b| are_alike(subject, a, b)),
            ("consumes", [p, x]) => of_two(p, x, &|p, x| subject.turnover(p, x) == Some(Turnover::Consumed)),
            ("produces", [p, x]) => of_two(p, x, &|p, x| subject.turnover(p, x) == Some(Turnover::Produced)),
            ("turns", [p]) => of_one(p, &|p| turns(subject, p)),
            ("depends", [a, b]) => match (at(a), at(b)) {
                (Part::Rate(k) | Part::Thing(k), Part::Thing(z)) => {
                    Part::Truth(depends(subject, &targets[k].name, &targets[z].name))
                }
                _ => Part::Nothing,
            },
            _ => Part::Nothing,
        },
        _ => Part::Nothing,
    }
}

/// Whether no parameter stands in the rate of a state or the value of an output: nothing was left to be found there.
fn is_known(subject: &Subject, name: &str) -> bool {
    subject.reached(name).is_some_and(|leaves| !leaves.iter().any(|l| matches!(l, Leaf::Param(_))))
}

/// Whether something stands in the equations of several states, as a torque between coupled bodies does.
fn is_shared(subject: &Subject, name: &str) -> bool {
    let states = subject.model.states.iter().map(|s| &s.quantity.name);
    states.filter(|state| subject.balance(state).is_some() && depends(subject, state, name)).count() > 1
}

/// Whether a force acts on a speed, or a torque on an angular rate: their product is a power. Nothing is said where a unit is
/// missing.
fn is_power(subject: &Subject, force: &str, speed: &str) -> bool {
    let (Some(force), Some(speed)) = (subject.unit(force), subject.unit(speed)) else { return true };
    let watt = Unit::parse("W");
    watt.is_ok_and(|watt| force.product(&speed).is_some_and(|product| product.same_dimension(&watt)))
}

/// Exponents of a temperature.
const TEMPERATURE: [i8; 7] = [0, 0, 0, 0, 1, 0, 0];

/// Whether a unit is that of a temperature, or of how much of a substance there is, in moles or by volume in moles or mass.
fn is_intensive(unit: &Unit) -> bool {
    match unit.dimension {
        [_, 0, 0, 0, 0, moles, 0] if moles != 0 => true,
        dimension => [TEMPERATURE, [-3, 1, 0, 0, 0, 0, 0]].contains(&dimension),
    }
}

/// Whether two things measure the same. Nothing is said where a unit is missing.
pub(super) fn are_alike(subject: &Subject, a: &str, b: &str) -> bool {
    let (Some(a), Some(b)) = (subject.unit(a), subject.unit(b)) else { return true };
    a.same_dimension(&b)
}

/// Whether a rate makes of some species, all measured alike, others.
fn turns(subject: &Subject, param: &str) -> bool {
    let [consumed, made] = [Turnover::Consumed, Turnover::Produced].map(|turnover| subject.species(param, turnover));
    let (Some(first), Some(_)) = (consumed.first(), made.first()) else { return false };
    consumed.iter().all(|x| are_alike(subject, first, x))
}

/// Whether the rate of a state or the value of an output depends on something, lets looked through.
fn depends(subject: &Subject, name: &str, on: &str) -> bool {
    let leaf = subject.leaf(on);
    subject.reached(name).is_some_and(|leaves| leaf.is_some_and(|l| leaves.contains(&l)))
}

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
