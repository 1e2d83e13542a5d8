//! The page from its first to its last line.

use super::drawing::Paper;
use super::figure::Figure;
use super::picture::Picture;
#[cfg(feature = "png")]
use super::raster::{self, RasterError};
use super::section::Section;
use super::subject::{Content, Subject};
use super::{
    convergence, correlations, diagnosis, drawing, equations, headline, histories, modes, parameters, progress,
    regression, reproduction, requirements, residuals, spectra, starts, study, surfaces,
};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use sha2::{Digest, Sha256};

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("figure.js");

/// The whole page; the same subject gives the same text.
pub fn page(subject: &Subject) -> String {
    let sections = match &subject.content {
        Content::AtWork(..) => of_work(subject),
        Content::Diagnosis(found) => {
            diagnosis::sections(subject, found).into_iter().chain(reproduction::section(subject)).collect()
        }
        Content::Result(_) => of_fit(subject),
    };
    let anchors: Vec<&str> = sections.iter().map(|s| s.anchor).collect();
    let head = Head {
        kind: headline::kind(subject),
        name: subject.name(),
        doc: headline::doc(subject),
        verdict: headline::verdict(subject, &anchors),
    };
    frame(&head, &sections)
}

/// What stands above the sections of a page.
pub(super) struct Head<'a> {
    /// What the page is about, in a word or two.
    pub(super) kind: &'a str,
    pub(super) name: &'a str,
    pub(super) doc: Option<&'a str>,
    pub(super) verdict: Markup,
}

/// A page around its sections.
pub(super) fn frame(head: &Head<'_>, sections: &[Section]) -> String {
    let title = format!("{}: {}", head.name, head.kind);
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
                    p.kind { (head.kind) }
                    button #theme type="button" title="light or dark" aria-label="switch between light and dark" hidden { "◐" }
                    h1 { (head.name) }
                    @if let Some(doc) = head.doc { p.doc { (doc) } }
                    (head.verdict)
                    nav aria-label="contents" {
                        @for s in sections { a href={ "#" (s.anchor) } { (s.title) } }
                    }
                }
                main {
                    @for s in sections {
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
pub struct Drawing(Drawn);

#[derive(Debug, Clone)]
enum Drawn {
    Figure(Figure),
    Picture(Picture),
}

impl Drawing {
    /// The name by which it is asked for.
    pub fn name(&self) -> &str {
        match &self.0 {
            Drawn::Figure(figure) => &figure.id,
            Drawn::Picture(picture) => &picture.id,
        }
    }

    /// What it shows.
    pub fn caption(&self) -> &str {
        match &self.0 {
            Drawn::Figure(figure) => &figure.caption,
            Drawn::Picture(picture) => &picture.caption,
        }
    }

    /// Pixels across of the drawing as it stands on the page.
    pub fn width(&self) -> u32 {
        match &self.0 {
            Drawn::Figure(figure) => drawing::size(figure).0 as u32,
            Drawn::Picture(picture) => picture.width as u32,
        }
    }

    /// SVG with caption and key.
    pub fn svg(&self, paper: Paper) -> String {
        match &self.0 {
            Drawn::Figure(figure) => drawing::alone(figure, paper),
            Drawn::Picture(picture) => picture.alone(paper),
        }
    }

    /// The figure as PNG, so many pixels wide: the same bytes on every machine.
    ///
    /// # Errors
    /// [`RasterError`].
    #[cfg(feature = "png")]
    pub fn png(&self, paper: Paper, width: u32) -> Result<Vec<u8>, RasterError> {
        raster::png(&self.svg(paper), width)
    }
}

/// Every figure of the page, in the order of the page.
pub fn drawings(subject: &Subject) -> Vec<Drawing> {
    if let Some(found) = subject.diagnosis() {
        return diagnosis::figures(subject, found).into_iter().map(|f| Drawing(Drawn::Figure(f))).collect();
    }
    let before = [
        study::figures,
        regression::figures,
        surfaces::figures,
        histories::figures,
        residuals::figures,
        spectra::figures,
    ];
    let before = before.into_iter().flat_map(|of| of(subject));
    let behind = starts::figure(subject).into_iter().chain(convergence::figures(subject));
    let pictures = modes::pictures(subject).into_iter().map(Drawn::Picture);
    let all = before.map(Drawn::Figure).chain(pictures).chain(behind.map(Drawn::Figure));
    all.map(Drawing).collect()
}

fn of_fit(subject: &Subject) -> Vec<Section> {
    let all = [
        equations::section(subject),
        parameters::section(subject),
        requirements::section(subject),
        surfaces::section(subject),
        histories::section(subject),
        residuals::section(subject),
        spectra::section(subject),
        correlations::section(subject),
        modes::section(subject),
        starts::section(subject),
        convergence::section(subject),
        convergence::lengths(subject),
        reproduction::section(subject),
    ];
    let first = study::sections(subject).into_iter().chain(regression::sections(subject));
    first.chain(all.into_iter().flatten()).collect()
}

/// Of work that goes on: what changes first.
fn of_work(subject: &Subject) -> Vec<Section> {
    let all = [
        convergence::section(subject),
        starts::section(subject),
        parameters::section(subject),
        equations::section(subject),
    ];
    let first = progress::section(subject).into_iter().chain(study::sections(subject));
    first.chain(all.into_iter().flatten()).collect()
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
        assert!(!SCRIPT.contains("</script") && SCRIPT.lines().count() < 420);
        assert!(!STYLE.contains("</style") && !STYLE.contains("url("));
    }
}
