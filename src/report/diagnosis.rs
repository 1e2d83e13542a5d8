//! A diagnosis: what is wrong and when, the causes with their alternatives, what changes in the equations, what is gained, what
//! was ruled out.

use super::section::{Part, Rows, Section, Trust, Verdict as Judged};
use crate::equations::{Line, lines, shown as set};
use crate::page::columns::{Column, Columns};
use crate::page::figure::{Figure, Look, Mark, Panel, Shape};
use crate::page::number::{behind, bracketed, unit_of_frequency};
use crate::page::subject::Subject;
use crate::page::thinning::Kept;
use crate::text;
use crate::words::Words;
use fdm_doctor::{Finding, probability};
use fdm_infer::{
    Biased, Cause, EffectAt, Feedback, FrontModel, FrontOutput, LackOfFit, NewValue, OutputGain, PlaceKind,
    UnnamedCause, Verdict,
};
use fdm_results::documents::{DiagnosisDocument, digits, fixed, with_run};
use maud::{Markup, html};
use similar::{ChangeTag, DiffOp, TextDiff, capture_diff_slices};

/// Points of a line.
const POINTS: usize = 4000;
/// Rows of a table that need not be folded, and of what would have been seen.
const FEW: usize = 12;
/// Places, laws and candidates that are named.
const NAMED: usize = 3;
/// Nats behind the likeliest place within which others are named: odds of 100 : 1.
const ALIKE: f64 = 4.6;
/// Probability below which another kind of explanation is not named in short.
const SMALLEST: f64 = 0.005;
/// Standard errors between an estimate and the written value that are told: beyond them something else is wrong, too.
const APART: f64 = 3.0;
/// Fits of a search that are shown.
const NEAREST: usize = 5;
/// Outputs whose errors have columns of their own in text.
const OUTPUTS: usize = 2;
/// Standard errors by which a parameter has moved before it is shown.
const MOVED: f64 = 1.0;

/// Sentences and tables in the words of a field: what is missing, how sure that is and what it changes; where `verbose`, all that was weighed, tried
/// and assumed as well.
pub fn diagnosis_text(found: &DiagnosisDocument, verbose: bool, words: Words) -> String {
    let stopped = is_cut_short(found).then(|| "The search was stopped before its end.".into());
    let head = unexplained(found).chain([verdict(found).sentence]).chain(likelier(found)).chain(stopped);
    let head = head.map(|said| format!("{}\n", words.told(&said))).collect();
    let brief = || mended(found).into_iter().chain([brief(found)]).collect();
    let sections = if verbose { whole(found) } else { brief() };
    text::below(head, &sections.into_iter().map(|section| words.section(section)).collect::<Vec<_>>())
}

/// What is told first: causes or places, what else it could be, the errors of each output.
fn brief(found: &DiagnosisDocument) -> Section {
    let causes = found.causes.iter().enumerate().flat_map(|(k, c)| {
        let values = c.parameters.iter().map(value).collect::<Vec<String>>().join(", ");
        // beside nothing that could stand in its place the verdict says how sure it is
        let among =
            if c.group.is_empty() { String::new() } else { format!("probability {}, ", probability(c.probability)) };
        let sure = format!("{values} ({among}{:.1} nats)", c.loss);
        let list = [sure]
            .into_iter()
            .chain(apart(found, c))
            .chain(alternatives(c))
            .chain(c.separating_experiment.iter().map(to_tell_apart));
        [Part::Line(format!("{}. {}: {}", k + 1, c.place, c.doc)), Part::List(list.collect())]
    });
    let others = found.explanations.iter().filter(|e| e.verdict != found.verdict && e.probability >= SMALLEST);
    let others = others.map(|e| format!("{} ({})", explained(e.verdict), probability(e.probability)));
    let others: Vec<String> = others.collect();
    let others = (!others.is_empty()).then(|| format!("It could be: {}.", others.join(", ")));
    Section::new("brief", "In short")
        .with(Part::Gap)
        .with_all(causes)
        .lines(places(found))
        .lines(lacks(found).take(NAMED).filter(|_| found.causes.is_empty()).map(str::to_string))
        .lines(others)
        .lines(found.feedback.iter().flat_map(following))
        .with(errors(found))
}

