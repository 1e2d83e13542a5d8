//! A study: how often intervals hold, how far estimates scatter beside their errors, how they are distributed, and what became of
//! the repeats.

use super::document::Section;
use super::figure::{Figure, Look, Mark, Panel, Shape};
use super::headline::Trust;
use super::number::{bracketed, shown};
use super::subject::{Subject, list};
use maud::{Markup, html};
use serde_json::Value;

/// Parameters whose estimates are drawn.
const DRAWN: usize = 24;
/// Coverages within this of 95 % are good.
const GOOD: f64 = 0.02;
/// Below this nobody should rely on them.
const LEAST: f64 = 0.88;
/// Histograms reach so many errors to both sides, in so many columns.
const REACH: f64 = 4.0;
const COLUMNS: usize = 32;
/// Kinds of errors, those to be trusted first, and what they are called.
const KINDS: [(&str, &str, Look); 2] =
    [("corrected", "corrected", Look::Model), ("cramer_rao", "Cramér–Rao", Look::Residual)];

/// What can be said in a sentence, and what speaks against the intervals.
pub(super) fn verdict(study: &Value) -> (Trust, String, Vec<(String, &'static str)>) {
    let (done, converged) = (number(&study["done"]), number(&study["converged"]));
    let noise = colour(study);
    let Some(pooled) = list(&study["pooled"]).last() else {
        return (Trust::Bad, format!("No interval came of {done} repeats with {noise} noise."), Vec::new());
    };
    let coverage = number(&pooled["coverage"]);
    let sentence = format!(
        "Nominal 95 % intervals hold the truth in {} of all cases, over {converged} repeats with {noise} noise.",
        covers(&pooled["coverage"], &pooled["interval"])
    );
    let mut points = Vec::new();
    if let Some((name, share)) = pooled["worst"][0].as_str().zip(pooled["worst"][1].as_f64()) {
        let off = (share - 0.95).abs() > GOOD;
        points.extend(
            off.then(|| (format!("Furthest off: `{name}`, whose intervals hold in {} %", percent(share)), "coverage")),
        );
    }
    let biased: Vec<String> = biased(study).map(|p| format!("`{}`", label(p))).collect();
    if biased.len() * 20 > list(&study["parameters"]).len() {
        points.push((format!("More bias than chance explains: {}", biased.join(", ")), "coverage"));
    }
    if converged < done {
        points.push((format!("{} of {done} repeats did not converge", done - converged), "outcomes"));
    }
    if done < number(&study["asked"]) {
        points.push((format!("Interrupted: {done} of {} repeats are done", study["asked"]), "outcomes"));
    }
    let trust = match (coverage - 0.95).abs() {
        _ if coverage < LEAST => Trust::Bad,
        off if off <= GOOD && points.is_empty() => Trust::Good,
        _ => Trust::Reserved,
    };
    (trust, sentence, points)
}

fn colour(study: &Value) -> &str {
    match study["colour"].as_str() {
        Some("lag") => "lagged",
        Some(colour) => colour,
        None => "the described",
    }
}

/// Percent, with what chance leaves open.
fn covers(share: &Value, interval: &Value) -> String {
    let [low, high] = [0, 1].map(|k| percent(number(&interval[k])));
    format!("{} % ({low} to {high} %)", percent(number(share)))
}

fn percent(share: f64) -> String {
    format!("{:.1}", 100.0 * share)
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

fn biased(study: &Value) -> impl Iterator<Item = &Value> {
    list(&study["parameters"]).iter().filter(|p| number(&p["bias"]).abs() > number(&p["bias_chance"]))
}

/// A parameter as the columns of the repeats call it.
fn label(p: &Value) -> String {
    let of = |what: &str, key: &str| {
        p[key].as_str().filter(|t| !t.is_empty()).map_or(String::new(), |text| format!("{what}{text}"))
    };
    format!("{}{}{}", p["name"].as_str().unwrap_or_default(), of(" of ", "run"), of(", ", "step"))
}

fn interval<'a>(p: &'a Value, kind: &str) -> Option<&'a Value> {
    list(&p["intervals"]).iter().find(|i| i["kind"] == kind)
}

/// Kinds of errors that were printed for any parameter.
fn printed(study: &Value) -> Vec<(&'static str, &'static str, Look)> {
    let any = |kind: &str| list(&study["parameters"]).iter().any(|p| interval(p, kind).is_some());
    KINDS.into_iter().filter(|(kind, ..)| any(kind)).collect()
}

