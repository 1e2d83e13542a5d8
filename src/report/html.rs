//! Reports as pages: one file that asks for no other, its sections with tables, figures and links between them.

use super::page::figure::Figure;
use super::page::number::unit;
use super::section::{Cell, Column, Kind, Mark, Medium, Part, Point, Report, Section, Table, Trust, Verdict};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use sha2::{Digest, Sha256};

const STYLE: &str = include_str!("page/page.css");
const SCRIPT: &str = include_str!("page/figure.js");
/// The table by which browsers place indices, fractions and roots, for machines without a math font.
const MATHEMATICS: &[u8] = include_bytes!("page/mathematics.ttf");
/// Points that stand at the top.
const FIRST: usize = 4;

/// The whole page; the same report gives the same text.
pub(crate) fn page(report: &Report) -> String {
    let title = format!("{}: {}", report.name, report.kind);
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
                style { (PreEscaped(style())) }
            }
            body {
                header {
                    p.kind { (report.kind) }
                    button #theme type="button" title="light or dark" aria-label="switch between light and dark" hidden { "◐" }
                    h1 { (report.name) }
                    @if let Some(doc) = &report.doc { p.doc { (doc) } }
                    (verdict(&report.verdict, &report.sections))
                    nav aria-label="contents" {
                        @for s in &report.sections { a href={ "#" (s.anchor) } { (s.title) } }
                    }
                }
                main {
                    @for s in &report.sections {
                        section id=(s.anchor) { h2 { (s.title) } (parts(&s.parts)) }
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

/// The style of all pages, behind the font of what formulas need beside letters.
pub(crate) fn style() -> String {
    let font = base64(MATHEMATICS);
    format!("@font-face {{ font-family: \"fdm mathematics\"; src: url(data:font/ttf;base64,{font}); }}\n{STYLE}")
}

/// Links lead to the sections that the page has.
fn verdict(verdict: &Verdict, sections: &[Section]) -> Markup {
    let linked = |point: &Point| sections.iter().any(|s| s.anchor == point.anchor);
    let one = |point: &Point| {
        html! { li { @if linked(point) { a href={ "#" (point.anchor) } { (quoted(&point.sentence)) } } @else { (quoted(&point.sentence)) } } }
    };
    let (first, rest) = verdict.points.split_at(FIRST.min(verdict.points.len()));
    html! {
        div class={ "verdict " (word(verdict.trust)) } role="status" {
            p.sentence { span.sign aria-hidden="true" { (sign(verdict.trust)) } (quoted(&verdict.sentence)) }
            @if let Some(facts) = &verdict.facts { p.facts { (facts) } }
            @if !first.is_empty() { ol { @for point in first { (one(point)) } } }
            @if !rest.is_empty() {
                details {
                    summary { (rest.len()) " more" }
                    ul { @for point in rest { (one(point)) } }
                }
            }
        }
    }
}

fn word(trust: Trust) -> &'static str {
    match trust {
        Trust::Good => "good",
        Trust::Reserved => "reserved",
        Trust::Bad => "bad",
        Trust::Open => "working",
    }
}

fn sign(trust: Trust) -> &'static str {
    match trust {
        Trust::Good => "✓",
        Trust::Reserved => "!",
        Trust::Bad => "✗",
        Trust::Open => "…",
    }
}

/// What stands between backticks is a name.
fn quoted(sentence: &str) -> Markup {
    html! { @for (k, part) in sentence.split('`').enumerate() { @if k % 2 == 1 { code { (part) } } @else { (typeset(part)) } } }
}

fn parts(all: &[Part]) -> Markup {
    html! { @for one in all { (part(one)) } }
}

fn part(part: &Part) -> Markup {
    match part {
        Part::Line(said) => html! { p { (quoted(said)) } },
        Part::Note(said) => html! { p.note { (quoted(said)) } },
        Part::Warning(said) => html! { p.warning { (quoted(said)) } },
        Part::Heading(said) => html! { h3 { (quoted(said)) } },
        Part::List(items) => html! { @if !items.is_empty() { ul { @for item in items { li { (quoted(item)) } } } } },
        Part::Table(own) => table(own),
        // by itself it has the whole width, on paper too: one drawn for half of it would have labels of twice the size
        Part::Figure(figure) => Figure { half: false, ..(**figure).clone() }.markup(),
        Part::Pair(figures) => html! { div.pair { @for figure in figures { (figure.clone().half().markup()) } } },
        Part::Folded { summary, open, class, parts: inside } => html! {
            details class=[Some(*class).filter(|c| !c.is_empty())] open[*open] { summary { (summary) } (parts(inside)) }
        },
        Part::Markup(markup) => markup.clone(),
        Part::Only(Medium::Page, inside) => self::part(inside),
        Part::Only(Medium::Text, _) | Part::Gap => html! {},
    }
}

fn table(table: &Table) -> Markup {
    let columns: Vec<&Column> = table.columns.iter().filter(|c| c.only != Some(Medium::Text) && !is_void(c)).collect();
    html! {
        @if let Some(caption) = &table.caption { p { (quoted(caption)) } }
        div.scroll { table class=[Some(table.class).filter(|c| !c.is_empty())] {
            thead { tr { @for c in &columns {
                th.number[is_number(c.kind)] title=[Some(c.hint).filter(|h| !h.is_empty())] { (typeset(&c.title)) }
            } } }
            tbody { @for row in 0..table.rows { tr { @for c in &columns { (cell(c.kind, &c.cells[row])) } } } }
        } }
    }
}

/// Whether a column of words says nothing at all: width is for what there is to say.
fn is_void(column: &Column) -> bool {
    let is_wordy = matches!(column.kind, Kind::Words | Kind::Unit | Kind::Sentence);
    is_wordy && column.cells.iter().all(|cell| cell.text.is_empty() && cell.markup.is_none())
}

fn is_number(kind: Kind) -> bool {
    matches!(kind, Kind::Number | Kind::Span)
}

fn cell(kind: Kind, cell: &Cell) -> Markup {
    let large = cell.mark != Mark::Plain;
    html! {
        @match kind {
            Kind::Name => th scope="row" { code { (cell.text) } (more(cell)) },
            Kind::Label => th scope="row" { (cell.text) (more(cell)) },
            Kind::Words => td.large[large] { (typeset(&cell.text)) (more(cell)) },
            Kind::Unit => td { (unit(&cell.text)) (more(cell)) },
            Kind::Sentence => td.reason { (quoted(&cell.text)) (more(cell)) },
            Kind::Number | Kind::Span => td.number.large[large] { (number(&cell.text)) (more(cell)) },
        }
    }
}

fn more(cell: &Cell) -> Markup {
    html! { @if let Some(markup) = &cell.markup { (markup) } }
}

/// Numbers with their own signs; a dash between two of them, and where there is none.
fn number(text: &str) -> String {
    if text == "-" {
        return "–".into();
    }
    let mut last = ' ';
    let sign = |c: char| {
        let before = std::mem::replace(&mut last, c);
        match c {
            '-' if before.is_ascii_digit() => '–',
            '-' => '\u{2212}',
            c => c,
        }
    };
    typeset(text).chars().map(sign).collect()
}

/// Signs that terminals do without.
fn typeset(text: &str) -> String {
    text.replace("R^2", "R²").replace("+-", "±").replace("Cramer-Rao", "Cramér–Rao").replace("D-W", "D–W")
}

/// No request to anywhere, and no script but the page's own, known by its fingerprint.
fn policy() -> String {
    let hash = base64(&Sha256::digest(SCRIPT.as_bytes()));
    format!(
        "default-src 'none'; script-src 'sha256-{hash}'; style-src 'unsafe-inline'; img-src data:; font-src data:; base-uri 'none'; form-action 'none'"
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
    fn numbers_have_signs_and_ranges_dashes() {
        let shown = ["-", "-1.5e-7", "94.1 (-3.0-99.5)", "-2 +- 1"].map(number);
        assert_eq!(shown, ["–", "−1.5e−7", "94.1 (−3.0–99.5)", "−2 ± 1"]);
    }

    #[test]
    fn the_script_is_whole_and_short() {
        assert!(!SCRIPT.contains("</script") && SCRIPT.lines().count() < 420);
        assert!(!STYLE.contains("</style") && !STYLE.contains("url("));
    }
}