/// Errors of each output before and after, all runs together, beside those of noise alone.
fn errors(found: &DiagnosisDocument) -> Rows<(&FrontOutput, Option<&FrontOutput>)> {
    let number = |v: Option<f64>| v.map_or("-".to_string(), |v| digits(v, 3));
    let after = found.front.iter().find(|m| m.recommended).map_or(&[][..], |m| &m.outputs);
    let before = found.front.first().map_or(&[][..], |m| &m.outputs);
    let validated = before.iter().any(|o| o.rms_validation.is_some());
    let noise = |o: &FrontOutput| found.lack_of_fit.iter().find(|m| m.output == o.output).map(|m| m.noise_level);
    let mut table = Rows::over(before.iter().enumerate().map(|(k, o)| (o, after.get(k))));
    table.name("output", |(o, _)| format!("{}{}", o.output, bracketed(o.unit.as_deref())));
    table.number("RMS", |(o, _)| number(o.rms_training));
    if !after.is_empty() {
        table.number("with it", |(_, o)| number(o.and_then(|o| o.rms_training)));
    }
    table.number("noise", |(o, _)| number(noise(o)));
    if validated {
        table.number("validation", |(o, _)| number(o.rms_validation));
        if !after.is_empty() {
            table.number("with it", |(_, o)| number(o.and_then(|o| o.rms_validation)));
        }
    }
    table
}

fn whole(found: &DiagnosisDocument) -> Vec<Section> {
    let all = [
        mended(found),
        Some(causes(found)),
        Some(wrong(found, "")),
        front(found),
        Some(gained(found)),
        moved(found),
        tried(found),
        Some(ended(found)),
    ];
    all.into_iter().flatten().collect()
}

/// The sections of a diagnosis.
pub(crate) fn sections(subject: &Subject, found: &DiagnosisDocument) -> Vec<Section> {
    let runs = ordered(subject, &found.outputs).into_iter().enumerate().map(|(k, (summary, table))| {
        let figures = overlays(k, table).into_iter().map(Part::from).collect();
        Part::Folded { summary, open: k < 2, class: "run", parts: figures }
    });
    let all = [
        mended(found),
        Some(causes(found)).filter(|s| !s.parts.is_empty()),
        Some(wrong(found, &subject.time())).filter(|s| !s.parts.is_empty()),
        front(found),
        change(subject),
        Some(gained(found).with_all(runs)).filter(|_| !found.outputs.is_empty()),
        moved(found),
        tried(found),
        Some(ended(found)),
    ];
    all.into_iter().flatten().collect()
}

/// In one sentence, and the sentences that stand below it, each with the section that shows it.
pub(crate) fn verdict(found: &DiagnosisDocument) -> Judged {
    let resembles = !found.causes.is_empty();
    let said = match (found.verdict, found.stopped) {
        (Verdict::RecordFault, _) => "The records are to be mended, and the model lacks nothing else",
        (Verdict::EffectFound, _) => "Something is missing from the model",
        (Verdict::Disturbance, _) => "A disturbance (process noise) acts on the model",
        (Verdict::Law, _) => "A function of one signal is missing that no effect of the catalogue is",
        (Verdict::UnknownCause, _) if resembles => {
            "Something is missing from the model that is none of the causes that were tried: parts of the records disagree on the \
             nearest one"
        }
        (Verdict::UnknownCause, _) => "The model is wrong in a way that nothing that was tried explains",
        (Verdict::NoEffectFound, true) => "Nothing was found before the search was stopped",
        (Verdict::NoEffectFound, false) => "No missing effect detected",
    };
    let is_clean = found.verdict == Verdict::NoEffectFound && !found.stopped;
    let causes = found.causes.iter().enumerate().map(|(k, c)| {
        format!("Cause {}: {} (probability {}, {:.1} nats)", k + 1, c.doc, probability(c.probability), c.loss)
    });
    let stopped = is_cut_short(found).then(|| "The search was stopped before its end".into());
    let faults = found.mended.iter().flat_map(|mended| {
        let more = if found.verdict == Verdict::RecordFault { "" } else { "; all else is about records so mended" };
        mended.faults.iter().map(move |f| format!("{}{more}", fault(f)))
    });
    let of_told = found.explanations.iter().find(|e| e.verdict == found.verdict);
    let probable = of_told.map_or(String::new(), |e| format!(" (probability {})", probability(e.probability)));
    Judged::new(if is_clean { Trust::Good } else { Trust::Reserved }, format!("{said}{probable}."))
        .with_points(unexplained(found), "gain")
        .with_points(likelier(found), "wrong")
        .with_points(faults, "mended")
        .with_points(stopped, "causes")
        .with_points(causes, "causes")
        .with_points(places(found), "wrong")
        .with_points(lacks(found).map(str::to_string), "wrong")
}

