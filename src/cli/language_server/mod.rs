//! `fdm lsp`: models in an editor, by the Language Server Protocol. Finds mistakes while one types, says what a name is and where
//! it stands, completes, renames, lays out.
//!
//! Notices change the open texts, requests are answered from them, diagnostics follow when the editor is quiet. No model is run,
//! no file is read but those that a model uses, and a broken text ends nothing.

mod completion;
mod findings;
mod names;
mod streams;

use crate::language::document::{self, Document};
use crate::language::hover;
use fdm_grammar::{Span, format};
use lsp_server::{Connection, ErrorCode, Message, Notification, Request, Response};
use lsp_types::notification::{
    DidChangeTextDocument, DidCloseTextDocument, DidOpenTextDocument, Notification as _, PublishDiagnostics,
};
use lsp_types::request::{
    CodeActionRequest, Completion, DocumentHighlightRequest, DocumentSymbolRequest, Formatting, GotoDefinition,
    HoverRequest, PrepareRenameRequest, References, Rename, Request as Question, SignatureHelpRequest,
};
use lsp_types::*;
use serde_json::Value;
use std::collections::BTreeMap;

/// Why the server could not go on.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// What came is not the protocol, or the streams broke.
    #[error("the editor cannot be understood: {0}")]
    Protocol(#[from] lsp_server::ProtocolError),
    /// The streams broke.
    #[error("the editor cannot be reached: {0}")]
    Stream(#[from] std::io::Error),
}

/// Serves an editor over standard input and output until it leaves; says whether it took its leave before.
///
/// # Errors
/// Streams that break, and messages that are none.
pub fn serve_standard_streams() -> Result<bool, ServerError> {
    let (connection, threads) = streams::standard()?;
    let orderly = serve(&connection)?;
    drop(connection);
    threads.join()?;
    Ok(orderly)
}

/// Serves an editor until it leaves; says whether it took its leave before.
///
/// # Errors
/// A conversation that does not begin as the protocol says.
pub fn serve(connection: &Connection) -> Result<bool, ServerError> {
    let (id, _) = connection.initialize_start()?;
    let about = ServerInfo { name: "fdm".into(), version: Some(env!("CARGO_PKG_VERSION").into()) };
    let answer = InitializeResult { capabilities: capabilities(), server_info: Some(about) };
    connection.initialize_finish(id, serde_json::to_value(answer).unwrap_or_default())?;
    let mut server = Server { connection, documents: BTreeMap::new() };
    loop {
        let message = match server.connection.receiver.try_recv() {
            Ok(message) => message,
            Err(_) => {
                // nobody waits: time for what takes longer
                server.publish();
                let Ok(message) = server.connection.receiver.recv() else { return Ok(false) };
                message
            }
        };
        match message {
            Message::Request(request) => {
                if connection.handle_shutdown(&request)? {
                    return Ok(true);
                }
                server.send(server.answer(request).into());
            }
            Message::Notification(notice) if notice.method == "exit" => return Ok(false),
            Message::Notification(notice) => server.notice(notice),
            Message::Response(_) => {}
        }
    }
}

fn capabilities() -> ServerCapabilities {
    ServerCapabilities {
        position_encoding: Some(PositionEncodingKind::UTF16),
        text_document_sync: Some(TextDocumentSyncKind::INCREMENTAL.into()),
        hover_provider: Some(true.into()),
        definition_provider: Some(OneOf::Left(true)),
        references_provider: Some(OneOf::Left(true)),
        document_highlight_provider: Some(OneOf::Left(true)),
        document_symbol_provider: Some(OneOf::Left(true)),
        document_formatting_provider: Some(OneOf::Left(true)),
        rename_provider: Some(OneOf::Right(RenameOptions {
            prepare_provider: Some(true),
            work_done_progress_options: WorkDoneProgressOptions::default(),
        })),
        completion_provider: Some(CompletionOptions {
            trigger_characters: Some(vec!["[".into(), "/".into(), "*".into()]),
            ..Default::default()
        }),
        signature_help_provider: Some(SignatureHelpOptions {
            trigger_characters: Some(vec!["(".into(), ",".into()]),
            ..Default::default()
        }),
        code_action_provider: Some(CodeActionProviderCapability::Options(CodeActionOptions {
            code_action_kinds: Some(vec![CodeActionKind::QUICKFIX]),
            ..Default::default()
        })),
        ..Default::default()
    }
}

struct Server<'a> {
    connection: &'a Connection,
    /// By address, so that findings are published in one order.
    documents: BTreeMap<String, Open>,
}

