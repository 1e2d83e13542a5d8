//! Mistakes and warnings in the editor's words, and what mends them.

use super::{offset, range as range_of};
use crate::language::document::Document;
use fdm_grammar::{Code, Diagnostic};
use lsp_types::{
    CodeAction, CodeActionKind, DiagnosticRelatedInformation, DiagnosticSeverity, DiagnosticTag, Location,
    NumberOrString, Range, TextEdit, Uri, WorkspaceEdit,
};

/// More findings of one text are not sent.
const MOST: usize = 500;

/// Every finding with its place, its code, its hint and the places that explain it.
pub(super) fn diagnostics(document: &Document, uri: &Uri) -> Vec<lsp_types::Diagnostic> {
    document.findings.iter().take(MOST).map(|f| diagnostic(document, uri, f)).collect()
}

fn diagnostic(document: &Document, uri: &Uri, finding: &Diagnostic) -> lsp_types::Diagnostic {
    let severity = if finding.is_error() { DiagnosticSeverity::ERROR } else { DiagnosticSeverity::WARNING };
    let hint = finding.hint.as_ref().map_or(String::new(), |h| format!("\n{h}"));
    let related = finding.labels.iter().map(|label| DiagnosticRelatedInformation {
        location: Location::new(uri.clone(), range_of(document, label.span)),
        message: label.text.clone(),
    });
    let related: Vec<_> = related.collect();
    lsp_types::Diagnostic {
        range: range_of(document, finding.span),
        severity: Some(severity),
        code: Some(NumberOrString::String(finding.code.text().into())),
        source: Some("fdm".into()),
        message: format!("{}{hint}", finding.message),
        related_information: (!related.is_empty()).then_some(related),
        tags: (finding.code == Code::Unused).then(|| vec![DiagnosticTag::UNNECESSARY]),
        ..Default::default()
    }
}

/// What mends the findings of a range: the word that was meant in the place of the one that was written.
pub(super) fn actions(document: &Document, uri: &Uri, range: Range) -> Vec<CodeAction> {
    let (start, end) = (offset(document, range.start), offset(document, range.end));
    let near = |f: &&Diagnostic| f.span.start as usize <= end && start <= f.span.end as usize;
    let fix = |finding: &Diagnostic| {
        let meant = meant(finding)?;
        let edit = TextEdit::new(range_of(document, finding.span), meant.into());
        Some(CodeAction {
            title: format!("Write `{meant}`"),
            kind: Some(CodeActionKind::QUICKFIX),
            diagnostics: Some(vec![diagnostic(document, uri, finding)]),
            edit: Some(changes(uri, vec![edit])),
            is_preferred: Some(true),
            ..Default::default()
        })
    };
    document.findings.iter().filter(near).filter_map(fix).collect()
}

/// Edits of one text.
#[allow(clippy::mutable_key_type, reason = "the protocol's type; the address is not changed while it is a key")]
pub(super) fn changes(uri: &Uri, edits: Vec<TextEdit>) -> WorkspaceEdit {
    WorkspaceEdit::new([(uri.clone(), edits)].into_iter().collect())
}

/// The word that is meant, when the hint names one.
fn meant(finding: &Diagnostic) -> Option<&str> {
    finding.hint.as_deref()?.strip_prefix("did you mean `")?.strip_suffix("`?")
}
