//! A study: how often intervals hold, how far estimates scatter beside their errors, how they are distributed, and what became of
//! the repeats.

use super::figure::{Figure, Look, Mark, Panel, Shape};
use super::number::{bracketed, shown};
use super::section::{Section, Trust, Verdict};
use super::subject::Subject;
use crate::study::{GOAL_TITLES, goal_cells};
use fdm_results::documents::digits_by_error;
use fdm_results::documents::study::{Colour, Coverage, Interval, Kind, Share, Study};
use maud::{Markup, html};

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
const KINDS: [(Kind, &str, Look); 2] =
    [(Kind::Corrected, "corrected", Look::Model), (Kind::CramerRao, "Cramér–Rao", Look::Residual)];

/// What can be said in a sentence, and what speaks against the intervals.
pub(super) fn verdict(study: &Study) -> Verdict {
    let (done, converged, noise) = (study.done, study.converged, colour(study));
    let Some(pooled) = study.trusted() else {
        return (Trust::Bad, format!("No interval came of {done} repeats with {noise} noise."), Vec::new());
    };
    let coverage = pooled.coverage;
    let sentence = format!(
        "Nominal 95 % intervals hold the truth in {} of all cases, over {converged} repeats with {noise} noise.",
        covers(coverage, pooled.interval)
    );
    let mut points = Vec::new();
    let (name, share) = &pooled.worst;
    if (share - 0.95).abs() > GOOD {
        points.push((format!("Furthest off: `{name}`, whose intervals hold in {} %", percent(*share)), "coverage"));
    }
    let biased: Vec<String> =
        study.parameters.iter().filter(|p| p.is_biased()).map(|p| format!("`{}`", p.subject.label())).collect();
    if biased.len() * 20 > study.parameters.len() {
        points.push((format!("More bias than chance explains: {}", biased.join(", ")), "coverage"));
    }
    if let Some(worst) = study.worst_requirement()
        && (worst.coverage.share - 0.95).abs() > GOOD
    {
        let share = percent(worst.coverage.share);
        points.push((format!("Requirement furthest off: `{}`, {share} %", worst.goal.name), "requirements-coverage"));
    }
    if converged < done {
        points.push((format!("{} of {done} repeats did not converge", done - converged), "outcomes"));
    }
    if !study.is_whole() {
        points.push((format!("Interrupted: {done} of {} repeats are done", study.asked), "outcomes"));
    }
    let trust = match (coverage - 0.95).abs() {
        _ if coverage < LEAST => Trust::Bad,
        off if off <= GOOD && points.is_empty() => Trust::Good,
        _ => Trust::Reserved,
    };
    (trust, sentence, points)
}

fn colour(study: &Study) -> &'static str {
    match study.colour {
        None => "the described",
        Some(Colour::White) => "white",
        Some(Colour::Fitted) => "fitted",
        Some(Colour::Ar1) => "AR(1)",
        Some(Colour::Pink) => "pink",
    }
}

/// Percent, with what chance leaves open.
fn covers(share: f64, interval: [f64; 2]) -> String {
    let [low, high] = interval.map(percent);
    format!("{} % ({low} to {high} %)", percent(share))
}

fn percent(share: f64) -> String {
    format!("{:.1}", 100.0 * share)
}

/// Kinds of errors that were printed for any parameter.
fn printed(study: &Study) -> Vec<(Kind, &'static str, Look)> {
    let any = |kind: Kind| study.parameters.iter().any(|p| p.interval(kind).is_some());
    KINDS.into_iter().filter(|(kind, ..)| any(*kind)).collect()
}

