//! Pieces to lines: statements one to a line, the user's line ends inside them, blocks moved in, single blank lines.
//!
//! Where a line that is too long is broken.
//!
//! Words and comments of a text in one sequence, each with the line ends and the space that stand before it.

use super::{STEP, WIDTH};
use crate::syntax::{Token, TokenKind, WordUse, tokens, word_use};
use std::borrow::Cow;

/// A line to be written.
#[derive(Debug, Clone)]
pub(super) enum Line<'a> {
    /// Nothing.
    Blank,
    /// A comment that has its line for itself.
    Comment { indent: usize, text: &'a str },
    /// Words of a statement.
    Words(Words<'a>),
}

/// The words of one line.
#[derive(Debug, Clone)]
pub(super) struct Words<'a> {
    pub(super) indent: usize,
    /// With the spaces before each.
    pub(super) pieces: Vec<(usize, &'a Piece<'a>)>,
    /// Comments at its end.
    pub(super) comments: Vec<&'a str>,
    /// Column of the first comment, when it is lined up.
    pub(super) comment_at: usize,
    /// Whether a statement begins here.
    pub(super) begins: bool,
    /// The keyword of the statement when the line begins with one of its items: lines of the same kind may be lined up.
    pub(super) items: Option<Items<'a>>,
}

/// What is listed in a statement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Items<'a> {
    /// `param`, `prior`, ...; empty for equations.
    pub(super) keyword: &'a str,
    /// Index of the first piece of the first item on this line.
    pub(super) from: usize,
}

impl Words<'_> {
    /// Characters without the comments.
    pub(super) fn width(&self) -> usize {
        self.indent + self.pieces.iter().map(|(spaces, p)| spaces + p.width()).sum::<usize>()
    }
}

/// Cuts a text into lines.
pub(super) fn lines<'a>(pieces: &'a [Piece<'a>]) -> Vec<Line<'a>> {
    let mut cutter = Cutter { pieces, partners: partners(pieces), lines: Vec::new(), depth: 0 };
    let mut at = 0;
    while at < pieces.len() {
        at = cutter.next(at);
    }
    cutter.lines
}

/// For every opening bracket the one that closes it.
fn partners(pieces: &[Piece<'_>]) -> Vec<Option<usize>> {
    let mut partners = vec![None; pieces.len()];
    let mut open = Vec::new();
    for (k, piece) in pieces.iter().enumerate() {
        if piece.is_word(TokenKind::Open) {
            open.push(k);
        } else if piece.is_word(TokenKind::Close)
            && let Some(opened) = open.pop()
        {
            partners[opened] = Some(k);
        }
    }
    partners
}

struct Cutter<'a> {
    pieces: &'a [Piece<'a>],
    partners: Vec<Option<usize>>,
    lines: Vec<Line<'a>>,
    depth: usize,
}

impl<'a> Cutter<'a> {
    /// Writes what begins at a piece between statements; returns the index of the first piece behind it.
    fn next(&mut self, at: usize) -> usize {
        let piece = &self.pieces[at];
        if piece.is_comment() {
            self.comment(at);
            return at + 1;
        }
        if piece.is(";")
            && let Some(Line::Words(last)) = self.lines.last_mut()
        {
            last.pieces.push((0, piece));
            return at + 1;
        }
        if piece.is("}") {
            self.depth = self.depth.saturating_sub(1);
            if matches!(self.lines.last(), Some(Line::Blank)) {
                self.lines.pop();
            }
            self.lines.push(Line::Words(self.words(self.depth * STEP, vec![(0, piece)])));
            return at + 1;
        }
        self.blank(at);
        let (end, opens) = self.statement(at);
        let lines = Statement::new(&self.pieces[at..end], self.depth * STEP).lines();
        self.lines.extend(lines);
        self.depth += usize::from(opens);
        end
    }

