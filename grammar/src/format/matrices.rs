//! Rows of a matrix that have a line each: their elements stand below each other, ends lined up as numbers are.

use super::WIDTH;
use super::lines::{Line, Words};
use super::pieces::Shape;
use crate::syntax::TokenKind;
use std::ops::Range;

/// Lines up neighbouring rows of as many elements.
pub(super) fn align(lines: &mut [Line<'_>]) {
    let mut from = 0;
    while from < lines.len() {
        let Some(first) = row(&lines[from]) else {
            from += 1;
            continue;
        };
        let mut rows = vec![first];
        while let Some(next) = lines.get(from + rows.len()).and_then(row).filter(|r| r.len() == rows[0].len()) {
            rows.push(next);
        }
        let length = rows.len();
        space(&mut lines[from..from + length], &rows);
        from += length;
    }
}

/// The pieces of every element of a line that holds one row, `[a, b, c],`.
fn row(line: &Line<'_>) -> Option<Vec<Range<usize>>> {
    let Line::Words(words) = line else { return None };
    if words.begins || !words.pieces.first()?.1.is("[") {
        return None;
    }
    let (mut depth, mut elements, mut from) = (0_usize, Vec::new(), 1);
    for (k, (_, piece)) in words.pieces.iter().enumerate() {
        match piece.shape {
            Shape::Word(TokenKind::Open) => depth += 1,
            Shape::Word(TokenKind::Close) => {
                depth = depth.saturating_sub(1);
                if depth == 0 {
                    elements.push(from..k);
                    let rest = &words.pieces[k + 1..];
                    return rest.iter().all(|(_, p)| p.is(",")).then_some(elements);
                }
            }
            _ if depth == 1 && piece.is(",") => {
                elements.push(from..k);
                from = k + 1;
            }
            _ => {}
        }
    }
    None
}

/// Puts spaces before the elements that are shorter than others of their column.
fn space(lines: &mut [Line<'_>], rows: &[Vec<Range<usize>>]) {
    let width = |words: &Words<'_>, element: &Range<usize>| {
        let pieces = words.pieces[element.clone()].iter().enumerate();
        pieces.map(|(k, (spaces, p))| p.width() + if k > 0 { *spaces } else { 0 }).sum::<usize>()
    };
    let mut widths = vec![0; rows[0].len()];
    for (line, row) in lines.iter().zip(rows) {
        let Line::Words(words) = line else { continue };
        widths.iter_mut().zip(row).for_each(|(widest, element)| *widest = (*widest).max(width(words, element)));
    }
    // brackets, and a comma and a space for each
    let whole = |line: &Line<'_>| match line {
        Line::Words(words) => words.indent + widths.iter().map(|w| w + 2).sum::<usize>() < WIDTH,
        _ => true,
    };
    if !lines.iter().all(whole) {
        return;
    }
    for (line, row) in lines.iter_mut().zip(rows) {
        let Line::Words(words) = line else { continue };
        for (element, widest) in row.iter().zip(&widths) {
            let missing = widest - width(words, element);
            if let Some((spaces, _)) = words.pieces.get_mut(element.start).filter(|_| !element.is_empty()) {
                *spaces += missing;
            }
        }
    }
}
