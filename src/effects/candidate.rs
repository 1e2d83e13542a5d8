//! An effect at a place of a model, and what comes of it there.

use super::definition::{Effect, Kind};
use super::extension::Extension;
use super::rewrite;
use super::scales::Scales;
use super::subject::{Subject, Untried};
use fdm_grammar::diagnostic::Diagnostic;
use fdm_grammar::syntax::{EffectLine, Field, Place, SlotKind};
use std::collections::HashMap;
use std::sync::Arc;

/// Values for params and nuisances of an effect, by their names in the effect; what is not named starts at its first
/// trial, or at its null value.
pub type Choice = HashMap<String, f64>;

/// Where the effects of a catalogue fit a model.
#[derive(Debug, Clone, Default)]
pub struct Places {
    /// In the order of the catalogue, then of the model's text.
    pub candidates: Vec<Candidate>,
    /// Effects that fit more places than are tried.
    pub crowded: Vec<Crowded>,
    /// Names of the model to which no effect can be attached.
    pub untried: Vec<Untried>,
}

impl Places {
    /// The candidate that is written `effect(target, ...)`, with or without blanks.
    pub fn find(&self, written: &str) -> Option<&Candidate> {
        let plain = |s: &str| s.chars().filter(|c| !c.is_whitespace()).collect::<String>();
        let wanted = plain(written);
        self.candidates.iter().find(|c| plain(&c.to_string()) == wanted)
    }
}

/// An effect that fits more places than the limit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Crowded {
    /// Its name.
    pub effect: String,
    /// The places that are tried.
    pub limit: usize,
    /// The places that were found until the search for them ended.
    pub found: usize,
    /// The fields in which it is at home; one of them chosen, all places are tried.
    pub fields: Vec<Field>,
}

impl std::fmt::Display for Crowded {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { effect, limit, found, fields } = self;
        match fields.first().filter(|_| *limit == 0) {
            Some(field) => {
                write!(f, "`{effect}` fits {found} places; only `--catalogue {}` tries them", field.word())
            }
            None => write!(f, "`{effect}` fits more than {limit} places; only so many are tried"),
        }
    }
}

/// An effect attached to names of a model. Displayed as `input_delay(stick)`.
#[derive(Debug, Clone)]
pub struct Candidate {
    effect: Arc<Effect>,
    targets: Vec<String>,
    kinds: Vec<SlotKind>,
}

impl Candidate {
    pub(super) fn new(effect: Arc<Effect>, targets: Vec<String>, kinds: Vec<SlotKind>) -> Self {
        Self { effect, targets, kinds }
    }

    /// The effect.
    pub fn effect(&self) -> &Effect {
        &self.effect
    }

    /// The names that it is attached to, one for each slot.
    pub fn targets(&self) -> &[String] {
        &self.targets
    }

    /// What these are.
    pub fn kinds(&self) -> &[SlotKind] {
        &self.kinds
    }

    /// What a search can do with it.
    pub fn kind(&self) -> Kind {
        self.effect.kind()
    }

    /// What it is, with the names of the model.
    pub fn doc(&self) -> String {
        let slots = self.effect.tree().slots.iter().map(|s| &s.name.text);
        slots
            .zip(&self.targets)
            .fold(self.effect.doc().to_string(), |doc, (slot, target)| doc.replace(&format!("{{{slot}}}"), target))
    }

    /// The state into whose equation a noise enters (`noise der(x) = q;`); `None` for an effect that is an equation.
    pub fn noise(&self) -> Option<&str> {
        self.effect.tree().lines.iter().find_map(|(line, _)| match line {
            EffectLine::Noise(place, _) => self.target(place),
            _ => None,
        })
    }

    /// What it adds a term to: `der(x)` or an output; `None` for an effect that replaces something.
    pub fn adds_to(&self) -> Option<String> {
        self.effect.tree().lines.iter().find_map(|(line, _)| match line {
            EffectLine::Add(place, _) => {
                let target = self.target(place)?;
                Some(if place.derivative { format!("der({target})") } else { target.to_string() })
            }
            _ => None,
        })
    }

    /// The name of the model that a place of the effect stands for.
    fn target(&self, place: &Place) -> Option<&str> {
        self.targets.get(self.effect.slot(&place.name.text)?).map(String::as_str)
    }

    /// The model with this effect in it, as text and tree.
    ///
    /// # Errors
    /// Why it cannot be written into this model.
    pub fn apply(&self, subject: &Subject, scales: &dyn Scales, choice: &Choice) -> Result<Extension, Diagnostic> {
        rewrite::apply(self, subject, scales, choice)
    }
}

impl std::fmt::Display for Candidate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}({})", self.effect.name(), self.targets.join(", "))
    }
}
