//! A study: how often intervals hold, how far estimates scatter beside their errors, how they are distributed, and what became of the repeats.

use super::section::{Cell, Part, Point, Rows, Section, Trust, Verdict, capital};
use crate::page::columns::Columns;
use crate::page::figure::{Figure, Look, Mark, Panel, Shape};
use crate::page::number::{bracketed, shown};
use crate::text;
use fdm_results::documents::study::{
    Colour, Coverage, Figure as Estimated, Goal, GoalCoverage, Interval, Judged, Kind, Pooled, Repeat, Share, Study,
    Subject,
};
use fdm_results::documents::{digits, digits_by_error};
use maud::html;

/// Parameters whose estimates are drawn.
const DRAWN: usize = 24;
/// Coverages within this of 95 % are good.
const GOOD: f64 = 0.02;
/// Below this nobody should rely on them.
const LEAST: f64 = 0.88;
/// Histograms reach so many errors to both sides, in so many columns.
const REACH: f64 = 4.0;
const COLUMNS: usize = 32;
/// Kinds of errors, those to be trusted first, and what they are called in figures.
const KINDS: [(Kind, &str, Look); 2] =
    [(Kind::Corrected, "corrected", Look::Model), (Kind::CramerRao, "Cramér–Rao", Look::Residual)];

/// What the intervals are worth; every parameter with bias, scatter and coverage; what should not be overlooked.
pub fn study_table(study: &Study) -> String {
    text::sections(&[coverages(study), requirements(study), outcomes(study)])
}

/// What can be said in a sentence, and what speaks against the intervals.
pub(crate) fn verdict(study: &Study) -> Verdict {
    let (done, converged, noise) = (study.done, study.converged, colour(study.colour));
    let Some(pooled) = study.trusted() else {
        return Verdict::new(Trust::Bad, format!("No interval came of {done} repeats with {noise} noise."));
    };
    let coverage = pooled.coverage;
    let sentence = format!(
        "Nominal 95 % intervals hold the truth in {} of all cases, over {converged} repeats with {noise} noise.",
        between(coverage, pooled.interval)
    );
    let mut verdict = Verdict::new(Trust::Reserved, sentence);
    let mut point = |said: String, anchor: &'static str| verdict.points.push(Point { sentence: said, anchor });
    let (name, share) = &pooled.worst;
    if (share - 0.95).abs() > GOOD {
        point(format!("Furthest off: `{name}`, whose intervals hold in {} %", percent(*share)), "coverage");
    }
    let biased = study.parameters.iter().filter(|p| p.is_biased()).count();
    if let Some(said) = more_bias(study).filter(|_| biased * 20 > study.parameters.len()) {
        point(capital(&said), "coverage");
    }
    if let Some(worst) = study.worst_requirement()
        && (worst.coverage.share - 0.95).abs() > GOOD
    {
        let share = percent(worst.coverage.share);
        point(format!("Requirement furthest off: `{}`, {share} %", worst.goal.name), "requirements-coverage");
    }
    if let Some(said) = not_converged(study) {
        point(said, "outcomes");
    }
    if !study.is_whole() {
        point(format!("Interrupted: {done} of {} repeats are done", study.asked), "outcomes");
    }
    verdict.trust = match (coverage - 0.95).abs() {
        _ if coverage < LEAST => Trust::Bad,
        off if off <= GOOD && verdict.points.is_empty() => Trust::Good,
        _ => Trust::Reserved,
    };
    verdict
}

/// Percent, with what chance leaves open, in a sentence.
fn between(share: f64, interval: [f64; 2]) -> String {
    let [low, high] = interval.map(percent);
    format!("{} % ({low} to {high} %)", percent(share))
}

