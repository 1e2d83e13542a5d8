//! A figure as SVG, for readers without scripts and for paper. The script draws the same at the size of the window.

use super::figure::{Figure, Mark, Panel, Shape};
use super::scale::Scale;
use super::thinning::kept;
use maud::{Markup, PreEscaped, html};
use std::fmt::Write;

/// Of a whole figure, and of one of two beside each other: on a sheet both are made as much smaller, so that their labels are equal.
const WIDTHS: [f64; 2] = [760.0, 370.0];
const LEFT: f64 = 66.0;
const RIGHT: f64 = 10.0;
const TOP: f64 = 8.0;
const GAP: f64 = 16.0;
const BOTTOM: f64 = 40.0;
/// What a file of its own looks like, in the colours of the page; programs that read such files know no variables.
const STYLE: &str = include_str!("alone.css");
const COLOURS: &str = include_str!("page.css");
/// Above the drawing of a file of its own: its caption and its key.
const HEAD: f64 = 44.0;
/// Points of a line on paper.
const MOST_POINTS: usize = 1500;

/// What a file of its own is drawn on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Paper {
    /// White.
    #[default]
    Light,
    /// As the page is in the dark.
    Dark,
}

impl Paper {
    /// The style with this paper's colours.
    fn style(self) -> String {
        let head = match self {
            Self::Light => ":root {",
            Self::Dark => ":root[data-theme=\"dark\"] {",
        };
        let block = COLOURS.split_once(head).and_then(|(_, rest)| rest.split('}').next()).unwrap_or_default();
        let colours = block.split(';').filter_map(|part| part.trim().strip_prefix("--")?.split_once(": "));
        colours.fold(STYLE.to_string(), |style, (name, colour)| style.replace(&format!("var(--{name})"), colour))
    }
}

/// Where a panel lies on the paper, and its axes.
struct Frame {
    x: Scale,
    y: Scale,
    width: f64,
    top: f64,
    height: f64,
}

impl Frame {
    fn across(&self, v: f64) -> f64 {
        LEFT + (self.width - LEFT - RIGHT) * self.x.share(v)
    }

    fn down(&self, v: f64) -> f64 {
        self.top + self.height * (1.0 - self.y.share(v))
    }
}

/// The whole figure, in the colours of the page that it stands on.
pub(crate) fn svg(figure: &Figure) -> Markup {
    let (width, height) = size(figure);
    html! {
        svg viewBox={ "0 0 " (width) " " (height) } width=(width) height=(height) role="img" aria-label=(figure.caption) { (body(figure, width, height)) }
    }
}

/// The figure as a file of its own, with its caption and its key.
pub(crate) fn alone(figure: &Figure, paper: Paper) -> String {
    stacked(std::slice::from_ref(figure), paper)
}

/// Figures below each other as one file, each with its caption and its key.
pub(crate) fn stacked(figures: &[Figure], paper: Paper) -> String {
    let sheet = |figure: &Figure| {
        let (width, height) = size(figure);
        Sheet { caption: figure.caption.clone(), key: key(figure), width, height, body: body(figure, width, height) }
    };
    file(&figures.iter().map(sheet).collect::<Vec<_>>(), paper)
}

/// A drawing with what stands above it: its caption and its key.
pub(crate) struct Sheet {
    pub(crate) caption: String,
    /// Empty, or the key of a figure.
    pub(crate) key: Markup,
    pub(crate) width: f64,
    pub(crate) height: f64,
    pub(crate) body: Markup,
}

/// Names of the marks beside short lines of their colours.
fn key(figure: &Figure) -> Markup {
    let marks = figure.key();
    // letters are seven pixels wide at most
    let places = marks.iter().scan(LEFT, |x, mark| {
        let here = *x;
        *x += 44.0 + 7.0 * mark.name.chars().count() as f64;
        Some(here)
    });
    html! {
        @for (mark, x) in marks.iter().zip(places) {
            line class={ "key " (mark.look.word()) } x1=(x) x2=(x + 18.0) y1="33" y2="33" {}
            text.label x=(x + 24.0) y="37" { (mark.name) }
        }
    }
}

/// Drawings below each other as a file.
pub(crate) fn file(sheets: &[Sheet], paper: Paper) -> String {
    let width = sheets.iter().map(|s| s.width).fold(WIDTHS[1], f64::max);
    let whole: f64 = sheets.iter().map(|s| HEAD + s.height).sum();
    let tops = sheets.iter().scan(0.0, |top, sheet| {
        let here = *top;
        *top += HEAD + sheet.height;
        Some(here)
    });
    let title = sheets.first().map_or("", |s| s.caption.as_str());
    let markup = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (width) " " (whole) } width=(width) height=(whole) font-family="sans-serif" {
            title { (title) }
            style { (PreEscaped(paper.style())) }
            rect.paper width=(width) height=(whole) {}
            @for (sheet, top) in sheets.iter().zip(tops) {
                g transform={ "translate(0 " (top) ")" } {
                    text.caption x=(if sheet.key.0.is_empty() { 12.0 } else { LEFT }) y="18" { (sheet.caption) }
                    (sheet.key)
                    g transform={ "translate(0 " (HEAD) ")" } { (sheet.body) }
                }
            }
        }
    };
    markup.into_string() + "\n"
}

