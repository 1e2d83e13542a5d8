//! The language server as an editor meets it: `fdm lsp` is started and spoken to over its standard streams.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdin, ChildStdout, Stdio};

const ADDRESS: &str = "file:///models/pitch.fdm";

const PITCH: &str = "model pitch \"pitch rate\" {
  input stick [deg];
  state q \"pitch rate\" [deg/s], θ [deg] = free;
  param a = 0.8 in [0, 9] [1/s] \"damping\", K = 1.5 [1/s^2];
  der(q) = -a*q + K*stick; /* 𝛼𝛽 */ der(θ) = q;
  output q_m [deg/s] = q, θ_m [deg] = θ + measured(q_m)*0/a;
  prior a ~ normal(1, 0.5), θ(0) ~ normal(0, 1);
  noise q_m = 0.1;
  trim { stick = 5; }
}
";

/// An editor with nothing but the conversation.
struct Editor {
    server: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    last: i64,
    version: i64,
    published: Vec<Value>,
}

impl Editor {
    fn start() -> Self {
        let mut command = support::fdm();
        let mut server =
            command.arg("lsp").stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("the server starts");
        let to = server.stdin.take().expect("its input");
        let from = BufReader::new(server.stdout.take().expect("its output"));
        let mut editor = Editor { server, to, from, last: 0, version: 0, published: Vec::new() };
        let answer = editor.ask("initialize", json!({"processId": null, "rootUri": null, "capabilities": {}}));
        assert_eq!(answer["serverInfo"]["name"], "fdm");
        assert_eq!(answer["capabilities"]["hoverProvider"], true);
        editor.tell("initialized", json!({}));
        editor
    }

    /// With a text open, and its findings.
    fn open(text: &str) -> (Self, Vec<Value>) {
        let mut editor = Self::start();
        let document = json!({"uri": ADDRESS, "languageId": "fdm", "version": 0, "text": text});
        editor.tell("textDocument/didOpen", json!({"textDocument": document}));
        let found = editor.findings();
        (editor, found)
    }

    fn send(&mut self, message: &Value) {
        let text = message.to_string();
        write!(self.to, "Content-Length: {}\r\n\r\n{text}", text.len()).expect("the server listens");
        self.to.flush().expect("the server listens");
    }

    fn tell(&mut self, method: &str, params: Value) {
        self.send(&json!({"jsonrpc": "2.0", "method": method, "params": params}));
    }

    fn receive(&mut self) -> Value {
        let mut length = 0;
        loop {
            let mut line = String::new();
            assert!(self.from.read_line(&mut line).expect("the server speaks") > 0, "the server has gone");
            match line.trim().strip_prefix("Content-Length: ") {
                Some(number) => length = number.parse().expect("a length"),
                None if line.trim().is_empty() => break,
                None => {}
            }
        }
        let mut body = vec![0; length];
        self.from.read_exact(&mut body).expect("the server speaks");
        serde_json::from_slice(&body).expect("JSON")
    }

    /// The whole answer to a question.
    fn reply(&mut self, method: &str, params: Value) -> Value {
        self.last += 1;
        let id = self.last;
        self.send(&json!({"jsonrpc": "2.0", "id": id, "method": method, "params": params}));
        loop {
            let message = self.receive();
            if message["id"] == id {
                return message;
            }
            self.published.push(message);
        }
    }

    fn ask(&mut self, method: &str, params: Value) -> Value {
        let mut reply = self.reply(method, params);
        assert!(reply.get("error").is_none(), "{method}: {reply}");
        reply["result"].take()
    }

    /// A question about a place; line and column from 0, in UTF-16 units.
    fn at(&mut self, method: &str, line: u32, column: u32) -> Value {
        self.ask(method, place(line, column))
    }

    /// The findings of the version that is open.
    fn findings(&mut self) -> Vec<Value> {
        let version = self.version;
        loop {
            let message = if self.published.is_empty() { self.receive() } else { self.published.remove(0) };
            let params = &message["params"];
            if message["method"] == "textDocument/publishDiagnostics" && params["version"] == version {
                return params["diagnostics"].as_array().expect("findings").clone();
            }
        }
    }

    fn change(&mut self, changes: Value) {
        self.version += 1;
        let document = json!({"uri": ADDRESS, "version": self.version});
        self.tell("textDocument/didChange", json!({"textDocument": document, "contentChanges": changes}));
    }

    fn leave(mut self) {
        assert_eq!(self.ask("shutdown", Value::Null), Value::Null);
        self.tell("exit", Value::Null);
        drop(self.to);
        assert!(self.server.wait().expect("the server ends").success());
    }
}

