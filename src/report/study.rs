//! Monte-Carlo studies as tables; the same for a page of Markdown.

use super::table::{aligned_right, plain, trimmed};
use fdm_results::documents::study::{
    Colour, Coverage, Figure, Goal, GoalCoverage, Interval, Judged, Kind, Pooled, Repeat, Share, Study, Subject,
};
use fdm_results::documents::{digits, digits_by_error};

/// What the intervals are worth; every parameter with bias, scatter and coverage; what should not be overlooked.
pub fn study_table(study: &Study) -> String {
    let runs = study.parameters.iter().any(|p| p.subject.run.is_some());
    let steps = study.parameters.iter().any(|p| !p.subject.step.is_empty());
    let kinds = [(Kind::CramerRao, "Cramer-Rao"), (Kind::Corrected, "corrected")];
    let printed: Vec<_> =
        kinds.into_iter().filter(|(kind, _)| study.parameters.iter().any(|p| p.interval(*kind).is_some())).collect();
    let mut header = Vec::new();
    header.extend(steps.then_some("step"));
    header.push("parameter");
    header.extend(runs.then_some("run"));
    let left = header.len();
    header.extend(["truth", "mean", "bias", "+-", "scatter"]);
    for (_, name) in &printed {
        header.extend([*name, "scatter/it", "covers %"]);
    }
    let mut table = plain(&header);
    (left..header.len()).for_each(|k| aligned_right(&mut table, k));
    let mut step = "";
    for p in &study.parameters {
        let mut row = Vec::new();
        row.extend(steps.then(|| if p.subject.step == step { String::new() } else { p.subject.step.clone() }));
        step = &p.subject.step;
        row.push(p.subject.name.clone());
        row.extend(runs.then(|| p.subject.run.clone().unwrap_or_default()));
        row.extend(moments(p));
        printed.iter().for_each(|(kind, _)| row.extend(interval(p.interval(*kind))));
        table.add_row(row);
    }
    let mut parts = vec![verdict(study), trimmed(&table)];
    if !study.requirements.is_empty() {
        parts.push(goals_table(&study.requirements));
    }
    parts.extend(Some(remarks(study)).filter(|remarks| !remarks.is_empty()));
    parts.join("\n")
}

/// Titles of [`goal_cells`].
pub(crate) const GOAL_TITLES: [&str; 9] =
    ["requirement", "truth", "mean", "scatter", "half width", "covers %", "above", "below", "by draws"];

/// Every requirement with what its intervals are worth.
fn goals_table(requirements: &[GoalCoverage]) -> String {
    let mut table = plain(&GOAL_TITLES);
    (1..GOAL_TITLES.len()).for_each(|k| aligned_right(&mut table, k));
    requirements.iter().for_each(|r| {
        table.add_row(goal_cells(r));
    });
    trimmed(&table)
}

/// Truth, mean and scatter of the values, mean half width of the intervals, their coverage, on which side the truth was missed, and how many are draws.
pub(crate) fn goal_cells(r: &GoalCoverage) -> [String; 9] {
    let Goal { name, unit, truth } = &r.goal;
    let unit = unit.as_deref().filter(|u| *u != "1").map_or(String::new(), |u| format!(" [{u}]"));
    let spread = r.scatter.unwrap_or(0.0);
    let value = |v: Option<f64>| v.map_or(String::new(), |v| digits(v, digits_by_error(v, spread, 3).unwrap_or(5)));
    let width = |v: Option<f64>| v.map_or(String::new(), |v| digits(v, 3));
    let drawn = percent(r.drawn as f64 / r.coverage.of.max(1) as f64);
    let [above, below] = r.missed.map(|n| n.to_string());
    [
        format!("{name}{unit}"),
        value(*truth),
        value(r.mean),
        width(r.scatter),
        width(r.half_width),
        covers(&r.coverage),
        above,
        below,
        format!("{drawn} %"),
    ]
}

