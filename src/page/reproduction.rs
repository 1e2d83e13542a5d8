//! What it takes to get the same numbers again: the command, the files by their fingerprints, the program.

use super::document::Section;
use super::subject::{Subject, list};
use maud::html;
use serde_json::Value;

pub(super) fn section(subject: &Subject) -> Option<Section> {
    let manifest = &subject.manifest;
    let words: Vec<&str> = list(&manifest["command"]).iter().filter_map(Value::as_str).collect();
    let model = list(&manifest["identity"]["parts"]).iter().find(|p| p[0] == "model").and_then(|p| p[1].as_str());
    let content = html! {
        pre.command { code { (command(&words)) } }
        div.scroll { table.facts {
            tbody {
                tr { th scope="row" { "program" } td { "fdm " (manifest["fdm"].as_str().unwrap_or_default()) } td {} }
                tr { th scope="row" { "model" } td { (manifest["model_file"].as_str().unwrap_or_default()) } td { code { (model.unwrap_or_default()) } } }
                @for data in list(&manifest["data"]) {
                    tr {
                        th scope="row" { "run " (data["run"].as_str().unwrap_or_default()) }
                        td { (data["file"].as_str().unwrap_or_default()) }
                        td { code { (data["sha256"].as_str().unwrap_or("no file")) } }
                    }
                }
                @if let Some(seed) = manifest["seed"].as_u64() { tr { th scope="row" { "seed" } td { (seed) } td {} } }
            }
        } }
        p.note { "Fingerprints are SHA-256. The same command on the same files gives the same bits, whatever the number of threads." }
        details { summary { "the model's text" } pre.text { (subject.source.text()) } }
    };
    Some(Section::new("reproduction", "To reproduce it", content))
}

/// The command as it can be typed; the program without its place.
fn command(words: &[&str]) -> String {
    let quoted = |word: &&str| {
        let plain = |c: char| c.is_alphanumeric() || "-_./=:,+@%".contains(c);
        if !word.is_empty() && word.chars().all(plain) {
            word.to_string()
        } else {
            format!("'{}'", word.replace('\'', "'\\''"))
        }
    };
    let rest = words.get(1..).unwrap_or_default().iter().map(quoted);
    std::iter::once("fdm".to_string()).chain(rest).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_can_be_typed_again() {
        assert_eq!(command(&["/x/fdm", "fit", "a b.fdm", "it's"]), "fdm fit 'a b.fdm' 'it'\\''s'");
        assert_eq!(command(&[]), "fdm");
    }
}
