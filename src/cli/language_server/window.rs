//! The language server for one text in a window of `fdm studio`, in the same process.

use super::serve;
use lsp_server::{Connection, Message, Notification, Request};
use serde_json::{Value, json};

/// The name of the text.
const URI: &str = "file:///model.fdm";

/// The window's side of a conversation.
struct Window {
    connection: Connection,
    last: i32,
    text: Option<String>,
}

impl Window {
    /// The answer to a question; null where the server has gone.
    fn ask(&mut self, method: &str, params: Value) -> Value {
        self.last += 1;
        let sent = self.connection.sender.send(Request::new(self.last.into(), method.into(), params).into());
        while sent.is_ok() {
            match self.connection.receiver.recv() {
                Ok(Message::Response(found)) if found.id == self.last.into() => {
                    return found.response_result.unwrap_or_default();
                }
                // findings are told elsewhere
                Ok(_) => {}
                Err(_) => break,
            }
        }
        Value::Null
    }

    fn tell(&self, method: &str, params: Value) {
        let _ = self.connection.sender.send(Notification::new(method.into(), params).into());
    }

    fn open(&mut self, text: &str) {
        let document = json!({ "uri": URI, "version": self.last });
        match &self.text {
            Some(own) if own == text => return,
            Some(_) => {
                self.tell(
                    "textDocument/didChange",
                    json!({ "textDocument": document, "contentChanges": [{ "text": text }] }),
                );
            }
            None => {
                self.ask("initialize", json!({ "capabilities": {} }));
                self.tell("initialized", json!({}));
                let item = json!({ "uri": URI, "version": 0, "languageId": "fdm", "text": text });
                self.tell("textDocument/didOpen", json!({ "textDocument": item }));
            }
        }
        self.text = Some(text.into());
    }
}

/// Answers questions about texts: text, method of the protocol, line and column (UTF-16) from 0; the answer is JSON.
pub(crate) fn answering() -> fdm_studio::Language {
    let (connection, server) = Connection::memory();
    // it ends with the window's side; where no thread can be had nothing is answered
    let _ = std::thread::Builder::new().name("language server".into()).spawn(move || serve(&server));
    let mut window = Window { connection, last: 0, text: None };
    Box::new(move |text, method, (line, character)| {
        window.open(text);
        let place = json!({ "textDocument": { "uri": URI }, "position": { "line": line, "character": character } });
        window.ask(method, place).to_string()
    })
}
