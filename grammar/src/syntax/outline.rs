//! Where the header and the statements of a text begin and end, found from tokens alone, so that a mistake in one
//! statement leaves all others readable.

use super::scan::{Kind, Token};
use super::scan::{WordUse, word_use};
use std::ops::Range;

/// Levels of brackets, calls and `if`s inside each other.
pub(super) const NESTING_LIMIT: usize = 256;

/// What is wrong with the brackets of a statement; numbers are indices of tokens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fault {
    /// A bracket that its statement does not close.
    Unclosed(usize),
    /// A bracket closed by one of another kind.
    Mismatch(usize, usize),
    /// The bracket or `if` that exceeds [`NESTING_LIMIT`].
    TooDeep(usize),
}

/// The tokens of one statement or of the header, without the semicolon.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Extent {
    pub(super) tokens: Range<usize>,
    /// Ended by `;` (the header: by `{`), not by what follows.
    pub(super) closed: bool,
    pub(super) fault: Option<Fault>,
}

/// The parts of a text.
#[derive(Debug, Default)]
pub(super) struct Outline {
    /// Tokens before the header, which should not be there.
    pub(super) before: Range<usize>,
    /// From `model` to `{`.
    pub(super) header: Option<Extent>,
    /// What stands between the braces, in order; also what stands behind them, when that is no second model.
    pub(super) statements: Vec<Extent>,
    /// The brace that closes the model, when it is there.
    pub(super) end: Option<usize>,
    /// The first token behind the closing brace.
    pub(super) surplus: Option<usize>,
    /// The deepest nesting of any statement, at most one above [`NESTING_LIMIT`].
    pub(super) deepest: usize,
    /// The word `model` where a second model begins; nothing behind it is looked at.
    pub(super) second: Option<usize>,
}

impl Outline {
    /// Finds the parts.
    pub(super) fn new(text: &str, tokens: &[Token]) -> Self {
        let cutter = Cutter { text, tokens, braces: pairs_of_braces(text, tokens) };
        let mut outline = Self::default();
        let mut at = cutter.header(&mut outline);
        while at < tokens.len() {
            if cutter.is(at, "model") {
                outline.second = Some(at);
                break;
            }
            if cutter.is(at, ";") {
                at += 1;
                continue;
            }
            if outline.end.is_some() && outline.surplus.is_none() {
                outline.surplus = Some(at);
            }
            if cutter.is(at, "}") {
                outline.end.get_or_insert(at);
                at += 1;
            } else {
                let (extent, deepest, next) = cutter.statement(at);
                outline.deepest = outline.deepest.max(deepest);
                outline.statements.push(extent);
                at = next;
            }
        }
        outline
    }
}

/// Index pairs of braces that belong together, by the opening one.
fn pairs_of_braces(text: &str, tokens: &[Token]) -> Vec<(usize, usize)> {
    let (mut open, mut pairs) = (Vec::new(), Vec::new());
    for (k, token) in tokens.iter().enumerate() {
        match (token.kind, token.text(text)) {
            (Kind::Open, "{") => open.push(k),
            (Kind::Close, "}") => pairs.extend(open.pop().map(|o| (o, k))),
            _ => {}
        }
    }
    pairs.sort_unstable();
    pairs
}

struct Cutter<'a> {
    text: &'a str,
    tokens: &'a [Token],
    braces: Vec<(usize, usize)>,
}