/// Its sections, with what each repeat gave where that is at hand; none before the first repeat.
pub(crate) fn sections(study: &Study, repeats: Option<&Columns>) -> Vec<Section> {
    if study.parameters.is_empty() {
        return Vec::new();
    }
    let drawn = repeats.map_or(Vec::new(), |repeats| histograms(study, repeats));
    let more = study.parameters.len() - drawn.len();
    let estimates = (!drawn.is_empty()).then(|| {
        Section::new("estimates", "Estimates of the repeats")
            .line("The deviation of every estimate from the truth, in standard errors of its own repeat, beside the normal distribution.")
            .with(Part::Pair(drawn))
            .notes((more > 0).then(|| format!("{more} more are in `repeats.csv`.")))
    });
    let all = [Some(coverages(study)), Some(requirements(study)), estimates, Some(outcomes(study))];
    all.into_iter().flatten().filter(|s| !s.parts.is_empty()).collect()
}

/// All of its figures.
pub(crate) fn figures(study: &Study, repeats: Option<&Columns>) -> Vec<Figure> {
    let histograms = repeats.map_or(Vec::new(), |repeats| histograms(study, repeats));
    [coverage(study), scatter(study)].into_iter().flatten().chain(histograms).collect()
}

/// What intervals are worth, all together and parameter by parameter.
fn coverages(study: &Study) -> Section {
    let pooled = study.pooled.iter().map(|pooled| {
        let [low, high] = pooled.interval.map(percent);
        format!(
            "nominal 95 % intervals by {} errors hold the truth in {} % ({low}-{high}) of all parameters; furthest off: {} with {} %; scatter over error {:.2} to {:.2}",
            kind(pooled.kind), percent(pooled.coverage), pooled.worst.0, percent(pooled.worst.1), pooled.ratios[0], pooled.ratios[1],
        )
    });
    let worst = study.worst_requirement().map(|worst| {
        format!(
            "nominal 95 % intervals of requirements: furthest off: {} with {} %; `above` and `below` count the truths beyond their ends",
            worst.goal.name,
            percent(worst.coverage.share)
        )
    });
    let note = "Bias is in standard errors, with what chance alone gives in 95 % of cases. Ratios are the scatter of the estimates over the root mean square of \
                the printed errors: 1 is right, more means that errors are printed too small. In brackets the interval of 95 % that so many repeats leave open.";
    let whole = if study.is_whole() { String::new() } else { format!(" of {} (interrupted)", study.asked) };
    let noise = colour(study.colour);
    let head = format!("{}{whole} repeats with {noise} noise, seed {}", study.done, study.seed);
    Section::new("coverage", "What intervals are worth")
        .with(Part::Line(head).in_text())
        .lines(pooled.chain(worst))
        .with(parameters(study))
        .explained(note)
        .with_all([coverage(study), scatter(study)].into_iter().flatten())
}

fn parameters(study: &Study) -> Rows<(usize, &Coverage)> {
    let mut table = Rows::over(study.parameters.iter().enumerate());
    table.number("no.", |(k, _)| k + 1).on_page();
    if study.parameters.iter().any(|p| !p.subject.step.is_empty()) {
        let mut last = "";
        table.words("step", |(_, p)| {
            let same = std::mem::replace(&mut last, &p.subject.step) == p.subject.step;
            if same { String::new() } else { p.subject.step.clone() }
        });
    }
    table.name("parameter", |(_, p)| p.subject.name.clone());
    table.runs(|(_, p)| p.subject.run.as_deref());
    table.unit(|(_, p)| p.subject.unit.clone()).on_page();
    let settled = |p: &Coverage, v: f64| digits(v, digits_by_error(p.subject.truth, p.scatter, 3).unwrap_or(5));
    let finite = |v: f64, text: String| if v.is_finite() { text } else { String::new() };
    table.number("truth", |(_, p)| settled(p, p.subject.truth));
    table.number("mean", |(_, p)| finite(p.mean, settled(p, p.mean)));
    table.number("bias", |(_, p)| {
        Cell::warned(finite(p.bias, format!("{:+.2}", p.bias)), p.bias.is_finite() && p.is_biased())
    });
    table.number("+-", |(_, p)| finite(p.bias_chance, format!("{:.2}", p.bias_chance)));
    table.number("scatter", |(_, p)| finite(p.scatter, digits(p.scatter, 3)));
    for (of, ..) in printed(study).into_iter().rev() {
        let cell = |p: &Coverage, text: fn(&Interval) -> String| p.interval(of).map_or(String::new(), text);
        table.number(kind(of), |(_, p)| cell(p, |i| digits(i.error, 3)));
        table.number("scatter/it", |(_, p)| cell(p, |i| format!("{:.2}", i.ratio)));
        table.number("covers %", |(_, p)| {
            let too_few = p.interval(of).is_some_and(|i| i.coverage.interval[1] < 0.95);
            Cell::coloured(cell(p, |i| covers(&i.coverage)), too_few)
        });
    }
    table
}

