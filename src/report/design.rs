//! What the next runs would determine: a table of parameters, one of manoeuvres or of experiments; on a page what is known after each run,
//! and what is flown, or when samples are taken.

use super::section::{Part, Report, Rows, Section, Trust, Verdict};
use crate::page::figure::{Figure, Look, Mark, Panel};
use crate::page::number::bracketed;
use crate::regions;
use crate::words::Words;
use crate::{html, text};
use fdm_results::documents::design::{Design, Distinction, Experiment, Experiments, Gain, Manoeuvre, Outlook};
use fdm_results::documents::digits;
use fdm_system::model::Model;

/// Logarithm of odds that are clear: 20 to 1.
const CLEAR: f64 = 3.0;
/// Manoeuvres that are listed.
const LISTED: usize = 12;

/// Looks of what is known now, after the first planned run and after the last.
const LOOKS: [Look; 3] = [Look::Measured, Look::Residual, Look::Model];

/// A planned run: its name, and time and inputs as columns of name, unit and values.
pub type Planned = (String, Vec<(String, Option<String>, Vec<f64>)>);

/// The response of a planned experiment: times (N), and outputs (N by q).
pub type Drawn = (Vec<f64>, Vec<f64>);

/// Planned experiments, and parameters before and after them.
pub fn experiments_table(found: &Experiments, model: &Model) -> String {
    told(planned_experiments(found, model), model)
}

/// A page of planned experiments with the response of each.
pub fn experiments_page(found: &Experiments, model: &Model, drawn: &[Drawn]) -> String {
    let count = found.experiments.len();
    let sentence = format!("{} planned.{}", counted(count, "experiment"), least_known(&found.outlook, count));
    let trust = if found.undetermined_then.is_empty() { Trust::Good } else { Trust::Reserved };
    let said = "One standard error of every parameter as a part of its value: by the runs so far, and after the planned experiments.";
    let drawn_errors = errors(&found.outlook, count).into_iter().flat_map(|f| [Part::Line(said.into()), f.into()]);
    let known = Section::new("errors", "What is known")
        .with_all(drawn_errors)
        .with_all(regions::of_experiments(found).map(|picture| Part::Markup(picture.markup())));
    let samples = Section::new("samples", "When samples are taken")
        .with_all(found.experiments.iter().zip(drawn).enumerate().map(|(k, one)| course(k, one, model)));
    html::page(
        &Words::of(model.source()).report(Report {
            kind: "design of the next experiments".into(),
            name: model.name().into(),
            doc: Some(model.definition().doc.clone()).filter(|doc| !doc.is_empty()),
            verdict: Verdict::new(trust, sentence),
            sections: [planned_experiments(found, model), known, samples]
                .into_iter()
                .filter(|section| !section.parts.is_empty())
                .collect(),
        }),
    )
}

fn planned_experiments(found: &Experiments, model: &Model) -> Section {
    let time = model.definition().time.to_string();
    let mut rows = Rows::over(found.experiments.iter().enumerate());
    rows.name("experiment", |(k, _)| (k + 1).to_string());
    for (place, level) in found.experiments.first().into_iter().flat_map(|one| one.levels.iter().enumerate()) {
        let title = format!("{}{}", level.name, bracketed(level.unit.as_deref()));
        rows.number(&title, |(_, one)| one.levels.get(place).map_or("-".into(), |level| digits(level.value, 4)));
    }
    rows.sentence(&format!("samples at [{time}]"), |(_, one)| times(one));
    rows.number("bits", |(_, one)| format!("{:.1}", one.bits));
    rows.words("largest motion of outputs", |(_, one)| motion(model, &one.excursions));
    let mut known = known(&found.outlook);
    known.number("after all", |o| part(o.value, o.then.last().copied().flatten()));
    let now = found.undetermined_now.iter().map(|d| format!("not determined so far: {}", d.sentence));
    let then = found.undetermined_then.iter().map(|d| format!("not determined by these experiments: {}", d.sentence));
    Section::new("design", "The next experiments").with(rows).with(known).lines(now.chain(then))
}