impl Cutter<'_> {
    fn is(&self, at: usize, word: &str) -> bool {
        self.tokens.get(at).is_some_and(|t| t.text(self.text) == word)
    }

    fn word_use(&self, at: usize) -> Option<WordUse> {
        // names elsewhere: they begin a statement where another name follows
        if ["known", "smooth", "limit", "requirement"].iter().any(|word| self.is(at, word))
            && self.tokens.get(at + 1).is_some_and(|t| t.kind == Kind::Name)
        {
            return Some(WordUse::Statement);
        }
        // so is this one, behind which a condition stands
        let condition = |t: &Token| matches!(t.kind, Kind::Name | Kind::Number) || t.text(self.text) == "not";
        if self.is(at, "when") && self.tokens.get(at + 1).is_some_and(condition) {
            return Some(WordUse::Statement);
        }
        let token = self.tokens.get(at).filter(|t| t.kind == Kind::Keyword)?;
        word_use(token.text(self.text))
    }

    /// Finds the header and returns the index of the first token behind it.
    fn header(&self, outline: &mut Outline) -> usize {
        let first = |k: &usize| self.tokens[*k].first_on_line && self.is(*k, "model");
        let start = if self.looks_like_header(0) { 0 } else { (0..self.tokens.len()).find(first).unwrap_or(0) };
        if start == 0 && !self.is(0, "model") && !self.looks_like_header(0) {
            return 0;
        }
        let mut end = start + 1;
        while end < self.tokens.len() && !self.ends_header(end) {
            end += 1;
        }
        let closed = self.is(end, "{");
        outline.before = 0..start;
        outline.header = Some(Extent { tokens: start..end, closed, fault: None });
        end + usize::from(closed)
    }

    /// `modle name "doc" {`: the brace comes before any statement does.
    fn looks_like_header(&self, start: usize) -> bool {
        let named = self.tokens.get(start).is_some_and(|t| t.kind == Kind::Name);
        let end = (start..self.tokens.len()).take(5).find(|k| self.ends_header(*k));
        named && end.is_some_and(|e| self.is(e, "{"))
    }

    fn ends_header(&self, at: usize) -> bool {
        matches!(self.tokens[at].kind, Kind::Semicolon)
            || matches!(self.tokens[at].text(self.text), "{" | "}" | "=")
            || self.tokens[at].first_on_line && matches!(self.word_use(at), Some(WordUse::Statement | WordUse::Planned))
    }

    /// The statement that begins at a token, its deepest nesting, and the index of the first token behind it.
    fn statement(&self, start: usize) -> (Extent, usize, usize) {
        let planned = self.word_use(start) == Some(WordUse::Planned);
        let mut nesting = Nesting { text: self.text, levels: Vec::new(), deepest: 0, fault: None };
        // a trim, reactions and events are statements that end with their own brace; a table has one, however many points it holds
        let ends_itself = ["trim", "reactions", "when"].iter().any(|word| self.is(start, word));
        let own = if self.is(start, "trim") { Some(start + 1) } else { self.own_brace(start) };
        let own = own.and_then(|open| self.partner(open));
        let inside = |at: usize| own.is_some_and(|close| at <= close);
        let mut at = start;
        let closed = loop {
            let Some(token) = self.tokens.get(at) else { break false };
            match token.kind {
                Kind::Semicolon if inside(at) => nesting.end_value(),
                Kind::Semicolon => break true,
                Kind::OpenText | Kind::OpenComment => {
                    at += 1;
                    break true;
                }
                Kind::Close if self.is(at, "}") && !inside(at) => break false,
                Kind::Open if self.is(at, "{") && !inside(at) => match self.block(at, planned) {
                    Some(end) => at = end,
                    None => nesting.enter(at, token, None),
                },
                _ if inside(at) && !self.begins_line(at) => nesting.enter(at, token, self.tokens[..at].last()),
                _ if at > start && self.begins_statement(at, &nesting) => break false,
                _ => nesting.enter(at, token, self.tokens[..at].last()),
            }
            at += 1;
            let ended = own.map_or(planned && self.is(at - 1, "}"), |close| ends_itself && at > close);
            if ended && !self.is(at, ";") {
                return (Extent { tokens: start..at, closed: true, fault: nesting.fault() }, nesting.deepest, at);
            }
        };
        let next = at + usize::from(closed && self.is(at, ";"));
        (Extent { tokens: start..at, closed, fault: nesting.fault() }, nesting.deepest, next)
    }

    /// The brace behind which the points of a table, reactions, or what an event sets stand.
    fn own_brace(&self, start: usize) -> Option<usize> {
        const LONGEST_HEAD: usize = 256;
        let head = start..self.tokens.len().min(start + LONGEST_HEAD);
        let open = head.clone().find(|k| self.is(*k, "{") || self.is(*k, ";") || self.is(*k, "}"));
        let has_one = ["table", "reactions", "when"].iter().any(|word| self.is(start, word));
        open.filter(|open| has_one && self.is(*open, "{"))
    }

    /// The brace that closes the one at a token.
    fn partner(&self, open: usize) -> Option<usize> {
        self.braces.binary_search_by_key(&open, |(o, _)| *o).ok().map(|pair| self.braces[pair].1)
    }

    /// Whether a statement that cannot stand inside another begins a line here.
    fn begins_line(&self, at: usize) -> bool {
        self.tokens[at].first_on_line && self.word_use(at) == Some(WordUse::Statement)
    }

    /// The end of a `{ ... }` inside a statement: any in planned statements, which hold statements of their own;
    /// elsewhere only short ones, since the brace may as well have lost its partner.
    fn block(&self, open: usize, planned: bool) -> Option<usize> {
        let close = self.partner(open)?;
        let short = close - open < 200 && !(open..close).any(|k| self.word_use(k) == Some(WordUse::Statement));
        (planned || short).then_some(close)
    }

    /// Whether a statement begins here although the one before is not closed by `;`.
    fn begins_statement(&self, at: usize, nesting: &Nesting) -> bool {
        let token = &self.tokens[at];
        let Some(purpose) = self.word_use(at) else { return false };
        let complete = !nesting.inside_brackets()
            && match self.tokens[at - 1].kind {
                Kind::Name | Kind::Number | Kind::Text | Kind::Unit | Kind::Close => true,
                Kind::Keyword => matches!(self.tokens[at - 1].text(self.text), "fixed" | "run" | "free"),
                _ => false,
            };
        match purpose {
            WordUse::Planned => token.first_on_line && complete,
            WordUse::Statement if self.is(at, "time") => token.first_on_line && complete,
            WordUse::Statement => token.first_on_line || complete,
            _ => false,
        }
    }
}