/// A text that is open.
struct Open {
    uri: Uri,
    version: i32,
    document: Document,
    /// Whether its findings are told.
    is_checked: bool,
}

impl Server<'_> {
    /// An editor that has gone is found out by the loop.
    fn send(&self, message: Message) {
        let _ = self.connection.sender.send(message);
    }

    fn notice(&mut self, notice: Notification) {
        match notice.method.as_str() {
            DidOpenTextDocument::METHOD => {
                let Ok(params) = serde_json::from_value::<DidOpenTextDocumentParams>(notice.params) else { return };
                let TextDocumentItem { uri, version, text, .. } = params.text_document;
                let document = Document::new(uri.path().as_str(), text);
                self.documents.insert(uri.to_string(), Open { uri, version, document, is_checked: false });
            }
            DidChangeTextDocument::METHOD => {
                let Ok(params) = serde_json::from_value::<DidChangeTextDocumentParams>(notice.params) else { return };
                let VersionedTextDocumentIdentifier { uri, version } = params.text_document;
                if let Some(open) = self.documents.get_mut(uri.as_str()) {
                    let document = changed(&open.document, params.content_changes);
                    (open.document, open.version, open.is_checked) = (document, version, false);
                }
            }
            DidCloseTextDocument::METHOD => {
                let Ok(params) = serde_json::from_value::<DidCloseTextDocumentParams>(notice.params) else { return };
                if let Some(open) = self.documents.remove(params.text_document.uri.as_str()) {
                    self.send(published(PublishDiagnosticsParams::new(open.uri, Vec::new(), None)));
                }
            }
            _ => {}
        }
    }

    /// Checks one changed text, and the others when nothing has come meanwhile.
    fn publish(&mut self) {
        while let Some(open) = self.documents.values_mut().find(|open| !open.is_checked) {
            open.document.check();
            open.is_checked = true;
            let found = findings::diagnostics(&open.document, &open.uri);
            let message = published(PublishDiagnosticsParams::new(open.uri.clone(), found, Some(open.version)));
            self.send(message);
            if !self.connection.receiver.is_empty() {
                return;
            }
        }
    }

    fn answer(&self, request: Request) -> Response {
        match request.method.as_str() {
            HoverRequest::METHOD => self.at::<HoverRequest>(
                request,
                |p| p.text_document_position_params.clone(),
                |d, at, _| {
                    Ok(hover::hover(d, at).map(|(value, span)| Hover {
                        contents: HoverContents::Markup(MarkupContent { kind: MarkupKind::Markdown, value }),
                        range: Some(range(d, span)),
                    }))
                },
            ),
            GotoDefinition::METHOD => self.at::<GotoDefinition>(
                request,
                |p| p.text_document_position_params.clone(),
                |d, at, p| {
                    let uri = p.text_document_position_params.text_document.uri;
                    let place = names::definition(d, at).map(|span| Location::new(uri, range(d, span)));
                    Ok(place.map(GotoDefinitionResponse::Scalar))
                },
            ),
            References::METHOD => self.at::<References>(
                request,
                |p| p.text_document_position.clone(),
                |d, at, p| {
                    let uri = p.text_document_position.text_document.uri;
                    let Some((name, _)) = d.name_at(at) else { return Ok(None) };
                    let own = d.find(name).map(|n| n.name().span.start);
                    let mut places = names::places(d, name);
                    places.retain(|s| p.context.include_declaration || Some(s.start) != own);
                    Ok(Some(places.into_iter().map(|s| Location::new(uri.clone(), range(d, s))).collect()))
                },
            ),
            DocumentHighlightRequest::METHOD => self.at::<DocumentHighlightRequest>(
                request,
                |p| p.text_document_position_params.clone(),
                |d, at, _| {
                    let Some((name, _)) = d.name_at(at) else { return Ok(None) };
                    let places = names::places(d, name).into_iter();
                    Ok(Some(places.map(|s| DocumentHighlight { range: range(d, s), kind: None }).collect()))
                },
            ),
            PrepareRenameRequest::METHOD => self.at::<PrepareRenameRequest>(
                request,
                |p| p.clone(),
                |d, at, _| {
                    Ok(d.name_at(at).map(|(name, span)| PrepareRenameResponse::RangeWithPlaceholder {
                        range: range(d, span),
                        placeholder: name.into(),
                    }))
                },
            ),
            Rename::METHOD => self.at::<Rename>(
                request,
                |p| p.text_document_position.clone(),
                |d, at, p| names::rename(d, &p.text_document_position.text_document.uri, at, &p.new_name).map(Some),
            ),
            Completion::METHOD => self.at::<Completion>(
                request,
                |p| p.text_document_position.clone(),
                |d, at, _| Ok(Some(CompletionResponse::Array(completion::items(d, at)))),
            ),
            SignatureHelpRequest::METHOD => self.at::<SignatureHelpRequest>(
                request,
                |p| p.text_document_position_params.clone(),
                |d, at, _| Ok(completion::signature(d, at)),
            ),
            DocumentSymbolRequest::METHOD => {
                let start = |p: &DocumentSymbolParams| {
                    TextDocumentPositionParams::new(p.text_document.clone(), Position::default())
                };
                self.at::<DocumentSymbolRequest>(request, start, |d, _, _| {
                    Ok(Some(DocumentSymbolResponse::Nested(names::symbols(d))))
                })
            }
            Formatting::METHOD => {
                let start = |p: &DocumentFormattingParams| {
                    TextDocumentPositionParams::new(p.text_document.clone(), Position::default())
                };
                self.at::<Formatting>(request, start, |d, _, _| Ok(formatted(d)))
            }
            CodeActionRequest::METHOD => {
                let start =
                    |p: &CodeActionParams| TextDocumentPositionParams::new(p.text_document.clone(), p.range.start);
                self.at::<CodeActionRequest>(request, start, |d, _, p| {
                    let actions = findings::actions(d, &p.text_document.uri, p.range);
                    Ok(Some(actions.into_iter().map(CodeActionOrCommand::CodeAction).collect()))
                })
            }
            method => {
                let message = format!("`{method}` is not served");
                Response::new_err(request.id, ErrorCode::MethodNotFound as i32, message)
            }
        }
    }

    /// Answers a question about a place in an open text.
    fn at<R: Question>(
        &self,
        request: Request,
        place: impl Fn(&R::Params) -> TextDocumentPositionParams,
        answer: impl FnOnce(&Document, usize, R::Params) -> Result<R::Result, String>,
    ) -> Response {
        let refused = |id, code: ErrorCode, message| Response::new_err(id, code as i32, message);
        let params: R::Params = match serde_json::from_value(request.params) {
            Ok(params) => params,
            Err(e) => return refused(request.id, ErrorCode::InvalidParams, e.to_string()),
        };
        let TextDocumentPositionParams { text_document, position } = place(&params);
        let Some(Open { document, .. }) = self.documents.get(text_document.uri.as_str()) else {
            return refused(request.id, ErrorCode::InvalidParams, "this text is not open".into());
        };
        let offset = offset(document, position);
        match answer(document, offset, params).map(|a| serde_json::to_value(a).unwrap_or(Value::Null)) {
            Ok(value) => Response::new_ok(request.id, value),
            Err(reason) => refused(request.id, ErrorCode::RequestFailed, reason),
        }
    }
}