    fn words(&self, indent: usize, pieces: Vec<(usize, &'a Piece<'a>)>) -> Words<'a> {
        Words { indent, pieces, comments: Vec::new(), comment_at: 0, begins: true, items: None }
    }

    /// A comment outside of statements: at the end of the line before, or a line of its own.
    fn comment(&mut self, at: usize) {
        let piece = &self.pieces[at];
        if at > 0
            && piece.line_ends == 0
            && let Some(Line::Words(last)) = self.lines.last_mut()
            && !is_full(&last.comments)
        {
            last.comments.push(&piece.text);
            return;
        }
        self.blank(at);
        self.lines.push(Line::Comment { indent: self.depth * STEP, text: &piece.text });
    }

    /// Keeps one of the blank lines before a piece, but none at the edges of a block.
    fn blank(&mut self, at: usize) {
        let opened = match self.lines.last() {
            None | Some(Line::Blank) => true,
            Some(Line::Words(last)) => last.pieces.last().is_some_and(|(_, p)| p.is("{")),
            Some(Line::Comment { .. }) => false,
        };
        if self.pieces[at].line_ends > 1 && !opened {
            self.lines.push(Line::Blank);
        }
    }

    /// The index behind the statement that begins here, and whether it ends with the opening of a block.
    fn statement(&self, start: usize) -> (usize, bool) {
        let mut at = start;
        while let Some(piece) = self.pieces.get(at) {
            if piece.is(";") {
                return (at + 1, false);
            }
            if piece.is("}") && at > start {
                return (at, false);
            }
            match self.partners[at] {
                Some(close) if piece.is("{") && self.is_block(start, at, close) => {
                    if !self.is_short(start, at, close) {
                        return (at + 1, true);
                    }
                    let closed = self.pieces.get(close + 1).is_some_and(|p| p.is(";") && p.line_ends == 0);
                    return (close + 1 + usize::from(closed), false);
                }
                Some(close) => at = close + 1,
                None if piece.is("{") => return (at + 1, true),
                None => at += 1,
            }
        }
        (at, false)
    }

    /// Whether braces hold statements: a table's hold points.
    fn is_block(&self, start: usize, open: usize, close: usize) -> bool {
        let word = |w: &str| self.pieces[start].is(w);
        word("model")
            || word("trim")
            || word("reactions")
            || word("effect")
            || (open..close).any(|k| self.pieces[k].is(";"))
    }

    /// Whether a block stands on one line and may stay there.
    fn is_short(&self, start: usize, open: usize, close: usize) -> bool {
        let inside = &self.pieces[open + 1..=close];
        let flat = inside.iter().all(|p| p.line_ends == 0 && !p.is_comment() && !p.is("{"));
        let width = |p: &Piece<'_>| p.width() + usize::from(p.space);
        // the semicolon behind it counts
        let whole = self.depth * STEP + self.pieces[start..=close].iter().map(width).sum::<usize>() + 1;
        flat && !self.pieces[start].is("model") && whole <= WIDTH
    }
}

/// One statement, on its way to lines.
struct Statement<'a> {
    pieces: &'a [Piece<'a>],
    indent: usize,
    /// The keyword of a statement that lists something; empty for an equation.
    keyword: Option<&'a str>,
    /// Column at which further items begin.
    hang: usize,
}