/// What is open at a place inside a statement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Level {
    /// Index of the opening token, and its sign.
    Bracket(usize, u8),
    Condition,
    Then,
    Else,
}

struct Nesting<'a> {
    text: &'a str,
    levels: Vec<Level>,
    deepest: usize,
    fault: Option<Fault>,
}

impl Nesting<'_> {
    fn enter(&mut self, at: usize, token: &Token, previous: Option<&Token>) {
        match (token.kind, token.text(self.text)) {
            (Kind::Open, open) => self.levels.push(Level::Bracket(at, open.as_bytes()[0])),
            (Kind::Close, close) => self.close(at, close),
            (Kind::Sign, ",") => self.leave(&[Level::Condition, Level::Then, Level::Else]),
            (Kind::Keyword, "if") => {
                let chained = previous.is_some_and(|p| p.kind == Kind::Keyword && p.text(self.text) == "else");
                // `else if` goes on at the level of the `if` before it.
                if chained && self.levels.last() == Some(&Level::Else) {
                    self.levels.pop();
                }
                self.levels.push(Level::Condition);
            }
            (Kind::Keyword, "then") => self.turn(&[Level::Then, Level::Else], Level::Condition, Level::Then),
            (Kind::Keyword, "else") => self.turn(&[Level::Else, Level::Condition], Level::Then, Level::Else),
            _ => {}
        }
        self.deepest = self.deepest.max(self.levels.len());
        if self.levels.len() > NESTING_LIMIT {
            self.fault.get_or_insert(Fault::TooDeep(at));
            // Nothing more is to be learnt from this statement; forget the levels to keep memory flat.
            self.levels.clear();
        }
    }

    /// A value among several ends: its choices do.
    fn end_value(&mut self) {
        self.leave(&[Level::Condition, Level::Then, Level::Else]);
    }

    fn leave(&mut self, over: &[Level]) {
        while self.levels.last().is_some_and(|l| over.contains(l)) {
            self.levels.pop();
        }
    }

    fn turn(&mut self, over: &[Level], from: Level, to: Level) {
        self.leave(over);
        if let Some(last) = self.levels.last_mut().filter(|l| **l == from) {
            *last = to;
        }
    }

    fn close(&mut self, at: usize, close: &str) {
        self.leave(&[Level::Condition, Level::Then, Level::Else]);
        // A closing bracket without partner is left to the grammar, which knows what should stand there.
        if let Some(Level::Bracket(opened_at, open)) = self.levels.pop()
            && !matches!((open, close), (b'(', ")") | (b'[', "]") | (b'{', "}"))
        {
            self.fault.get_or_insert(Fault::Mismatch(opened_at, at));
        }
    }

    fn inside_brackets(&self) -> bool {
        self.levels.iter().any(|l| matches!(l, Level::Bracket(..)))
    }

    /// What is wrong at the end of the statement.
    fn fault(&self) -> Option<Fault> {
        let open = self.levels.iter().rev().find_map(|l| match l {
            Level::Bracket(at, _) => Some(Fault::Unclosed(*at)),
            _ => None,
        });
        self.fault.or(open)
    }
}