/// A span in the protocol's words.
fn range(document: &Document, span: Span) -> Range {
    let [start, end] = document.range(span).map(|p| Position::new(p.line, p.character));
    Range::new(start, end)
}

/// The byte of a place.
fn offset(document: &Document, position: Position) -> usize {
    document.offset(document::Position { line: position.line, character: position.character })
}

/// The text after the editor's changes, each of which sees the one before.
fn changed(document: &Document, changes: Vec<TextDocumentContentChangeEvent>) -> Document {
    let name = document.source.name();
    let one = |before: Document, change: TextDocumentContentChangeEvent| {
        let text = match change.range {
            Some(range) => {
                let (start, end) = (offset(&before, range.start), offset(&before, range.end));
                let mut text = before.text().to_string();
                text.replace_range(start.min(end)..end.max(start), &change.text);
                text
            }
            None => change.text,
        };
        Document::new(name, text)
    };
    changes.into_iter().fold(Document::new(name, document.text().to_string()), one)
}

/// The text laid out, when it is not and can be.
fn formatted(document: &Document) -> Option<Vec<TextEdit>> {
    let text = format::format(&document.source).ok()?;
    if text == document.text() {
        return Some(Vec::new());
    }
    Some(vec![TextEdit::new(range(document, Span::new(0, document.text().len())), text)])
}

fn published(params: PublishDiagnosticsParams) -> Message {
    Notification::new(PublishDiagnostics::METHOD.into(), params).into()
}