/// What intervals of requirements are worth: truth, mean and scatter of the values, half width and coverage of the intervals, on which side the truth was missed.
fn requirements(study: &Study) -> Section {
    let value = |r: &GoalCoverage, v: Option<f64>| {
        let digits = |v: f64| digits(v, digits_by_error(v, r.scatter.unwrap_or(0.0), 3).unwrap_or(5));
        v.map_or(String::new(), digits)
    };
    let width = |v: Option<f64>| v.map_or(String::new(), |v| digits(v, 3));
    let mut table = Rows::over(&study.requirements);
    table.name("requirement", |r| {
        let unit = r.goal.unit.as_deref().filter(|u| *u != "1").map_or(String::new(), |u| format!(" [{u}]"));
        format!("{}{unit}", r.goal.name)
    });
    table.number("truth", |r| value(r, r.goal.truth));
    table.number("mean", |r| value(r, r.mean));
    table.number("scatter", |r| width(r.scatter));
    table.number("half width", |r| width(r.half_width));
    table.number("covers %", |r| Cell::coloured(covers(&r.coverage), r.coverage.interval[1] < 0.95));
    table.number("above", |r| r.missed[0]);
    table.number("below", |r| r.missed[1]);
    table.number("by draws", |r| format!("{} %", percent(r.drawn as f64 / r.coverage.of.max(1) as f64)));
    let note = "The truth is the value at the parameters that the records were made with. `above` and `below` count the truths beyond the ends of the intervals. \
                A requirement that is not linear within the errors has its interval by draws.";
    let there = !study.requirements.is_empty();
    Section::new("requirements-coverage", "What intervals of requirements are worth")
        .with_all(there.then(|| Part::from(table)))
        .with_all(there.then(|| Part::Note(note.into()).on_page()))
}

/// What should not be overlooked, and what became of the repeats.
fn outcomes(study: &Study) -> Section {
    let lost = study.requirements.iter().filter(|r| r.coverage.of < study.converged);
    let lost: Vec<String> =
        lost.map(|r| format!("{} ({} of {})", r.goal.name, study.converged - r.coverage.of, study.converged)).collect();
    let lost =
        (!lost.is_empty()).then(|| format!("requirements without an interval in some repeats: {}", lost.join(", ")));
    let none = study.no_requirements.as_ref().map(|why| format!("requirements that are not studied: {why}"));
    let reasons = study.astray.iter().map(|(reason, n)| Part::Line(format!("  {n}: {reason}")).in_text());
    let said = [lost, none, more_bias(study), not_converged(study)].into_iter().flatten().map(Part::Line);
    let said: Vec<Part> = said.chain(reasons).collect();
    let part = |n: usize| match study.done {
        0 => String::new(),
        done => format!("{} %", percent(n as f64 / done as f64)),
    };
    let table = html! {
        div.scroll { table { tbody {
            tr { th scope="row" { "converged" } td.number { (study.converged) } td.number { (part(study.converged)) } }
            @for (reason, count) in &study.astray {
                tr { th scope="row" { (reason) } td.number { (count) } td.number { (part(*count)) } }
            }
            @if study.done < study.asked { tr { th scope="row" { "not done" } td.number { (study.asked - study.done) } td {} } }
        } } }
    };
    Section::new("outcomes", "What became of the repeats")
        .with(Part::Markup(table))
        .with_all((!said.is_empty()).then_some(Part::Gap))
        .with_all(said)
        .explained(format!("Seed {}.", study.seed))
}

