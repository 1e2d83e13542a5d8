//! What the states do in a mode: the components of its eigenvector, each as a hand of a dial, its length by decades.

use crate::page::number::{behind, text, unit};
use crate::page::picture::Picture;
use fdm_results::documents::{Component, ModeDocument};
use maud::{Markup, html};

/// Modes whose shapes are drawn.
const MOST: usize = 12;
const WIDTH: f64 = 360.0;
const HEIGHT: f64 = 230.0;
const RADIUS: f64 = 84.0;
/// The centre stands for ten to minus this.
const DECADES: f64 = 3.0;
/// Between two names below each other.
const LINE: f64 = 14.0;
/// Components that have a name beside the dial.
const NAMED: usize = 16;

/// A hand of the dial.
struct Hand<'a> {
    name: &'a str,
    magnitude: f64,
    /// In degrees.
    phase: f64,
}

impl Hand<'_> {
    /// Where it ends.
    fn tip(&self) -> (f64, f64) {
        let length = RADIUS * (1.0 + self.magnitude.log10() / DECADES).clamp(0.0, 1.0);
        let angle = self.phase.to_radians();
        (WIDTH / 2.0 + length * angle.cos(), HEIGHT / 2.0 - length * angle.sin())
    }
}

/// One picture for each pair of complex modes, with the number that the table gives it.
pub(crate) fn pictures(modes: &[ModeDocument], time: &str) -> Vec<Picture> {
    let upper = modes.iter().filter(|m| m.im >= 0.0).enumerate();
    upper.filter_map(|(k, m)| picture(k + 1, m, time)).take(MOST).collect()
}

fn picture(k: usize, mode: &ModeDocument, time: &str) -> Option<Picture> {
    let all: Vec<Hand<'_>> = mode.shape.iter().filter_map(hand).collect();
    let greatest = mode.shape.iter().find(|c| c.magnitude == 1.0)?;
    if mode.im == 0.0 || all.is_empty() {
        return None;
    }
    let unit =
        Some(behind(greatest.unit.as_deref())).filter(|u| !u.is_empty()).map_or(String::new(), |u| format!(" in{u}"));
    let caption =
        format!("mode {k}: {} ± {}j 1/{time}; 1 is {}{unit}", text(mode.re, 4), text(mode.im, 4), greatest.state);
    let body = html! { (dial()) @for h in &all { (drawn(h)) } (names(&all)) };
    Some(Picture { id: format!("mode-shape-{k}"), caption, width: WIDTH, height: HEIGHT, body })
}

/// A component that is long enough to be seen.
fn hand(component: &Component) -> Option<Hand<'_>> {
    let (name, magnitude) = (component.state.as_str(), component.magnitude);
    let phase = component.phase.filter(|_| magnitude > 10f64.powf(-DECADES))?;
    Some(Hand { name, magnitude, phase })
}

fn dial() -> Markup {
    let (x, y) = (WIDTH / 2.0, HEIGHT / 2.0);
    html! {
        @for k in 0..DECADES as i32 {
            @let r = RADIUS * (1.0 - f64::from(k) / DECADES);
            circle.frame cx=(x) cy=(y) r=(place(r)) {}
            text.tick x=(place(x + 3.0)) y=(place(y - r + 11.0)) { (text(10f64.powi(-k), 1)) }
        }
        @for spoke in 0..12 {
            @let angle = f64::from(30 * spoke).to_radians();
            line.grid x1=(x) y1=(y) x2=(place(x + RADIUS * angle.cos())) y2=(place(y - RADIUS * angle.sin())) {}
        }
        text.tick x=(x) y=(place(y - RADIUS - 6.0)) text-anchor="middle" { "90°" }
        text.tick x=(x) y=(place(y + RADIUS + 15.0)) text-anchor="middle" { "−90°" }
    }
}

fn drawn(hand: &Hand<'_>) -> Markup {
    let (x, y) = hand.tip();
    html! {
        path class="model line hand" d={ "M" (WIDTH / 2.0) " " (HEIGHT / 2.0) "L" (place(x)) " " (place(y)) } {}
        circle class="dot model" cx=(place(x)) cy=(place(y)) r="3" {
            title { (hand.name) ": " (text(hand.magnitude, 3)) " at " (text(hand.phase, 3)) "°" }
        }
    }
}

