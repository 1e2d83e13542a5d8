//! Text to tokens: what the outline, the messages, the formatter and editors need to know before and beside the grammar.
//! Spaces vanish here and comments stand apart; the grammar reads the same text again with its own, equal lexis.
//!
//! The words that the language uses itself: one table for the scanner, the checker and the hints.

use super::parse::{continues_name, starts_name};
use crate::source::Span;

/// The kind of a token.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A word that users may declare.
    Name,
    /// A word of the grammar.
    Keyword,
    /// A number.
    Number,
    /// A string with its quotes.
    Text,
    /// `[unit]` with its brackets.
    Unit,
    /// An opening bracket.
    Open,
    /// A closing bracket.
    Close,
    /// `;`
    Semicolon,
    /// Any other sign, also those that only other languages have (`:=`, `&&`, `**`).
    Sign,
    /// A word that begins like a number: `2x`, `1e`, `1.2.3`.
    Malformed,
    /// Characters that the language does not use.
    Junk,
    /// A string that is not closed on its line.
    OpenText,
    /// A `/*` that is not closed.
    OpenComment,
}

/// A token and its place.
#[derive(Debug, Clone, Copy)]
pub struct Token {
    /// What it is.
    pub kind: Kind,
    /// Whether nothing but spaces and comments stands before it on its line.
    pub first_on_line: bool,
    /// Where it stands.
    pub span: Span,
}

impl Token {
    /// The token as written.
    pub fn text<'a>(&self, source: &'a str) -> &'a str {
        &source[self.span.range()]
    }
}

/// Signs of more than one character; those of other languages stand here to be recognised in one piece.
const LONG_SIGNS: [&str; 21] = [
    "<->", "<=", ">=", "==", "!=", ":=", "**", "&&", "||", "~=", "<>", "=<", "=>", "+=", "-=", "*=", "/=", "->", ".*",
    "./", ".^",
];

/// All tokens of a text, or the span of the token that is one too many.
pub(super) fn scan(text: &str, limit: usize) -> Result<Vec<Token>, Span> {
    Ok(scan_with_comments(text, limit)?.0)
}

/// All tokens of a text and, apart from them, the places of its comments; both in the order of the text. Whatever stands
/// there has tokens: a string or comment that is not closed, too, and characters that the language does not use.
pub fn tokens(text: &str) -> (Vec<Token>, Vec<Span>) {
    scan_with_comments(text, usize::MAX).unwrap_or_default()
}

/// Whether a text holds effects and no model: it begins with the word.
pub fn holds_effects(text: &str) -> bool {
    let mut rest = text.trim_start_matches('\u{feff}').trim_start();
    loop {
        let end = if rest.starts_with("//") {
            rest.find('\n')
        } else if rest.starts_with("/*") {
            rest.find("*/").map(|at| at + 2)
        } else {
            return rest.strip_prefix("effect").is_some_and(|r| !r.starts_with(continues_name));
        };
        rest = end.map_or("", |end| rest[end..].trim_start());
    }
}

fn scan_with_comments(text: &str, limit: usize) -> Result<(Vec<Token>, Vec<Span>), Span> {
    let mut scanner = Scanner { text, at: 0, tokens: Vec::new() };
    let mut comments = Vec::new();
    // Editors on Windows put a byte order mark before the text.
    scanner.at = if text.starts_with('\u{feff}') { '\u{feff}'.len_utf8() } else { 0 };
    let mut first_on_line = true;
    while let Some(c) = scanner.peek() {
        if c.is_whitespace() {
            first_on_line |= is_line_end(c);
            scanner.at += c.len_utf8();
        } else if scanner.rest().starts_with("//") {
            let start = scanner.at;
            scanner.skip(|c| !is_line_end(c));
            comments.push(Span::new(start, scanner.at));
        } else {
            let start = scanner.at;
            if let Some(kind) = scanner.token(c) {
                let span = Span::new(start, scanner.at);
                if scanner.tokens.len() == limit {
                    return Err(span);
                }
                scanner.tokens.push(Token { kind, first_on_line, span });
                first_on_line = false;
            } else {
                comments.push(Span::new(start, scanner.at));
                first_on_line |= text[start..scanner.at].contains(is_line_end);
            }
        }
    }
    Ok((scanner.tokens, comments))
}