pub(super) fn sections(subject: &Subject) -> Vec<Section> {
    let Some(study) = subject.study().filter(|study| !study.parameters.is_empty()) else { return Vec::new() };
    let estimates = histograms(subject, study);
    let drawn = estimates.len();
    let all = study.parameters.len();
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
    if !study.requirements.is_empty() || study.no_requirements.is_some() {
        sections.push(Section::new(
            "requirements-coverage",
            "What intervals of requirements are worth",
            requirements(study),
        ));
    }
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

fn table(study: &Study) -> Markup {
    let parameters = &study.parameters;
    let runs = parameters.iter().any(|p| p.subject.run.as_ref().is_some_and(|run| !run.is_empty()));
    let (steps, kinds) = (parameters.iter().any(|p| !p.subject.step.is_empty()), printed(study));
    html! {
        div.scroll { table {
            thead { tr {
                th.number { "no." } th { "parameter" } @if runs { th { "run" } } @if steps { th { "step" } }
                th { "unit" } th.number { "truth" } th.number { "mean" } th.number { "bias" } th.number { "±" } th.number { "scatter" }
                @for (_, name, _) in &kinds { th.number { (name) " σ" } th.number { "ratio" } th.number { "covers %" } }
            } }
            tbody { @for (k, p) in parameters.iter().enumerate() {
                @let (s, digits) = (&p.subject, digits_by_error(p.subject.truth, p.scatter, 3).unwrap_or(5));
                tr {
                    td.number { (k + 1) }
                    th scope="row" { code { (s.name) } }
                    @if runs { td { (s.run.as_deref().unwrap_or_default()) } }
                    @if steps { td { (s.step) } }
                    td { (s.unit.as_deref().unwrap_or_default()) }
                    td.number { (shown(s.truth, digits)) } td.number { (shown(p.mean, digits)) }
                    td.number.large[p.is_biased()] { (shown(p.bias, 2)) }
                    td.number { (shown(p.bias_chance, 2)) } td.number { (shown(p.scatter, 3)) }
                    @for (kind, ..) in &kinds { (cells(p.interval(*kind))) }
                }
            } }
        } }
    }
}

fn requirements(study: &Study) -> Markup {
    html! {
        @if !study.requirements.is_empty() { div.scroll { table {
            thead { tr { @for (k, title) in GOAL_TITLES.iter().enumerate() { th.number[k > 0] { (title) } } } }
            tbody { @for r in &study.requirements { tr {
                @for (k, cell) in goal_cells(r).iter().enumerate() {
                    @if k == 0 { th scope="row" { (cell) } }
                    @else { td.number.large[k == 5 && r.coverage.interval[1] < 0.95] { (cell) } }
                }
            } } }
        } } }
        p.note {
            "The truth is the value at the parameters that the records were made with. `Above` and `below` count the truths beyond the ends of the intervals. "
            "A requirement that is not linear within the errors has its interval by draws."
        }
        @if let Some(why) = &study.no_requirements { p.note { "Not studied: " (why) "." } }
    }
}

fn cells(interval: Option<&Interval>) -> Markup {
    let Some(i) = interval else { return html! { td.number { "–" } td.number { "–" } td.number { "–" } } };
    let Share { share, interval: [low, high], .. } = i.coverage;
    html! {
        td.number { (shown(i.error, 3)) }
        td.number { (format!("{:.2}", i.ratio)) }
        td.number.large[high < 0.95] { (percent(share)) " (" (percent(low)) "–" (percent(high)) ")" }
    }
}

fn outcomes(study: &Study) -> Markup {
    let (asked, done) = (study.asked, study.done);
    let part = |n: usize| if done > 0 { format!("{} %", percent(n as f64 / done as f64)) } else { String::new() };
    html! {
        div.scroll { table { tbody {
            tr { th scope="row" { "converged" } td.number { (study.converged) } td.number { (part(study.converged)) } }
            @for (reason, count) in &study.astray {
                tr { th scope="row" { (reason) } td.number { (count) } td.number { (part(*count)) } }
            }
            @if done < asked { tr { th scope="row" { "not done" } td.number { (asked - done) } td {} } }
        } } }
        p.note { "Repeats that did not converge have no interval; counted as misses they are in the result's JSON as " code { "of_all" } ". Seed " (study.seed) "." }
    }
}

/// All of them.
pub(super) fn figures(subject: &Subject) -> Vec<Figure> {
    let Some(study) = subject.study() else { return Vec::new() };
    [coverage(study), scatter(study)].into_iter().flatten().chain(histograms(subject, study)).collect()
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
        names: places.iter().map(|(k, j)| format!("{}, {}", parameters[*k].subject.label(), kinds[*j].1)).collect(),
        half: false,
        samples: None,
    })
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
fn histograms(subject: &Subject, study: &Study) -> Vec<Figure> {
    let parameters = study.parameters.iter().enumerate();
    parameters.filter_map(|(k, p)| histogram(subject, k, p)).take(DRAWN).collect()
}

fn histogram(subject: &Subject, k: usize, p: &Coverage) -> Option<Figure> {
    let (repeats, name) = (subject.repeats.as_ref()?, p.subject.label());
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
    use fdm_results::documents::study::{Pooled, Subject};

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
        let judged = |s: &Study| verdict(s).0;
        assert_eq!(judged(&study(0.951, 200, 0.1)), Trust::Good);
        assert_eq!(judged(&study(0.951, 190, 0.1)), Trust::Reserved);
        assert_eq!(judged(&study(0.951, 200, -0.5)), Trust::Reserved);
        assert_eq!(judged(&study(0.91, 200, 0.1)), Trust::Reserved);
        assert_eq!(judged(&study(0.6, 200, 0.1)), Trust::Bad);
        let said = verdict(&study(0.951, 200, 0.1)).1;
        assert!(said.contains("95.1 % (94.1 to 96.1 %)") && said.contains("200 repeats with white noise"), "{said}");
    }
}