fn place(line: u32, column: u32) -> Value {
    json!({"textDocument": {"uri": ADDRESS}, "position": {"line": line, "character": column}})
}

fn with(mut params: Value, name: &str, value: Value) -> Value {
    params[name] = value;
    params
}

/// `line:from-to` of ranges.
fn ranges(list: &Value) -> Vec<String> {
    let one = |item: &Value| {
        let range = if item["range"].is_null() { item } else { &item["range"] };
        let (start, end) = (&range["start"], &range["end"]);
        assert_eq!(start["line"], end["line"]);
        format!("{}:{}-{}", start["line"], start["character"], end["character"])
    };
    list.as_array().expect("a list").iter().map(one).collect()
}

fn labels(list: &Value) -> Vec<&str> {
    list.as_array().expect("a list").iter().filter_map(|i| i["label"].as_str()).collect()
}

#[test]
fn findings_follow_the_keys() {
    let (mut editor, found) = Editor::open(PITCH);
    assert!(found.is_empty(), "{found:?}");
    // `K*stick` becomes `K*stik`, counted behind a Greek letter
    let range = json!({"start": {"line": 4, "character": 20}, "end": {"line": 4, "character": 25}});
    editor.change(json!([{"range": range, "text": "stik"}]));
    let found = editor.findings();
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(
        (&found[0]["code"], &found[0]["severity"], &found[0]["source"]),
        (&json!("E0201"), &json!(1), &json!("fdm"))
    );
    assert_eq!(found[0]["message"], "`stik` is not declared\ndid you mean `stick`?");
    assert_eq!(ranges(&json!([found[0]])), ["4:20-24"]);

    let asked =
        json!({"textDocument": {"uri": ADDRESS}, "range": found[0]["range"], "context": {"diagnostics": found}});
    let fixes = editor.ask("textDocument/codeAction", asked);
    let edits = &fixes[0]["edit"]["changes"][ADDRESS];
    assert_eq!((&fixes[0]["title"], &edits[0]["newText"]), (&json!("Write `stick`"), &json!("stick")));
    editor.change(json!([{"range": edits[0]["range"], "text": edits[0]["newText"]}]));
    assert!(editor.findings().is_empty());

    // two edits in one message, the second sees the first; behind surrogate pairs columns count twice
    let second = json!({"start": {"line": 5, "character": 23}, "end": {"line": 5, "character": 24}});
    let first = json!({"start": {"line": 4, "character": 38}, "end": {"line": 4, "character": 49}});
    editor.change(json!([{"range": first, "text": "// "}, {"range": second, "text": "g"}]));
    let codes: Vec<Value> = editor.findings().iter().map(|f| f["code"].clone()).collect();
    assert!(codes.contains(&json!("E0401")), "the equation of θ is a comment now: {codes:?}");
    editor.change(json!([{"text": PITCH.replace("param a", "param b = 1, a")}]));
    let found = editor.findings();
    assert_eq!((&found[0]["code"], &found[0]["tags"]), (&json!("W0702"), &json!([1])), "{found:?}");
    editor.change(json!([{"text": PITCH.replace("state q", "input q [deg/s]; state q")}]));
    let found = editor.findings();
    let related = &found[0]["relatedInformation"][0];
    assert_eq!(related["message"], "first declared here, as input", "{found:?}");
    assert_eq!(ranges(&json!([related["location"]])), ["2:8-9"]);
    editor.tell("textDocument/didClose", json!({"textDocument": {"uri": ADDRESS}}));
    editor.leave();
}

#[test]
fn effects_are_read_as_effects() {
    let text = std::fs::read_to_string(support::repository().join("models/effects.fdm")).expect("effects");
    let (mut editor, found) = Editor::open(&text);
    assert!(found.is_empty(), "{found:?}");
    editor.change(json!([{"text": text.replace("clip(i, -limit, limit)", "clip(i, -limt, limit)")}]));
    let found = editor.findings();
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(found[0]["message"], "`limt` is not declared\ndid you mean `limit`?");
    editor.leave();
}