/// Sampling times in words; of many the first and the last.
fn times(one: &Experiment) -> String {
    let listed = |times: &[f64]| times.iter().map(|t| digits(*t, 4)).collect::<Vec<_>>().join(", ");
    match &one.times[..] {
        many @ [first, .., last] if many.len() > LISTED => {
            format!("{} times, {} to {}", many.len(), digits(*first, 4), digits(*last, 4))
        }
        few => listed(few),
    }
}

/// Sampling times on the response.
fn course(k: usize, (planned, (at, response)): (&Experiment, &Drawn), model: &Model) -> Figure {
    let outputs = &model.definition().outputs;
    let q = outputs.len();
    let panel = |(o, output): (usize, &fdm_grammar::model::Output)| {
        let values: Vec<f64> = response.iter().skip(o).step_by(q).copied().collect();
        let taken = at.iter().zip(&values).map(|(t, v)| if planned.times.contains(t) { *v } else { f64::NAN });
        let name = &output.quantity.name;
        let label = format!("{name}{}", bracketed(output.quantity.unit.as_ref().map(ToString::to_string).as_deref()));
        let marks =
            vec![Mark::dots("samples", Look::Residual, taken.collect()), Mark::line("model", Look::Model, values)];
        Panel::new(label, 110, marks)
    };
    let level = |l: &fdm_results::documents::design::Level| format!("{} {}", l.name, digits(l.value, 4));
    let levels = planned.levels.iter().map(level).collect::<Vec<_>>().join(", ");
    let caption =
        if levels.is_empty() { format!("experiment {}", k + 1) } else { format!("experiment {}: {levels}", k + 1) };
    let time = format!("t{}", bracketed(Some(&model.definition().time.to_string())));
    Figure::new(format!("samples-{}", k + 1), caption, time, at.clone())
        .with_all(outputs.iter().enumerate().map(panel).collect())
        .in_group("samples")
}

/// A section as text, in the words of the model's field.
fn told(section: Section, model: &Model) -> String {
    text::sections(&[Words::of(model.source()).section(section)])
}

fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { " is" } else { "s are" })
}

/// The parameter that is least known after all that is planned, as a sentence behind another.
fn least_known(outlook: &[Outlook], count: usize) -> String {
    let what = if count == 1 { "it" } else { "them" };
    let last = |o: &Outlook| o.then.last().copied().flatten().or(o.now.filter(|_| o.then.is_empty()));
    let relative = |o: &&Outlook| last(o).map_or(f64::INFINITY, |e| e / o.value.abs());
    let least = outlook.iter().max_by(|a, b| relative(a).total_cmp(&relative(b)));
    least.map_or(String::new(), |o| format!(" Least known after {what}: {}, {}.", o.parameter, part(o.value, last(o))))
}

/// Parameters now and then, planned runs, the most informative manoeuvres, and what nothing would determine.
pub fn design_table(design: &Design, model: &Model) -> String {
    told(section(design, model), model)
}

/// A page of planned runs.
pub fn design_page(design: &Design, model: &Model, planned: &[Planned]) -> String {
    let count = design.steps.len();
    let sentence = format!("{} planned.{}", counted(count, "run"), least_known(&design.outlook, count));
    let trust = if design.undetermined_then.is_empty() { Trust::Good } else { Trust::Reserved };
    let flown = Section::new("inputs", "What is flown")
        .with_all(planned.iter().enumerate().filter_map(|(k, (name, columns))| inputs(k, name, columns)));
    let drawn = errors(&design.outlook, design.steps.len()).map(|figure| {
        let said = "One standard error of every parameter as a part of its value: by the runs so far, and after the planned ones.";
        Section::new("errors", "What is known").line(said).with(figure)
    });
    html::page(
        &Words::of(model.source()).report(Report {
            kind: "design of the next runs".into(),
            name: model.name().into(),
            doc: Some(model.definition().doc.clone()).filter(|doc| !doc.is_empty()),
            verdict: Verdict::new(trust, sentence),
            sections: std::iter::once(section(design, model))
                .chain(drawn)
                .chain(Some(flown).filter(|s| !s.parts.is_empty()))
                .collect(),
        }),
    )
}