/// Width and height on paper.
pub(crate) fn size(figure: &Figure) -> (f64, f64) {
    let panels: f64 = figure.panels.iter().map(|p| f64::from(p.height) + GAP).sum();
    (WIDTHS[usize::from(figure.half || figure.is_few())], TOP + panels - GAP + BOTTOM)
}

fn body(figure: &Figure, width: f64, height: f64) -> Markup {
    let x = Scale::around(figure.at.iter(), figure.margin(), figure.logarithmic);
    let mut top = TOP;
    let mut frames = Vec::new();
    for panel in &figure.panels {
        let values = panel.marks.iter().flat_map(|m| m.values.iter().chain(&m.low));
        let y = Scale::around(values, 0.04, panel.logarithmic);
        frames.push(Frame { x, y, width, top, height: f64::from(panel.height) });
        top += f64::from(panel.height) + GAP;
    }
    html! {
        @for (panel, frame) in figure.panels.iter().zip(&frames) { (drawn(figure, panel, frame)) }
        @if let Some(frame) = frames.last() {
            @for (v, label) in across(figure, &x, width) {
                text.tick x=(tenth(frame.across(v))) y=(tenth(frame.top + frame.height + 15.0)) text-anchor="middle" { (label) }
            }
            text.label x=(tenth((LEFT + width - RIGHT) / 2.0)) y=(tenth(height - 6.0)) text-anchor="middle" { (figure.label) }
        }
    }
}

/// The ticks of the axis across: the names of things where there is room for all, else round numbers, between things and whole numbers none.
fn across(figure: &Figure, x: &Scale, width: f64) -> Vec<(f64, String)> {
    let longest = figure.names.iter().map(|name| name.chars().count()).max();
    // letters are seven pixels wide at most, and two keep names apart
    if longest.is_some_and(|longest| (7 * (longest + 2) * figure.names.len()) as f64 <= width - LEFT - RIGHT) {
        return figure.at.iter().copied().zip(figure.names.iter().cloned()).collect();
    }
    let whole = !x.logarithmic && figure.at.iter().all(|v| v.fract() == 0.0);
    let most = if whole { (x.high - x.low) as usize } else { usize::MAX };
    let ticks = |count: usize| x.ticks(count.min(most).max(1));
    let room = (width / 95.0) as usize;
    let found = ticks(room);
    // one number says nothing of the scale
    if found.len() < 2 { ticks(2 * room) } else { found }
}

fn drawn(figure: &Figure, panel: &Panel, frame: &Frame) -> Markup {
    let (right, bottom) = (frame.width - RIGHT, frame.top + frame.height);
    let middle = tenth(frame.top + frame.height / 2.0);
    html! {
        @for (v, _) in across(figure, &frame.x, frame.width) {
            line.grid x1=(tenth(frame.across(v))) x2=(tenth(frame.across(v))) y1=(tenth(frame.top)) y2=(tenth(bottom)) {}
        }
        @for (v, label) in frame.y.ticks((panel.height / 30) as usize) {
            line.grid x1=(LEFT) x2=(right) y1=(tenth(frame.down(v))) y2=(tenth(frame.down(v))) {}
            text.tick x=(LEFT - 6.0) y=(tenth(frame.down(v) + 4.0)) text-anchor="end" { (label) }
        }
        rect.frame x=(LEFT) y=(tenth(frame.top)) width=(right - LEFT) height=(tenth(frame.height)) {}
        @for mark in &panel.marks { (marked(figure, mark, frame)) }
        text.label transform={ "translate(13 " (middle) ") rotate(-90)" } text-anchor="middle" { (panel.label) }
    }
}