pub(super) fn sections(subject: &Subject) -> Vec<Section> {
    let study = &subject.result["study"];
    if list(&study["parameters"]).is_empty() {
        return Vec::new();
    }
    let estimates = histograms(subject);
    let drawn = estimates.len();
    let all = list(&study["parameters"]).len();
    let mut sections = vec![Section::new(
        "coverage",
        "What intervals are worth",
        html! {
            (table(study))
            p.note {
                "Bias is in standard errors, with what chance alone gives in 95 % of cases. Ratios are the scatter of the estimates over the root mean square of "
                "the printed errors: 1 is right, more means that errors are printed too small. In brackets the interval of 95 % that so many repeats leave open."
            }
            @for figure in [coverage(study), scatter(study)].iter().flatten() { (figure.markup()) }
        },
    )];
    if drawn > 0 {
        sections.push(Section::new(
            "estimates",
            "Estimates of the repeats",
            html! {
                p { "The deviation of every estimate from the truth, in standard errors of its own repeat, beside the normal distribution." }
                div.pair { @for figure in &estimates { (figure.markup()) } }
                @if all > drawn { p.note { (all - drawn) " more are in " code { "repeats.csv" } "." } }
            },
        ));
    }
    sections.push(Section::new("outcomes", "What became of the repeats", outcomes(study)));
    sections
}

fn table(study: &Value) -> Markup {
    let parameters = list(&study["parameters"]);
    let has = |key: &str| parameters.iter().any(|p| p[key].as_str().is_some_and(|t| !t.is_empty()));
    let (runs, steps, kinds) = (has("run"), has("step"), printed(study));
    html! {
        div.scroll { table {
            thead { tr {
                th.number { "no." } th { "parameter" } @if runs { th { "run" } } @if steps { th { "step" } }
                th { "unit" } th.number { "truth" } th.number { "mean" } th.number { "bias" } th.number { "±" } th.number { "scatter" }
                @for (_, name, _) in &kinds { th.number { (name) " σ" } th.number { "ratio" } th.number { "covers %" } }
            } }
            tbody { @for (k, p) in parameters.iter().enumerate() {
                @let digits = settled(p);
                tr {
                    td.number { (k + 1) }
                    th scope="row" { code { (p["name"].as_str().unwrap_or_default()) } }
                    @if runs { td { (p["run"].as_str().unwrap_or_default()) } }
                    @if steps { td { (p["step"].as_str().unwrap_or_default()) } }
                    td { (p["unit"].as_str().unwrap_or_default()) }
                    td.number { (shown(&p["truth"], digits)) } td.number { (shown(&p["mean"], digits)) }
                    td.number.large[number(&p["bias"]).abs() > number(&p["bias_chance"])] { (shown(&p["bias"], 2)) }
                    td.number { (shown(&p["bias_chance"], 2)) } td.number { (shown(&p["scatter"], 3)) }
                    @for (kind, ..) in &kinds { (cells(interval(p, kind))) }
                }
            } }
        } }
    }
}

/// Digits down to a hundredth of the scatter.
fn settled(p: &Value) -> usize {
    let ratio = (number(&p["truth"]) / number(&p["scatter"])).abs();
    if ratio.is_finite() && ratio > 0.0 { (ratio.log10().floor() + 3.0).clamp(3.0, 12.0) as usize } else { 5 }
}

fn cells(interval: Option<&Value>) -> Markup {
    let Some(i) = interval else { return html! { td.number { "–" } td.number { "–" } td.number { "–" } } };
    let share = &i["coverage"];
    let bad = number(&share["interval"][1]) < 0.95;
    html! {
        td.number { (shown(&i["error"], 3)) }
        td.number { (format!("{:.2}", number(&i["ratio"]))) }
        td.number.large[bad] {
            (percent(number(&share["share"]))) " (" (percent(number(&share["interval"][0]))) "–" (percent(number(&share["interval"][1]))) ")"
        }
    }
}

