//! The page from its first to its last line.

use super::figure::Figure;
use super::subject::Subject;
use super::{
    convergence, correlations, diagnosis, drawing, equations, headline, histories, modes, parameters, reproduction,
    residuals, spectra,
};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use sha2::{Digest, Sha256};

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("figure.js");

/// A part of the page that can be pointed at.
pub(super) struct Section {
    /// The name by which links find it.
    pub(super) anchor: &'static str,
    /// Above it, and in the list of contents.
    pub(super) title: &'static str,
    pub(super) content: Markup,
}

impl Section {
    pub(super) fn new(anchor: &'static str, title: &'static str, content: Markup) -> Self {
        Self { anchor, title, content }
    }
}

/// The whole page; the same subject gives the same text.
pub fn page(subject: &Subject) -> String {
    let sections = match subject.diagnosis.is_some() {
        true => diagnosis::sections(subject).into_iter().chain(reproduction::section(subject)).collect(),
        false => of_fit(subject),
    };
    let anchors: Vec<&str> = sections.iter().map(|s| s.anchor).collect();
    let title = format!("{}: {}", subject.name(), headline::kind(subject));
    let markup = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(policy());
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                meta name="generator" content={ "fdm " (env!("CARGO_PKG_VERSION")) };
                link rel="icon" href="data:,";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                header {
                    p.kind { (headline::kind(subject)) }
                    button #theme type="button" title="light or dark" aria-label="switch between light and dark" hidden { "◐" }
                    h1 { (subject.name()) }
                    @if let Some(doc) = headline::doc(subject) { p.doc { (doc) } }
                    (headline::verdict(subject, &anchors))
                    nav aria-label="contents" {
                        @for s in &sections { a href={ "#" (s.anchor) } { (s.title) } }
                    }
                }
                main {
                    @for s in &sections {
                        section id=(s.anchor) { h2 { (s.title) } (s.content) }
                    }
                }
                footer {
                    p { "Made by fdm " (env!("CARGO_PKG_VERSION")) ". This page asks nothing of a network. In figures: drag, pinch or Ctrl + wheel "
                        "to zoom, double click to see all again; arrow keys move the crosshair." }
                }
                script { (PreEscaped(SCRIPT)) }
            }
        }
    };
    markup.into_string()
}

/// A figure of a page, to be drawn as a file of its own.
#[derive(Debug, Clone)]
pub struct Drawing(Figure);

impl Drawing {
    /// The name by which it is asked for.
    pub fn name(&self) -> &str {
        &self.0.id
    }

    /// What it shows.
    pub fn caption(&self) -> &str {
        &self.0.caption
    }

    /// SVG on white, with caption and key.
    pub fn svg(&self) -> String {
        drawing::alone(&self.0)
    }
}

/// Every figure of the page that has axes of its own, in the order of the page.
pub fn drawings(subject: &Subject) -> Vec<Drawing> {
    let figures = match subject.diagnosis.is_some() {
        true => diagnosis::figures(subject),
        false => {
            let all = [histories::figures, residuals::figures, spectra::figures, convergence::figures];
            all.into_iter().flat_map(|of| of(subject)).collect()
        }
    };
    figures.into_iter().map(Drawing).collect()
}

fn of_fit(subject: &Subject) -> Vec<Section> {
    let all = [
        equations::section(subject),
        parameters::section(subject),
        histories::section(subject),
        residuals::section(subject),
        spectra::section(subject),
        correlations::section(subject),
        modes::section(subject),
        convergence::section(subject),
        convergence::lengths(subject),
        reproduction::section(subject),
    ];
    all.into_iter().flatten().collect()
}

/// No request to anywhere, and no script but the page's own, known by its fingerprint.
fn policy() -> String {
    let hash = base64(&Sha256::digest(SCRIPT.as_bytes()));
    format!(
        "default-src 'none'; script-src 'sha256-{hash}'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"
    )
}

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for chunk in bytes.chunks(3) {
        let word = (0..3).fold(0_u32, |word, k| word << 8 | u32::from(chunk.get(k).copied().unwrap_or(0)));
        for k in 0..4 {
            let letter = LETTERS[(word >> (18 - 6 * k) & 63) as usize] as char;
            text.push(if k <= chunk.len() { letter } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fingerprints_are_written_as_browsers_read_them() {
        assert_eq!(base64(b"any carnal pleas"), "YW55IGNhcm5hbCBwbGVhcw==");
        assert_eq!(base64(b"any carnal pleasu"), "YW55IGNhcm5hbCBwbGVhc3U=");
        assert_eq!(base64(b"any carnal pleasur"), "YW55IGNhcm5hbCBwbGVhc3Vy");
    }

    #[test]
    fn the_script_is_whole_and_short() {
        assert!(!SCRIPT.contains("</script") && SCRIPT.lines().count() < 400);
        assert!(!STYLE.contains("</style") && !STYLE.contains("url("));
    }
}
