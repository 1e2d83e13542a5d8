//! Words and comments of a text in one sequence, each with the line ends and the space that stand before it.

use crate::syntax::{Token, TokenKind, tokens};
use std::borrow::Cow;

/// What a piece is to the layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    /// A word, number, sign or bracket.
    Word(TokenKind),
    /// `// ...` to the end of its line.
    LineComment,
    /// `/* ... */`
    BlockComment,
}

/// A word or a comment.
#[derive(Debug, Clone)]
pub(super) struct Piece<'a> {
    /// As written; comments without spaces at the ends of their lines.
    pub(super) text: Cow<'a, str>,
    pub(super) shape: Shape,
    /// Line ends between this and the piece before it.
    pub(super) line_ends: usize,
    /// Spaces between this and the piece before it on the same line.
    pub(super) gap: usize,
    /// Whether a space belongs before it when it does not begin a line.
    pub(super) space: bool,
    /// `[2]` that belongs to the name before it.
    pub(super) is_index: bool,
}

impl Piece<'_> {
    pub(super) fn is_comment(&self) -> bool {
        !matches!(self.shape, Shape::Word(_))
    }

    pub(super) fn is_word(&self, kind: TokenKind) -> bool {
        self.shape == Shape::Word(kind)
    }

    /// Whether this is a sign, bracket or keyword with this text.
    pub(super) fn is(&self, text: &str) -> bool {
        self.text == text && !self.is_comment() && !self.is_word(TokenKind::Text)
    }

    /// Characters that it takes on a line.
    pub(super) fn width(&self) -> usize {
        self.text.chars().count()
    }
}

/// Everything that is written in a text, in order.
pub(super) fn pieces(text: &str) -> Vec<Piece<'_>> {
    let (words, comments) = tokens(text);
    let mut pieces: Vec<Piece<'_>> = Vec::with_capacity(words.len() + comments.len());
    let mut words = words.into_iter().peekable();
    let mut comments = comments.into_iter().peekable();
    let (mut end, mut before) = (0, Before::default());
    loop {
        let word_first = match (words.peek(), comments.peek()) {
            (Some(word), Some(comment)) => word.span < *comment,
            (word, _) => word.is_some(),
        };
        let word = if word_first { words.next() } else { None };
        let comment_next = if word_first { None } else { comments.next() };
        let Some(span) = word.map(|w| w.span).or(comment_next) else { break };
        let between = &text[end..span.start as usize];
        let written = &text[span.range()];
        let gap = between.chars().count();
        let (shape, space, is_index) = match word {
            Some(word) => {
                let touches = gap == 0 && !pieces.last().is_some_and(Piece::is_comment);
                let is_index = touches && before.is_indexed_by(&word, written);
                (Shape::Word(word.kind), before.space(&word, written) && !is_index, is_index)
            }
            None if written.starts_with("//") => (Shape::LineComment, true, false),
            None => (Shape::BlockComment, true, false),
        };
        let text = if word.is_some() { Cow::Borrowed(written) } else { comment(written) };
        // no word touches a comment
        let space = space || pieces.last().is_some_and(Piece::is_comment) && !matches!(written, ";" | ",");
        pieces.push(Piece { text, shape, line_ends: line_ends(between), gap, space, is_index });
        if let Some(word) = word {
            before = Before::new(&before, &word, written);
        }
        end = span.end as usize;
    }
    pieces
}

/// Line ends of any kind, each counted once.
fn line_ends(between: &str) -> usize {
    let bytes = between.as_bytes();
    let ends = |k: &usize| bytes[*k] == b'\n' && (*k == 0 || bytes[*k - 1] != b'\r') || bytes[*k] == b'\r';
    (0..bytes.len()).filter(ends).count()
}

/// A comment without what cannot be seen: spaces at the ends of its lines, and line ends of other systems.
fn comment(written: &str) -> Cow<'_, str> {
    if !written.contains(['\n', '\r']) {
        return Cow::Borrowed(written.trim_end());
    }
    let unified = written.replace("\r\n", "\n").replace('\r', "\n");
    let lines: Vec<&str> = unified.split('\n').map(str::trim_end).collect();
    Cow::Owned(lines.join("\n"))
}

/// What is known of the word before.
#[derive(Debug, Clone, Copy, Default)]
struct Before {
    kind: Option<TokenKind>,
    /// A name or a closing bracket: a bracket behind it is that of a call.
    callable: bool,
    /// A sign before a single operand.
    unary: bool,
    /// An operand or what ends one, so that a sign behind it stands between two.
    operand: bool,
    /// A sign that binds its operands without spaces.
    tight: bool,
}

impl Before {
    fn new(before: &Before, word: &Token, written: &str) -> Self {
        use TokenKind::{Close, Keyword, Malformed, Name, Number, Open, Sign, Text, Unit};
        let sums = matches!(written, "+" | "-");
        // words of effects, which elsewhere are names: those never follow another operand
        if before.operand && matches!(written, "try" | "with") {
            return Self { kind: Some(Keyword), ..Self::default() };
        }
        Self {
            kind: Some(word.kind),
            callable: word.kind == Name,
            unary: word.kind == Sign && sums && !before.operand,
            operand: matches!(word.kind, Name | Number | Close | Unit | Text | Malformed)
                || word.kind == Keyword && matches!(written, "free" | "run" | "fixed"),
            tight: word.kind == Open && written != "{" || word.kind == Sign && is_product(written),
        }
    }

    /// Whether brackets that directly follow the word before hold an index or a size.
    fn is_indexed_by(&self, word: &Token, written: &str) -> bool {
        let inside = |c: char| c.is_ascii_digit() || c.is_whitespace() || matches!(c, ',' | ':' | '[' | ']');
        word.kind == TokenKind::Unit && self.kind == Some(TokenKind::Name) && written.chars().all(inside)
    }

    /// Whether a space stands between the word before and this one.
    fn space(&self, word: &Token, written: &str) -> bool {
        if self.kind.is_none() || written == ";" {
            return false;
        }
        match (word.kind, written) {
            // braces hold points or statements
            (TokenKind::Open, "{") | (TokenKind::Close, "}") => true,
            (TokenKind::Close, _) | (TokenKind::Sign, "," | ":") => false,
            (TokenKind::Open, "(") if self.callable => false,
            (TokenKind::Sign, sign) if is_product(sign) => false,
            _ => !self.unary && !self.tight,
        }
    }
}

fn is_product(sign: &str) -> bool {
    matches!(sign, "*" | "/" | "^" | ".")
}