fn outcomes(study: &Value) -> Markup {
    let (asked, done) = (number(&study["asked"]), number(&study["done"]));
    let part = |n: f64| if done > 0.0 { format!("{} %", percent(n / done)) } else { String::new() };
    html! {
        div.scroll { table { tbody {
            tr { th scope="row" { "converged" } td.number { (study["converged"]) } td.number { (part(number(&study["converged"]))) } }
            @for reason in list(&study["astray"]) {
                tr { th scope="row" { (reason[0].as_str().unwrap_or_default()) } td.number { (reason[1]) } td.number { (part(number(&reason[1]))) } }
            }
            @if done < asked { tr { th scope="row" { "not done" } td.number { (asked - done) } td {} } }
        } } }
        p.note { "Repeats that did not converge have no interval; counted as misses they are in the result's JSON as " code { "of_all" } ". Seed " (study["seed"]) "." }
    }
}

/// All of them.
pub(super) fn figures(subject: &Subject) -> Vec<Figure> {
    let study = &subject.result["study"];
    [coverage(study), scatter(study)].into_iter().flatten().chain(histograms(subject)).collect()
}

/// How often the intervals of each parameter hold, and its scatter over its error.
fn coverage(study: &Value) -> Option<Figure> {
    let (parameters, kinds) = (list(&study["parameters"]), printed(study));
    if parameters.is_empty() || kinds.is_empty() {
        return None;
    }
    // the kinds of errors of a parameter stand beside each other
    let places: Vec<(usize, usize)> =
        (0..parameters.len()).flat_map(|k| (0..kinds.len()).map(move |j| (k, j))).collect();
    let column = |j: usize, of: &dyn Fn(&Value) -> f64| -> Vec<f64> {
        let one = |(k, own): &(usize, usize)| {
            let found = interval(&parameters[*k], kinds[j].0).filter(|_| *own == j);
            found.map_or(f64::NAN, of)
        };
        places.iter().map(one).collect()
    };
    let (mut covers, mut ratios) = (Vec::new(), Vec::new());
    let level = |v: f64| Mark::line("", Look::Bound, vec![v; places.len()]);
    covers.push(level(95.0));
    ratios.push(level(1.0));
    for (j, (_, name, look)) in kinds.iter().enumerate() {
        let edge = |side: usize| column(j, &move |i| 100.0 * number(&i["coverage"]["interval"][side]));
        covers.push(Mark::between("", *look, Shape::Bars, edge(0), edge(1)));
        covers.push(Mark::dots(name, *look, column(j, &|i| 100.0 * number(&i["coverage"]["share"]))));
        ratios.push(Mark::dots(name, *look, column(j, &|i| number(&i["ratio"]))));
    }
    let panel =
        |label: &str, height: u32, marks: Vec<Mark>| Panel { label: label.into(), height, logarithmic: false, marks };
    Some(Figure {
        id: "coverage-1".into(),
        group: "coverage".into(),
        caption: "intervals of 95 % that hold the truth, and scatter over printed error".into(),
        label: "number of the parameter".into(),
        logarithmic: false,
        at: places.iter().map(|(k, j)| *k as f64 + 1.0 + 0.25 * *j as f64).collect(),
        panels: vec![panel("covers [%]", 170, covers), panel("scatter / σ", 110, ratios)],
        names: places.iter().map(|(k, j)| format!("{}, {}", label(&parameters[*k]), kinds[*j].1)).collect(),
        half: false,
        samples: None,
    })
}

/// The scatter of every parameter against its printed error, each in the parameter's unit.
fn scatter(study: &Value) -> Option<Figure> {
    let usable =
        |p: &&Value| number(&p["scatter"]) > 0.0 && list(&p["intervals"]).iter().all(|i| number(&i["error"]) > 0.0);
    let mut points: Vec<(f64, usize, f64, String)> = Vec::new();
    for p in list(&study["parameters"]).iter().filter(usable) {
        for (j, (kind, name, _)) in KINDS.iter().enumerate() {
            let Some(found) = interval(p, kind) else { continue };
            let unit = bracketed(p["unit"].as_str());
            points.push((
                number(&found["error"]),
                j,
                number(&p["scatter"]),
                format!("{}{unit}, {name} σ = {}", label(p), shown(&found["error"], 3)),
            ));
        }
    }
    if points.len() < 2 {
        return None;
    }
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let at: Vec<f64> = points.iter().map(|p| p.0).collect();
    let mut marks = vec![Mark::line("equal", Look::Bound, at.clone())];
    for (j, (_, name, look)) in KINDS.iter().enumerate() {
        let values: Vec<f64> = points.iter().map(|p| if p.1 == j { p.2 } else { f64::NAN }).collect();
        if values.iter().any(|v| v.is_finite()) {
            marks.push(Mark::dots(name, *look, values));
        }
    }
    Some(Figure {
        id: "scatter-1".into(),
        group: "scatter".into(),
        caption: "scatter of the estimates against printed standard errors, each in the parameter's unit".into(),
        label: "printed standard error".into(),
        logarithmic: true,
        at,
        panels: vec![Panel { label: "scatter".into(), height: 210, logarithmic: true, marks }],
        names: points.into_iter().map(|p| p.3).collect(),
        half: false,
        samples: None,
    })
}

