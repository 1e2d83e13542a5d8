//! The modes of a model: a map of the eigenvalues with ellipses of two standard errors, what each mode is, and what the states do in it.

use super::section::{Part, Rows, Section};
use crate::page::number::text as number;
use crate::page::picture::Picture;
use crate::page::scale::Scale;
use crate::shapes;
use crate::text;
use fdm_results::documents::{ModeDocument, ModesDocument, digits};
use fdm_system::linear::ModeErrors;
use maud::{Markup, html};

const WIDTH: f64 = 520.0;
const HEIGHT: f64 = 360.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 10.0;
const BOTTOM: f64 = 42.0;
/// Damping ratios whose lines are drawn.
const DAMPING: [f64; 5] = [0.1, 0.3, 0.5, 0.7, 0.9];

/// An eigenvalue, and the covariance of its parts: of the real part, of both, of the imaginary part.
struct Root {
    re: f64,
    im: f64,
    spread: Option<[f64; 3]>,
}

/// One row for each mode, a pair in one.
pub fn modes_table(found: &ModesDocument) -> String {
    text::sections(&[section(found)])
}

/// What each mode is, where the model was linearised, and what the states do.
pub(crate) fn section(found: &ModesDocument) -> Section {
    let (modes, time) = (&found.modes, time(found));
    let section = Section::new("modes", "Modes");
    if let Some(why) = &found.left_out {
        return section.line(format!("There is no map of the modes here: {why}."));
    }
    let rays = DAMPING.map(|d| d.to_string()).join(", ");
    let drawn = (!modes.is_empty()).then(|| {
        let note = format!(
            "Ellipses are two standard errors, from the covariance of the parameters (corrected for the colour of the residuals where that is known). \
             Rays are damping ratios {rays}."
        );
        [Part::Markup(map(modes, time).markup()), Part::Note(note).on_page()]
    });
    let infinite = (found.infinite == Some(true))
        .then(|| [Part::Gap, Part::Note("delayed states give infinitely many modes; these are the rightmost".into())]);
    let lost = modes.iter().any(|m| m.standard_errors == Some(None));
    let lost = lost
        .then(|| [Part::Gap, Part::Note("an eigenvalue that is not apart from others has no standard error".into())]);
    let linearised = found.linearised.iter().flat_map(|said| [Part::Gap, Part::Note(said.clone())]);
    section
        .with_all(drawn.into_iter().flatten())
        .with(table(modes, time))
        .with_all(infinite.into_iter().chain(lost).flatten())
        .with_all(linearised)
        .with_all(dials(modes, time))
}

/// A dial for each oscillation.
fn dials(modes: &[ModeDocument], time: &str) -> Vec<Part> {
    let dials = shapes::pictures(modes, time);
    if dials.is_empty() {
        return Vec::new();
    }
    let more = modes.iter().filter(|m| m.im > 0.0).count() - dials.len();
    let note = "A hand is a component of the eigenvector: its angle is the phase, its length the size by decades, from a thousandth in the middle \
                to one at the rim. Sizes are in the units of the states (below), over that of the state that is named as 1.";
    let more = (more > 0).then(|| Part::Note(format!("{more} more are in the table.")).on_page());
    let dials = html! { div.pair { @for dial in &dials { (dial.markup()) } } };
    let heading = Part::Heading("What the states do in each oscillation".into()).on_page();
    let table = Part::folded("as a table", vec![Part::Markup(shapes::table(modes))]);
    let before = [heading, Part::Note(note.into()).on_page(), Part::Markup(dials)];
    before.into_iter().chain(more).chain([table]).collect()
}

/// Real parts and errors below this part of the frequency are rounding, and 0.
const ROUNDING: f64 = 1e-12;

/// With so many digits, beside a frequency or another size.
fn rounded(v: f64, significant: usize, size: f64) -> String {
    digits(if v.abs() < ROUNDING * size { 0.0 } else { v }, significant)
}

