//! The cells of a line: name, doc, unit, value and bounds of each of its items.

use super::lines::{Items, Words};
use super::pieces::{Piece, Shape};
use crate::syntax::TokenKind;

/// What stands in a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cell {
    Name,
    Doc,
    Unit,
    Value,
    Bounds,
}

/// A column: the number of the item on its line, and what of it.
pub(super) type Stop = (usize, Cell);

/// The stops of a line and the pieces where they begin.
pub(super) fn stops(words: &Words<'_>, items: Items<'_>) -> Vec<(Stop, usize)> {
    let mut stops = vec![((0, Cell::Name), items.from)];
    let (mut item, mut depth) = (0, 0_usize);
    let mut begins = false;
    for (k, (_, piece)) in words.pieces.iter().enumerate().skip(items.from + 1) {
        let last = stops.last().map_or(Cell::Name, |((_, cell), _)| *cell);
        if depth == 0 && begins {
            item += 1;
            stops.push(((item, Cell::Name), k));
            begins = false;
        } else if depth == 0
            && let Some(cell) = cell(piece, last)
        {
            // what is said twice of an item (`"doc" [unit] per run`) belongs to the cell before
            if !stops.iter().rev().take_while(|((i, _), _)| *i == item).any(|((_, c), _)| *c == cell) {
                stops.push(((item, cell), k));
            }
        }
        match piece.shape {
            Shape::Word(TokenKind::Open) => depth += 1,
            Shape::Word(TokenKind::Close) => depth = depth.saturating_sub(1),
            _ => begins = depth == 0 && piece.is(",") && !items.keyword.is_empty(),
        }
    }
    stops
}

/// The cell that a piece begins.
fn cell(piece: &Piece<'_>, last: Cell) -> Option<Cell> {
    match &*piece.text {
        _ if piece.is_word(TokenKind::Text) => Some(Cell::Doc),
        _ if piece.is_word(TokenKind::Unit) && !piece.is_index => Some(Cell::Unit),
        "=" | "+=" | "~" => Some(Cell::Value),
        // bounds belong to the value that they directly follow, `fixed` and `per run` too
        "in" if last != Cell::Value => Some(Cell::Bounds),
        "fixed" | "per" if !matches!(last, Cell::Value | Cell::Bounds | Cell::Doc) => Some(Cell::Doc),
        // behind a unit it is no function
        "log" | "held" if last == Cell::Unit => Some(Cell::Doc),
        _ => None,
    }
}