/// Errors now, after the first planned run and after the last, parameter by parameter.
fn errors(outlook: &[Outlook], count: usize) -> Option<Figure> {
    let percent = |of: &dyn Fn(&Outlook) -> Option<f64>| -> Vec<f64> {
        let one = |o: &Outlook| of(o).map_or(f64::NAN, |e| 100.0 * e / o.value.abs());
        outlook.iter().map(one).map(|v| if v.is_finite() { v } else { f64::NAN }).collect()
    };
    let after = |k: usize| percent(&move |o: &Outlook| o.then.get(k).copied().flatten());
    let mut marks = vec![Mark::dots("by the runs so far", LOOKS[0], percent(&|o| o.now))];
    marks.extend((count > 0).then(|| Mark::dots("after run 1", LOOKS[1], after(0))));
    marks.extend((count > 1).then(|| Mark::dots(&format!("after run {count}"), LOOKS[2], after(count - 1))));
    // of one parameter the table says all
    let many = marks.iter().any(|m| m.values.iter().filter(|v| v.is_finite()).count() > 1);
    many.then(|| {
        Figure::new("errors-1", "standard errors", "parameter", (1..=outlook.len()).map(|k| k as f64).collect())
            .with(Panel::new("of the value [%]", 200, marks).logarithmic())
            .named(outlook.iter().map(|o| o.parameter.clone()).collect())
    })
}

/// The inputs of a planned run over time.
fn inputs(k: usize, name: &str, columns: &[(String, Option<String>, Vec<f64>)]) -> Option<Figure> {
    let ((time, unit, at), inputs) = columns.split_first()?;
    let panel = |(name, unit, values): &(String, Option<String>, Vec<f64>)| {
        Panel::new(
            format!("{name}{}", bracketed(unit.as_deref())),
            90,
            vec![Mark::line(name, Look::Input, values.clone())],
        )
    };
    Some(
        Figure::new(format!("inputs-{}", k + 1), name, format!("{time}{}", bracketed(unit.as_deref())), at.clone())
            .with_all(inputs.iter().map(panel).collect()),
    )
}

fn section(design: &Design, model: &Model) -> Section {
    let time = model.definition().time.to_string();
    let runs = design.steps.iter().enumerate().map(|(k, step)| {
        let (m, words) = (&step.manoeuvre, step.manoeuvre.words(&time));
        format!("run {}: `{}`, {words}, height {}: {:.1} bits", k + 1, m.input, digits(m.height, 3), step.bits)
    });
    let now = design.undetermined_now.iter().map(|d| format!("not determined so far: {}", d.sentence));
    let then = design.undetermined_then.iter().map(|d| format!("no manoeuvre here would determine: {}", d.sentence));
    let said = now.chain(then).chain(lost(&design.lost, &time));
    Section::new("design", "The next runs")
        .lines(runs)
        .with(parameters(design, &time))
        .with(Part::from(manoeuvres(design, model, &time)))
        .lines(said)
}

/// Planned runs with the odds after them, and the manoeuvres that separate two models best.
pub fn distinction_table(found: &Distinction, model: &Model) -> String {
    let time = model.definition().time.to_string();
    let [first, second] = &found.models;
    let runs = found.steps.iter().enumerate().map(|(k, step)| {
        let (m, words, [a, b]) = (&step.manoeuvre, step.manoeuvre.words(&time), step.log_odds);
        let odds = format!("e^{a:.1} if `{first}` is true, e^{b:.1} if `{second}` is");
        format!("run {}: `{}`, {words}, height {}: odds after it {odds}", k + 1, m.input, digits(m.height, 3))
    });
    let mut table = Rows::over(found.separations.iter().take(LISTED));
    table.words("as the next run", |s| named(&s.manoeuvre, &time));
    table.number("height", |s| digits(s.manoeuvre.height, 3));
    table.number("log odds, first true", |s| format!("{:.1}", s.log_odds[0]));
    table.number("second true", |s| format!("{:.1}", s.log_odds[1]));
    table.words("largest motion of outputs", |s| motion(model, &s.excursions));
    let unclear = found.separations.first().filter(|s| s.mean() < CLEAR);
    let unclear = unclear.map(|_| "no manoeuvre here separates them clearly: larger or longer ones would".to_string());
    let section = Section::new("design", "The next runs")
        .lines(runs)
        .with(table)
        .lines(lost(&found.lost, &time).into_iter().chain(unclear));
    told(section, model)
}

