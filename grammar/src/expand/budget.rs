//! How large a model may become when what it says in short is written out.

use crate::diagnostic::{Code, Diagnostic};
use crate::source::Span;

/// Most names, numbers and signs of a model written out.
pub const MOST_NODES: usize = 4_000_000;
/// Most bytes of names, docs and units of a model written out.
const MOST_BYTES: usize = 256 << 20;

/// What may still be written.
#[derive(Debug)]
pub(super) struct Budget {
    nodes: usize,
    bytes: usize,
    told: bool,
}

impl Budget {
    pub(super) fn new() -> Self {
        Self { nodes: MOST_NODES, bytes: MOST_BYTES, told: false }
    }

    /// Takes what is needed; `false` when there is not enough, now or before.
    pub(super) fn spend(&mut self, nodes: usize, bytes: usize) -> bool {
        match (self.nodes.checked_sub(nodes), self.bytes.checked_sub(bytes)) {
            (Some(nodes), Some(bytes)) => (self.nodes, self.bytes) = (nodes, bytes),
            _ => (self.nodes, self.bytes) = (0, 0),
        }
        !self.is_spent()
    }

    /// Whether something did not fit.
    pub(super) fn is_spent(&self) -> bool {
        self.nodes == 0 || self.bytes == 0
    }

    /// What is told about it, once.
    pub(super) fn finding(&mut self, span: Span) -> Option<Diagnostic> {
        if std::mem::replace(&mut self.told, true) {
            return None;
        }
        let message = format!(
            "written out, this model has more than {MOST_NODES} names, numbers and signs, or more than {} MiB of \
             names and docs",
            MOST_BYTES >> 20
        );
        Some(Diagnostic::new(Code::TooLarge, span, message).hint("this is where the limit is passed"))
    }
}
