//! A text in the one layout: only the spaces, line ends and blank lines between its words change.
//!
//! **In** a [`Source`] that fits the grammar. **Out** the same words and comments in the same order, laid out; or why not.
//! **Never** looks at a syntax tree, so that comments and new statements come free, and never changes a word: the result is
//! read again and compared. **Start** at [`format()`]: `lines.rs` makes words and comments of the text, cuts them
//! into statements and lines and breaks those that are too long, `columns.rs` lines up neighbours.

mod columns;
mod lines;
#[cfg(test)]
mod tests;

use crate::diagnostic::Diagnostic;
use crate::source::Source;
use crate::syntax::{self, Printer};
use lines::Piece;

/// Most characters of a line that is laid out; what cannot be broken may be longer.
pub const WIDTH: usize = 120;
/// Spaces by which the inside of braces is moved.
const STEP: usize = 2;

/// Why a text is left as it is.
#[derive(Debug, Clone)]
pub enum Refusal {
    /// It does not fit the grammar.
    Mistakes(Vec<Diagnostic>),
    /// Laid out it would say something else: a mistake of the formatter, not of the text.
    Meaning,
}

/// Lays a model out.
///
/// # Errors
/// What of the text cannot be read; then nothing is laid out.
pub fn format(source: &Source) -> Result<String, Refusal> {
    let before = meaning(source).map_err(Refusal::Mistakes)?;
    let laid_out = Source::new(source.name(), settled(source.text()));
    let same = meaning(&laid_out).is_ok_and(|after| after == before) && same_words(source.text(), laid_out.text());
    if same { Ok(laid_out.text().into()) } else { Err(Refusal::Meaning) }
}

/// Laid out until nothing moves: a break that was made is the writer's own break to the next layout, which may put what follows
/// it elsewhere (behind a name that is longer than a line).
fn settled(text: &str) -> String {
    let mut laid_out = layout(text);
    // most layouts of a text after the first
    for _ in 0..5 {
        let again = layout(&laid_out);
        if again == laid_out {
            break;
        }
        laid_out = again;
    }
    laid_out
}

/// What a text says, apart from its places.
fn meaning(source: &Source) -> Result<String, Vec<Diagnostic>> {
    if syntax::holds_effects(source.text()) {
        let (effects, findings) = syntax::parse_effects(source);
        let printed: Vec<String> = effects.iter().map(syntax::print_effect).collect();
        return if findings.is_empty() { Ok(printed.concat()) } else { Err(findings) };
    }
    let tree = syntax::parse(source)?;
    Ok(Printer::with_source(&tree, source).model())
}

/// Lays out any text; of one that does not fit the grammar nothing is promised but that its words stay.
fn layout(text: &str) -> String {
    let pieces = lines::pieces(text);
    let mut lines = lines::lines(&pieces);
    columns::align(&mut lines);
    columns::align_rows(&mut lines);
    let body = lines::print(&lines);
    let mark = if text.starts_with('\u{feff}') { "\u{feff}" } else { "" };
    // the line ends that the first line has
    let windows = text.find('\n').is_some_and(|end| text[..end].ends_with('\r'));
    let body = if windows { body.replace('\n', "\r\n") } else { body };
    format!("{mark}{body}")
}

/// Whether two texts have the same words and the same comments, each in the same order.
fn same_words(a: &str, b: &str) -> bool {
    let split = |text| -> (Vec<_>, Vec<_>) { lines::pieces(text).into_iter().partition(Piece::is_comment) };
    let ((comments_a, words_a), (comments_b, words_b)) = (split(a), split(b));
    words_a.iter().map(word).eq(words_b.iter().map(word)) && comments_a.iter().map(word).eq(comments_b.iter().map(word))
}

/// What counts of a piece: behind a name, `[1]` with and without a space are two things.
fn word<'a>(piece: &'a Piece<'_>) -> (&'a str, bool) {
    (&piece.text, piece.is_index)
}
