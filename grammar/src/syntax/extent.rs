//! The text of a value with all brackets around it: the place of an expression leaves out those around the whole.

use super::scan::{Kind, scan};
use crate::source::Span;

/// From behind the `=` of a value to its last bracket; `value` is the place of its expression inside the statement.
pub fn value_extent(text: &str, statement: Span, value: Span) -> Span {
    let offset = statement.start as usize;
    let Some(Ok(tokens)) = text.get(statement.range()).map(|t| scan(t, usize::MAX)) else { return value };
    let (start, end) = (value.start as usize - offset, value.end as usize - offset);
    let statement = &text[statement.range()];
    let sign = tokens.iter().rposition(|t| t.text(statement) == "=" && t.span.end as usize <= start);
    let first = sign.map_or(0, |k| k + 1);
    let mut depth = 0_usize;
    for token in &tokens[first..] {
        match token.kind {
            Kind::Open => depth += 1,
            Kind::Close => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth == 0 && token.span.end as usize >= end {
            return Span::new(offset + tokens[first].span.start as usize, offset + token.span.end as usize);
        }
    }
    value
}
