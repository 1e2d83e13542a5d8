//! The modes of the model as it was found: a map of the eigenvalues with ellipses of two standard errors, and what each mode is.

use super::document::Section;
use super::headline::quoted;
use super::number::{shown, text};
use super::picture::Picture;
use super::scale::Scale;
use super::shapes;
use super::subject::{Subject, list};
use maud::{Markup, html};
use serde_json::Value;

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
    let document = &subject.result["modes"];
    let modes = list(&document["modes"]);
    if modes.is_empty() {
        let why = document["left_out"].as_str()?;
        return Some(Section::new(
            "modes",
            "Modes",
            html! { p { "There is no map of the modes here: " (quoted(why)) "." } },
        ));
    }
    let time = document["time"].as_str().unwrap_or("s");
    let dials = shapes::pictures(modes, time);
    let oscillations = modes.iter().filter(|m| m["im"].as_f64().is_some_and(|im| im > 0.0)).count();
    let content = html! {
        (map(modes, time).markup("map-of-roots"))
        p.note {
            "Ellipses are two standard errors, from the covariance of the parameters (corrected for the colour of the residuals where that is known). "
            "Rays are damping ratios " (DAMPING.map(|d| d.to_string()).join(", ")) "."
            @if document["infinite"] == true { " Delayed states give infinitely many modes; these are the rightmost." }
        }
        (table(modes, time))
        @if let Some(said) = document["linearised"].as_str() { p.note { (said) "." } }
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
    let document = &subject.result["modes"];
    let (modes, time) = (list(&document["modes"]), document["time"].as_str().unwrap_or("s"));
    if modes.is_empty() {
        return Vec::new();
    }
    std::iter::once(map(modes, time)).chain(shapes::pictures(modes, time)).collect()
}

fn root(mode: &Value) -> Option<Root> {
    let errors = &mode["standard_errors"];
    let spread = || {
        let (re, im) = (errors["re"].as_f64()?, errors["im"].as_f64()?);
        Some([re * re, errors["covariance"].as_f64().unwrap_or(0.0), im * im])
    };
    Some(Root { re: mode["re"].as_f64()?, im: mode["im"].as_f64()?, spread: spread() })
}

fn map(modes: &[Value], time: &str) -> Picture {
    let roots: Vec<Root> = modes.iter().filter_map(root).collect();
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
                    @let far = 4.0 * size.max(f64::MIN_POSITIVE);
                    line.ray x1=(place(across(0.0))) y1=(place(down(0.0))) x2=(place(across(-damping * far)))
                        y2=(place(down(sign * (1.0 - damping * damping).sqrt() * far))) {}
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

fn table(modes: &[Value], time: &str) -> Markup {
    let states = |m: &Value| list(&m["states"]).iter().filter_map(Value::as_str).collect::<Vec<_>>().join(", ");
    let with = |m: &Value, name: &str| {
        // of a real eigenvalue these are known
        let known = m["im"] == 0.0 && matches!(name, "im" | "damping");
        let error = m["standard_errors"][name]
            .as_f64()
            .filter(|_| !known)
            .map_or(String::new(), |e| format!(" ± {}", text(2.0 * e, 2)));
        format!("{}{error}", shown(&m[name], 4))
    };
    let upper = |m: &&Value| m["im"].as_f64().is_some_and(|im| im >= 0.0);
    html! {
        div.scroll { table {
            thead { tr {
                th.number { "mode" } th.number { "real part ± 2σ" } th.number { "imaginary part ± 2σ" } th.number { "damping ± 2σ" }
                th.number { "frequency ± 2σ [rad/" (time) "]" } th.number { "half [" (time) "]" } th.number { "double [" (time) "]" } th { "states" }
            } }
            tbody { @for (k, m) in modes.iter().filter(upper).enumerate() { tr {
                td.number { (k + 1) } td.number { (with(m, "re")) } td.number { (with(m, "im")) } td.number { (with(m, "damping")) } td.number { (with(m, "frequency")) }
                td.number { (shown(&m["time_to_half"], 4)) } td.number { (shown(&m["time_to_double"], 4)) } td { (states(m)) }
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