/// The names in two columns beside the dial, each with a thread to its hand.
fn names(hands: &[Hand<'_>]) -> Markup {
    let mut longest: Vec<&Hand<'_>> = hands.iter().collect();
    longest.sort_by(|a, b| b.magnitude.total_cmp(&a.magnitude));
    longest.truncate(NAMED);
    let (mut right, mut left): (Vec<&Hand<'_>>, Vec<&Hand<'_>>) =
        longest.into_iter().partition(|h| h.tip().0 >= WIDTH / 2.0);
    html! {
        @for (column, side) in [(&mut right, 1.0), (&mut left, -1.0)] {
            @let heights = apart(column);
            @for (h, y) in column.iter().zip(heights) {
                @let (tip, x) = (h.tip(), WIDTH / 2.0 + side * (RADIUS + 16.0));
                path class="thread" d={ "M" (place(tip.0)) " " (place(tip.1)) "L" (place(x - side * 4.0)) " " (place(y)) } {}
                text.label x=(place(x)) y=(place(y + 4.0)) text-anchor=(if side > 0.0 { "start" } else { "end" }) {
                    (h.name) " " (text(h.magnitude, 2))
                }
            }
        }
    }
}

/// Heights of the names of a column, in the order of the tips and never on each other.
fn apart(column: &mut [&Hand<'_>]) -> Vec<f64> {
    column.sort_by(|a, b| a.tip().1.total_cmp(&b.tip().1));
    let mut heights: Vec<f64> = column.iter().map(|h| h.tip().1).collect();
    for k in 1..heights.len() {
        heights[k] = heights[k].max(heights[k - 1] + LINE);
    }
    // what was pushed beyond the paper pushes back
    let mut lowest = HEIGHT - 8.0;
    for y in heights.iter_mut().rev() {
        *y = y.min(lowest);
        lowest = *y - LINE;
    }
    heights
}

/// Mode shapes as numbers, for every mode.
pub(crate) fn table(modes: &[ModeDocument]) -> Markup {
    let upper: Vec<&ModeDocument> = modes.iter().filter(|m| m.im >= 0.0).collect();
    let states = upper.first().map_or(&[][..], |m| &m.shape);
    let cell = |m: &ModeDocument, k: usize| {
        let Some(c) = m.shape.get(k).filter(|c| c.magnitude.is_finite()) else { return "–".to_string() };
        let phase = c.phase.filter(|_| m.im != 0.0);
        let sign = if phase.is_none() && c.phase.is_some_and(|p| p.abs() > 90.0) { "−" } else { "" };
        format!("{sign}{}{}", text(c.magnitude, 3), phase.map_or(String::new(), |p| format!(" ∠ {}°", text(p, 3))))
    };
    html! {
        div.scroll { table {
            thead { tr { th { "state" } th { "unit" } @for k in 0..upper.len() { th.number { "mode " (k + 1) } } } }
            tbody { @for (k, state) in states.iter().enumerate() { tr {
                th scope="row" { code { (state.state) } }
                td { (unit(state.unit.as_deref().unwrap_or_default())) }
                @for m in &upper { td.number { (cell(m, k)) } }
            } } }
        } }
    }
}

fn place(v: f64) -> String {
    format!("{v:.1}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hands_end_where_their_phase_and_decade_say_and_names_keep_apart() {
        let hand = |magnitude, phase| Hand { name: "x", magnitude, phase };
        let (x, y) = hand(1.0, 90.0).tip();
        assert!((x - WIDTH / 2.0).abs() < 1e-9 && (y - (HEIGHT / 2.0 - RADIUS)).abs() < 1e-9);
        let (x, _) = hand(0.1, 0.0).tip();
        assert!((x - (WIDTH / 2.0 + RADIUS * 2.0 / 3.0)).abs() < 1e-9);
        let all: Vec<Hand<'_>> = (0..12).map(|k| hand(0.9, -80.0 - 0.1 * f64::from(k))).collect();
        let mut column: Vec<&Hand<'_>> = all.iter().collect();
        let heights = apart(&mut column);
        assert!(heights.windows(2).all(|w| w[1] - w[0] >= LINE - 1e-9) && heights[11] < HEIGHT && heights[0] > 0.0);
    }
}