impl<'a> Statement<'a> {
    fn new(pieces: &'a [Piece<'a>], indent: usize) -> Self {
        let first = &pieces[0];
        // a word of statements that is a name elsewhere
        let declares = pieces.get(1).is_some_and(|p| p.is_word(TokenKind::Name));
        let keyword = match word_use(&first.text) {
            None if declares && first.text == "known" => Some(&*first.text),
            Some(WordUse::Statement)
                if matches!(&*first.text, "model" | "time" | "trim" | "table" | "use" | "reactions") =>
            {
                None
            }
            Some(WordUse::Statement) => Some(&*first.text),
            Some(WordUse::Planned) => None,
            // one name or derivative on the left; longer left sides would move their neighbours far apart
            _ => pieces.iter().filter(|p| !p.is_comment()).take(LEFT_SIDE).any(|p| p.is("=")).then_some(""),
        };
        // a keyword that stands alone on its line has its items below it, moved in
        let alone = pieces.get(1).is_none_or(|p| p.line_ends > 0);
        let hang = indent + if alone { STEP } else { first.width() + 1 };
        Self { pieces, indent, keyword, hang }
    }

    fn is_table(&self) -> bool {
        self.pieces[0].is("table")
    }

    fn lists(&self) -> bool {
        self.keyword.is_some_and(|k| !k.is_empty())
    }

    fn lines(&self) -> Vec<Line<'a>> {
        let mut lines = Vec::new();
        let mut row: Vec<&'a Piece<'a>> = Vec::new();
        let mut comments: Vec<&'a str> = Vec::new();
        let mut state = Position { depth: 0, item: !self.lists(), hanging: false };
        let mut beginning = state;
        for (k, piece) in self.pieces.iter().enumerate() {
            let ends_row = !row.is_empty() && (piece.line_ends > 0 || !comments.is_empty());
            if piece.is_comment() {
                let next = self.pieces.get(k + 1);
                let last = piece.shape == Shape::LineComment || next.is_none_or(|n| n.line_ends > 0);
                if ends_row && (piece.line_ends > 0 || is_full(&comments)) || row.is_empty() && last {
                    self.flush(&mut row, &mut comments, beginning, &mut lines);
                    lines.push(Line::Comment { indent: self.hang.max(self.indent + STEP), text: &piece.text });
                    beginning = state;
                } else if last || !comments.is_empty() {
                    comments.push(&piece.text);
                } else {
                    row.push(piece);
                }
                continue;
            }
            let clings = piece.is(";") || piece.is(",") || piece.is_index;
            if clings && row.is_empty() {
                if let Some(Line::Words(last)) = lines.iter_mut().rev().find(|l| matches!(l, Line::Words(_))) {
                    last.pieces.push((0, piece));
                    state.pass(piece, self.lists());
                    beginning = state;
                    continue;
                }
            } else if ends_row && !clings {
                self.flush(&mut row, &mut comments, beginning, &mut lines);
                beginning = state;
            }
            row.push(piece);
            state.pass(piece, self.lists());
        }
        self.flush(&mut row, &mut comments, beginning, &mut lines);
        lines
    }

    /// Ends a line of the user's: it is written on one or, where it is too long, on several.
    fn flush(
        &self,
        row: &mut Vec<&'a Piece<'a>>,
        comments: &mut Vec<&'a str>,
        mut state: Position,
        lines: &mut Vec<Line<'a>>,
    ) {
        let mut rest = &std::mem::take(row)[..];
        let mut first = !lines.iter().any(|l| matches!(l, Line::Words(_)));
        while !rest.is_empty() {
            let begins = !first && self.lists() && state.item && state.depth == 0;
            state.hanging |= begins;
            let indent = match () {
                _ if first => self.indent,
                _ if begins => self.hang,
                // lists in the braces of a table stand as deep as they are nested
                _ if self.is_table() && state.depth > 1 => {
                    self.indent + STEP * (state.depth - usize::from(rest[0].is_word(TokenKind::Close)))
                }
                _ if rest[0].is_word(TokenKind::Close) => self.indent,
                _ if state.hanging => self.hang + STEP,
                _ => self.indent + STEP,
            };
            let end = wrap(rest, indent, state.depth);
            let (line, more) = rest.split_at(end);
            rest = more;
            let spaces = |(k, p): (usize, &&'a Piece<'a>)| (usize::from(p.space && k > 0), *p);
            let items = match self.keyword {
                Some("") if first => Some(Items { keyword: "", from: 0 }),
                Some(keyword) if self.lists() && first && line.len() > 1 => Some(Items { keyword, from: 1 }),
                Some(keyword) if begins => Some(Items { keyword, from: 0 }),
                _ => None,
            };
            let pieces = line.iter().enumerate().map(spaces).collect();
            let comments = if rest.is_empty() { std::mem::take(comments) } else { Vec::new() };
            lines.push(Line::Words(Words { indent, pieces, comments, comment_at: 0, begins: first, items }));
            line.iter().for_each(|p| state.pass(p, self.lists()));
            first = false;
        }
    }
}

/// Pieces up to the sign of `der(x[1]) = ...`.
const LEFT_SIDE: usize = 6;

/// Whether nothing can stand behind these comments on their line.
fn is_full(comments: &[&str]) -> bool {
    comments.last().is_some_and(|c| c.starts_with("//"))
}