/// What is likelier than what is told, and cannot be told: faults of records that no repair was found for, sets that predict worse.
fn likelier(found: &DiagnosisDocument) -> Option<String> {
    let best = found.explanations.first().filter(|e| e.verdict != found.verdict)?;
    let told = found.explanations.iter().find(|e| e.verdict == found.verdict)?;
    let is = best.probability > told.probability;
    is.then(|| format!("Likelier is {} (probability {}).", explained(best.verdict), probability(best.probability)))
}

/// Outputs of which the model explains nothing: what is found beside such a fit may be about the fit.
fn unexplained(found: &DiagnosisDocument) -> impl Iterator<Item = String> {
    OutputGain::unexplained(&found.outputs).into_iter().map(|(output, r2)| {
        let r2 = fixed(Some(r2), 2);
        format!("The model as it was given explains nothing of {output} (R^2 {r2}): look at its structure and its start values first.")
    })
}

/// Whether the search was stopped after something was found.
fn is_cut_short(found: &DiagnosisDocument) -> bool {
    found.stopped && matches!(found.verdict, Verdict::EffectFound | Verdict::Disturbance)
}

/// What the outputs lack, where something is wrong.
fn lacks(found: &DiagnosisDocument) -> impl Iterator<Item = &str> {
    let wrong = found.lack_of_fit.iter().filter(|_| found.verdict != Verdict::NoEffectFound);
    wrong.flat_map(|m| &m.sentences).map(String::as_str)
}

/// What is wrong, where, and what it could be; `time` is the unit of time.
fn wrong(found: &DiagnosisDocument, time: &str) -> Section {
    let of_output = |(k, m): (usize, &LackOfFit)| {
        let unit = behind(m.unit.as_deref());
        let (rms, level) = (digits(m.rms, 3), digits(m.noise_level, 3));
        let heading = format!("`{}`: {rms}{unit} where noise would leave {level}{unit}", m.output);
        let parts = [Part::Heading(heading), Part::List(m.sentences.clone()), Part::Pair(of_lack_of_fit(k, m, time))];
        parts.map(Part::on_page)
    };
    let said = lacks(found).map(|said| Part::Line(format!("  {said}")).in_text());
    let mut kinds = Rows::over(&found.explanations);
    kinds.words("what it could be", |e| explained(e.verdict));
    kinds.number("probability", |e| probability(e.probability));
    kinds.number("evidence", |e| format!("{:.1} nats", e.evidence));
    Section::new("wrong", "What is wrong")
        .with(kinds)
        .lines(places(found))
        .with_all(found.lack_of_fit.iter().enumerate().flat_map(of_output))
        .with_all(said)
}

/// A kind of explanation, in words.
fn explained(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::NoEffectFound => "nothing beside noise",
        Verdict::RecordFault => "a fault of the records, or where they begin",
        Verdict::EffectFound => "effects of the catalogue",
        Verdict::Disturbance => "a disturbance in an equation",
        Verdict::Law => "a function of one signal in an equation",
        Verdict::UnknownCause => "none of these",
    }
}

/// Where what has no name enters, in sentences, where that is the verdict.
fn places(found: &DiagnosisDocument) -> Vec<String> {
    let is_it = |u: &&UnnamedCause| match found.verdict {
        Verdict::Disturbance => u.signal.is_none() && u.place.kind == PlaceKind::Equation,
        Verdict::Law => u.signal.is_some(),
        Verdict::UnknownCause => u.place.kind == PlaceKind::Output,
        Verdict::EffectFound | Verdict::RecordFault | Verdict::NoEffectFound => false,
    };
    let own: Vec<&UnnamedCause> = found.unnamed.iter().filter(is_it).collect();
    let best = own.first().map_or(0.0, |u| u.evidence);
    let near = own.into_iter().filter(|u| u.evidence > best - ALIKE).take(NAMED);
    near.map(|u| match &u.signal {
        Some(signal) => format!("a function of {signal} in {} ({:.1} nats)", u.place, u.evidence),
        None => format!("something of its own course in every run in {} ({:.1} nats)", u.place, u.evidence),
    })
    .collect()
}