struct Scanner<'a> {
    text: &'a str,
    at: usize,
    tokens: Vec<Token>,
}

impl<'a> Scanner<'a> {
    fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    fn peek(&self) -> Option<char> {
        self.rest().chars().next()
    }

    fn skip(&mut self, belongs: impl Fn(char) -> bool) {
        let rest = self.rest();
        self.at += rest.find(|c| !belongs(c)).unwrap_or(rest.len());
    }

    /// Moves behind the token that begins with `c`; `None` for a comment.
    fn token(&mut self, c: char) -> Option<Kind> {
        let start = self.at;
        if starts_name(c) {
            self.skip(continues_name);
            // parts of submodels: `act.y`
            while self.rest().strip_prefix('.').is_some_and(|part| part.starts_with(starts_name)) {
                self.at += 1;
                self.skip(continues_name);
            }
            return Some(if is_keyword(&self.text[start..self.at]) { Kind::Keyword } else { Kind::Name });
        }
        let next = self.rest()[c.len_utf8()..].chars().next();
        if c.is_ascii_digit() || c == '.' && next.is_some_and(|n| n.is_ascii_digit()) {
            return Some(self.number());
        }
        if c == '"' {
            return Some(self.string());
        }
        if self.rest().starts_with("/*") {
            return self.comment();
        }
        Some(self.sign(c))
    }

    fn number(&mut self) -> Kind {
        self.skip(|c| c.is_ascii_digit());
        if self.peek() == Some('.') {
            self.at += 1;
            self.skip(|c| c.is_ascii_digit());
        }
        let rest = self.rest();
        if let Some(exponent) = rest.strip_prefix(['e', 'E']) {
            let digits = exponent.strip_prefix(['+', '-']).unwrap_or(exponent);
            if digits.starts_with(|c: char| c.is_ascii_digit()) {
                self.at += rest.len() - digits.len();
                self.skip(|c| c.is_ascii_digit());
            }
        }
        let end = self.at;
        self.skip(|c| continues_name(c) || c == '.');
        // `2.*x` is 2 times x, and MATLAB's `2.^x` 2 to the x: only words that run on are malformed.
        if self.at == end { Kind::Number } else { Kind::Malformed }
    }

    fn string(&mut self) -> Kind {
        self.at += 1;
        let start = self.at;
        self.skip(|c| c != '"' && !is_line_end(c));
        if self.peek() == Some('"') {
            self.at += 1;
            return Kind::Text;
        }
        self.at = start + self.text[start..self.at].trim_end().len();
        Kind::OpenText
    }

    fn comment(&mut self) -> Option<Kind> {
        match self.rest()[2..].find("*/") {
            Some(length) => {
                self.at += length + 4;
                None
            }
            None => {
                self.at = self.text.len();
                Some(Kind::OpenComment)
            }
        }
    }

    fn sign(&mut self, c: char) -> Kind {
        if c == '['
            && let Some(length) = self.unit()
        {
            self.at += length;
            return Kind::Unit;
        }
        let long = LONG_SIGNS.iter().find(|s| self.rest().starts_with(**s));
        if c.is_ascii() {
            self.at += long.map_or(1, |s| s.len());
        }
        match c {
            '(' | '[' | '{' => Kind::Open,
            ')' | ']' | '}' => Kind::Close,
            ';' => Kind::Semicolon,
            '+' | '-' | '*' | '/' | '^' | '<' | '>' | '=' | '!' | '&' | '|' | ',' | '.' | ':' | '~' | '\'' => {
                Kind::Sign
            }
            _ => {
                self.skip(is_junk);
                Kind::Junk
            }
        }
    }

    /// Length of the `[unit]` or `[index]` here; brackets behind `in` hold bounds, behind signs and brackets vectors,
    /// and a unit ends on its line.
    fn unit(&self) -> Option<usize> {
        let previous = self.tokens.last()?;
        match previous.kind {
            Kind::Keyword
                if matches!(previous.text(self.text), "in" | "if" | "then" | "else" | "and" | "or" | "not") =>
            {
                return None;
            }
            Kind::Sign | Kind::Open | Kind::Semicolon => return None,
            _ => {}
        }
        let inside = &self.rest()[1..];
        let end = inside.find([']', '[', '{', '}', ';', '"', '\n', '\r'])?;
        (inside.as_bytes()[end] == b']').then_some(end + 2)
    }
}