/// Manoeuvres that were left out.
fn lost(lost: &[(Manoeuvre, String)], time: &str) -> Option<String> {
    let (manoeuvre, reason) = lost.first()?;
    let (count, words) = (lost.len(), manoeuvre.words(time));
    Some(format!("{count} manoeuvres cannot be followed; the first, {words} of `{}`: {reason}", manoeuvre.input))
}

fn motion(model: &Model, excursions: &[f64]) -> String {
    let motion = model.definition().outputs.iter().zip(excursions).map(|(o, v)| {
        let unit = o.quantity.unit.as_ref().map_or(String::new(), |u| format!(" {u}"));
        format!("{} {}{unit}", o.quantity.name, digits(*v, 2))
    });
    motion.collect::<Vec<String>>().join(", ")
}

/// An error beside its value.
fn part(value: f64, error: Option<f64>) -> String {
    match error {
        None => "unknown".into(),
        Some(error) if value != 0.0 => match 100.0 * error / value.abs() {
            percent if percent >= 1000.0 => ">1000 %".into(),
            percent => format!("{} %", digits(percent, 2)),
        },
        Some(error) => digits(error, 2),
    }
}

/// What is known of parameters so far.
fn known(outlook: &[Outlook]) -> Rows<&Outlook> {
    let mut table = Rows::over(outlook);
    table.name("parameter", |o| o.parameter.clone());
    table.number("value", |o| digits(o.value, 5));
    table.unit(|o| o.unit.clone());
    table.number("error now", |o| part(o.value, o.now));
    table
}

fn parameters<'a>(design: &'a Design, time: &str) -> Rows<&'a Outlook> {
    let best = |o: &Outlook| o.best.and_then(|(k, error)| Some((design.gains.get(k)?, error)));
    let mut table = known(&design.outlook);
    for k in 0..design.steps.len() {
        table.number(&format!("after run {}", k + 1), |o| part(o.value, o.then.get(k).copied().flatten()));
    }
    table.words("best by", |o| best(o).map_or("-".into(), |(gain, _)| named(&gain.manoeuvre, time)));
    table.number("then", |o| best(o).map_or("-".into(), |(_, error)| part(o.value, Some(error))));
    table
}

fn named(manoeuvre: &Manoeuvre, time: &str) -> String {
    format!("{}: {}", manoeuvre.input, manoeuvre.words(time))
}

fn manoeuvres<'a>(design: &'a Design, model: &Model, time: &str) -> Rows<&'a Gain> {
    let size = |value: f64| if value == 0.0 { 1.0 } else { value.abs() };
    let worst = |gain: &Gain| {
        let relative = design.outlook.iter().zip(&gain.errors).map(|(o, e)| (o, e.unwrap_or(f64::INFINITY)));
        relative.max_by(|a, b| (a.1 / size(a.0.value)).total_cmp(&(b.1 / size(b.0.value))))
    };
    let mut table = Rows::over(design.gains.iter().take(LISTED));
    table.words("as the next run", |gain| named(&gain.manoeuvre, time));
    table.number("bits", |gain| format!("{:.1}", gain.bits));
    table.words("worst known after it", |gain| {
        worst(gain).map_or(String::new(), |(o, e)| {
            format!("{} {}", o.parameter, part(o.value, Some(e).filter(|e| e.is_finite())))
        })
    });
    table.words("largest motion of outputs", |gain| motion(model, &gain.excursions));
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_told_beside_their_values() {
        assert_eq!(part(2.0, Some(0.1)), "5.0 %");
        assert_eq!(part(0.0, Some(0.1)), "0.10");
        assert_eq!((part(1.0, None), part(1e-3, Some(1.0))), ("unknown".into(), ">1000 %".into()));
    }
}
