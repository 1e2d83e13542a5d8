//! Equation error: how well each measured rate is met, by what, and how the estimates depend on the data that were used.

use super::document::Section;
use super::figure::{Figure, Look, Mark, Panel, Shape};
use super::headline::Trust;
use super::number::{bracketed, shown, text};
use super::subject::{Subject, called, list, numbers};
use maud::{Markup, html};
use serde_json::Value;

/// A rate of which less is explained is named.
const LITTLE: f64 = 0.5;
/// Parameters whose dependence is drawn.
const DRAWN: usize = 24;

/// What can be said in a sentence, and what speaks against the estimates.
pub(super) fn verdict(result: &Value) -> (Trust, String, Vec<(String, &'static str)>) {
    let fits = list(&result["fits"]);
    let equations: Vec<&Value> = fits.iter().flat_map(|f| list(&f["equations"])).collect();
    let r_squared = |e: &Value| e["r_squared"].as_f64().unwrap_or(f64::NAN);
    let Some(worst) = equations.iter().min_by(|a, b| r_squared(a).total_cmp(&r_squared(b))) else {
        return (Trust::Bad, "No equation is a regression.".into(), refusals(result).collect());
    };
    let name = |e: &Value| e["equation"].as_str().unwrap_or_default().to_string();
    let many = if equations.len() == 1 { "The regression" } else { "Of the regressions the worst" };
    let sentence = format!("{many} explains {} % of {}.", text(100.0 * r_squared(worst), 4), name(worst));
    let mut points: Vec<(String, &'static str)> = Vec::new();
    let little = equations.iter().filter(|e| r_squared(e) < LITTLE);
    points.extend(little.map(|e| {
        (format!("Little is explained of `{}`: {} %", name(e), text(100.0 * r_squared(e), 3)), "regressions")
    }));
    for fit in fits {
        for together in list(&fit["reason"]["collinear"]) {
            let names: Vec<&str> = list(together).iter().filter_map(Value::as_str).collect();
            points.push((
                format!("The data hardly tell apart `{}`; they share what is known of them", names.join("`, `")),
                "regressions",
            ));
        }
        for unseen in list(&fit["unseen"]).iter().filter_map(Value::as_str) {
            points.push((format!("`{unseen}` is multiplied by nothing in these data"), "regressions"));
        }
    }
    points.extend(refusals(result));
    let kept: Vec<&str> = list(&result["kept"]).iter().filter_map(Value::as_str).collect();
    if !kept.is_empty() {
        points.push((format!("Not estimated, so that their values stay: `{}`", kept.join("`, `")), "parameters"));
    }
    let trust = if points.is_empty() { Trust::Good } else { Trust::Reserved };
    (trust, sentence, points)
}

fn refusals(result: &Value) -> impl Iterator<Item = (String, &'static str)> {
    let one = |r: &Value| (format!("Left out: {}", r["reason"].as_str().unwrap_or_default()), "regressions");
    list(&result["refused"]).iter().map(one)
}

pub(super) fn sections(subject: &Subject) -> Vec<Section> {
    let fits = subject.list("fits");
    if fits.is_empty() {
        return Vec::new();
    }
    let content = html! {
        div.scroll { table {
            thead { tr { th { "rate" } th.number { "R²" } th.number { "RMS of the residual" } th.number { "rows" } } }
            tbody { @for e in fits.iter().flat_map(|f| list(&f["equations"])) { tr {
                th scope="row" { code { (e["equation"].as_str().unwrap_or_default()) } }
                td.number { (shown(&e["r_squared"], 5)) } td.number { (shown(&e["rms"], 4)) } td.number { (e["rows"]) }
            } } }
        } }
        @for fit in fits { (terms(fit)) }
        p.note {
            "A partial F is the square of value over error: how much worse the regression is without the term. The part of the rate is the term's mean size over the rate's. "
            "Noise of measured states enters the columns of a regression, which draws its estimates towards zero; output error does not suffer from that."
        }
        @for figure in components(subject) { (figure.markup()) }
    };
    let mut sections = vec![Section::new("regressions", "Regressions", content)];
    let depend = dependence(subject);
    if !depend.is_empty() {
        sections.push(Section::new(
            "dependence",
            "Dependence on the data",
            html! {
                p { "Every estimate, with two standard errors, over the highest frequency and over the part of the records that is used." }
                div.pair { @for figure in &depend { (figure.markup()) } }
            },
        ));
    }
    sections
}

/// What each parameter of a regression multiplies, and what it is worth.
fn terms(fit: &Value) -> Markup {
    html! {
        div.scroll { table {
            thead { tr { th { "parameter" } th { "multiplies" } th.number { "value" } th.number { "σ" } th.number { "coloured σ" } th.number { "partial F" } th.number { "part of the rate" } } }
            tbody { @for p in list(&fit["parameters"]) { tr {
                th scope="row" { code { (called(p)) } }
                td { (list(&p["columns"]).iter().filter_map(Value::as_str).collect::<Vec<_>>().join("; ")) }
                td.number { (shown(&p["value"], 5)) } td.number { (shown(&p["standard_error"], 3)) } td.number { (shown(&p["coloured_error"], 3)) }
                td.number { (shown(&p["partial_f"], 3)) } td.number { (shown(&p["significance"], 2)) }
            } } }
        } }
    }
}

/// All of them.
pub(super) fn figures(subject: &Subject) -> Vec<Figure> {
    components(subject).into_iter().chain(dependence(subject)).collect()
}

/// What the principal components explain, one after the other.
fn components(subject: &Subject) -> Vec<Figure> {
    let one = |(k, fit): (usize, &Value)| {
        let all = list(&fit["components"]);
        let column = |key: &str| all.iter().map(|c| c[key].as_f64().unwrap_or(f64::NAN)).collect::<Vec<f64>>();
        let equations: Vec<&str> = list(&fit["equations"]).iter().filter_map(|e| e["equation"].as_str()).collect();
        let panel = |label: &str, logarithmic: bool, look: Look, values: Vec<f64>| Panel {
            label: label.into(),
            height: 90,
            logarithmic,
            marks: vec![Mark::line("", look, values.clone()), Mark::dots(label, look, values)],
        };
        (all.len() > 1).then(|| Figure {
            id: format!("components-{}", k + 1),
            group: format!("components-{}", k + 1),
            caption: format!("principal components of {}: {} were taken", equations.join(", "), fit["chosen"]),
            label: "components".into(),
            logarithmic: false,
            at: column("count"),
            panels: vec![
                panel("R²", false, Look::Model, column("r_squared")),
                panel("total error", true, Look::Residual, column("total_error")),
            ],
            names: Vec::new(),
            half: false,
            samples: None,
        })
    };
    subject.list("fits").iter().enumerate().filter_map(one).collect()
}

/// Every parameter over the highest frequency, and over the part of the records.
fn dependence(subject: &Subject) -> Vec<Figure> {
    let unit = if subject.time() == "s" { "Hz".to_string() } else { format!("cycles per {}", subject.time()) };
    let kinds = [
        ("by_cutoff", "cutoff", format!("highest frequency [{unit}]")),
        ("by_length", "part", "part of the records".to_string()),
    ];
    let parameters = subject.list("parameters").iter().take(DRAWN).enumerate();
    let both = |(k, p): (usize, &Value)| {
        let drawn =
            kinds.iter().filter_map(|(key, id, label)| course(subject.list(key), p, format!("{id}-{}", k + 1), label));
        drawn.collect::<Vec<_>>()
    };
    parameters.flat_map(both).collect()
}

fn course(rows: &[Value], of: &Value, id: String, label: &str) -> Option<Figure> {
    let same = |p: &&Value| p["name"] == of["name"] && p["run"] == of["run"];
    let found: Vec<Option<&Value>> = rows.iter().map(|row| list(&row["parameters"]).iter().find(same)).collect();
    let column =
        |key: &str| -> Vec<f64> { found.iter().map(|p| p.and_then(|p| p[key].as_f64()).unwrap_or(f64::NAN)).collect() };
    let (values, errors, coloured) = (column("value"), column("standard_error"), column("coloured_error"));
    if values.iter().filter(|v| v.is_finite()).count() < 2 {
        return None;
    }
    let error = |k: usize| if coloured[k].is_finite() { coloured[k] } else { errors[k] };
    let edge = |sign: f64| values.iter().enumerate().map(|(k, v)| v + sign * 2.0 * error(k)).collect::<Vec<f64>>();
    Some(Figure {
        group: id.clone(),
        id,
        caption: called(of),
        label: label.into(),
        logarithmic: false,
        at: numbers(&rows.iter().map(|row| row["at"].clone()).collect()),
        panels: vec![Panel {
            label: format!("{}{}", of["name"].as_str().unwrap_or_default(), bracketed(of["unit"].as_str())),
            height: 130,
            logarithmic: false,
            marks: vec![
                Mark::between("± 2σ", Look::Other, Shape::Bars, edge(-1.0), edge(1.0)),
                Mark::dots("estimate", Look::Model, values),
            ],
        }],
        names: Vec::new(),
        half: true,
        samples: None,
    })
}
