//! Tokens back to text: every token at the line and column where the user wrote it, so that one parser serves files
//! and macro alike, and every place in the text leads back to the token that stands there.

use proc_macro2::{Delimiter, Group, LineColumn, Literal, Span, TokenStream, TokenTree};
use std::ops::Range;
use syn::Lit;

/// The text of a model and the tokens it came from.
#[derive(Debug)]
pub(crate) struct ModelText {
    /// As the user wrote it, without comments; its first line is that of the first token.
    pub(crate) text: String,
    /// Where each token stands in the text, in the order of the text.
    marks: Vec<(Range<usize>, Span)>,
}

/// A token that Rust knows and the language does not.
#[derive(Debug)]
pub(crate) struct ForeignToken {
    pub(crate) span: Span,
    pub(crate) message: String,
}

/// A token without its surroundings.
struct Piece {
    text: String,
    span: Span,
    /// Characters of the source before `text` that are left out (`r#`).
    skipped: usize,
    /// The next token follows without a space (`<` of `<=`).
    joint: bool,
}

impl ModelText {
    /// Writes the tokens; all foreign tokens are reported.
    pub(crate) fn new(tokens: TokenStream) -> Result<Self, Vec<ForeignToken>> {
        let flat = flatten(tokens);
        if !flat.foreign.is_empty() {
            return Err(flat.foreign);
        }
        let placed = if flat.regrouped { None } else { placed(&flat.pieces) };
        Ok(placed.unwrap_or_else(|| joined(&flat.pieces)))
    }

    /// The first and the last token that a span of the text touches; the nearest one where there is none.
    pub(crate) fn tokens(&self, span: fdm_grammar::Span) -> (Span, Span) {
        let range = span.range();
        let Some(last_mark) = self.marks.len().checked_sub(1) else { return (Span::call_site(), Span::call_site()) };
        let first = self.marks.partition_point(|(r, _)| r.end <= range.start).min(last_mark);
        let behind = self.marks.partition_point(|(r, _)| r.start < range.end);
        (self.marks[first].1, self.marks[behind.saturating_sub(1).max(first)].1)
    }

    fn push(&mut self, piece: &Piece) {
        let start = self.text.len();
        self.text.push_str(&piece.text);
        self.marks.push((start..self.text.len(), piece.span));
    }
}

/// All tokens in one row, delimiters included.
struct Flat {
    pieces: Vec<Piece>,
    foreign: Vec<ForeignToken>,
    /// Parentheses were added that the user did not write.
    regrouped: bool,
}

/// Walks the token trees with its own stack: nesting is the user's choice.
fn flatten(tokens: TokenStream) -> Flat {
    let mut flat = Flat { pieces: Vec::new(), foreign: Vec::new(), regrouped: false };
    let mut open = vec![(trees(tokens), None)];
    while let Some((trees, close)) = open.last_mut() {
        let Some(tree) = trees.pop() else {
            flat.pieces.extend(close.take());
            open.pop();
            continue;
        };
        match tree {
            TokenTree::Group(group) => {
                let inner = trees_of(&mut flat, &group);
                open.push(inner);
            }
            TokenTree::Punct(p) if p.as_char() == '#' && is_doc_comment(p.span(), trees) => {
                // `/// ...` is an ordinary comment of the language; rustc made an attribute of it
                let attribute = |t: &TokenTree| matches!(t, TokenTree::Group(_));
                while trees.pop().is_some_and(|t| !attribute(&t)) {}
            }
            TokenTree::Punct(p) => {
                let joint = p.spacing() == proc_macro2::Spacing::Joint;
                flat.pieces.push(Piece { text: p.as_char().into(), span: p.span(), skipped: 0, joint });
            }
            TokenTree::Ident(ident) => {
                let name = ident.to_string();
                let (skipped, text) = name.strip_prefix("r#").map_or((0, &*name), |rest| (2, rest));
                flat.pieces.push(Piece { text: text.into(), span: ident.span(), skipped, joint: false });
            }
            TokenTree::Literal(literal) => {
                let span = literal.span();
                match plain(literal) {
                    Ok(text) => flat.pieces.push(Piece { text, span, skipped: 0, joint: false }),
                    Err(message) => flat.foreign.push(ForeignToken { span, message }),
                }
            }
        }
    }
    flat
}

/// A literal of Rust as the language writes it, or why it can not. Strings mean what they mean in Rust; the language
/// knows no escapes.
fn plain(literal: Literal) -> Result<String, String> {
    let text = literal.to_string();
    match Lit::new(literal) {
        Lit::Int(_) | Lit::Float(_) => Ok(text),
        Lit::Str(string) if string.value().contains('"') => {
            Err("a doc string of a model cannot hold the sign \"".to_owned())
        }
        Lit::Str(string) => Ok(format!("\"{}\"", string.value())),
        _ => Err(format!("{text} is a literal of Rust; a model has numbers and strings \"...\"")),
    }
}