fn table<'a>(modes: &'a [ModeDocument], time: &str) -> Rows<(usize, &'a ModeDocument)> {
    let short = |v: Option<f64>| v.map_or(String::new(), |v| rounded(v, 4, 1.0));
    let mut table = Rows::over(modes.iter().filter(|m| m.im >= 0.0).enumerate());
    table.number("mode", |(k, _)| k + 1).on_page();
    let with = modes.iter().any(|m| m.standard_errors.is_some());
    let error = |table: &mut Rows<(usize, &ModeDocument)>, of: fn(&ModeDocument, &ModeErrors) -> String| {
        if with {
            table.number("standard error", |(_, m)| m.standard_errors.flatten().map_or(String::new(), |e| of(m, &e)));
        }
    };
    table.number("eigenvalue", |(_, m)| match m.im != 0.0 {
        true => format!("{} ± {}j", rounded(m.re, 5, m.frequency), digits(m.im, 5)),
        false => rounded(m.re, 5, m.frequency),
    });
    error(&mut table, |m, e| match m.im != 0.0 {
        true => format!("{} and {}", rounded(e.re, 3, m.frequency), digits(e.im, 3)),
        false => rounded(e.re, 3, m.frequency),
    });
    table.number("damping", |(_, m)| short(m.damping));
    error(&mut table, |_, e| rounded(e.damping, 3, 1.0));
    table.number(&format!("frequency [rad/{time}]"), |(_, m)| digits(m.frequency, 5));
    error(&mut table, |_, e| digits(e.frequency, 3));
    table.number(&format!("half [{time}]"), |(_, m)| short(m.time_to_half));
    table.number(&format!("double [{time}]"), |(_, m)| short(m.time_to_double));
    table.words("states", |(_, m)| m.states.join(", "));
    table
}

fn time(found: &ModesDocument) -> &str {
    found.time.as_deref().unwrap_or("s")
}

/// The map and the dials.
pub(crate) fn pictures(found: &ModesDocument) -> Vec<Picture> {
    let (modes, time) = (&found.modes, time(found));
    if modes.is_empty() {
        return Vec::new();
    }
    std::iter::once(map(modes, time)).chain(shapes::pictures(modes, time)).collect()
}

/// What is known of the error of an eigenvalue.
fn errors(mode: &ModeDocument) -> Option<&ModeErrors> {
    mode.standard_errors.as_ref()?.as_ref().filter(|e| e.re.is_finite() && e.im.is_finite())
}

fn root(mode: &ModeDocument) -> Root {
    let covariance = |e: &ModeErrors| if e.covariance.is_finite() { e.covariance } else { 0.0 };
    let spread = errors(mode).map(|e| [e.re * e.re, covariance(e), e.im * e.im]);
    Root { re: mode.re, im: mode.im, spread }
}

fn map(modes: &[ModeDocument], time: &str) -> Picture {
    let roots: Vec<Root> = modes.iter().map(root).collect();
    let body = plane(&roots, time);
    Picture { id: "eigenvalues".into(), caption: "Eigenvalues".into(), width: WIDTH, height: HEIGHT, body }
}

