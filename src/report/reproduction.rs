//! What it takes to get the same numbers again: the command, the files by their fingerprints, the program.

use super::section::Section;
use crate::page::subject::Subject;
use maud::html;

pub(crate) fn section(subject: &Subject) -> Option<Section> {
    let manifest = subject.manifest.as_ref()?;
    let content = html! {
        pre.command { code { (command(&manifest.command)) } }
        div.scroll { table.facts {
            tbody {
                tr { th scope="row" { "program" } td { "fdm " (manifest.fdm) } td {} }
                tr { th scope="row" { "model" } td { (manifest.model_file) } td { code { (manifest.identity.model().unwrap_or_default()) } } }
                @for data in &manifest.data {
                    tr {
                        th scope="row" { "run " (data.run) }
                        td { (data.file) }
                        td { code { (data.sha256.as_deref().unwrap_or("no file")) } }
                    }
                }
                @if let Some(seed) = manifest.seed { tr { th scope="row" { "seed" } td { (seed) } td {} } }
            }
        } }
        p.note { "Fingerprints are SHA-256. The same command on the same files gives the same bits, whatever the number of threads." }
        details { summary { "the model's text" } pre.text { (subject.source.text()) } }
    };
    Some(Section::drawn("reproduction", "To reproduce it", content))
}

/// The command as it can be typed; the program without its place.
fn command(words: &[String]) -> String {
    let quoted = |word: &String| {
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
        assert_eq!(command(&["/x/fdm", "fit", "a b.fdm", "it's"].map(String::from)), "fdm fit 'a b.fdm' 'it'\\''s'");
        assert_eq!(command(&[]), "fdm");
    }
}
