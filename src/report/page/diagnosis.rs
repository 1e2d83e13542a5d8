//! A diagnosis as sections of a page: what is wrong and when, the causes with their rivals, what changes in the equations, what is gained.

use super::equations::{Line, lines, shown as set};
use super::figure::{Figure, Look, Mark, Panel, Shape};
use super::number::{bracketed, probability, shown, text};
use super::subject::{Subject, called};
use super::table::{Column, Table};
use super::thinning::kept;
use crate::section::{Point, Section, Trust, Verdict};
use fdm_discover::{CurvePoint, FrontModel, LackOfFit, OutputGain, PlaceKind, Verdict as Found};
use fdm_results::documents::{CauseDocument, DiagnosisDocument};
use maud::{Markup, html};
use similar::{ChangeTag, DiffOp, TextDiff, capture_diff_slices};

/// Points of a line.
const POINTS: usize = 4000;
/// Rows of a table that need not be folded.
const FEW: usize = 12;
/// Rows of tables that have no end.
const ROWS: usize = 60;

/// The sections of a diagnosis.
pub(crate) fn sections(subject: &Subject, found: &DiagnosisDocument) -> Vec<Section> {
    [
        wrong(subject, found),
        causes(found),
        front(found),
        change(subject),
        gained(subject, found),
        moved(found),
        rejected(found),
        detectable(found),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// In one sentence, and the sentences that stand below it, each with the section that shows it.
pub(crate) fn verdict(found: &DiagnosisDocument) -> Verdict {
    let p = format!("family-wise p {}", chance(found.family_wise_p));
    let (trust, sentence) = match found.verdict {
        Found::EffectFound => (Trust::Reserved, format!("Something is missing from the model ({p}).")),
        Found::Disturbance => (Trust::Reserved, format!("A disturbance (process noise) acts on the model ({p}).")),
        Found::UnknownCause if found.stopped => {
            (Trust::Reserved, format!("The model is wrong; the search for the cause was stopped ({p})."))
        }
        Found::UnknownCause => {
            (Trust::Reserved, format!("The model is wrong, but no effect of the catalogue explains how ({p})."))
        }
        Found::NoEffectFound if found.stopped => {
            (Trust::Reserved, format!("Nothing was found before the search was stopped ({p})."))
        }
        Found::NoEffectFound => {
            (Trust::Good, format!("No missing effect detected (family-wise p = {}).", probability(found.family_wise_p)))
        }
    };
    let unexplained = OutputGain::unexplained(&found.outputs).into_iter();
    let mut points: Vec<(String, &'static str)> = unexplained
        .map(|(output, r2)| {
            (format!("The model as it was given explains nothing of {output} (R² {})", shown(r2, 2)), "gain")
        })
        .collect();
    if found.stopped && matches!(found.verdict, Found::EffectFound | Found::Disturbance) {
        points.push(("The search was stopped before its end".into(), "wrong"));
    }
    for (k, c) in found.causes.iter().enumerate() {
        let gain = shown(c.gain_training, 4);
        points.push((format!("Cause {}: {} (gain in log-likelihood {gain})", k + 1, c.doc), "causes"));
    }
    if found.verdict != Found::NoEffectFound {
        points.extend(found.lack_of_fit.iter().flat_map(|m| &m.sentences).map(|s| (s.clone(), "wrong")));
    }
    points.extend(found.residual_analysis.iter().map(|s| (s.clone(), "wrong")));
    Verdict {
        trust,
        sentence,
        facts: None,
        points: points.into_iter().map(|(sentence, anchor)| Point { sentence, anchor }).collect(),
    }
}

fn chance(p: f64) -> String {
    match p {
        p if p < 1e-300 => "below 1e−300".into(),
        p if p < 1e-4 => text(p, 1),
        p => probability(p),
    }
}

fn wrong(subject: &Subject, found: &DiagnosisDocument) -> Option<Section> {
    let lack_of_fit = &found.lack_of_fit;
    if lack_of_fit.is_empty() {
        return None;
    }
    let time = subject.time();
    let content = html! {
        @for (k, m) in lack_of_fit.iter().enumerate() {
            @let (rms, level, unit) = (shown(m.rms, 3), shown(m.noise_level, 3), m.unit.as_deref().unwrap_or_default());
            h3 { code { (m.output) } ": " (rms) " " (unit) " where noise would leave " (level) " " (unit) }
            ul { @for s in &m.sentences { li { (s) } } }
            div.pair {
                @for figure in of_lack_of_fit(k, m, &time) { (figure.markup()) }
            }
        }
        @if !found.places.is_empty() {
            p { "Where something unknown would enter, by the odds that it does:" }
            div.scroll { table { thead { tr { th { "place" } th.number { "logarithm of the odds" } } } tbody {
                @for s in found.places.iter().filter(|s| s.evidence.is_finite()) { tr {
                    th scope="row" { (entrance(s.place.kind)) " of " code { (s.place.name) } }
                    td.number { (shown(s.evidence, 4)) }
                } }
            } } }
        }
        @if let Some(law) = law_figure(found) {
            p.note {
                "Where the residuals follow one signal alike in all runs, what is missing there, estimated beside the parameters; \
                 the band is two standard deviations wide on either side."
            }
            (law.markup())
        }
    };
    Some(Section::drawn("wrong", "What is wrong", content))
}

/// An unmodelled nonlinearity over its variable.
fn law_figure(found: &DiagnosisDocument) -> Option<Figure> {
    let law = found.attribution.as_ref()?.nonlinearity.as_ref()?;
    let (place, variable) = (&law.place, &law.curve.variable);
    let of = |value: fn(&CurvePoint) -> f64| law.curve.points.iter().map(value).collect::<Vec<f64>>();
    let added = match place.kind {
        PlaceKind::Equation => format!("added to der({})", place.name),
        _ => format!("added to {}", place.name),
    };
    let marks = vec![
        Mark::between(
            "two standard deviations",
            Look::Bound,
            Shape::Band,
            of(|p| p.value - 2.0 * p.deviation),
            of(|p| p.value + 2.0 * p.deviation),
        ),
        Mark::between("estimate", Look::Residual, Shape::Line, Vec::new(), of(|p| p.value)),
    ];
    Some(Figure {
        id: "law".into(),
        group: "law".into(),
        caption: format!("what {} lacks, over {variable}", place.name),
        label: variable.clone(),
        logarithmic: false,
        at: of(|p| p.at),
        panels: vec![Panel { label: added, height: 150, logarithmic: false, marks }],
        names: Vec::new(),
        half: true,
        samples: None,
    })
}

/// In what it enters, in one word.
fn entrance(kind: PlaceKind) -> &'static str {
    match kind {
        PlaceKind::Input => "input",
        PlaceKind::Equation => "equation",
        PlaceKind::Output => "output",
    }
}

/// All of them.
pub(crate) fn figures(subject: &Subject, found: &DiagnosisDocument) -> Vec<Figure> {
    let time = subject.time();
    let lack_of_fit = found
        .lack_of_fit
        .iter()
        .enumerate()
        .flat_map(|(k, m)| of_lack_of_fit(k, m, &time))
        .chain(law_figure(found))
        .chain(front_figure(found));
    let runs = ordered(subject, &found.outputs).into_iter().enumerate();
    lack_of_fit.chain(runs.flat_map(|(k, (_, table))| overlays(k, table))).collect()
}

fn of_lack_of_fit(k: usize, m: &LackOfFit, time: &str) -> Vec<Figure> {
    [bands(k, m, time), windows(k, m, time), amplitudes(k, m)].into_iter().flatten().collect()
}

/// A share of the error for each part of something.
fn shares(id: String, caption: &str, label: String, at: Vec<f64>, values: Vec<f64>) -> Option<Figure> {
    (values.len() > 1).then(|| Figure {
        group: id.clone(),
        id,
        caption: caption.into(),
        label,
        logarithmic: false,
        panels: vec![Panel {
            label: "part of the error [%]".into(),
            height: 130,
            logarithmic: false,
            marks: vec![Mark::between("share", Look::Model, Shape::Stems, vec![0.0; at.len()], values)],
        }],
        at,
        names: Vec::new(),
        half: true,
        samples: None,
    })
}

fn bands(k: usize, m: &LackOfFit, time: &str) -> Option<Figure> {
    let at = m.bands.iter().map(|b| 0.5 * (b.low + b.high)).collect();
    let values = m.bands.iter().map(|b| 100.0 * b.share).collect();
    let unit = if time == "s" { "Hz".to_string() } else { format!("cycles per {time}") };
    let mut figure = shares(format!("bands-{}", k + 1), "in which band", format!("frequency [{unit}]"), at, values)?;
    figure.logarithmic = true;
    Some(figure)
}

fn windows(k: usize, m: &LackOfFit, time: &str) -> Option<Figure> {
    let first = &m.windows.first()?.run;
    let own = || m.windows.iter().filter(|w| w.run == *first);
    let at = own().map(|w| 0.5 * (w.from + w.to)).collect();
    let values = own().map(|w| 100.0 * w.share).collect();
    shares(format!("windows-{}", k + 1), &format!("when, in {first}"), format!("time [{time}]"), at, values)
}

fn amplitudes(k: usize, m: &LackOfFit) -> Option<Figure> {
    let signal = &m.amplitudes.first()?.signal;
    let own = || m.amplitudes.iter().filter(|b| b.signal == *signal);
    let at = own().map(|b| 0.5 * (b.from + b.to)).collect();
    let values = own().map(|b| b.rms).collect();
    let label = format!("size of {signal}");
    let mut figure = shares(format!("amplitudes-{}", k + 1), "at which amplitude", label, at, values)?;
    figure.panels[0].label = format!("RMS{}", bracketed(m.unit.as_deref()));
    figure.panels[0].marks[0].name = "RMS of the error".into();
    Some(figure)
}

fn causes(found: &DiagnosisDocument) -> Option<Section> {
    let causes = &found.causes;
    if causes.is_empty() {
        return None;
    }
    let content = html! { @for (k, c) in causes.iter().enumerate() { (cause(k, c)) } };
    Some(Section::drawn("causes", "Causes", content))
}

fn cause(k: usize, c: &CauseDocument) -> Markup {
    let rivals = c.group.get(1..).unwrap_or_default();
    html! {
        div.cause {
            h3 { (k + 1) ". " (c.doc) " " code { (c.effect) "(" (c.targets.join(", ")) ")" } }
            div.scroll { table { thead { tr { th { "parameter" } th.number { "value" } th.number { "± 2σ" } th { "unit" } th { "what it is" } } } tbody {
                @for p in &c.parameters { tr {
                    th scope="row" { code { (p.name) } }
                    td.number { (shown(p.value, 5)) }
                    td.number { @if let Some(e) = p.standard_error { (text(2.0 * e, 2)) } }
                    td { (p.unit.as_deref().unwrap_or_default()) } td { (p.doc) }
                } }
            } } }
            p {
                "Gain in log-likelihood " strong { (shown(c.gain_training, 5)) }
                @if c.gain_validation.is_some() { ", on the validation runs " strong { (shown(c.gain_validation, 5)) } }
                "; score " (shown(c.score, 5)) "; chance of noise alone " (chance(c.p)) "."
            }
            @if rivals.is_empty() {
                p.note { "These records tell it from everything else in the catalogue." }
            } @else {
                p.warning { "These records cannot tell it from:" }
                ul { @for r in rivals { li { code { (r.place) } " (score " (shown(r.score, 5)) ", likeness " (shown(r.cosine, 3)) ")" } } }
            }
            @if let Some(experiment) = &c.separating_experiment { p { "To tell apart " (experiment) } }
        }
    }
}

/// The best models by number of effects.
fn front(found: &DiagnosisDocument) -> Option<Section> {
    let front = &found.front;
    let first = front.first().filter(|_| front.len() > 1)?;
    let validated = first.error_validation.is_some();
    let crossed = first.error_cross_validated.is_some();
    let percent = |v: f64| if v.is_finite() { format!("{} %", text(100.0 * v, 3)) } else { String::new() };
    let content = html! {
        p.note {
            "Each model as it is written: fitted once more by plain output error, and simulated. Errors are parts of that of the model \
             as it was given, the mean over outputs."
        }
        @if let Some(figure) = front_figure(found) { (figure.markup()) }
        div.scroll { table {
            thead { tr {
                th { "effects" } th.number { "parameters" } th.number { "error, fitted" }
                @if validated { th.number { "validation" } }
                @if crossed { th.number title="each run by a fit to the others; of a single run its last third" { "predicted" } }
                @for o in &first.outputs {
                    th.number { "RMS " code { (o.output) } (bracketed(o.unit.as_deref())) }
                    @if validated { th.number { "validation" } }
                }
                th { "" }
            } }
            tbody { @for m in front { tr {
                th scope="row" {
                    @if m.effects.is_empty() { "as given" }
                    @for (k, effect) in m.effects.iter().enumerate() { @if k > 0 { ", " } code { (effect) } }
                }
                td.number { "+" (m.parameters) }
                td.number { (percent(m.error_training)) }
                @if validated { td.number { (percent(m.error_validation.unwrap_or(f64::NAN))) } }
                @if crossed { td.number { (percent(m.error_cross_validated.unwrap_or(f64::NAN))) } }
                @for o in &m.outputs {
                    td.number { (shown(o.rms_training, 3)) }
                    @if validated { td.number { (shown(o.rms_validation, 3)) } }
                }
                td.reason { @if m.recommended { strong { "recommended" } } @else { (m.objection.as_deref().unwrap_or_default()) } }
            } } }
        } }
    };
    Some(Section::drawn("best-models", "Best models by size", content))
}

/// Errors over the number of effects.
fn front_figure(found: &DiagnosisDocument) -> Option<Figure> {
    let front = &found.front;
    let of = |error: fn(&FrontModel) -> f64| front.iter().map(|m| 100.0 * error(m)).collect::<Vec<f64>>();
    let mut marks =
        vec![Mark::between("fitted runs", Look::Residual, Shape::Dots, Vec::new(), of(|m| m.error_training))];
    if front.iter().any(|m| m.error_validation.is_some()) {
        let values = of(|m| m.error_validation.unwrap_or(f64::NAN));
        marks.push(Mark::between("validation runs", Look::Model, Shape::Dots, Vec::new(), values));
    } else if front.iter().any(|m| m.error_cross_validated.is_some()) {
        let values = of(|m| m.error_cross_validated.unwrap_or(f64::NAN));
        marks.push(Mark::between("predicted", Look::Model, Shape::Dots, Vec::new(), values));
    }
    (front.len() > 1).then(|| Figure {
        id: "front".into(),
        group: "front".into(),
        caption: "error of the written model".into(),
        label: "number of effects".into(),
        logarithmic: false,
        at: (0..front.len()).map(|k| k as f64).collect(),
        panels: vec![Panel { label: "part of the error [%]".into(), height: 150, logarithmic: true, marks }],
        names: front.iter().map(|m| m.effects.len().to_string()).collect(),
        half: true,
        samples: None,
    })
}

/// Equations and text, what goes and what comes.
fn change(subject: &Subject) -> Option<Section> {
    let (source, tree) = subject.extended.as_ref()?;
    let before = subject.tree.as_ref().map_or(Vec::new(), |tree| lines(tree, &subject.source));
    let after = lines(tree, source);
    let sets = |lines: &[Line]| lines.iter().map(|l| l.set.clone()).collect::<Vec<String>>();
    let operations = capture_diff_slices(similar::Algorithm::Myers, &sets(&before), &sets(&after));
    let diff = TextDiff::from_lines(subject.source.text(), source.text());
    let content = html! {
        p.note { "Green is new, red is what it replaces." }
        div.equations { @for operation in &operations { (changed(operation, &before, &after)) } }
        details open {
            summary { "the model's text" }
            pre.text {
                @for part in diff.iter_all_changes() {
                    @match part.tag() {
                        ChangeTag::Equal => (part.value()),
                        ChangeTag::Insert => ins { (part.value()) },
                        ChangeTag::Delete => del { (part.value()) },
                    }
                }
            }
        }
    };
    Some(Section::drawn("change", "The model, and what changes", content))
}

fn changed(operation: &DiffOp, before: &[Line], after: &[Line]) -> Markup {
    let (tag, old, new) = operation.as_tag_tuple();
    html! {
        @if tag == similar::DiffTag::Equal {
            @for line in &after[new] { (set(line, "")) }
        } @else {
            @for line in &before[old] { (set(line, "removed")) }
            @for line in &after[new] { (set(line, "added")) }
        }
    }
}

fn gained(subject: &Subject, found: &DiagnosisDocument) -> Option<Section> {
    let outputs = &found.outputs;
    if outputs.is_empty() {
        return None;
    }
    let role = |validation: bool| if validation { "validation" } else { "fitted" };
    let content = html! {
        div.scroll { table {
            thead { tr {
                th { "run" } th { "" } th { "output" } th.number { "RMS before" } th.number { "after" } th.number { "noise" } th { "unit" }
                th.number { "TIC before" } th.number { "after" } th.number { "R² before" } th.number { "after" }
            } }
            tbody { @for o in outputs { tr {
                td { (o.run) } td { (role(o.validation)) } th scope="row" { code { (o.output) } }
                td.number { (shown(o.rms_before, 3)) } td.number { (shown(o.rms_after, 3)) } td.number { (shown(o.noise_level, 3)) }
                td { (o.unit.as_deref().unwrap_or_default()) }
                td.number { (shown(o.tic_before, 3)) } td.number { (shown(o.tic_after, 3)) }
                td.number { (shown(o.r2_before, 5)) } td.number { (shown(o.r2_after, 5)) }
            } } }
        } }
        @if !found.gains.is_empty() {
            p { "Gain in log-likelihood, with two deviations:" }
            ul { @for g in &found.gains {
                li { (g.run) " (" (role(g.validation)) "): " strong { (shown(g.gain, 5)) }
                    " ± " (text(2.0 * g.deviation, 3)) }
            } }
        }
        @for (k, (run, table)) in ordered(subject, outputs).into_iter().enumerate() {
            details.run open[k < 2] {
                summary { (run) }
                @for figure in overlays(k, table) { (figure.markup()) }
            }
        }
    };
    Some(Section::drawn("gain", "Before and after", content))
}

/// Runs that were held out stand first.
fn ordered<'a>(subject: &'a Subject, outputs: &[OutputGain]) -> Vec<(String, &'a Table)> {
    let held = |run: &str| outputs.iter().any(|o| o.run == run && o.validation);
    let mut runs: Vec<_> = subject.runs.iter().map(|(run, table)| (held(run), run, table)).collect();
    runs.sort_by_key(|(held, ..)| !held);
    let told = |(held, run, table): (bool, &'a String, &'a Table)| {
        (if held { format!("{run} (validation)") } else { run.clone() }, table)
    };
    runs.into_iter().map(told).collect()
}

fn overlays(k: usize, table: &Table) -> Vec<Figure> {
    let Some(time) = table.columns.first() else { return Vec::new() };
    let outputs: Vec<&Column> =
        table.columns.iter().filter(|c| table.column(&format!("{}_before", c.name)).is_some()).collect();
    outputs.iter().enumerate().map(|(o, output)| overlay(k, o, table, time, output)).collect()
}

fn overlay(k: usize, o: usize, table: &Table, time: &Column, output: &Column) -> Figure {
    let other = |kind: &str| table.column(&format!("{}_{kind}", output.name)).map_or(&[][..], |c| &c.values);
    let (before, after) = (other("before"), other("after"));
    let left = |model: &[f64]| output.values.iter().zip(model).map(|(z, y)| z - y).collect::<Vec<f64>>();
    let (rest_before, rest_after) = (left(before), left(after));
    let indices = kept(&[&output.values, before, after, &rest_before, &rest_after], POINTS);
    let pick = |values: &[f64]| indices.iter().filter_map(|k| values.get(*k).copied()).collect::<Vec<f64>>();
    let unit = bracketed(output.unit.as_deref());
    let marks = vec![
        Mark::line("measured", Look::Measured, pick(&output.values)),
        Mark::line("before", Look::Residual, pick(before)),
        Mark::line("after", Look::Model, pick(after)),
    ];
    let rests = vec![
        Mark::line("residual before", Look::Residual, pick(&rest_before)),
        Mark::line("residual after", Look::Model, pick(&rest_after)),
    ];
    Figure {
        id: format!("overlay-{}-{}", k + 1, o + 1),
        group: format!("overlays-{k}"),
        caption: output.name.clone(),
        label: format!("time{}", bracketed(time.unit.as_deref())),
        logarithmic: false,
        at: pick(&time.values),
        panels: vec![
            Panel { label: format!("{}{unit}", output.name), height: 210, logarithmic: false, marks },
            Panel { label: format!("residual{unit}"), height: 110, logarithmic: false, marks: rests },
        ],
        names: Vec::new(),
        half: false,
        samples: (indices.len() < time.values.len()).then_some(time.values.len()),
    }
}

fn moved(found: &DiagnosisDocument) -> Option<Section> {
    let biased = &found.biased_parameters;
    if biased.is_empty() {
        return None;
    }
    let two = |v: Option<f64>| v.map_or(String::new(), |e| format!(" ± {}", text(2.0 * e, 2)));
    let content = html! {
        p.note { "Values with two standard errors. Moved by: in the standard errors that the fit without the effects claims." }
        div.scroll { table {
            thead { tr { th { "parameter" } th.number { "before" } th.number { "after" } th { "unit" } th.number { "moved by" } } }
            tbody { @for b in biased { tr {
                th scope="row" { code { (called(&b.name, b.run.as_deref())) } }
                td.number { (shown(b.before, 5)) (two(b.before_error)) } td.number { (shown(b.after, 5)) (two(b.after_error)) }
                td { (b.unit.as_deref().unwrap_or_default()) } td.number { (shown(b.moved, 3)) }
            } } }
        } }
    };
    Some(Section::drawn("moved", "What the missing effect had moved", content))
}

fn rejected(found: &DiagnosisDocument) -> Option<Section> {
    let rejected = &found.rejected;
    if rejected.is_empty() {
        return None;
    }
    let content = html! {
        p { (found.searches.len()) " searches; the last one ended: " (found.ended) "." }
        details open[rejected.len() <= FEW] {
            summary { (rejected.len()) " fits, and why they were not accepted" }
            div.scroll { table {
                thead { tr { th { "effect" } th.number { "search" } th.number { "gain" } th.number { "validation" } th { "not accepted because" } } }
                tbody { @for r in rejected.iter().take(ROWS) { tr {
                    th scope="row" { code { (r.place) } } td.number { (r.step) } td.number { (shown(r.gain_training, 4)) }
                    td.number { (shown(r.gain_validation, 4)) } td.reason { (r.reason) }
                } } }
            } }
        }
    };
    Some(Section::drawn("rejected", "What was fitted and not accepted", content))
}

fn detectable(found: &DiagnosisDocument) -> Option<Section> {
    let detectable = &found.detectable;
    if detectable.is_empty() {
        return None;
    }
    let content = html! {
        details {
            summary { "the smallest size that four of five records like these would show" }
            div.scroll { table {
                thead { tr { th { "effect" } th { "parameter" } th.number { "smallest" } th { "unit" } th.number title="beside what is fitted" { "distinct" } } }
                tbody { @for d in detectable.iter().take(ROWS) { tr {
                    th scope="row" { code { (d.place) } } td { code { (d.parameter) } }
                    td.number { (shown(d.smallest, 3)) } td { (d.unit.as_deref().unwrap_or_default()) } td.number { (shown(d.distinct, 2)) }
                } } }
            } }
        }
    };
    Some(Section::drawn("detectable", "What would have been seen", content))
}
