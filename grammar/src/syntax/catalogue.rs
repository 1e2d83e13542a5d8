//! A text of effects to their trees: what is wrong with one of them does not hide the others.
//!
//! Effects exactly as written: what they attach to, when they do not, and the lines of their rewrite. No meaning yet.

use super::expression::Builder;
use super::outline::{Extent, Fault};
use super::parse::{EffectHeader, Refusal, effect_header, effect_statement};
use super::scan::{Kind, Token, scan};
use super::slips::Slips;
use super::tree::{Declaration, ExprRef, Name, Role, SyntaxTree};
use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::source::{Source, Span};
use std::ops::Range;

/// Longest text of effects in bytes.
const TEXT_LIMIT: usize = 1 << 20;
/// Most words, numbers and signs in a text of effects.
const TOKEN_LIMIT: usize = 200_000;
/// Most effects in one text.
const EFFECT_LIMIT: usize = 1000;
/// Words with which a line of an effect begins.
const LINE_WORDS: [&str; 9] = ["param", "nuisance", "state", "let", "const", "add", "replace", "noise", "der"];

/// Every effect that could be read, and what is wrong with the others, in the order of the text.
pub fn parse_effects(source: &Source) -> (Vec<EffectTree>, Vec<Diagnostic>) {
    let text = source.text();
    let too_large = |span, message: String| (Vec::new(), vec![Diagnostic::new(Code::TooLarge, span, message)]);
    if text.len() > TEXT_LIMIT {
        return too_large(Span::default(), format!("the text has {} bytes; the limit is {TEXT_LIMIT}", text.len()));
    }
    let tokens = match scan(text, TOKEN_LIMIT) {
        Ok(tokens) => tokens,
        Err(span) => return too_large(span, format!("the text has more than {TOKEN_LIMIT} words, numbers and signs")),
    };
    let mut reader = Reader { text, tokens: &tokens, slips: Slips::new(text, &tokens) };
    let effects = reader.effects();
    (effects, reader.slips.finish())
}

struct Reader<'a> {
    text: &'a str,
    tokens: &'a [Token],
    slips: Slips<'a>,
}

impl<'a> Reader<'a> {
    fn is(&self, at: usize, word: &str) -> bool {
        self.tokens.get(at).is_some_and(|t| t.text(self.text) == word)
    }

    /// `effect` is a word of the language and begins one wherever it stands.
    fn effects(&mut self) -> Vec<EffectTree> {
        let mut starts: Vec<usize> = (0..self.tokens.len()).filter(|k| self.is(*k, "effect")).collect();
        if starts.first() != Some(&0) {
            let span = self.tokens.first().map_or(Span::default(), |t| t.span);
            let message = match self.tokens.first() {
                None => "the text holds no effect".to_string(),
                Some(first) if first.text(self.text) == "model" => "this is a model, not a text of effects".into(),
                Some(first) => {
                    format!(
                        "expected `effect NAME(x: state) {{`, found `{}`",
                        super::expected::shown(first.text(self.text))
                    )
                }
            };
            let found = Diagnostic::new(Code::Unexpected, span, message);
            self.slips.report([found.hint("an effect is written `effect NAME(x: state) \"doc\" { ... }`")]);
        }
        if let Some(surplus) = starts.get(EFFECT_LIMIT).copied() {
            let message = format!("this is effect {}; the limit is {EFFECT_LIMIT}", EFFECT_LIMIT + 1);
            self.slips.report([Diagnostic::new(Code::TooLarge, self.tokens[surplus].span, message)]);
            starts.truncate(EFFECT_LIMIT + 1);
        } else {
            starts.push(self.tokens.len());
        }
        starts.windows(2).filter_map(|pair| self.effect(pair[0]..pair[1])).collect()
    }

    /// The tokens from one `effect` to the next.
    fn effect(&mut self, tokens: Range<usize>) -> Option<EffectTree> {
        let open = tokens.clone().find(|k| self.is(*k, "{"));
        let header = tokens.start..open.unwrap_or(tokens.end);
        let mut builder = Builder::default();
        let fault = self.fault(&header);
        let extent = Extent { tokens: header, closed: open.is_some(), fault };
        let flawed = self.slips.flawed(&extent);
        let header = if flawed { None } else { self.header(&extent, &mut builder) };
        let open = open?;
        let (lines, close, sound) = self.lines(open + 1..tokens.end, &mut builder);
        let end = self.end(open, close, &tokens);
        let EffectHeader { name, slots, conditions, class, fields, doc } = header?;
        let pool = SyntaxTree {
            name: Name { text: String::new(), span: name.span },
            doc: None,
            statements: Vec::new(),
            expressions: builder.expressions,
            suspended: Vec::new(),
        };
        let span = self.tokens[tokens.start].span.to(self.tokens[end].span);
        sound.then_some(EffectTree { name, slots, conditions, class, fields, doc, lines, pool, span })
    }

