//! Neighbours of one kind are lined up: what is said of one stands below what is said of the other.
//!
//! The cells of a line: name, doc, unit, value and bounds of each of its items.
//!
//! Rows of a matrix that have a line each: their elements stand below each other, ends lined up as numbers are.

use super::WIDTH;
use super::lines::{Items, Line, Words};
use super::lines::{Piece, Shape};
use crate::syntax::TokenKind;
use std::ops::Range;

/// Lines up runs of declarations, of equations, and comments at the ends of lines.
pub(super) fn align(lines: &mut [Line<'_>]) {
    let mut run: Vec<usize> = Vec::new();
    let mut kind = None;
    for at in 0..lines.len() {
        let own = match &lines[at] {
            Line::Comment { .. } => continue,
            // the rest of a statement that began before
            Line::Words(words) if words.items.is_none() && !words.begins => continue,
            Line::Words(words) => words.items.map(|items| (items.keyword, start(words))),
            Line::Blank => None,
        };
        if own.is_none() || own != kind {
            columns(lines, &run);
            run.clear();
            kind = own;
        }
        if own.is_some() {
            run.push(at);
        }
    }
    columns(lines, &run);
    comments(lines);
}

/// The column at which the first item of a line stands.
fn start(words: &Words<'_>) -> usize {
    let from = words.items.map_or(0, |items| items.from);
    words.indent + words.pieces[..from].iter().map(|(spaces, p)| spaces + p.width()).sum::<usize>() + from.min(1)
}

/// A line of a run: its index, its stops with the pieces where they begin.
type Row = (usize, Vec<(Stop, usize)>);

/// Lines up one run.
fn columns(lines: &mut [Line<'_>], run: &[usize]) {
    let rows = run.iter().filter_map(|at| match &lines[*at] {
        Line::Words(words) => Some((*at, stops(words, words.items?))),
        _ => None,
    });
    let mut rows: Vec<Row> = rows.collect();
    let single = |row: &&Row| row.1.last().is_none_or(|((item, _), _)| *item == 0);
    let listed = rows.len() - rows.iter().filter(single).count();
    // lists of several to a line stand in columns where the user wrote them so
    let table = listed > 0 && 2 * listed >= rows.len();
    if table && !rows.iter().any(|(at, _)| is_spaced(&lines[*at])) {
        return;
    }
    if !table {
        rows.iter_mut().for_each(|(_, stops)| stops.retain(|((item, _), _)| *item == 0));
    }
    let mut from = 0;
    while from < rows.len() {
        let (order, length) = merged(&rows[from..]);
        fit(lines, &mut rows[from..from + length], &order);
        from += length;
    }
}

/// Whether words of a line stand apart by more than a space.
fn is_spaced(line: &Line<'_>) -> bool {
    let Line::Words(words) = line else { return false };
    words.pieces.iter().skip(1).any(|(_, p)| p.line_ends == 0 && p.gap > 1)
}

/// One order of stops in which those of as many rows as possible, from the first on, stand.
fn merged(rows: &[Row]) -> (Vec<Stop>, usize) {
    let mut order: Vec<Stop> = Vec::new();
    for (length, (_, stops)) in rows.iter().enumerate() {
        let mut wider = order.clone();
        let mut at = 0;
        for (stop, _) in stops {
            match wider.iter().position(|s| s == stop) {
                Some(place) if place < at => return (order, length),
                Some(place) => at = place + 1,
                None => {
                    // items of a list stand in their order, whatever is said of each
                    at += wider[at..].iter().take_while(|s| s.0 < stop.0).count();
                    wider.insert(at, *stop);
                    at += 1;
                }
            }
        }
        order = wider;
    }
    (order, rows.len())
}

/// Spaces out rows so that their stops stand below each other: all, or where lines would get too long the beginnings of
/// items, or names only, or none.
fn fit(lines: &mut [Line<'_>], rows: &mut [Row], order: &[Stop]) {
    let choices: [fn(&Stop) -> bool; 3] = [|_| true, |s| s.1 == Cell::Name, |s| s.0 == 0 && s.1 == Cell::Name];
    for chosen in choices {
        // the cell behind the names ends them
        let ends = |stop: &Stop, k: usize, row: &Row| chosen(stop) || k > 0 && chosen(&row.1[k - 1].0) && stop.0 == 0;
        let placed: Vec<Vec<(usize, usize)>> = place(lines, rows, order, ends);
        let fits = rows.iter().zip(&placed).all(|((at, _), spaces)| match &lines[*at] {
            Line::Words(words) => words.width() + spaces.iter().map(|(_, more)| more).sum::<usize>() <= WIDTH,
            _ => true,
        });
        if fits {
            for ((at, _), spaces) in rows.iter().zip(placed) {
                let Line::Words(words) = &mut lines[*at] else { continue };
                spaces.iter().for_each(|(piece, more)| words.pieces[*piece].0 += more);
            }
            return;
        }
    }
}

/// The spaces that are missing before pieces of each row.
fn place(
    lines: &[Line<'_>],
    rows: &[Row],
    order: &[Stop],
    chosen: impl Fn(&Stop, usize, &Row) -> bool,
) -> Vec<Vec<(usize, usize)>> {
    let cells: Vec<Vec<(usize, usize, usize)>> = rows.iter().map(|row| cells(lines, row, order, &chosen)).collect();
    // a column is as wide as what stands in it, where something stands behind it
    let mut widths = vec![0; order.len()];
    for row in &cells {
        for pair in row.windows(2) {
            let [(column, _, width), _] = pair else { continue };
            widths[*column] = widths[*column].max(width + 1);
        }
    }
    let begins = |column: usize| widths[..column].iter().sum::<usize>();
    let missing = |row: &Vec<(usize, usize, usize)>| {
        row.windows(2)
            .filter_map(|pair| match pair {
                [(column, _, width), (next, piece, _)] => {
                    Some((*piece, begins(*next).saturating_sub(begins(*column) + width + 1)))
                }
                _ => None,
            })
            .collect()
    };
    cells.iter().map(missing).collect()
}

/// Column, first piece and width of each cell of a row.
fn cells(
    lines: &[Line<'_>],
    row: &Row,
    order: &[Stop],
    chosen: impl Fn(&Stop, usize, &Row) -> bool,
) -> Vec<(usize, usize, usize)> {
    let Line::Words(words) = &lines[row.0] else { return Vec::new() };
    let kept = row.1.iter().enumerate().filter(|(k, (stop, _))| *k == 0 || chosen(stop, *k, row));
    let kept: Vec<(Stop, usize)> = kept.map(|(_, s)| *s).collect();
    let ends = kept.iter().skip(1).map(|(_, piece)| *piece).chain([words.pieces.len()]);
    let width = |from: usize, end: usize| {
        let pieces = words.pieces[from..end].iter().enumerate();
        pieces.map(|(k, (spaces, p))| p.width() + if k > 0 { *spaces } else { 0 }).sum::<usize>()
    };
    let column = |stop: &Stop| order.iter().position(|s| s == stop).unwrap_or_default();
    kept.iter().zip(ends).map(|((stop, from), end)| (column(stop), *from, width(*from, end))).collect()
}

/// Lines up the comments behind neighbouring lines.
fn comments(lines: &mut [Line<'_>]) {
    let mut from = 0;
    while from < lines.len() {
        let Some(indent) = commented(&lines[from]) else {
            from += 1;
            continue;
        };
        let length = lines[from..].iter().take_while(|l| commented(l) == Some(indent)).count();
        let run = &mut lines[from..from + length];
        let width = |l: &Line<'_>| if let Line::Words(words) = l { words.width() } else { 0 };
        let column = run.iter().map(width).max().unwrap_or_default() + 2;
        for line in run {
            if let Line::Words(words) = line {
                words.comment_at = column;
            }
        }
        from += length;
    }
}

/// The indent of a line with a comment of one line at its end.
fn commented(line: &Line<'_>) -> Option<usize> {
    match line {
        Line::Words(words) if !words.comments.is_empty() => Some(words.indent),
        _ => None,
    }
}

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
        "log" | "held" | "linear" if last == Cell::Unit => Some(Cell::Doc),
        _ => None,
    }
}

/// Lines up neighbouring rows of as many elements.
pub(super) fn align_rows(lines: &mut [Line<'_>]) {
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
