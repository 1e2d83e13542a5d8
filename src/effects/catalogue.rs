//! A text of effects, read and checked.

use super::candidate::{Candidate, Crowded, Places};
use super::conditions::fits;
use super::subject::{Subject, Target};
use crate::conditions::Effect;
use crate::null;
use fdm_grammar::diagnostic::{Code, Diagnostic};
use fdm_grammar::source::Source;
use fdm_grammar::syntax::{Class, Field, SlotKind, parse_effects};
use std::sync::Arc;

/// The text of the catalogue that is always there, `models/effects.fdm`.
pub const STANDARD: &str = include_str!("../../models/effects.fdm");

/// Most places of one effect; what is beyond is told, not tried.
const MOST_PLACES: usize = 2000;

/// Effects by the order of their texts.
#[derive(Debug, Clone, Default)]
pub struct Catalogue {
    effects: Vec<Arc<Effect>>,
    /// Of which fields: of all where there are few places.
    fields: Vec<Field>,
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
            } else if let Err(finding) = null::check(&effect) {
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

    /// Keeps what is at home in these fields or everywhere, and tries all places of it.
    pub fn restrict(&mut self, fields: &[Field]) {
        let at_home = |effect: &Effect| effect.fields().iter().any(|f| fields.contains(f));
        self.effects.retain(|effect| effect.fields().is_empty() || at_home(effect));
        self.fields = fields.to_vec();
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
        let mut places = Places { untried: subject.untried(), ..Places::default() };
        let targets = SlotKind::ALL.map(|kind| subject.targets(kind));
        for effect in &self.effects {
            let limit = match effect.class() {
                _ if !self.fields.is_empty() || effect.fields().is_empty() => MOST_PLACES,
                // what is flexible imitates much, and is asked for by who knows what it is
                Class::StandIn => 0,
                // most places of an effect of one field, where no field was chosen: it is searched where that costs
                // little
                _ => 40,
            };
            places_of(effect, subject, (&targets, limit), &mut places);
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

fn places_of(
    effect: &Arc<Effect>,
    subject: &Subject,
    (targets, limit): (&[Vec<Target>; 4], usize),
    places: &mut Places,
) {
    let before = places.candidates.len();
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
            if found <= limit {
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
        // most combinations of targets that are looked at for one effect
        if ended || looked == 1_000_000 {
            if found > limit || !ended {
                // none, rather than those that come first
                let tried = if limit < MOST_PLACES { 0 } else { limit };
                places.candidates.truncate(before + tried);
                let (name, fields) = (effect.name().to_string(), effect.fields().to_vec());
                places.crowded.push(Crowded { effect: name, limit: tried, found, fields });
            }
            return;
        }
    }
}