    fn header(&mut self, extent: &Extent, builder: &mut Builder) -> Option<EffectHeader> {
        let (text, start) = self.passage(&(extent.tokens.start..extent.tokens.end + usize::from(extent.closed)));
        match effect_header(text, start, builder) {
            Ok((header, findings)) => {
                self.slips.report(findings);
                header
            }
            Err(refusal) => {
                self.slips.refused(extent, &refusal);
                None
            }
        }
    }

    /// Reads the statements behind the brace; the closing brace, and whether all could be read.
    fn lines(&mut self, tokens: Range<usize>, builder: &mut Builder) -> (Vec<(EffectLine, Span)>, Option<usize>, bool) {
        let (mut lines, mut sound) = (Vec::new(), true);
        let mut start = tokens.start;
        for at in tokens {
            let (semicolon, close) = (self.is(at, ";"), self.is(at, "}"));
            if !semicolon && !close {
                continue;
            }
            if start < at {
                sound &= self.line(start..at, semicolon, builder, &mut lines);
            }
            if close {
                return (lines, Some(at), sound);
            }
            start = at + 1;
        }
        if start < self.tokens.len() {
            sound &= self.line(start..self.tokens.len().min(start + 200), false, builder, &mut Vec::new());
        }
        (lines, None, sound)
    }

    fn line(
        &mut self,
        tokens: Range<usize>,
        closed: bool,
        builder: &mut Builder,
        lines: &mut Vec<(EffectLine, Span)>,
    ) -> bool {
        let fault = self.fault(&tokens);
        let extent = Extent { tokens: tokens.clone(), closed, fault };
        if self.slips.flaws(&extent) {
            return false;
        }
        let (text, start) = self.passage(&tokens);
        match effect_statement(text, start, builder) {
            Ok((line, findings)) => {
                self.slips.report(findings);
                if !closed {
                    self.slips.semicolon(&tokens);
                }
                let span = Span::new(start, start + text.len());
                let sound = closed && line.is_some();
                lines.extend(line.map(|l| (l, span)));
                sound
            }
            Err(refusal) => {
                self.refused(&extent, &refusal);
                false
            }
        }
    }

    fn refused(&mut self, extent: &Extent, refusal: &Refusal) {
        let first = &self.tokens[extent.tokens.start];
        let word = first.text(self.text);
        let known = LINE_WORDS.contains(&word);
        if known || !matches!(first.kind, Kind::Name | Kind::Keyword) {
            return self.slips.refused(extent, refusal);
        }
        let (message, hint) = match (word, nearest(word, LINE_WORDS)) {
            ("input" | "output" | "table" | "tie" | "prior" | "trim" | "use" | "time", _) => {
                (format!("`{word}` cannot stand in an effect"), line_forms())
            }
            (_, Some(near)) => (format!("`{word}` begins no line of an effect"), format!("did you mean `{near}`?")),
            _ => (format!("`{word}` begins no line of an effect"), line_forms()),
        };
        self.slips.report([Diagnostic::new(Code::Unexpected, first.span, message).hint(hint)]);
    }

    /// Tells what is wrong with the end of an effect; its last token.
    fn end(&mut self, open: usize, close: Option<usize>, tokens: &Range<usize>) -> usize {
        let Some(close) = close else {
            let found = Diagnostic::new(Code::Unterminated, self.tokens[open].span, "this brace is not closed");
            self.slips.report([found.hint("write `}` behind the last line of the effect")]);
            return tokens.end - 1;
        };
        if close + 1 < tokens.end {
            let surplus = &self.tokens[close + 1];
            let shown = super::expected::shown(surplus.text(self.text));
            let message = format!("the effect ends before this `{shown}`");
            let found = Diagnostic::new(Code::Unexpected, surplus.span, message);
            self.slips.report([found.label(self.tokens[close].span, "the effect ends here")]);
        }
        close
    }

    /// Brackets that do not fit, and nesting beyond the limit.
    fn fault(&self, tokens: &Range<usize>) -> Option<Fault> {
        let mut open: Vec<usize> = Vec::new();
        let mut choices = 0;
        for at in tokens.clone() {
            let word = self.tokens[at].text(self.text);
            match self.tokens[at].kind {
                Kind::Open => open.push(at),
                Kind::Close => match open.pop() {
                    Some(o) if !matches!((self.tokens[o].text(self.text), word), ("(", ")") | ("[", "]")) => {
                        return Some(Fault::Mismatch(o, at));
                    }
                    _ => {}
                },
                Kind::Keyword if word == "if" => choices += 1,
                _ => {}
            }
            // brackets and `if`s inside each other
            if open.len() + choices > 32 {
                return Some(Fault::TooDeep(at));
            }
        }
        open.last().map(|o| Fault::Unclosed(*o))
    }

    /// The text of some tokens, and the byte where it begins.
    fn passage(&self, tokens: &Range<usize>) -> (&'a str, usize) {
        let start = self.tokens[tokens.start].span.start as usize;
        (&self.text[start..self.tokens[tokens.end - 1].span.end as usize], start)
    }
}

fn line_forms() -> String {
    "`param`, `nuisance`, `state`, `let`, `const`, `der(m) = ...`, `add der(x) += ...`, `replace i with ...`, \
     `noise der(x) = ...`"
        .into()
}

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
