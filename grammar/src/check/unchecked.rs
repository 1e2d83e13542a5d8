//! Equations and outputs whose units cannot be checked: told once for each name that lacks a unit.

use super::measures::Measure;
use super::scope::{Scope, SymbolId};
use crate::diagnostic::{Code, Diagnostic};
use crate::source::Span;

/// Which names of one block have units and which have not.
#[derive(Default)]
pub(super) struct Survey {
    /// Whether any has.
    pub(super) known: bool,
    /// Names without, each where it occurs first.
    unknown: Vec<(Span, SymbolId)>,
}

impl Survey {
    /// What another part of the same statement shows.
    pub(super) fn join(&mut self, other: Survey) {
        self.known |= other.known;
        self.unknown.extend(other.unknown);
    }
}

/// What cannot be checked because of one name.
#[derive(Clone)]
struct Unchecked {
    first: String,
    place: Span,
    more: usize,
}

/// What cannot be checked, by the names that are to blame.
pub(super) struct Ledger {
    entries: Vec<Option<Unchecked>>,
    /// By symbol: the survey that has seen it last.
    seen: Vec<usize>,
    surveys: usize,
}

impl Ledger {
    /// Nothing yet.
    pub(super) fn new(scope: &Scope<'_>) -> Self {
        Self { entries: vec![None; scope.symbols.len()], seen: vec![0; scope.symbols.len()], surveys: 0 }
    }

    /// Begins to look at another block.
    pub(super) fn survey(&mut self) -> Survey {
        self.surveys += 1;
        Survey::default()
    }

    /// A name in the block, with what is known of its unit.
    pub(super) fn see(&mut self, survey: &mut Survey, place: Span, measure: Measure) {
        match measure {
            Measure::Known(_) => survey.known = true,
            Measure::Unknown(s) if self.seen[s] != self.surveys => {
                self.seen[s] = self.surveys;
                survey.unknown.push((place, s));
            }
            _ => {}
        }
    }

    /// The block is an equation or an output; it cannot be checked when only some of its names have units.
    pub(super) fn enter(&mut self, survey: Survey, what: impl Fn() -> String) {
        for (place, s) in survey.unknown.into_iter().filter(|_| survey.known) {
            match &mut self.entries[s] {
                Some(entry) => entry.more += 1,
                none => *none = Some(Unchecked { first: what(), place, more: 0 }),
            }
        }
    }

    /// One warning for each name.
    pub(super) fn tell(self, scope: &Scope<'_>, findings: &mut Vec<Diagnostic>) {
        for (s, entry) in self.entries.into_iter().enumerate() {
            let Some(Unchecked { first, place, more }) = entry else { continue };
            let name = &scope.symbols[s].declaration.name;
            let others = match more {
                0 => String::new(),
                1 => " and of one more equation".into(),
                n => format!(" and of {n} more equations"),
            };
            let message = format!("`{}` has no unit: the units of {first}{others} cannot be checked", name.text);
            let finding = Diagnostic::new(Code::UnitUnknown, name.span, message).label(place, "this is not checked");
            findings.push(finding.hint("declare one, such as `[m/s]`, or `[1]` for a pure number"));
        }
    }
}
