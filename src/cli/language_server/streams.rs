//! Messages over standard input and output. What is no message is answered as JSON-RPC says, and the next one is read; no length
//! that an editor names is taken on trust.

use super::ServerError;
use lsp_server::{Connection, ErrorCode, Message};
use serde_json::{Value, json};
use std::io::{self, BufRead, Read, Write};
use std::thread::{Builder, JoinHandle};

/// Most bytes of a message; a longer one is left unread.
const MOST_BYTES: u64 = 64 << 20;
/// Most bytes of a line of a message's head.
const MOST_OF_LINE: u64 = 8 << 10;

/// The threads that read and write.
pub(super) struct Threads {
    reader: JoinHandle<io::Result<()>>,
    writer: JoinHandle<io::Result<()>>,
}

/// A connection with whoever holds the other ends of standard input and output.
pub(super) fn standard() -> Result<(Connection, Threads), ServerError> {
    let (server, editor) = Connection::memory();
    let Connection { sender, receiver } = editor;
    let read = move || {
        let mut input = io::stdin().lock();
        while let Some(found) = next(&mut input)? {
            let message = match found {
                Ok(message) => message,
                Err(refused) => {
                    tell(&refused.answer().to_string())?;
                    continue;
                }
            };
            let is_exit = matches!(&message, Message::Notification(n) if n.method == "exit");
            // nobody listens any more after the server has ended
            if sender.send(message).is_err() || is_exit {
                break;
            }
        }
        Ok(())
    };
    let write = move || receiver.into_iter().try_for_each(|message| message.write(&mut io::stdout().lock()));
    let reader = Builder::new().name("reader".into()).spawn(read)?;
    let writer = Builder::new().name("writer".into()).spawn(write)?;
    Ok((server, Threads { reader, writer }))
}

impl Threads {
    /// Waits until both have ended.
    pub(super) fn join(self) -> io::Result<()> {
        let ended = |thread: JoinHandle<io::Result<()>>| {
            thread.join().unwrap_or_else(|_| Err(io::Error::other("a thread has ended early")))
        };
        ended(self.reader).and(ended(self.writer))
    }
}

/// Why bytes are no message.
#[derive(Debug)]
struct Refused {
    code: ErrorCode,
    reason: String,
    /// The number of the request, where it can be read.
    id: Value,
}

impl Refused {
    fn new(code: ErrorCode, reason: impl Into<String>) -> Self {
        Self { code, reason: reason.into(), id: Value::Null }
    }

    fn answer(&self) -> Value {
        json!({"jsonrpc": "2.0", "id": self.id, "error": {"code": self.code as i32, "message": self.reason}})
    }
}

fn tell(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    write!(out, "Content-Length: {}\r\n\r\n{text}", text.len())?;
    out.flush()
}

/// The next message, or why what came is none; nothing at the end.
fn next(input: &mut impl BufRead) -> io::Result<Option<Result<Message, Refused>>> {
    let (mut length, mut any) = (None, false);
    loop {
        let mut line = Vec::new();
        let read = input.by_ref().take(MOST_OF_LINE).read_until(b'\n', &mut line)?;
        if read == 0 {
            return Ok(None);
        }
        let line = String::from_utf8_lossy(&line);
        let line = line.trim();
        match line.split_once(':') {
            _ if line.is_empty() && any => break,
            _ if line.is_empty() => {}
            Some((name, value)) if name.trim().eq_ignore_ascii_case("content-length") => {
                any = true;
                length = Some(value.trim().to_string());
            }
            _ => any = true,
        }
    }
    let Some(length) = length else {
        let reason = "a message begins with Content-Length: and the number of its bytes";
        return Ok(Some(Err(Refused::new(ErrorCode::InvalidRequest, reason))));
    };
    // where a message ends that does not say its length nobody knows
    let Ok(bytes) = length.parse::<u64>() else {
        let reason = "Content-Length is not a number of bytes";
        tell(&Refused::new(ErrorCode::InvalidRequest, reason).answer().to_string())?;
        return Err(io::Error::other(reason));
    };
    if bytes > MOST_BYTES {
        // told at once, for all of it may never come
        let reason = format!("a message of {bytes} bytes is too long: at most {MOST_BYTES} are read");
        tell(&Refused::new(ErrorCode::InvalidRequest, reason).answer().to_string())?;
        io::copy(&mut input.by_ref().take(bytes), &mut io::sink())?;
        return next(input);
    }
    let mut body = Vec::new();
    if (input.by_ref().take(bytes).read_to_end(&mut body)? as u64) < bytes {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    Ok(Some(message(&body)))
}

fn message(body: &[u8]) -> Result<Message, Refused> {
    let value: Value = serde_json::from_slice(body)
        .map_err(|e| Refused::new(ErrorCode::ParseError, format!("a message that is not JSON: {e}")))?;
    let id = value.get("id").filter(|id| id.is_i64() || id.is_string()).cloned().unwrap_or_default();
    serde_json::from_value(value).map_err(|_| Refused {
        id,
        ..Refused::new(ErrorCode::InvalidRequest, "neither a request nor a notification nor a response")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &str) -> Vec<String> {
        let mut input = text.as_bytes();
        let mut found = Vec::new();
        loop {
            match next(&mut input) {
                Ok(Some(Ok(Message::Notification(n)))) => found.push(n.method),
                Ok(Some(Ok(other))) => found.push(format!("{other:?}")),
                Ok(Some(Err(refused))) => found.push((refused.code as i32).to_string()),
                Ok(None) => return found,
                Err(e) => {
                    found.push(e.to_string());
                    return found;
                }
            }
        }
    }

    fn framed(body: &str) -> String {
        format!("Content-Length: {}\r\n\r\n{body}", body.len())
    }

    #[test]
    fn what_is_no_message_is_refused_and_the_next_one_is_read() {
        let good = framed(r#"{"jsonrpc":"2.0","method":"go"}"#);
        for (bad, code) in [
            (framed("{\"jsonrpc\": "), "-32700"),
            (framed("\u{1b}[2J"), "-32700"),
            (framed(&"[".repeat(100_000)), "-32700"),
            (framed("[]"), "-32600"),
            (framed("{\"id\": 3}"), "-32600"),
            (framed(""), "-32700"),
            ("Content-Type: text\r\n\r\n".into(), "-32600"),
        ] {
            assert_eq!(all(&format!("{bad}{good}{bad}{good}")), [code, "go", code, "go"], "{bad:.60}");
        }
        assert_eq!(all(&format!("{good}Content-Length: many\r\n\r\n{good}")).len(), 2);
        assert_eq!(all(&format!("{good}Content-Length: 99\r\n\r\nshort")).len(), 2);
    }
}
