//! Places as editors count them: lines from 0, columns in UTF-16 units.

use fdm_grammar::Span;
use lsp_types::{Position, Range};

/// Where the lines of a text begin.
#[derive(Debug, Clone)]
pub(super) struct Lines {
    starts: Vec<u32>,
}

impl Lines {
    pub(super) fn new(text: &str) -> Self {
        let bytes = text.as_bytes();
        // `\n`, `\r\n` and a `\r` that stands alone end lines, for editors as for the language
        let ends = |k: &usize| bytes[*k] == b'\n' || bytes[*k] == b'\r' && bytes.get(k + 1) != Some(&b'\n');
        let starts = std::iter::once(0).chain((0..bytes.len()).filter(ends).map(|k| k as u32 + 1));
        Self { starts: starts.collect() }
    }

    /// The editor's place of a byte.
    pub(super) fn position(&self, text: &str, offset: usize) -> Position {
        let mut offset = offset.min(text.len());
        while !text.is_char_boundary(offset) {
            offset -= 1;
        }
        let line = self.starts.partition_point(|s| *s as usize <= offset) - 1;
        let before = &text[self.starts[line] as usize..offset];
        Position::new(line as u32, before.encode_utf16().count() as u32)
    }

    /// The byte of an editor's place; behind the end of a line its end, behind the last line the end of the text.
    pub(super) fn offset(&self, text: &str, position: Position) -> usize {
        let Some(start) = self.starts.get(position.line as usize).map(|s| *s as usize) else { return text.len() };
        let end = self.starts.get(position.line as usize + 1).map_or(text.len(), |s| *s as usize);
        let line = text[start..end].trim_end_matches(['\n', '\r']);
        let mut units = 0;
        for (at, c) in line.char_indices() {
            if units >= position.character as usize {
                return start + at;
            }
            units += c.len_utf16();
        }
        start + line.len()
    }

    pub(super) fn range(&self, text: &str, span: Span) -> Range {
        let range = span.range();
        Range::new(self.position(text, range.start), self.position(text, range.end))
    }
}