/// All figures of a diagnosis.
pub(crate) fn figures(subject: &Subject, found: &DiagnosisDocument) -> Vec<Figure> {
    let time = subject.time();
    let lack_of_fit =
        found.lack_of_fit.iter().enumerate().flat_map(|(k, m)| of_lack_of_fit(k, m, &time)).chain(front_figure(found));
    let runs = ordered(subject, &found.outputs).into_iter().enumerate();
    lack_of_fit.chain(runs.flat_map(|(k, (_, table))| overlays(k, table))).collect()
}

fn of_lack_of_fit(k: usize, m: &LackOfFit, time: &str) -> Vec<Figure> {
    [bands(k, m, time), windows(k, m, time), amplitudes(k, m)].into_iter().flatten().collect()
}

/// A share of the error for each part of something.
fn shares(id: String, caption: &str, label: String, at: Vec<f64>, values: Vec<f64>) -> Option<Figure> {
    (values.len() > 1).then(|| {
        let stems = Mark::between("share", Look::Model, Shape::Stems, vec![0.0; at.len()], values);
        Figure::new(id, caption, label, at).with(Panel::new("part of the error [%]", 130, vec![stems])).half()
    })
}

fn bands(k: usize, m: &LackOfFit, time: &str) -> Option<Figure> {
    let at = m.bands.iter().map(|b| 0.5 * (b.low + b.high)).collect();
    let values = m.bands.iter().map(|b| 100.0 * b.share).collect();
    let unit = unit_of_frequency(time);
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
    let unit = m.unit.as_deref().filter(|_| m.output == *signal);
    let label = format!("size of {signal}{}", bracketed(unit));
    let mut figure = shares(format!("amplitudes-{}", k + 1), "at which amplitude", label, at, values)?;
    figure.panels[0].label = format!("RMS{}", bracketed(m.unit.as_deref()));
    figure.panels[0].marks[0].name = "RMS of the error".into();
    Some(figure)
}

/// A fault of the records in a sentence.
fn fault(found: &Finding) -> String {
    format!("`{}`: {}: {}", found.channels.join("`, `"), found.fault, found.what)
}

/// Faults of the records with their repairs, and what mending them changes.
fn mended(found: &DiagnosisDocument) -> Option<Section> {
    let mended = found.mended.as_ref()?;
    let faults = mended.faults.iter().flat_map(|f| {
        let repair = f.repair.iter().map(|repair| format!("repair: {}", repair.line));
        [Part::Line(fault(f)), Part::List(repair.collect())]
    });
    let number = |v: Option<f64>| v.map_or("-".to_string(), |v| digits(v, 3));
    let mut table = Rows::over(&mended.outputs);
    table.name("output", |o| format!("{}{}", o.output, bracketed(o.unit.as_deref())));
    table.number("RMS as recorded", |o| number(o.before));
    table.number("RMS mended", |o| number(o.after));
    let note = format!(
        "With probability {} the records are to be mended ({:.1} nats). RMS of the model as it was given, fitted to the records.",
        probability(mended.probability),
        mended.evidence
    );
    Some(Section::new("mended", "Mend the records").explained(&note).with_all(faults).with(table))
}

/// Each cause with its parameters, what it gains, and its alternatives.
fn causes(found: &DiagnosisDocument) -> Section {
    let parts = found.causes.iter().enumerate().flat_map(|(k, c)| {
        let list = apart(found, c).into_iter().chain(cause(c)).collect();
        [Part::Heading(format!("{}. {}: {}", k + 1, c.place, c.doc)), Part::List(list)]
    });
    let title = if found.verdict == Verdict::UnknownCause { "What comes nearest" } else { "Causes" };
    Section::new("causes", title).with_all(parts)
}

fn cause(c: &Cause) -> Vec<String> {
    let mut list: Vec<String> = c.parameters.iter().map(value).collect();
    list.push(format!("probability {}; without it alone {:.1} nats are lost", probability(c.probability), c.loss));
    list.extend(alternatives(c));
    list.extend(c.separating_experiment.iter().map(to_tell_apart));
    list
}