/// Deviations of the estimates in errors of their own repeats, parameter by parameter.
fn histograms(subject: &Subject) -> Vec<Figure> {
    let parameters = list(&subject.result["study"]["parameters"]).iter().enumerate();
    parameters.filter_map(|(k, p)| histogram(subject, k, p)).take(DRAWN).collect()
}

fn histogram(subject: &Subject, k: usize, p: &Value) -> Option<Figure> {
    let (repeats, name) = (subject.repeats.as_ref()?, label(p));
    // the errors that are to be trusted
    let (kind, error) = match interval(p, "corrected") {
        Some(_) => ("corrected", format!("{name}: corrected error")),
        None => ("Cramér–Rao", format!("{name}: Cramer-Rao error")),
    };
    let (values, errors) = (&repeats.column(&name)?.values, &repeats.column(&error)?.values);
    let truth = number(&p["truth"]);
    let deviations = values.iter().zip(errors).map(|(v, e)| (v - truth) / e).filter(|z| z.is_finite());
    let width = 2.0 * REACH / COLUMNS as f64;
    let (mut counts, mut all, mut beyond) = (vec![0.0; COLUMNS], 0, 0);
    for z in deviations {
        all += 1;
        let place = ((z + REACH) / width).floor();
        match counts.get_mut(place.max(0.0) as usize).filter(|_| place >= 0.0) {
            Some(count) => *count += 1.0,
            None => beyond += 1,
        }
    }
    if all == 0 {
        return None;
    }
    let at: Vec<f64> = (0..COLUMNS).map(|c| (c as f64 + 0.5) * width - REACH).collect();
    let normal =
        at.iter().map(|z| f64::from(all) * width * (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt()).collect();
    let outside = if beyond > 0 { format!("; {beyond} beyond {REACH}") } else { String::new() };
    Some(Figure {
        id: format!("estimates-{}", k + 1),
        group: format!("estimates-{}", k + 1),
        caption: format!("{name}, of {all} repeats{outside}"),
        label: format!("deviation from the truth [{kind} σ]"),
        logarithmic: false,
        panels: vec![Panel {
            label: "repeats".into(),
            height: 130,
            logarithmic: false,
            marks: vec![
                Mark::between("estimates", Look::Measured, Shape::Columns, vec![0.0; COLUMNS], counts),
                Mark::line("normal", Look::Model, normal),
            ],
        }],
        at,
        names: Vec::new(),
        half: true,
        samples: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn study(coverage: f64, converged: u64, bias: f64) -> Value {
        json!({
            "colour": "white", "seed": 3, "asked": 200, "done": 200, "converged": converged, "astray": [],
            "parameters": [{ "name": "k", "run": null, "step": "", "truth": 1.0, "bias": bias, "bias_chance": 0.14, "scatter": 0.1, "intervals": [] }],
            "pooled": [{ "coverage": coverage, "interval": [coverage - 0.01, coverage + 0.01], "worst": ["k", coverage] }],
        })
    }

    #[test]
    fn the_headline_follows_coverage_bias_and_what_went_astray() {
        let judged = |s: &Value| verdict(s).0;
        assert_eq!(judged(&study(0.951, 200, 0.1)), Trust::Good);
        assert_eq!(judged(&study(0.951, 190, 0.1)), Trust::Reserved);
        assert_eq!(judged(&study(0.951, 200, -0.5)), Trust::Reserved);
        assert_eq!(judged(&study(0.91, 200, 0.1)), Trust::Reserved);
        assert_eq!(judged(&study(0.6, 200, 0.1)), Trust::Bad);
        let said = verdict(&study(0.951, 200, 0.1)).1;
        assert!(said.contains("95.1 % (94.1 to 96.1 %)") && said.contains("200 repeats with white noise"), "{said}");
    }
}