/// The plane of the eigenvalues.
fn plane(roots: &[Root], time: &str) -> Markup {
    let size = roots.iter().map(|r| r.re.hypot(r.im)).fold(0.0, f64::max);
    // an ellipse that is larger than everything else would hide it
    let reach = |r: &Root, k: usize| r.spread.map_or(0.0, |s| (2.0 * s[k].sqrt()).min(size));
    // real eigenvalues alone have an imaginary axis too, and those on it a real one, else that would show rounding
    let (least, beside) = (0.3 * size, 0.03 * size);
    let re = roots.iter().flat_map(|r| [r.re - reach(r, 0), r.re + reach(r, 0)]).chain([beside, -beside]);
    let re: Vec<f64> = re.collect();
    let im = roots.iter().flat_map(|r| [r.im - reach(r, 2), r.im + reach(r, 2)]).chain([least, -least]);
    let im: Vec<f64> = im.collect();
    let (x, y) = (Scale::around(re.iter(), 0.08, false), Scale::around(im.iter(), 0.08, false));
    let across = |v: f64| LEFT + (WIDTH - LEFT - RIGHT) * x.share(v);
    let down = |v: f64| TOP + (HEIGHT - TOP - BOTTOM) * (1.0 - y.share(v));
    let steps = ((WIDTH - LEFT - RIGHT) / (x.high - x.low), (HEIGHT - TOP - BOTTOM) / (y.high - y.low));
    let place = |v: f64| format!("{v:.1}");
    html! {
        clipPath id="roots-clip" { rect x=(LEFT) y=(TOP) width=(WIDTH - LEFT - RIGHT) height=(HEIGHT - TOP - BOTTOM) {} }
        @for (v, label) in x.ticks(7) {
            line.grid x1=(place(across(v))) x2=(place(across(v))) y1=(TOP) y2=(HEIGHT - BOTTOM) {}
            text.tick x=(place(across(v))) y=(HEIGHT - BOTTOM + 15.0) text-anchor="middle" { (label) }
        }
        @for (v, label) in y.ticks(7) {
            line.grid x1=(LEFT) x2=(WIDTH - RIGHT) y1=(place(down(v))) y2=(place(down(v))) {}
            text.tick x=(LEFT - 6.0) y=(place(down(v) + 4.0)) text-anchor="end" { (label) }
        }
        rect.frame x=(LEFT) y=(TOP) width=(WIDTH - LEFT - RIGHT) height=(HEIGHT - TOP - BOTTOM) {}
        g clip-path="url(#roots-clip)" {
            line.axis x1=(place(across(0.0))) x2=(place(across(0.0))) y1=(TOP) y2=(HEIGHT - BOTTOM) {}
            line.axis x1=(LEFT) x2=(WIDTH - RIGHT) y1=(place(down(0.0))) y2=(place(down(0.0))) {}
            @for damping in DAMPING {
                @for sign in [1.0, -1.0] {
                    @let aside = (1.0 - damping * damping).sqrt();
                    // to the frame and no farther: dashes beyond it make a print of 20 MB
                    @let far = (-x.low / damping).min(y.high.max(-y.low) / aside);
                    line.ray x1=(place(across(0.0))) y1=(place(down(0.0))) x2=(place(across(-damping * far)))
                        y2=(place(down(sign * aside * far))) {}
                }
            }
            @for r in roots {
                @if let Some(spread) = r.spread { (ellipse(across(r.re), down(r.im), spread, steps, r.im == 0.0)) }
            }
            @for r in roots {
                @let (px, py) = (across(r.re), down(r.im));
                path.root d={ "M" (place(px - 5.0)) " " (place(py - 5.0)) "l10 10m0 -10l-10 10" } {
                    title { (number(r.re, 5)) @if r.im != 0.0 { (if r.im > 0.0 { " + " } else { " − " }) (number(r.im.abs(), 5)) "j" } }
                }
            }
        }
        text.label x=((LEFT + WIDTH - RIGHT) / 2.0) y=(HEIGHT - 6.0) text-anchor="middle" { "real part [1/" (time) "]" }
        text.label transform={ "translate(13 " ((TOP + HEIGHT - BOTTOM) / 2.0) ") rotate(-90)" } text-anchor="middle" {
            "imaginary part [rad/" (time) "]"
        }
    }
}

/// Two standard errors in every direction: the principal axes of the covariance on paper.
fn ellipse(px: f64, py: f64, spread: [f64; 3], steps: (f64, f64), real: bool) -> Markup {
    // down on paper is up in the plane
    let (a, b, c) = (spread[0] * steps.0 * steps.0, -spread[1] * steps.0 * steps.1, spread[2] * steps.1 * steps.1);
    let middle = (a + c) / 2.0;
    let radius = ((a - c) / 2.0).hypot(b);
    let (large, small) = ((middle + radius).max(0.0).sqrt(), (middle - radius).max(0.0).sqrt());
    let turn = 0.5 * (2.0 * b).atan2(a - c).to_degrees();
    // the error of a real eigenvalue is a line, which would not be seen
    let small = if real { small.max(1.2) } else { small };
    if !(large.is_finite() && small.is_finite()) {
        return html! {};
    }
    let place = |v: f64| format!("{v:.2}");
    html! {
        ellipse.spread cx=(place(px)) cy=(place(py)) rx=(place(2.0 * large)) ry=(place(2.0 * small))
            transform={ "rotate(" (place(turn)) " " (place(px)) " " (place(py)) ")" } {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ellipses_lie_along_what_varies_together() {
        // both parts rise together: the long axis points up to the right, which is a negative turn on paper
        let text = ellipse(0.0, 0.0, [1.0, 0.9, 1.0], (10.0, 10.0), false).into_string();
        assert!(text.contains("rotate(-45.00 0.00 0.00)"), "{text}");
        assert!(text.contains(&format!("rx=\"{:.2}\"", 20.0 * 1.9_f64.sqrt())), "{text}");
        assert!(text.contains(&format!("ry=\"{:.2}\"", 20.0 * 0.1_f64.sqrt())), "{text}");
    }
}