/// A parameter of an effect with its error.
fn value(p: &NewValue) -> String {
    let unit = p.unit.as_ref().filter(|u| *u != "1").map_or(String::new(), |u| format!(" {u}"));
    let error = p.standard_error.map_or(String::new(), |e| format!(" +- {}", digits(e, 2)));
    let apart = |written: &f64| p.standard_error.is_some_and(|e| (written - p.value).abs() > APART * e);
    // a wrong text fitted to other weights has other values
    let written = p
        .written
        .filter(apart)
        .map_or(String::new(), |w| format!("; a plain fit, as it is written, has {}", digits(w, 5)));
    format!("{} = {}{error}{unit}{written}", p.name, digits(p.value, 5))
}

/// How far parts of the records are apart on it, where that says that it is not the cause.
fn apart(found: &DiagnosisDocument, c: &Cause) -> Option<String> {
    let scatter = c.scatter.filter(|_| found.verdict == Verdict::UnknownCause)?;
    Some(format!("parts of the records are {} times as far apart on it as noise lets them", digits(scatter, 2)))
}

fn alternatives(c: &Cause) -> Option<String> {
    let others = c.group.iter().map(|r| format!("{} ({})", r.place, probability(r.probability)));
    let others: Vec<String> = others.collect();
    (!others.is_empty()).then(|| format!("these records cannot tell it from {}", others.join(", ")))
}

fn to_tell_apart(experiment: &String) -> String {
    format!("to tell apart {experiment}")
}

/// The best models by number of effects, by what their texts do when they are simulated.
fn front(found: &DiagnosisDocument) -> Option<Section> {
    let front = &found.front;
    let outputs = &front.first().filter(|_| front.len() > 1)?.outputs;
    let validated = front.iter().any(|m| m.error_validation.is_some());
    let percent = |v: Option<f64>| match v.filter(|v| v.is_finite()) {
        Some(v) => format!("{:.1} %", 100.0 * v),
        None => "-".into(),
    };
    let number = |v: Option<f64>| v.map_or("-".to_string(), |v| digits(v, 3));
    let mut table = Rows::over(front);
    table.name("best models by size", named);
    table.number("parameters", |m| format!("+{}", m.parameters));
    table.number("evidence", |m| format!("{:.1}", m.evidence));
    table.number("error, fitted", |m| percent(Some(m.error_training)));
    if validated {
        table.number("validation", |m| percent(m.error_validation));
    }
    for (k, output) in outputs.iter().enumerate() {
        let unit = bracketed(output.unit.as_deref());
        let only_on_page = outputs.len() > OUTPUTS;
        let title =
            if only_on_page { format!("RMS {}{unit}", output.output) } else { format!("RMS {}", output.output) };
        let column = table.number(&title, |m| m.outputs.get(k).map_or("-".into(), |o| number(o.rms_training)));
        if only_on_page {
            column.on_page();
        }
        if validated {
            let column =
                table.number("validation", |m| m.outputs.get(k).map_or("-".into(), |o| number(o.rms_validation)));
            if only_on_page {
                column.on_page();
            }
        }
    }
    let note = "Each model as it is written: fitted once more by plain output error, and simulated. Errors are parts of that of the model \
                as it was given, the mean over outputs.";
    let section = Section::new("best-models", "Best models by size").explained(note);
    Some(section.with_all(front_figure(found)).with(table))
}

/// The effects of a model of the front.
fn named(model: &&FrontModel) -> String {
    match (model.effects.is_empty(), model.recommended) {
        (true, _) => "as given".into(),
        (false, true) => format!("{} (written)", joined(&model.effects)),
        (false, false) => joined(&model.effects),
    }
}

