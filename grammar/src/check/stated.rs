//! What a statement beside the equations says of a name: as written, before anything is known of its expression.

use super::scope::{Scope, SymbolId};
use crate::source::Span;
use crate::syntax::{ExprRef, Role};

/// What a number says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// The mean of a prior.
    Mean,
    /// The standard deviation of a prior.
    Deviation,
    /// The standard deviation of an output's noise.
    Noise,
    /// The intensity of the noise in a state's equation.
    Intensity,
    /// The value of a state or an input at the trim.
    Trim,
    /// The least value of a state.
    Lower,
    /// The greatest value of a state.
    Upper,
    /// The width over which a state's rate fades out before its limits.
    Width,
    /// The condition of an event, by its number; about the first state that it sets.
    Condition(usize),
    /// The value of a state behind an event.
    Reset(usize),
}

impl Part {
    /// Whether it says how far a state may go.
    pub(super) fn is_limit(self) -> bool {
        matches!(self, Self::Lower | Self::Upper | Self::Width)
    }

    /// Whether it belongs to an event.
    pub(super) fn is_of_event(self) -> bool {
        matches!(self, Self::Condition(_) | Self::Reset(_))
    }
}

/// What is known about a param, the initial value of a state, an output, or the trim.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    pub(super) part: Part,
    /// About what: a param, a state (its initial value), an output; a state or an input at the trim.
    pub(super) symbol: SymbolId,
    /// Where that stands.
    pub(super) subject: Span,
    pub(super) root: ExprRef,
}

impl Known {
    /// In messages: "the mean of the prior of `a`".
    pub(super) fn words(&self, scope: &Scope<'_>) -> String {
        let symbol = &scope.symbols[self.symbol];
        let initial = symbol.role == Role::State && matches!(self.part, Part::Mean | Part::Deviation);
        let name = if initial { format!("{}(0)", symbol.name()) } else { symbol.name().into() };
        match self.part {
            Part::Mean => format!("the mean of the prior of `{name}`"),
            Part::Deviation => format!("the deviation of the prior of `{name}`"),
            Part::Noise => format!("the noise of `{name}`"),
            Part::Intensity => format!("the noise of `der({name})`"),
            Part::Trim => format!("the trim of `{name}`"),
            Part::Lower => format!("the lower limit of `{name}`"),
            Part::Upper => format!("the upper limit of `{name}`"),
            Part::Width => format!("the width of the limits of `{name}`"),
            Part::Condition(_) => format!("the condition of the event that sets `{name}`"),
            Part::Reset(_) => format!("the value of `{name}` behind the event"),
        }
    }
}

/// A tie of the text.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bond {
    /// The param that follows.
    pub(super) symbol: SymbolId,
    /// Where its name stands.
    pub(super) subject: Span,
    /// What it follows.
    pub(super) root: ExprRef,
}