/// Parameters with more bias than chance explains.
fn more_bias(study: &Study) -> Option<String> {
    let biased = study.parameters.iter().filter(|p| p.is_biased());
    let names: Vec<&str> = biased.map(|p| p.subject.name.as_str()).collect();
    let (few, all) = (names.len(), study.parameters.len());
    (few > 0).then(|| {
        format!("more bias than chance (`!`, one parameter in twenty by chance; {few} of {all}): {}", names.join(", "))
    })
}

/// How many repeats have no interval, and what they would leave of the coverage.
fn not_converged(study: &Study) -> Option<String> {
    let of_all = study
        .trusted()
        .map_or(String::new(), |p| format!("; counted as misses they leave {} % of all intervals", percent(p.of_all)));
    let lost = study.done - study.converged;
    (lost > 0).then(|| format!("{lost} of {} repeats did not converge{of_all}", study.done))
}

/// Kinds of errors that were printed for any parameter.
fn printed(study: &Study) -> Vec<(Kind, &'static str, Look)> {
    let any = |kind: Kind| study.parameters.iter().any(|p| p.interval(kind).is_some());
    KINDS.into_iter().filter(|(kind, ..)| any(*kind)).collect()
}

/// Percent, with the interval that chance leaves.
fn covers(share: &Share) -> String {
    let [low, high] = share.interval.map(percent);
    format!("{} ({low}-{high})", percent(share.share))
}

fn percent(share: f64) -> String {
    format!("{:.1}", 100.0 * share)
}

fn kind(kind: Kind) -> &'static str {
    match kind {
        Kind::CramerRao => "Cramer-Rao",
        Kind::Corrected => "corrected",
    }
}

fn colour(colour: Option<Colour>) -> &'static str {
    match colour {
        None => "the described",
        Some(Colour::White) => "white",
        Some(Colour::Fitted) => "fitted",
        Some(Colour::Ar1) => "AR(1)",
        Some(Colour::Pink) => "pink",
    }
}

/// How often the intervals of each parameter hold, and its scatter over its error.
fn coverage(study: &Study) -> Option<Figure> {
    let (parameters, kinds) = (&study.parameters, printed(study));
    if parameters.is_empty() || kinds.is_empty() {
        return None;
    }
    // the kinds of errors of a parameter stand beside each other
    let places: Vec<(usize, usize)> =
        (0..parameters.len()).flat_map(|k| (0..kinds.len()).map(move |j| (k, j))).collect();
    let column = |j: usize, of: &dyn Fn(&Interval) -> f64| -> Vec<f64> {
        let one = |(k, own): &(usize, usize)| {
            let found = parameters[*k].interval(kinds[j].0).filter(|_| *own == j);
            found.map_or(f64::NAN, of)
        };
        places.iter().map(one).collect()
    };
    let (mut covers, mut ratios) = (Vec::new(), Vec::new());
    let level = |v: f64| Mark::line("", Look::Bound, vec![v; places.len()]);
    covers.push(level(95.0));
    ratios.push(level(1.0));
    for (j, (_, name, look)) in kinds.iter().enumerate() {
        let edge = |side: usize| column(j, &move |i| 100.0 * i.coverage.interval[side]);
        covers.push(Mark::between("", *look, Shape::Bars, edge(0), edge(1)));
        covers.push(Mark::dots(name, *look, column(j, &|i| 100.0 * i.coverage.share)));
        ratios.push(Mark::dots(name, *look, column(j, &|i| i.ratio)));
    }
    Some(
        Figure::new(
            "coverage-1",
            "intervals of 95 % that hold the truth, and scatter over printed error",
            "number of the parameter",
            places.iter().map(|(k, j)| *k as f64 + 1.0 + 0.25 * *j as f64).collect(),
        )
        .in_group("coverage")
        .with(Panel::new("covers [%]", 170, covers))
        .with(Panel::new("scatter / σ", 110, ratios))
        .named(places.iter().map(|(k, j)| format!("{}, {}", parameters[*k].subject.label(), kinds[*j].1)).collect()),
    )
}