#[test]
fn names_are_explained_found_and_renamed() {
    let (mut editor, _) = Editor::open(PITCH);
    let hover = editor.at("textDocument/hover", 4, 6);
    let text = hover["contents"]["value"].as_str().expect("Markdown");
    for part in ["state **q** in `deg/s`", "pitch rate", "der(q) = -a*q + K*stick;"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let hover = editor.at("textDocument/hover", 3, 8);
    let text = hover["contents"]["value"].as_str().expect("Markdown");
    for part in ["parameter **a** in `1/s`", "damping", "= 0.8 in [0, 9]", "prior a ~ normal(1, 0.5)", "estimated"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert!(
        editor.at("textDocument/hover", 5, 44)["contents"]["value"].as_str().is_some_and(|t| t.contains("measured(y)"))
    );
    assert_eq!(editor.at("textDocument/hover", 4, 30), Value::Null, "a comment");

    // behind two characters of two units each
    let place_of_theta = editor.at("textDocument/definition", 4, 43);
    assert_eq!(ranges(&json!([place_of_theta])), ["2:32-33"]);
    let context = json!({"includeDeclaration": true});
    let uses = editor.ask("textDocument/references", with(place(3, 8), "context", context));
    assert_eq!(ranges(&uses), ["3:8-9", "4:12-13", "5:58-59", "6:8-9"]);
    let context = json!({"includeDeclaration": false});
    let uses = editor.ask("textDocument/references", with(place(6, 28), "context", context));
    assert_eq!(ranges(&uses), ["4:42-43", "5:38-39", "6:28-29"]);
    assert_eq!(ranges(&editor.at("textDocument/documentHighlight", 7, 9)), ["5:9-12", "5:51-54", "7:8-11"]);

    let prepared = editor.at("textDocument/prepareRename", 8, 10);
    assert_eq!(prepared["placeholder"], "stick");
    let edit = editor.ask("textDocument/rename", with(place(5, 10), "newName", json!("gyro")));
    assert_eq!(ranges(&edit["changes"][ADDRESS]), ["5:9-12", "5:51-54", "7:8-11"]);
    for (new, why) in [
        ("q", "declared"),
        ("delay", "function"),
        ("param", "word"),
        ("t", "time"),
        ("2x", "not a name"),
        ("a.b", "not a name"),
        ("", "not a name"),
    ] {
        let reply = editor.reply("textDocument/rename", with(place(5, 10), "newName", json!(new)));
        assert!(reply["error"]["message"].as_str().is_some_and(|m| m.contains(why)), "{new}: {reply}");
    }
    let outline = editor.ask("textDocument/documentSymbol", json!({"textDocument": {"uri": ADDRESS}}));
    let children = outline[0]["children"].as_array().expect("declarations");
    let names: Vec<&str> = children.iter().filter_map(|c| c["name"].as_str()).collect();
    assert_eq!((outline[0]["name"].as_str(), names), (Some("pitch"), vec!["stick", "q", "θ", "a", "K", "q_m", "θ_m"]));
    editor.leave();
}

#[test]
fn what_can_be_typed_depends_on_the_place() {
    let text = "model m {\n  param tau = 0.1 [\n  state x [m] = s\n  der(x) = clip(x, ta\n  pa\n  // st\n}";
    let (mut editor, found) = Editor::open(text);
    assert!(!found.is_empty());
    let units = editor.at("textDocument/completion", 1, 19);
    assert!(labels(&units).contains(&"deg") && !labels(&units).contains(&"tau"), "{units}");
    let operands = editor.at("textDocument/completion", 2, 17);
    for wanted in ["sin", "free", "pi"] {
        assert!(labels(&operands).contains(&wanted), "{wanted}: {operands}");
    }
    let inside = editor.at("textDocument/completion", 3, 21);
    assert!(labels(&inside).contains(&"delay"), "{inside}");
    let help = editor.at("textDocument/signatureHelp", 3, 21);
    assert_eq!(
        (&help["signatures"][0]["label"], &help["activeParameter"]),
        (&json!("clip(x, lower, upper)"), &json!(1))
    );
    assert_eq!(editor.at("textDocument/completion", 5, 7), json!([]), "a comment");

    editor.change(json!([{"text": PITCH}]));
    editor.findings();
    let names = editor.at("textDocument/completion", 4, 11);
    let q = names.as_array().expect("a list").iter().find(|i| i["label"] == "q").expect("q").clone();
    assert_eq!(q["detail"], "state [deg/s]");
    let statements = editor.at("textDocument/completion", 7, 2);
    assert!(labels(&statements).contains(&"param") && labels(&statements).contains(&"der(q) = "), "{statements}");
    let attributes = editor.at("textDocument/completion", 3, 16);
    assert_eq!(labels(&attributes), ["in", "fixed", "per run", "log", "held", "linear"]);
    editor.leave();
}

#[test]
fn texts_are_laid_out() {
    let (mut editor, _) = Editor::open("model a{output y=x;param x=1;}// end");
    let asked = json!({"textDocument": {"uri": ADDRESS}, "options": {"tabSize": 8, "insertSpaces": false}});
    let edits = editor.ask("textDocument/formatting", asked.clone());
    assert_eq!(edits[0]["newText"], "model a {\n  output y = x;\n  param x = 1;\n}  // end\n");
    assert_eq!(edits[0]["range"]["end"], json!({"line": 0, "character": 36}));
    editor.change(json!([{"text": edits[0]["newText"]}]));
    assert_eq!(editor.ask("textDocument/formatting", asked.clone()), json!([]));
    editor.change(json!([{"text": "model a { output = ; }"}]));
    assert_eq!(editor.ask("textDocument/formatting", asked), Value::Null, "what cannot be read is left alone");
    editor.leave();
}

#[test]
fn nothing_that_is_typed_ends_it() {
    let (mut editor, _) = Editor::open("");
    let everywhere = |editor: &mut Editor, line: u32, column: u32| {
        for method in ["hover", "definition", "completion", "signatureHelp", "documentHighlight", "prepareRename"] {
            editor.at(&format!("textDocument/{method}"), line, column);
        }
    };
    // as it is typed, key by key
    for length in (0..PITCH.len()).step_by(7).filter(|k| PITCH.is_char_boundary(*k)) {
        editor.change(json!([{"text": &PITCH[..length]}]));
        let line = PITCH[..length].matches('\n').count() as u32;
        everywhere(&mut editor, line, 1000);
        everywhere(&mut editor, line, 5);
    }
    for text in [
        "\u{feff}model",
        "\"",
        "/*",
        "[[[[",
        "model m { state x[3] [m]; der(x) = x[1; use \"a\" as b(",
        "}}};;;\r\r\n\0",
    ] {
        editor.change(json!([{"text": text}]));
        everywhere(&mut editor, 0, 3);
        everywhere(&mut editor, 9, 9);
    }
    let wild = json!({"start": {"line": 7, "character": 3}, "end": {"line": 0, "character": 1}});
    editor.change(json!([{"range": wild, "text": "x"}]));
    let refused = editor.reply(
        "textDocument/hover",
        json!({"textDocument": {"uri": "file:///other.fdm"}, "position": {"line": 0, "character": 0}}),
    );
    assert_eq!(refused["error"]["code"], -32602);
    assert_eq!(editor.reply("textDocument/hover", json!(3))["error"]["code"], -32602);
    assert_eq!(editor.reply("workspace/unheard", Value::Null)["error"]["code"], -32601);
    editor.tell("textDocument/didChange", json!({"nonsense": true}));
    editor.leave();
}

#[test]
fn what_is_no_message_is_answered_and_the_server_goes_on() {
    let (mut editor, _) = Editor::open(PITCH);
    for (body, code) in [("{\"jsonrpc\": ", -32700), ("\u{1b}]0;", -32700), ("[1, 2]", -32600), ("{\"id\": 7}", -32600)]
    {
        write!(editor.to, "Content-Length: {}\r\n\r\n{body}", body.len()).unwrap();
        editor.to.flush().unwrap();
        let answer = editor.receive();
        assert_eq!(answer["error"]["code"], code, "{answer}");
        assert_eq!(answer["id"], if code == -32600 && body.starts_with('{') { json!(7) } else { Value::Null });
        assert!(editor.at("textDocument/hover", 3, 8)["contents"].is_object());
    }
    // a length that no memory holds is refused at once, and what follows is not taken for messages
    write!(editor.to, "Content-Length: 99999999999999999\r\n\r\nabc").unwrap();
    editor.to.flush().unwrap();
    assert_eq!(editor.receive()["error"]["code"], -32600);
    drop(editor.to);
    let ended = editor.server.wait().unwrap();
    assert!(ended.code().is_some_and(|code| code < 3), "{ended}");
}

#[test]
fn a_burst_of_keys_in_a_large_text_is_answered_in_time() {
    let lines: Vec<String> = (0..2_000).map(|k| format!("  param p{k} = 1 [1/s] \"parameter {k}\";\n")).collect();
    let uses: Vec<String> = (0..2_000).map(|k| format!("p{k}")).collect();
    let text = format!("model large {{\n{}  output y = {};\n}}\n", lines.concat(), uses.join(" + "));
    let (mut editor, found) = Editor::open(&text);
    assert!(found.is_empty(), "{found:?}");
    let start = std::time::Instant::now();
    for _ in 0..30 {
        let range = json!({"start": {"line": 5, "character": 0}, "end": {"line": 5, "character": 0}});
        editor.change(json!([{"range": range, "text": " "}]));
    }
    assert!(
        editor.at("textDocument/hover", 3, 9)["contents"]["value"].as_str().is_some_and(|t| t.contains("parameter 2"))
    );
    assert!(editor.findings().is_empty());
    // in a debug build, on a loaded machine
    assert!(start.elapsed().as_secs() < 60, "{:?}", start.elapsed());
    editor.leave();
}