/// Where in a statement a line begins.
#[derive(Debug, Clone, Copy)]
struct Position {
    /// Brackets that are open.
    depth: usize,
    /// Whether an item of the list begins.
    item: bool,
    /// Whether an item began a line before.
    hanging: bool,
}

impl Position {
    fn pass(&mut self, piece: &Piece<'_>, lists: bool) {
        match piece.shape {
            Shape::Word(TokenKind::Open) => self.depth += 1,
            Shape::Word(TokenKind::Close) => self.depth = self.depth.saturating_sub(1),
            _ => {}
        }
        // the keyword itself and every comma of the list end what was before
        self.item = lists && self.depth == 0 && (piece.is(",") || self.item && piece.is_word(TokenKind::Keyword));
    }
}

/// The text of lines.
pub(super) fn print(lines: &[Line<'_>]) -> String {
    let mut out = String::new();
    let spaces = |out: &mut String, count: usize| out.extend(std::iter::repeat_n(' ', count));
    for line in lines {
        match line {
            Line::Blank => {}
            Line::Comment { indent, text } => {
                spaces(&mut out, *indent);
                out.push_str(text);
            }
            Line::Words(words) => {
                spaces(&mut out, words.indent);
                for (before, piece) in &words.pieces {
                    spaces(&mut out, *before);
                    out.push_str(&piece.text);
                }
                let gap = words.comment_at.saturating_sub(words.width()).max(2);
                for (k, comment) in words.comments.iter().enumerate() {
                    spaces(&mut out, if k == 0 { gap } else { 1 });
                    out.push_str(comment);
                }
            }
        }
        out.push('\n');
    }
    out
}

/// How much of some pieces goes on one line that begins at a column, inside so many brackets: all, or up to the best place
/// for a break, the last one of its kind that fits.
pub(super) fn wrap(pieces: &[&Piece<'_>], indent: usize, mut depth: usize) -> usize {
    let wide = |(k, p): (usize, &&Piece<'_>)| p.width() + usize::from(k > 0 && p.space);
    let mut whole = indent;
    if pieces.iter().enumerate().all(|piece| {
        whole += wide(piece);
        whole <= WIDTH
    }) {
        return pieces.len();
    }
    let (mut column, mut best) = (indent, None);
    for (k, piece) in pieces.iter().enumerate() {
        if k > 0
            && let Some(cost) = cost(pieces[k - 1], piece, depth)
        {
            // what stands before a bracket that is never left belongs to its depth
            if best.is_none_or(|(_, least)| cost <= least) {
                best = Some((k, cost));
            }
        }
        match piece.shape {
            Shape::Word(TokenKind::Open) => depth += 1,
            Shape::Word(TokenKind::Close) => depth = depth.saturating_sub(1),
            _ => {}
        }
        column += wide((k, piece));
        // a comma or semicolon never begins a line
        let last = pieces.get(k + 1).map_or(0, |next| usize::from(next.is(",") || next.is(";")));
        if column + last > WIDTH
            && let Some((end, _)) = best
        {
            return end;
        }
    }
    pieces.len()
}

/// The price of a break between two pieces; `None` where none may be.
fn cost(before: &Piece<'_>, after: &Piece<'_>, depth: usize) -> Option<usize> {
    let (comma, sum, product, attribute, value) = (0, 2, 3, 4, 9);
    let joint = match &*after.text {
        // at the beginning of a line it would be a comment of its own
        _ if after.is_comment() => return None,
        _ if before.is(",") => comma,
        _ if before.is_comment() || !after.space && !after.is("*") && !after.is("/") => {
            return None;
        }
        "and" | "or" | "then" | "else" => 1,
        // a sign before a single operand is no sum: its operand follows without space, and so does it an open bracket
        "+" | "-" if stands_between(before) => sum,
        "*" | "/" => product,
        _ if after.is_word(TokenKind::Text) || after.is_word(TokenKind::Unit) => attribute,
        "in" | "fixed" | "per" => attribute,
        _ if before.is("=") || before.is("~") => value,
        _ => return None,
    };
    Some(joint + 6 * depth)
}

fn stands_between(before: &Piece<'_>) -> bool {
    use TokenKind::{Close, Name, Number, Unit};
    matches!(before.shape, Shape::Word(Name | Number | Close | Unit))
}

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
