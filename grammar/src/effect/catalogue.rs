//! A text of effects, read and checked.

use super::candidate::{Candidate, Crowded, Places};
use super::conditions::fits;
use super::definition::Effect;
use super::probe;
use super::subject::{Subject, Target};
use crate::diagnostic::{Code, Diagnostic};
use crate::source::Source;
use crate::syntax::{SlotKind, parse_effects};
use std::sync::Arc;

/// The text of the catalogue that is always there, `models/effects.fdm`.
pub const STANDARD: &str = include_str!("../../../models/effects.fdm");

/// Most places of one effect; what is beyond is told, not tried.
const MOST_PLACES: usize = 2000;
/// Most combinations of targets that are looked at for one effect.
const MOST_LOOKED_AT: usize = 1_000_000;

/// Effects by the order of their texts.
#[derive(Debug, Clone, Default)]
pub struct Catalogue {
    effects: Vec<Arc<Effect>>,
}

impl Catalogue {
    /// Reads and checks a text of effects: those that are sound, and everything that is wrong with the others.
    pub fn read(source: &Source) -> (Self, Vec<Diagnostic>) {
        let (trees, mut findings) = parse_effects(source);
        let mut catalogue = Self::default();
        for tree in trees {
            let Some(effect) = Effect::check(tree, &mut findings) else { continue };
            if let Some(finding) = catalogue.rival(&effect) {
                findings.push(finding);
            } else if let Err(finding) = probe::check(&effect) {
                findings.push(finding);
            } else {
                catalogue.effects.push(Arc::new(effect));
            }
        }
        findings.sort_by_key(|f| (f.span, f.code));
        (catalogue, findings)
    }

    /// The catalogue that is always there.
    pub fn standard() -> Self {
        Self::read(&Source::new("models/effects.fdm", STANDARD)).0
    }

    /// Adds the effects of another catalogue; those of the same name and kinds replace the own ones.
    pub fn extend(&mut self, other: Self) {
        for effect in other.effects {
            self.effects.retain(|e| !same(e, &effect));
            self.effects.push(effect);
        }
    }

    /// Keeps the effects whose name pleases.
    pub fn retain(&mut self, pleases: impl Fn(&str) -> bool) {
        self.effects.retain(|effect| pleases(effect.name()));
    }

    /// The effects in their order.
    pub fn effects(&self) -> impl Iterator<Item = &Effect> {
        self.effects.iter().map(|e| &**e)
    }

    /// An effect that attaches to the same kinds of things under the same name.
    fn rival(&self, effect: &Effect) -> Option<Diagnostic> {
        let first = self.effects.iter().find(|e| same(e, effect))?;
        let name = &effect.tree().name;
        let message = format!("the effect `{}` is defined a second time", name.text);
        let found = Diagnostic::new(Code::DeclaredTwice, name.span, message);
        let hint = "effects may share a name when they attach to different kinds of things";
        Some(found.label(first.tree().name.span, "first defined here").hint(hint))
    }

    /// Every place where an effect fits, in the order of the catalogue and of the model's text.
    pub fn places(&self, subject: &Subject) -> Places {
        let mut places = Places::default();
        let targets = SlotKind::ALL.map(|kind| subject.targets(kind));
        for effect in &self.effects {
            places_of(effect, subject, &targets, &mut places);
        }
        places
    }
}

/// Whether two effects have one name and could be attached to the same things.
fn same(a: &Effect, b: &Effect) -> bool {
    let (a, b) = (a.tree(), b.tree());
    let overlap = |k: usize| a.slots[k].kinds.iter().any(|kind| b.slots[k].kinds.contains(kind));
    a.name.text == b.name.text && a.slots.len() == b.slots.len() && (0..a.slots.len()).all(overlap)
}

fn places_of(effect: &Arc<Effect>, subject: &Subject, targets: &[Vec<Target>; 4], places: &mut Places) {
    let choices: Vec<Vec<&Target>> = effect
        .tree()
        .slots
        .iter()
        .map(|slot| {
            let mut all: Vec<&Target> = slot.kinds.iter().flat_map(|k| &targets[*k as usize]).collect();
            all.sort_by_key(|t| t.order);
            all
        })
        .collect();
    if choices.iter().any(Vec::is_empty) {
        return;
    }
    let mut at = vec![0; choices.len()];
    let (mut looked, mut found) = (0, 0);
    loop {
        looked += 1;
        let chosen: Vec<&Target> = at.iter().zip(&choices).map(|(k, list)| list[*k]).collect();
        if fits(effect, subject, &chosen) {
            found += 1;
            if found <= MOST_PLACES {
                let names = chosen.iter().map(|t| t.name.clone()).collect();
                places.candidates.push(Candidate::new(effect.clone(), names, chosen.iter().map(|t| t.kind).collect()));
            }
        }
        // the last slot moves first
        let next = (0..choices.len()).rev().find(|slot| at[*slot] + 1 < choices[*slot].len());
        if let Some(slot) = next {
            at[slot] += 1;
            at[slot + 1..].fill(0);
        }
        let ended = next.is_none();
        if ended || looked == MOST_LOOKED_AT {
            if found > MOST_PLACES || !ended {
                let effect = effect.name().to_string();
                places.crowded.push(Crowded { effect, limit: MOST_PLACES });
            }
            return;
        }
    }
}