/// The trees of a stream, last first, so that `pop` takes them in order.
fn trees(tokens: TokenStream) -> Vec<TokenTree> {
    let mut trees: Vec<TokenTree> = tokens.into_iter().collect();
    trees.reverse();
    trees
}

/// Writes the opening delimiter; the inner trees and the closing one.
fn trees_of(flat: &mut Flat, group: &Group) -> (Vec<TokenTree>, Option<Piece>) {
    let inner = trees(group.stream());
    let pair = match group.delimiter() {
        Delimiter::Parenthesis => Some(("(", ")")),
        Delimiter::Brace => Some(("{", "}")),
        Delimiter::Bracket => Some(("[", "]")),
        // `$e:expr` of a macro_rules: one operand, whatever it is made of
        Delimiter::None if inner.len() > 1 => {
            flat.regrouped = true;
            Some(("(", ")"))
        }
        Delimiter::None => None,
    };
    let piece = |text: &str, span| Piece { text: text.into(), span, skipped: 0, joint: false };
    let Some((open, close)) = pair else { return (inner, None) };
    flat.pieces.push(piece(open, group.span_open()));
    (inner, Some(piece(close, group.span_close())))
}

/// Whether `#`, with `rest` (last first) behind it, is what rustc made of a doc comment: all its tokens stand at the
/// place of the comment, whereas those of a written attribute follow each other.
fn is_doc_comment(hash: Span, rest: &[TokenTree]) -> bool {
    let mut rest = rest.iter().rev();
    let group = match rest.next() {
        Some(TokenTree::Punct(p)) if p.as_char() == '!' => rest.next(),
        other => other,
    };
    let Some(TokenTree::Group(group)) = group else { return false };
    let doc = matches!(group.stream().into_iter().next(), Some(TokenTree::Ident(i)) if i == "doc");
    doc && group.delimiter() == Delimiter::Bracket && group.span_open().start() == hash.start()
}

/// Every token at its own line and column; `None` when the tokens do not stand in the order of their places, as
/// happens when another macro made some of them.
fn placed(pieces: &[Piece]) -> Option<ModelText> {
    let mut written = ModelText { text: String::new(), marks: Vec::with_capacity(pieces.len()) };
    let mut cursor = LineColumn { line: pieces.first()?.span.start().line, column: 0 };
    for piece in pieces {
        let start = piece.span.start();
        let at = LineColumn { line: start.line, column: start.column + piece.skipped };
        if at.line == 0 || at < cursor {
            return None;
        }
        if at.line > cursor.line {
            written.text.extend(std::iter::repeat_n('\n', at.line - cursor.line));
            cursor = LineColumn { line: at.line, column: 0 };
        }
        written.text.extend(std::iter::repeat_n(' ', at.column - cursor.column));
        written.push(piece);
        cursor = behind(at, &piece.text);
    }
    Some(written)
}

/// Where a text ends that begins at `at`.
fn behind(at: LineColumn, text: &str) -> LineColumn {
    match text.rsplit_once('\n') {
        None => LineColumn { line: at.line, column: at.column + text.chars().count() },
        Some((head, tail)) => {
            LineColumn { line: at.line + head.matches('\n').count() + 1, column: tail.chars().count() }
        }
    }
}

/// Tokens without usable places, separated by spaces, a statement to a line. An index stands at its name, and so do the
/// parts of a dotted name.
fn joined(pieces: &[Piece]) -> ModelText {
    let mut written = ModelText { text: String::new(), marks: Vec::with_capacity(pieces.len()) };
    for (k, piece) in pieces.iter().enumerate() {
        let next = pieces.get(k + 1).map_or("", |p| &*p.text);
        let dotted = (is_name(next) && piece.text == "." && k > 0 && is_name(&pieces[k - 1].text))
            || (is_name(&piece.text) && next == "." && pieces.get(k + 2).is_some_and(|p| is_name(&p.text)));
        let indexed = next == "[" && is_name(&piece.text) && is_index(&pieces[k + 2..]);
        written.push(piece);
        match &*piece.text {
            ";" | "{" | "}" => written.text.push('\n'),
            _ if piece.joint || dotted || indexed => {}
            _ => written.text.push(' '),
        }
    }
    written
}