fn joined(effects: &[EffectAt]) -> String {
    effects.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

/// Errors over the number of effects.
fn front_figure(found: &DiagnosisDocument) -> Option<Figure> {
    // along the axis their number rises
    let mut front: Vec<&FrontModel> = found.front.iter().collect();
    front.sort_by_key(|m| m.effects.len());
    let of = |error: fn(&FrontModel) -> f64| front.iter().map(|m| 100.0 * error(m)).collect::<Vec<f64>>();
    let mut marks =
        vec![Mark::between("fitted runs", Look::Residual, Shape::Dots, Vec::new(), of(|m| m.error_training))];
    if front.iter().any(|m| m.error_validation.is_some()) {
        let values = of(|m| m.error_validation.unwrap_or(f64::NAN));
        marks.push(Mark::between("validation runs", Look::Model, Shape::Dots, Vec::new(), values));
    }
    (front.len() > 1).then(|| {
        Figure::new(
            "front",
            "error of the written model",
            "number of effects",
            front.iter().map(|m| m.effects.len() as f64).collect(),
        )
        .with(Panel::new("part of the error [%]", 150, marks).logarithmic())
        .named(front.iter().map(|m| m.effects.len().to_string()).collect())
        .half()
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

/// How outputs are matched before and after, and what each run gains.
fn gained(found: &DiagnosisDocument) -> Section {
    let role = |validation: bool| if validation { "validation" } else { "training" };
    let number = |v: Option<f64>| v.map_or("-".to_string(), |v| digits(v, 3));
    let mut table = Rows::over(&found.outputs);
    table.words("", |o| role(o.validation));
    table.words("run", |o| o.run.clone());
    table.name("output", |o| o.output.clone());
    table.number("RMS before", |o| number(o.rms_before));
    table.number("after", |o| number(o.rms_after));
    table.number("noise", |o| digits(o.noise_level, 3));
    table.unit(|o| o.unit.clone()).on_page();
    table.number("TIC before", |o| fixed(o.tic_before, 4));
    table.number("after", |o| fixed(o.tic_after, 4));
    table.number("R^2 before", |o| fixed(o.r2_before, 4));
    table.number("after", |o| fixed(o.r2_after, 4));
    Section::new("gain", "Before and after").with(table)
}

/// Validation runs stand first.
fn ordered<'a>(subject: &'a Subject, outputs: &[OutputGain]) -> Vec<(String, &'a Columns)> {
    let is_validation = |run: &str| outputs.iter().any(|o| o.run == run && o.validation);
    let mut runs: Vec<_> = subject.runs.iter().map(|(run, table)| (is_validation(run), run, table)).collect();
    runs.sort_by_key(|(validation, ..)| !validation);
    let titled = |(validation, run, table): (bool, &'a String, &'a Columns)| {
        (if validation { format!("{run} (validation)") } else { run.clone() }, table)
    };
    runs.into_iter().map(titled).collect()
}

fn overlays(k: usize, table: &Columns) -> Vec<Figure> {
    let Some(time) = table.columns.first() else { return Vec::new() };
    let outputs: Vec<&Column> =
        table.columns.iter().filter(|c| table.column(&format!("{}_before", c.name)).is_some()).collect();
    outputs.iter().enumerate().map(|(o, output)| overlay(k, o, table, time, output)).collect()
}

fn overlay(k: usize, o: usize, table: &Columns, time: &Column, output: &Column) -> Figure {
    let other = |kind: &str| table.column(&format!("{}_{kind}", output.name)).map_or(&[][..], |c| &c.values);
    let (before, after) = (other("before"), other("after"));
    let left = |model: &[f64]| output.values.iter().zip(model).map(|(z, y)| z - y).collect::<Vec<f64>>();
    let (rest_before, rest_after) = (left(before), left(after));
    let kept = Kept::new(&[&output.values, before, after, &rest_before, &rest_after], POINTS);
    let pick = |values: &[f64]| kept.pick(values);
    let unit = bracketed(output.unit.as_deref());
    let marks = vec![
        Mark::samples("measured", Look::Measured, pick(&output.values)),
        Mark::line("before", Look::Residual, pick(before)),
        Mark::line("after", Look::Model, pick(after)),
    ];
    let rests = vec![
        Mark::samples("residual before", Look::Residual, pick(&rest_before)),
        Mark::samples("residual after", Look::Model, pick(&rest_after)),
    ];
    Figure::new(
        format!("overlay-{}-{}", k + 1, o + 1),
        output.name.clone(),
        format!("time{}", bracketed(time.unit.as_deref())),
        pick(&time.values),
    )
    .in_group(format!("overlays-{k}"))
    .with(Panel::new(format!("{}{unit}", output.name), 210, marks))
    .with(Panel::new(format!("residual{unit}"), 110, rests))
    .thinned(kept.samples())
}

/// Parameters that the missing effects had moved.
fn moved(found: &DiagnosisDocument) -> Option<Section> {
    let far = found.biased_parameters.iter().filter(|b| b.moved.is_some_and(|m| m.abs() >= MOVED));
    let far: Vec<&Biased> = far.collect();
    let any = !far.is_empty();
    let error = |e: Option<f64>| e.map_or(String::new(), |e| format!("+- {}", digits(e, 2)));
    let mut table = Rows::over(far);
    table.name("what the missing effect had moved", |b| with_run(&b.name, b.run.as_deref()));
    table.number("before", |b| digits(b.before, 5));
    table.number("", |b| error(b.before_error));
    table.number("after", |b| digits(b.after, 5));
    table.number("", |b| error(b.after_error));
    table.unit(|b| b.unit.clone()).on_page();
    table.number("moved by", |b| format!("{:.1} standard errors", b.moved.unwrap_or_default()));
    any.then(|| Section::new("moved", "What the missing effect had moved").with(table))
}

/// What was fitted, search by search.
fn tried(found: &DiagnosisDocument) -> Option<Section> {
    let count: usize = found.searches.iter().map(|s| s.tried.len()).sum();
    let best = found.searches.iter().enumerate();
    let best = best.flat_map(|(k, s)| s.tried.iter().take(NEAREST).map(move |t| (k + 1, t)));
    let mut table = Rows::over(best);
    table.name("tried", |(_, t)| joined(&t.effects));
    table.number("search", |(k, _)| k.to_string());
    table.number("evidence", |(_, t)| format!("{:+.1}", t.evidence));
    let summary =
        format!("the likeliest of {count} fits, with their evidence beside the model from which each search went on");
    let folded = Part::Folded { summary, open: count <= FEW, class: "", parts: vec![table.into()] };
    let more = (count > 0).then(|| Part::Line(format!("the likeliest of {count} fits (--json lists all)")).in_text());
    (count > 0).then(|| Section::new("tried", "What was tried").with(folded).with_all(more))
}

/// What the records hide, why the search ended, and what was assumed.
fn ended(found: &DiagnosisDocument) -> Section {
    let band = found.band.map(|(low, high)| {
        let (low, high) = (digits(low, 3), digits(high, 3));
        format!("In the frequency domain, from {low} to {high} cycles per unit of time.")
    });
    let left_out = found.left_out.len();
    let left_out = (left_out > 0)
        .then(|| format!("{left_out} candidates could not be tried (--json lists them with the reasons)."));
    let said = std::iter::once(format!("The search ended: {}.", found.ended));
    Section::new("search", "The search")
        .with_all(feedback(found))
        .with(Part::Gap)
        .lines(said.chain(band).chain(found.notes.iter().cloned()).chain(left_out))
}

/// Inputs that move with the states, and what that hides.
fn feedback(found: &DiagnosisDocument) -> Vec<Part> {
    let Some(feedback) = &found.feedback else { return Vec::new() };
    let inputs = following(feedback);
    let hidden: Vec<String> = feedback.hidden.iter().take(FEW).map(ToString::to_string).collect();
    let more = feedback.hidden.len() - hidden.len();
    let more = if more > 0 { format!(" and {more} more (--json)") } else { String::new() };
    let hides = match hidden.is_empty() {
        true => "nothing that was tried is hidden by that".into(),
        false => format!(
            "what these records hide, as the fitted parameters make up for nearly all of it: {}{more}; inputs that do not \
             move with the states would show it",
            hidden.join(", ")
        ),
    };
    std::iter::once(Part::Gap).chain(inputs.chain([hides]).map(Part::Line)).collect()
}

/// Inputs that move with the states, and how much of them is their own.
fn following(feedback: &Feedback) -> impl Iterator<Item = String> {
    feedback.inputs.iter().map(|input| {
        let (name, own) = (&input.input, 100.0 * (1.0 - input.explained));
        match input.feedback {
            true => format!("{name} follows the states, as under a controller or a pilot: {own:.0} % of it is its own"),
            false => format!("{name} moves with the states: {own:.0} % of it is its own"),
        }
    })
}