/// The scatter of every parameter against its printed error, each in the parameter's unit.
fn scatter(study: &Study) -> Option<Figure> {
    let usable = |p: &&Coverage| p.scatter > 0.0 && p.intervals.iter().all(|i| i.error > 0.0);
    let mut points: Vec<(f64, usize, f64, String)> = Vec::new();
    for p in study.parameters.iter().filter(usable) {
        for (j, (kind, name, _)) in KINDS.iter().enumerate() {
            let Some(found) = p.interval(*kind) else { continue };
            let unit = bracketed(p.subject.unit.as_deref());
            points.push((
                found.error,
                j,
                p.scatter,
                format!("{}{unit}, {name} σ = {}", p.subject.label(), shown(found.error, 3)),
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
    Some(
        Figure::new(
            "scatter-1",
            "scatter of the estimates against printed standard errors, each in the parameter's unit",
            "printed standard error",
            at,
        )
        .in_group("scatter")
        .with(Panel::new("scatter", 210, marks).logarithmic())
        .logarithmic()
        .named(points.into_iter().map(|p| p.3).collect()),
    )
}

/// Deviations of the estimates in errors of their own repeats, parameter by parameter.
fn histograms(study: &Study, repeats: &Columns) -> Vec<Figure> {
    let parameters = study.parameters.iter().enumerate();
    parameters.filter_map(|(k, p)| histogram(repeats, k, p)).take(DRAWN).collect()
}

fn histogram(repeats: &Columns, k: usize, p: &Coverage) -> Option<Figure> {
    let name = p.subject.label();
    // the errors that are to be trusted
    let (kind, error) = match p.interval(Kind::Corrected) {
        Some(_) => ("corrected", format!("{name}: corrected error")),
        None => ("Cramér–Rao", format!("{name}: Cramer-Rao error")),
    };
    let (values, errors) = (&repeats.column(&name)?.values, &repeats.column(&error)?.values);
    let truth = p.subject.truth;
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
    Some(
        Figure::new(
            format!("estimates-{}", k + 1),
            format!("{name}, of {all} repeats{outside}"),
            format!("deviation from the truth [{kind} σ]"),
            at,
        )
        .with(Panel::new(
            "repeats",
            130,
            vec![
                Mark::between("estimates", Look::Measured, Shape::Columns, vec![0.0; COLUMNS], counts),
                Mark::line("normal", Look::Model, normal),
            ],
        ))
        .half(),
    )
}

/// The table of each study, and one line for each where there are several.
pub fn studies_text(studies: &[Study]) -> String {
    let one = |s: &Study| format!("{}: {}\n", s.name, study_table(s));
    let mut text: String = studies.iter().map(one).collect();
    if studies.len() > 1 {
        text.push_str(&studies_table(studies));
    } else {
        text.pop();
    }
    text
}

/// One line for each study: the errors that are to be trusted.
fn studies_table(studies: &[Study]) -> String {
    let mut table = Rows::over(studies.iter().map(summary));
    for (k, title) in SUMMARY.iter().enumerate() {
        match k {
            0 | 1 => table.words(title, |cells| cells[k].clone()),
            _ => table.number(title, |cells| cells[k].clone()),
        };
    }
    text::table(table)
}

/// Studies of several systems as a table of a page in Markdown.
pub fn studies_markdown(studies: &[Study]) -> String {
    let mut text = format!("| {} |\n|{}\n", SUMMARY.join(" | "), "---|".repeat(SUMMARY.len()));
    studies.iter().for_each(|s| text.push_str(&format!("| {} |\n", summary(s).join(" | "))));
    text
}

const SUMMARY: [&str; 9] = [
    "system",
    "noise",
    "repeats",
    "parameters",
    "corrected intervals cover %",
    "furthest off",
    "scatter/error",
    "Cramer-Rao cover %",
    "not converged",
];

fn summary(study: &Study) -> [String; 9] {
    let cover = |p: &Pooled| {
        let [low, high] = p.interval.map(percent);
        format!("{} ({low}-{high})", percent(p.coverage))
    };
    let of = |kind: Kind| study.pooled.iter().find(|p| p.kind == kind);
    let (raw, corrected) = (of(Kind::CramerRao), of(Kind::Corrected));
    let trusted = study.trusted();
    [
        study.name.clone(),
        colour(study.colour).into(),
        study.done.to_string(),
        study.parameters.len().to_string(),
        corrected.map_or("-".into(), cover),
        trusted.map_or("-".into(), |p| format!("{} {}", p.worst.0, percent(p.worst.1))),
        trusted.map_or("-".into(), |p| format!("{:.2}-{:.2}", p.ratios[0], p.ratios[1])),
        raw.map_or("-".into(), cover),
        (study.done - study.converged).to_string(),
    ]
}

/// Every figure of every repeat: columns of a file.
pub fn repeat_columns(subjects: &[Subject], goals: &[Goal], repeats: &[Option<Repeat>]) -> Vec<(String, Vec<f64>)> {
    let done: Vec<(usize, &Repeat)> = repeats.iter().enumerate().filter_map(|(k, r)| Some((k, r.as_ref()?))).collect();
    let mut columns = vec![
        ("repeat".to_string(), done.iter().map(|(k, _)| *k as f64).collect()),
        ("converged".to_string(), done.iter().map(|(_, r)| f64::from(u8::from(r.is_good()))).collect()),
    ];
    for (k, subject) in subjects.iter().enumerate() {
        let mut column = |what: &str, of: fn(&Estimated) -> f64| {
            let values = done.iter().map(|(_, r)| of(&r.figures[k])).collect();
            columns.push((format!("{}{what}", subject.label()), values));
        };
        column("", |f| f.value);
        column(": Cramer-Rao error", |f| f.errors[0]);
        column(": corrected error", |f| f.errors[1]);
    }
    for (k, goal) in goals.iter().enumerate() {
        let mut column = |what: &str, of: fn(&Judged) -> f64| {
            let values = done.iter().map(|(_, r)| r.requirements.get(k).map_or(f64::NAN, of)).collect();
            columns.push((format!("requirement {}{what}", goal.name), values));
        };
        column("", |j| j.value);
        column(": low", |j| j.interval[0]);
        column(": high", |j| j.interval[1]);
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    fn study(coverage: f64, converged: usize, bias: f64) -> Study {
        let (name, worst) = (String::from("k"), (String::from("k"), coverage));
        let subject = Subject { step: String::new(), name: name.clone(), run: None, unit: None, truth: 1.0 };
        let parameter = Coverage {
            subject,
            repeats: converged,
            mean: 1.0,
            bias,
            bias_chance: 0.14,
            scatter: 0.1,
            intervals: Vec::new(),
        };
        let interval = [coverage - 0.01, coverage + 0.01];
        let pooled = Pooled { kind: Kind::Corrected, coverage, interval, of_all: coverage, worst, ratios: [1.0; 2] };
        Study {
            name,
            colour: Some(Colour::White),
            seed: 3,
            asked: 200,
            done: 200,
            converged,
            astray: Vec::new(),
            parameters: vec![parameter],
            pooled: vec![pooled],
            requirements: Vec::new(),
            no_requirements: None,
        }
    }

    #[test]
    fn the_headline_follows_coverage_bias_and_what_went_astray() {
        let judged = |s: &Study| verdict(s).trust;
        assert_eq!(judged(&study(0.951, 200, 0.1)), Trust::Good);
        assert_eq!(judged(&study(0.951, 190, 0.1)), Trust::Reserved);
        assert_eq!(judged(&study(0.951, 200, -0.5)), Trust::Reserved);
        assert_eq!(judged(&study(0.91, 200, 0.1)), Trust::Reserved);
        assert_eq!(judged(&study(0.6, 200, 0.1)), Trust::Bad);
        let said = verdict(&study(0.951, 200, 0.1)).sentence;
        assert!(said.contains("95.1 % (94.1 to 96.1 %)") && said.contains("200 repeats with white noise"), "{said}");
    }
}