fn marked(figure: &Figure, mark: &Mark, frame: &Frame) -> Markup {
    let places = kept(&[&mark.values], MOST_POINTS);
    let places: Vec<usize> = places.into_iter().filter(|k| *k < figure.at.len()).collect();
    let foot = |k: usize| mark.low.get(k).copied().unwrap_or(0.0);
    let at = |k: usize, v: f64| (frame.across(figure.at[k]), frame.down(v));
    let class = format!("{} {}", mark.look.word(), if mark.shape == Shape::Band { "band" } else { "line" });
    match mark.shape {
        Shape::Dots => html! {
            @for (x, y) in places.iter().map(|k| at(*k, mark.values[*k])).filter(|(x, y)| x.is_finite() && y.is_finite()) {
                circle class={ "dot " (mark.look.word()) } cx=(tenth(x)) cy=(tenth(y)) r="2.2" {}
            }
        },
        Shape::Line => html! { path class=(class) d=(path(places.iter().map(|k| at(*k, mark.values[*k])))) {} },
        Shape::Band => {
            let upper = places.iter().map(|k| at(*k, mark.values[*k]));
            let lower = places.iter().rev().map(|k| at(*k, foot(*k)));
            let all: Vec<(f64, f64)> = upper.chain(lower).filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
            html! { path class=(class) d={ (path(all.into_iter())) "Z" } {} }
        }
        Shape::Columns => {
            let half = 0.5 * spacing(&figure.at);
            let mut d = String::new();
            for k in places.into_iter().filter(|k| mark.values[*k].is_finite()) {
                let edge = |v: f64| frame.across(v);
                let (left, right) = (edge(figure.at[k] - half), edge(figure.at[k] + half));
                let (low, high) = (frame.down(foot(k)), frame.down(mark.values[k]));
                d.push_str(&path([(left, low), (left, high), (right, high), (right, low)].into_iter()));
            }
            html! { path class={ (mark.look.word()) " columns" } d=(d) {} }
        }
        Shape::Stems | Shape::Bars => {
            let mut d = String::new();
            for k in places {
                d.push_str(&path([at(k, foot(k)), at(k, mark.values[k])].into_iter()));
            }
            html! { path class={ (class) " " (if mark.shape == Shape::Bars { "bars" } else { "stems" }) } d=(d) {} }
        }
    }
}

/// The least distance of two places.
fn spacing(at: &[f64]) -> f64 {
    let least = at.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min);
    if least.is_finite() { least } else { 1.0 }
}

/// Points as a path that breaks where there is none; a point alone is a dot.
fn path(points: impl Iterator<Item = (f64, f64)>) -> String {
    let mut text = String::new();
    let (mut before, mut last) = (0, (0, 0));
    for (x, y) in points {
        if !(x.is_finite() && y.is_finite()) {
            text.push_str(if before == 1 { "h0" } else { "" });
            before = 0;
            continue;
        }
        // tenths of a pixel, and only what changes
        let here = ((x * 10.0).round() as i64, (y * 10.0).round() as i64);
        let _ = match before {
            0 => write!(text, "M{} {}", tenths(here.0), tenths(here.1)),
            _ => write!(text, "l{} {}", tenths(here.0 - last.0), tenths(here.1 - last.1)),
        };
        (before, last) = (before + 1, here);
    }
    text.push_str(if before == 1 { "h0" } else { "" });
    text
}

fn tenths(v: i64) -> String {
    let sign = if v < 0 { "-" } else { "" };
    match (v.abs() / 10, v.abs() % 10) {
        (whole, 0) => format!("{sign}{whole}"),
        (0, part) => format!("{sign}.{part}"),
        (whole, part) => format!("{sign}{whole}.{part}"),
    }
}

fn tenth(v: f64) -> String {
    if v.is_finite() { tenths((v * 10.0).round() as i64) } else { "0".into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_papers_have_a_colour_for_everything() {
        for paper in [Paper::Light, Paper::Dark] {
            assert!(!paper.style().contains("var("), "{}", paper.style());
        }
        assert!(Paper::Light.style().contains(".paper { fill: #fff; }"));
        assert!(Paper::Dark.style().contains(".paper { fill: #14171a; }"));
    }

    #[test]
    fn paths_break_where_nothing_is_and_show_points_alone() {
        let nan = f64::NAN;
        let text = path([(0.0, 1.0), (1.04, 0.5), (2.0, nan), (3.0, 3.0), (4.0, nan)].into_iter());
        assert_eq!(text, "M0 1l1 -.5M3 3h0");
    }

    #[test]
    fn whole_numbers_have_none_between_them_and_every_axis_has_two() {
        let labels = |at: Vec<f64>, width: f64| {
            let x = Scale::around(at.iter(), 0.02, false);
            let found = across(&Figure::new("a", "", "", at), &x, width);
            found.into_iter().map(|(_, label)| label).collect::<Vec<_>>()
        };
        assert_eq!(labels((0..5).map(f64::from).collect(), 760.0), ["0", "1", "2", "3", "4"]);
        assert_eq!(labels(vec![5.0, 95.0], 240.0), ["20", "40", "60", "80"]);
        assert_eq!(labels(vec![0.43, 0.58], 240.0), ["0.45", "0.50", "0.55"]);
    }
}