fn is_line_end(c: char) -> bool {
    matches!(c, '\n' | '\r')
}

fn is_junk(c: char) -> bool {
    !(c.is_whitespace() || starts_name(c) || c.is_ascii_digit() || "()[]{};+-*/^<>=!&|,.:~'\"".contains(c))
}

/// What a word of the language is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WordUse {
    /// Begins a statement: `model`, `time`, `prior`, `noise`, `trim`, `tie`, `table`, `use`, `reactions` and the kinds of declarations.
    Statement,
    /// Begins a statement that the language describes and this version does not compile.
    Planned,
    /// Stands behind a declared name: `in`, `fixed`, `per run`, `free`.
    Attribute,
    /// Stands in expressions: `if`, `then`, `else`, `and`, `or`, `not`.
    Expression,
    /// A value that is always there: `t`, `pi`, `inf`. Can be read, not declared.
    Value,
}

macro_rules! words {
    ($($word:literal $purpose:ident;)*) => {
        /// Every reserved word with its use.
        pub const WORDS: &[(&str, WordUse)] = &[$(($word, WordUse::$purpose),)*];

        /// The use of a reserved word; `None` for a word that users may declare.
        pub fn word_use(word: &str) -> Option<WordUse> {
            match word { $($word => Some(WordUse::$purpose),)* _ => None }
        }
    };
}

words! {
    "model"  Statement;
    "input"  Statement;
    "state"  Statement;
    "param"  Statement;
    "const"  Statement;
    "let"    Statement;
    "output" Statement;
    "time"   Statement;
    "prior"  Statement;
    "noise"  Statement;
    "trim"   Statement;
    "tie"    Statement;
    "table"  Statement;
    "use"    Statement;
    "reactions" Statement;
    "effect" Planned;
    "in"     Attribute;
    "fixed"  Attribute;
    "per"    Attribute;
    "run"    Attribute;
    "free"   Attribute;
    "if"     Expression;
    "then"   Expression;
    "else"   Expression;
    "and"    Expression;
    "or"     Expression;
    "not"    Expression;
    "t"      Value;
    "pi"     Value;
    "inf"    Value;
}

/// The reserved words with one of these uses, in the order of the table.
pub fn words_for(uses: &[WordUse]) -> impl Iterator<Item = &'static str> {
    WORDS.iter().filter(|(_, purpose)| uses.contains(purpose)).map(|(word, _)| *word)
}

/// Whether the word is part of the grammar and therefore never a name.
pub(super) fn is_keyword(word: &str) -> bool {
    !matches!(word_use(word), None | Some(WordUse::Value))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinds(text: &str) -> Vec<(Kind, &str)> {
        scan(text, usize::MAX).unwrap_or_default().iter().map(|t| (t.kind, t.text(text))).collect()
    }

    #[test]
    fn brackets_behind_in_hold_bounds_and_others_units() {
        let units: Vec<_> = kinds("a [m/s^2] in [0, 1] [in] [1").into_iter().filter(|t| t.1.contains('[')).collect();
        let vector: Vec<_> = kinds("else [1] [m]").into_iter().map(|t| t.0).collect();
        assert_eq!(vector, [Kind::Keyword, Kind::Open, Kind::Number, Kind::Close, Kind::Unit]);
        assert_eq!(units, [(Kind::Unit, "[m/s^2]"), (Kind::Open, "["), (Kind::Unit, "[in]"), (Kind::Open, "[")]);
    }

    #[test]
    fn numbers_are_told_from_words_that_begin_like_them() {
        use Kind::{Malformed, Name, Number, Sign};
        assert_eq!(kinds("2.*.5"), [(Number, "2."), (Sign, "*"), (Number, ".5")]);
        assert_eq!(kinds("1e-3-1e x"), [(Number, "1e-3"), (Sign, "-"), (Malformed, "1e"), (Name, "x")]);
        assert_eq!(kinds("2x 1.2.3 1_0"), [(Malformed, "2x"), (Malformed, "1.2.3"), (Malformed, "1_0")]);
    }

    #[test]
    fn the_first_token_beyond_the_limit_is_given() {
        assert_eq!(scan("a b /* c */ d", 2).err(), Some(Span::new(12, 13)));
        assert!(scan("a b // c", 2).is_ok());
    }
}
