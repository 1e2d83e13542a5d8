//! The modes of the model as it was found: a map of the eigenvalues with ellipses of two standard errors, and what each mode is.

use super::number::{shown, text};
use super::picture::Picture;
use super::scale::Scale;
use super::section::{Section, quoted};
use super::shapes;
use super::subject::Subject;
use fdm_results::documents::{ModeDocument, StandardErrors};
use maud::{Markup, html};

const WIDTH: f64 = 620.0;
const HEIGHT: f64 = 420.0;
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

pub(super) fn section(subject: &Subject) -> Option<Section> {
    let document = subject.modes()?;
    let modes = &document.modes;
    if modes.is_empty() {
        let why = document.left_out.as_deref()?;
        return Some(Section::new(
            "modes",
            "Modes",
            html! { p { "There is no map of the modes here: " (quoted(why)) "." } },
        ));
    }
    let time = document.time.as_deref().unwrap_or("s");
    let dials = shapes::pictures(modes, time);
    let oscillations = modes.iter().filter(|m| m.im > 0.0).count();
    let content = html! {
        (map(modes, time).markup("map-of-roots"))
        p.note {
            "Ellipses are two standard errors, from the covariance of the parameters (corrected for the colour of the residuals where that is known). "
            "Rays are damping ratios " (DAMPING.map(|d| d.to_string()).join(", ")) "."
            @if document.infinite == Some(true) { " Delayed states give infinitely many modes; these are the rightmost." }
        }
        (table(modes, time))
        @if let Some(said) = &document.linearised { p.note { (said) "." } }
        @if !dials.is_empty() {
            h3 { "What the states do in each oscillation" }
            p.note {
                "A hand is a component of the eigenvector: its angle is the phase, its length the size by decades, from a thousandth in the middle "
                "to one at the rim. Sizes are in the units of the states (below), over that of the state that is named as 1."
            }
            div.pair { @for dial in &dials { (dial.markup("dial")) } }
            @if oscillations > dials.len() { p.note { (oscillations - dials.len()) " more are in the table." } }
            details { summary { "as a table" } (shapes::table(modes)) }
        }
    };
    Some(Section::new("modes", "Modes", content))
}

/// The map and the dials.
pub(super) fn pictures(subject: &Subject) -> Vec<Picture> {
    let Some(document) = subject.modes() else { return Vec::new() };
    let (modes, time) = (&document.modes, document.time.as_deref().unwrap_or("s"));
    if modes.is_empty() {
        return Vec::new();
    }
    std::iter::once(map(modes, time)).chain(shapes::pictures(modes, time)).collect()
}

/// What is known of the error of an eigenvalue.
fn errors(mode: &ModeDocument) -> Option<&StandardErrors> {
    mode.standard_errors.as_ref()?.as_ref().filter(|e| e.re.is_finite() && e.im.is_finite())
}

fn root(mode: &ModeDocument) -> Root {
    let covariance = |e: &StandardErrors| if e.covariance.is_finite() { e.covariance } else { 0.0 };
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
    let re: Vec<f64> = roots.iter().flat_map(|r| [r.re - reach(r, 0), r.re + reach(r, 0), 0.0]).collect();
    // real eigenvalues alone have an imaginary axis too
    let least = 0.3 * size;
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
                    title { (text(r.re, 5)) @if r.im != 0.0 { (if r.im > 0.0 { " + " } else { " − " }) (text(r.im.abs(), 5)) "j" } }
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

fn table(modes: &[ModeDocument], time: &str) -> Markup {
    let with = |value: Option<f64>, error: Option<f64>| {
        let error = error.filter(|e| e.is_finite()).map_or(String::new(), |e| format!(" ± {}", text(2.0 * e, 2)));
        format!("{}{error}", shown(value, 4))
    };
    let of = |m: &ModeDocument, error: fn(&StandardErrors) -> f64| m.standard_errors.flatten().as_ref().map(error);
    // of a real eigenvalue its imaginary part and its damping are known
    let open = |m: &ModeDocument, error: fn(&StandardErrors) -> f64| of(m, error).filter(|_| m.im != 0.0);
    html! {
        div.scroll { table {
            thead { tr {
                th.number { "mode" } th.number { "real part ± 2σ" } th.number { "imaginary part ± 2σ" } th.number { "damping ± 2σ" }
                th.number { "frequency ± 2σ [rad/" (time) "]" } th.number { "half [" (time) "]" } th.number { "double [" (time) "]" } th { "states" }
            } }
            tbody { @for (k, m) in modes.iter().filter(|m| m.im >= 0.0).enumerate() { tr {
                td.number { (k + 1) } td.number { (with(Some(m.re), of(m, |e| e.re))) } td.number { (with(Some(m.im), open(m, |e| e.im))) }
                td.number { (with(m.damping, open(m, |e| e.damping))) } td.number { (with(Some(m.frequency), of(m, |e| e.frequency))) }
                td.number { (shown(m.time_to_half, 4)) } td.number { (shown(m.time_to_double, 4)) } td { (m.states.join(", ")) }
            } } }
        } }
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
