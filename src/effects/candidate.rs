//! An effect at a place of a model, and what comes of it there.
//!
//! A model with an effect in it: the user's text with the new lines in their place, and what they brought.

use super::rewrite;
use super::scales::Scales;
use super::subject::{Subject, Untried};
use crate::conditions::{Effect, Kind};
use crate::null;
use crate::null::Null;
use fdm_grammar::diagnostic::Diagnostic;
use fdm_grammar::model::Model;
use fdm_grammar::source::Source;
use fdm_grammar::syntax::{EffectLine, Field, Place, SlotKind, StatementKind, SyntaxTree, parse};
use fdm_grammar::unit::Unit;
use fdm_grammar::{Compiled, compile_tree, examine_tree};
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

/// A parameter that an effect brings.
#[derive(Debug, Clone)]
pub struct NewParam {
    /// Its name in the extended model.
    pub name: String,
    /// Its name in the effect.
    pub local: String,
    /// What it is.
    pub doc: String,
    /// Its unit, when it follows from the model's.
    pub unit: Option<Unit>,
    /// The value at which the effect vanishes, which may be infinite; a nuisance has none: its first trial stands here.
    pub null: f64,
    /// The value in the extended text.
    pub start: f64,
    /// Bounds; infinite where there are none.
    pub lower: f64,
    /// See `lower`.
    pub upper: f64,
    /// The values to try, in the effect's order; empty for a param whose size is left free.
    pub trials: Vec<f64>,
    /// Physics has it at its null or above: a fit that wants it below is told, and is no cause.
    pub positive: bool,
    /// The data cannot see it at the null.
    pub nuisance: bool,
    /// Stays as it is when the extended model is fitted.
    pub fixed: bool,
    /// A value of its own in every run.
    pub per_run: bool,
    /// The first value of a state that follows this signal: a fit begins with what each run recorded first.
    pub begins_as: Option<String>,
}

/// A model's text with an effect in it.
#[derive(Debug, Clone)]
pub struct Extension {
    pub(super) source: Source,
    pub(super) params: Vec<NewParam>,
    pub(super) declared: Vec<String>,
    pub(super) base: Model,
}

impl Extension {
    /// The user's text with the new lines in their place; everything else is as it was, to the byte.
    pub fn text(&self) -> &str {
        self.source.text()
    }

    /// The text under the name of the model's file.
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// The new parameters, in the order of the effect.
    pub fn params(&self) -> &[NewParam] {
        &self.params
    }

    /// The tree of the text with all new declarations behind the old ones, so that parameters and states of the base model
    /// keep their numbers.
    ///
    /// # Errors
    /// Mistakes of the new text, which the effect made.
    pub fn tree(&self) -> Result<SyntaxTree, Vec<Diagnostic>> {
        let mut tree = parse(&self.source)?;
        let new = |kind: &StatementKind| match kind {
            StatementKind::Declare(_, list) => list.iter().all(|d| self.declared.contains(&d.name.text)),
            _ => false,
        };
        tree.statements.sort_by_key(|s| new(&s.kind));
        Ok(tree)
    }

    /// Compiles the tree: the model for screening.
    ///
    /// # Errors
    /// Why the effect does not fit this model, with places in [`Extension::source`].
    pub fn compile(&self) -> Result<Compiled, Vec<Diagnostic>> {
        compile_tree(&self.source, self.tree()?, Vec::new())
    }

    /// The checked model of the tree without programs, for those who choose what is differentiated.
    ///
    /// # Errors
    /// As [`Extension::compile`].
    pub fn model(&self) -> Result<Model, Vec<Diagnostic>> {
        let (loose, _) = examine_tree(&self.source, self.tree()?, Vec::new())?;
        Ok(loose.tied(&[]))
    }

    /// How the effect vanishes at its null values: the extended model compared with the base model, at random points.
    pub fn null(&self, extended: &Model) -> Null {
        null::judge(&self.base, extended, &self.params)
    }
}