/// Truth, mean, bias in errors with its chance, scatter.
fn moments(p: &Coverage) -> [String; 5] {
    let settled = digits_by_error(p.subject.truth, p.scatter, 3).unwrap_or(5);
    let finite = |v: f64, text: String| if v.is_finite() { text } else { String::new() };
    let mark = if p.is_biased() { "!" } else { "" };
    [
        digits(p.subject.truth, settled),
        finite(p.mean, digits(p.mean, settled)),
        finite(p.bias, format!("{:+.2}{mark}", p.bias)),
        finite(p.bias_chance, format!("{:.2}", p.bias_chance)),
        finite(p.scatter, digits(p.scatter, 3)),
    ]
}

fn interval(interval: Option<&Interval>) -> [String; 3] {
    let Some(i) = interval else { return Default::default() };
    [digits(i.error, 3), format!("{:.2}", i.ratio), covers(&i.coverage)]
}

/// Percent, with the interval that chance leaves.
fn covers(share: &Share) -> String {
    let [low, high] = share.interval.map(percent);
    format!("{} ({low}-{high})", percent(share.share))
}

fn percent(share: f64) -> String {
    format!("{:.1}", 100.0 * share)
}

/// What is said above the tables.
fn verdict(study: &Study) -> String {
    let whole = if study.is_whole() { String::new() } else { format!(" of {} (interrupted)", study.asked) };
    let mut text = format!("{}{whole} repeats with {} noise, seed {}\n", study.done, colour(study.colour), study.seed);
    for pooled in &study.pooled {
        let [low, high] = pooled.interval.map(percent);
        text.push_str(&format!(
            "nominal 95 % intervals by {} errors hold the truth in {} % ({low}-{high}) of all parameters; furthest off: {} with {} %; scatter over error {:.2} to {:.2}\n",
            kind(pooled.kind), percent(pooled.coverage), pooled.worst.0, percent(pooled.worst.1), pooled.ratios[0], pooled.ratios[1],
        ));
    }
    if let Some(worst) = study.worst_requirement() {
        text.push_str(&format!(
            "nominal 95 % intervals of requirements: furthest off: {} with {} %; `above` and `below` count the truths beyond their ends\n",
            worst.goal.name,
            percent(worst.coverage.share)
        ));
    }
    text
}

/// What is said below them.
fn remarks(study: &Study) -> String {
    let mut text = String::new();
    if !study.requirements.is_empty() {
        let lost: Vec<String> = study
            .requirements
            .iter()
            .filter(|r| r.coverage.of < study.converged)
            .map(|r| format!("{} ({} of {})", r.goal.name, study.converged - r.coverage.of, study.converged))
            .collect();
        if !lost.is_empty() {
            text.push_str(&format!("requirements without an interval in some repeats: {}\n", lost.join(", ")));
        }
    }
    if let Some(why) = &study.no_requirements {
        text.push_str(&format!("requirements that are not studied: {why}\n"));
    }
    let biased: Vec<&str> =
        study.parameters.iter().filter(|p| p.is_biased()).map(|p| p.subject.name.as_str()).collect();
    if !biased.is_empty() {
        let count = study.parameters.len();
        text.push_str(&format!(
            "more bias than chance (`!`, one parameter in twenty by chance; {} of {count}): {}\n",
            biased.len(),
            biased.join(", ")
        ));
    }
    if study.converged < study.done {
        let counted: Vec<String> = study.astray.iter().map(|(reason, n)| format!("{n}: {reason}")).collect();
        let of_all = study.trusted().map_or(String::new(), |p| {
            format!("; counted as misses they leave {} % of all intervals", percent(p.of_all))
        });
        text.push_str(&format!(
            "{} of {} repeats did not converge{of_all}\n  {}\n",
            study.done - study.converged,
            study.done,
            counted.join("\n  ")
        ));
    }
    text
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
    let mut table = plain(&SUMMARY);
    (2..SUMMARY.len()).for_each(|k| aligned_right(&mut table, k));
    for study in studies {
        table.add_row(summary(study));
    }
    trimmed(&table)
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
        let mut column = |what: &str, of: fn(&Figure) -> f64| {
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