fn is_name(text: &str) -> bool {
    text.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// Whether `1]`, `:, 2]`, `1:3]` follows: no unit but `[1]` looks like this, and that one is a unit only behind a declared
/// name, where the language does not look at spaces.
fn is_index(rest: &[Piece]) -> bool {
    let inside: Vec<&str> = rest.iter().map(|p| &*p.text).take_while(|t| *t != "]").take(8).collect();
    let part = |t: &&str| matches!(*t, ":" | ",") || t.bytes().all(|b| b.is_ascii_digit());
    !inside.is_empty() && inside.iter().all(part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::str::FromStr;

    fn text_of(source: &str) -> ModelText {
        ModelText::new(TokenStream::from_str(source).expect("tokens")).expect("no foreign tokens")
    }

    #[test]
    fn text_stands_where_it_was_written() {
        let source = "model a \"b c\" {\n  param k = 1e-3 in [-0.2, .5], m = 2.*x^2;   state\tα [m/s^2]; if a<=b then 2. else 0.5\n\n}";
        let plain = source.replace('\t', " ");
        assert_eq!(text_of(source).text, plain);
    }

    #[test]
    fn comments_vanish_and_leave_their_places() {
        let written = text_of("model a { // one\n  /// two\n  param k /* three */ = 1; //! four\n}");
        assert_eq!(written.text, "model a {\n\n  param k             = 1;\n}");
    }

    #[test]
    fn text_begins_in_the_line_of_the_first_token_and_keeps_its_column() {
        assert_eq!(text_of("\n\n   model a {\n }").text, "   model a {\n }");
    }

    #[test]
    fn strings_over_several_lines_do_not_shift_what_follows() {
        let source = "model a \"first\n  second\" { state x; }\n";
        assert_eq!(text_of(source).text, source.trim_end());
    }

    #[test]
    fn strings_mean_what_they_mean_in_rust() {
        let written = text_of(r####"model a "\\beta \u{e4}" { input u r"\beta", v; }"####);
        assert_eq!(written.text, "model a \"\\beta ä\"       { input u \"\\beta\" , v; }");
    }

    #[test]
    fn raw_identifiers_are_their_names() {
        assert_eq!(text_of("param r#loop = 1;").text, "param   loop = 1;");
    }

    #[test]
    fn every_span_leads_to_its_tokens() {
        let source = "param αβ = x +\n  y_1;";
        let written = text_of(source);
        let of = |word: &str| {
            let start = written.text.find(word).expect("word");
            let (first, last) = written.tokens(fdm_grammar::Span::new(start, start + word.len()));
            let (a, b) = (first.start(), last.end());
            ((a.line, a.column), (b.line, b.column))
        };
        assert_eq!(of("αβ"), ((1, 6), (1, 8)));
        assert_eq!(of("x +\n  y_1"), ((1, 11), (2, 5)));
        // a part of a token, the gap before a token, the end of the text
        assert_eq!(of("_1"), ((2, 2), (2, 5)));
        assert_eq!(of("\n "), ((2, 2), (2, 5)));
        let end = written.text.len();
        assert_eq!(written.tokens(fdm_grammar::Span::new(end, end)).0.start().column, 5);
    }

    #[test]
    fn tokens_without_places_are_joined_by_spaces() {
        let tokens = quote::quote!(model a { param k = 1e-3 in [-0.2, 2.5]; let c = k <= 2.0; });
        let written = ModelText::new(tokens).expect("no foreign tokens");
        assert_eq!(written.text, "model a {\nparam k = 1e-3 in [ - 0.2 , 2.5 ] ;\nlet c = k <= 2.0 ;\n}\n");
    }

    #[test]
    fn indices_and_dotted_names_without_places_stay_together() {
        let tokens = quote::quote!(let y[2] = act.x[1] + A[1, 2:3]*B[:, 1]; input u [deg], w [m/s];);
        let written = ModelText::new(tokens).expect("no foreign tokens");
        let expected = "let y[2 ] = act.x[1 ] + A[1 , 2 : 3 ] * B[: , 1 ] ;\ninput u [deg ] , w [m / s ] ;\n";
        assert_eq!(written.text.replace("[ ", "["), expected);
    }

    #[test]
    fn an_expression_out_of_a_macro_stays_one_operand() {
        let inner = TokenTree::Group(Group::new(Delimiter::None, quote::quote!(a + b)));
        let lone = TokenTree::Group(Group::new(Delimiter::None, quote::quote!(c)));
        let written = ModelText::new(quote::quote!(let k = 2 * #inner * #lone;)).expect("no foreign tokens");
        assert_eq!(written.text, "let k = 2 * ( a + b ) * c ;\n");
    }

    #[test]
    fn foreign_literals_are_told_all_at_once() {
        let tokens = TokenStream::from_str("model a \"\\\"\" { state x b'u'; }").expect("tokens");
        let foreign = ModelText::new(tokens).expect_err("two foreign tokens");
        assert_eq!(foreign.iter().map(|f| f.span.start().column).collect::<Vec<_>>(), [8, 23]);
    }

    #[test]
    fn nesting_costs_no_stack() {
        let mut stream = quote::quote!(x);
        for _ in 0..3_000 {
            stream = TokenTree::Group(Group::new(Delimiter::Parenthesis, stream)).into();
        }
        assert_eq!(ModelText::new(stream).expect("no foreign tokens").text.matches('(').count(), 3_000);
    }
}
