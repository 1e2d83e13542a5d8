//! Effects exactly as written: what they attach to, when they do not, and the lines of their rewrite. No meaning yet.

use super::tree::{Declaration, ExprRef, Name, Role, SyntaxTree};
use crate::source::Span;

/// What an effect can be attached to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SlotKind {
    /// An input.
    Input,
    /// A state; as `der(x)`, its equation.
    State,
    /// An output.
    Output,
    /// A declared parameter.
    Param,
}

impl SlotKind {
    /// Every kind.
    pub const ALL: [SlotKind; 4] = [Self::Input, Self::State, Self::Output, Self::Param];

    /// The word for it, which is that of the declaration.
    pub fn word(self) -> &'static str {
        match self {
            Self::Input => "input",
            Self::State => "state",
            Self::Output => "output",
            Self::Param => "param",
        }
    }
}

/// How an effect explains what it explains, in the order in which explanations are believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum Class {
    /// A law of physics: friction, a missing coupling, a limit.
    #[default]
    Mechanism,
    /// What stands between the vehicle and the record: zeros, lags and scales of sensors.
    Sensor,
    /// Something flexible that can take the place of many causes: a mode, a lag in a coupling, a parameter that changes.
    StandIn,
}

impl Class {
    /// Every class.
    pub const ALL: [Class; 3] = [Self::Mechanism, Self::Sensor, Self::StandIn];

    /// The word for it, behind `as`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Mechanism => "mechanism",
            Self::Sensor => "sensor",
            Self::StandIn => "stand_in",
        }
    }
}

/// A field of work whose effects a search may be restricted to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Field {
    /// Aeroplanes.
    Aircraft,
    /// Helicopters and multicopters.
    Rotorcraft,
    /// Ships and boats.
    Ship,
    /// Machines, drives, robots.
    Mechanism,
    /// Tanks, heat, flows.
    Process,
    /// Chemical reactions.
    Kinetics,
}

impl Field {
    /// Every field.
    pub const ALL: [Field; 6] =
        [Self::Aircraft, Self::Rotorcraft, Self::Ship, Self::Mechanism, Self::Process, Self::Kinetics];

    /// The word for it, behind `for`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Aircraft => "aircraft",
            Self::Rotorcraft => "rotorcraft",
            Self::Ship => "ship",
            Self::Mechanism => "mechanism",
            Self::Process => "process",
            Self::Kinetics => "kinetics",
        }
    }
}

/// `x: state | input`: a name that stands for one of the user's.
#[derive(Debug, Clone, PartialEq)]
pub struct Slot {
    /// The name in the effect.
    pub name: Name,
    /// What it can stand for, in the order of the text.
    pub kinds: Vec<SlotKind>,
}

/// `unless depends(der(x), z)`, `when x < z`
#[derive(Debug, Clone, PartialEq)]
pub struct Condition {
    /// `unless` (a place is left out where the test holds) or `when` (where it does not).
    pub unless: bool,
    /// The test.
    pub test: ExprRef,
}

/// `param c = 0 [unit] in [lower, upper] try a, b "doc"`, or `nuisance`.
#[derive(Debug, Clone, PartialEq)]
pub struct Tunable {
    /// A value that the data cannot see at the null: tried on a grid.
    pub nuisance: bool,
    /// Name, null value, unit, bounds, doc, `fixed`, `per run`.
    pub declaration: Declaration,
    /// Values that a search tries, behind `try`.
    pub trials: Vec<ExprRef>,
    /// `positive`: physics has it at its null or above.
    pub positive: bool,
}

/// Where something is added: `der(x)` or `y`.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// The equation of a state.
    pub derivative: bool,
    /// The name of a slot.
    pub name: Name,
}

/// One line of an effect.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "a catalogue has tens of lines")]
pub enum EffectLine {
    /// `param`, `nuisance`
    Tunable(Tunable),
    /// `state`, `let` or `const` of the effect's own
    Own(Role, Vec<Declaration>),
    /// `der(m) = right;` of a state of its own: left and right
    Equation(ExprRef, ExprRef),
    /// `add der(x) += term;`
    Add(Place, ExprRef),
    /// `replace i with expression;`
    Replace(Name, ExprRef),
    /// `noise der(x) = intensity;`
    Noise(Place, ExprRef),
}

/// An effect as written.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectTree {
    /// Its name.
    pub name: Name,
    /// What it attaches to.
    pub slots: Vec<Slot>,
    /// Where it does not fit.
    pub conditions: Vec<Condition>,
    /// What kind of explanation it is; a mechanism where nothing is said.
    pub class: Class,
    /// The fields in which it is at home; everywhere where nothing is said.
    pub fields: Vec<Field>,
    /// What it is, with `{i}` for the name that the slot `i` stands for.
    pub doc: Option<Name>,
    /// The lines between the braces, each with its place.
    pub lines: Vec<(EffectLine, Span)>,
    /// The expressions of this effect, in a tree without statements.
    pub pool: SyntaxTree,
    /// From the word `effect` to the closing brace.
    pub span: Span,
}
