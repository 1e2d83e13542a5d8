//! Where a line that is too long is broken.

use super::WIDTH;
use super::pieces::{Piece, Shape};
use crate::syntax::TokenKind;

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
