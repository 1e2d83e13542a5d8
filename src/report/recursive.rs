//! Recursive least squares as tables and pictures: the chosen iterate, and how the estimates moved along the record.

use super::plot::TimeHistory;
use super::section::{Part, Rows, Section};
use crate::regression::{left_out, not_estimated};
use crate::text;
use fdm_estimate::equation_error::RecursiveParameter;
use fdm_estimate::{BestIterate, Criterion};
use fdm_results::documents::{digits, with_run};

/// Rows of the table of the history.
const ROWS: usize = 12;

fn name(p: &RecursiveParameter) -> String {
    with_run(&p.name, p.run.as_deref())
}

/// The parameters of the chosen iterate beside the last ones and those of plain least squares, the errors of each, and the history.
pub fn recursive_table(found: &BestIterate) -> String {
    let r = &found.recursion;
    let (Some(best), Some(last)) = (r.iterates.get(found.best), r.iterates.last()) else {
        return String::from("the records have no step that says anything about a parameter\n");
    };
    let mut table = Rows::over(r.parameters.iter().enumerate());
    table.name("parameter", |(_, p)| name(p));
    table.number("value", |(j, _)| digits(best.values[*j], 6));
    table.number("std error", |(j, _)| digits(best.errors[*j], 3));
    table.number("%", |(j, _)| digits(100.0 * best.errors[*j] / best.values[*j].abs(), 2));
    table.number("last", |(j, _)| digits(last.values[*j], 6));
    table.number("all steps", |(j, _)| digits(r.batch[*j], 6));
    table.unit(|(_, p)| p.unit.clone());
    let how = match found.criterion {
        Criterion::Simulation => "its simulated error over all records is the least",
        Criterion::OneStep => "its errors from each sample to the next are the least",
        Criterion::Last => "it is the last one, as asked for",
    };
    let (count, time) = (r.iterates.len(), digits(best.time, 5));
    let chosen = format!("iterate {} of {count}, at {time} of `{}`: {how}", found.best + 1, r.runs[best.run].name);
    let section = Section::new("recursion", "Recursive least squares")
        .with(table)
        .with(Part::Gap)
        .line(chosen)
        .lines(simulated(found))
        .with(history(found))
        .lines(left_out(&r.refused).chain(not_estimated(&r.kept)));
    text::sections(&[section])
}

/// What simulations say, where there were any.
fn simulated(found: &BestIterate) -> Vec<String> {
    if found.simulated.is_empty() {
        return Vec::new();
    }
    let shown = |error: Option<f64>| error.map_or("not finite".into(), |e| digits(e, 4));
    let [best, last] = [found.best, found.recursion.iterates.len() - 1].map(|k| shown(found.error_of(k)));
    let all = shown(found.batch_error);
    let lost = found.simulated.iter().filter(|(_, e)| e.is_none()).count();
    let lost = (lost > 0)
        .then(|| format!("{lost} of {} iterates that were simulated left the finite numbers", found.simulated.len()));
    let part = format!(
        "part of the outputs' mean square that a simulation does not meet: {best}; with the last iterate {last}, with least squares of \
         all steps {all}"
    );
    std::iter::once(part).chain(lost).collect()
}

/// Some iterates, the chosen one among them.
fn history(found: &BestIterate) -> Rows<usize> {
    let r = &found.recursion;
    let (count, most) = (r.iterates.len(), ROWS.min(r.iterates.len()));
    let mut rows: Vec<usize> = (1..=most).map(|k| k * count / most - 1).chain([found.best]).collect();
    rows.sort_unstable();
    rows.dedup();
    let mut table = Rows::over(rows);
    table.words("run", |k| r.runs[r.iterates[*k].run].name.clone());
    table.number("time", |k| format!("{}{}", digits(r.iterates[*k].time, 4), if *k == found.best { "*" } else { "" }));
    table.number("one step", |k| digits(r.iterates[*k].one_step, 3));
    table.number("simulated", |k| found.error_of(*k).map_or(String::new(), |e| digits(e, 3)));
    for (j, p) in r.parameters.iter().enumerate() {
        table.number(&name(p), |k| digits(r.iterates[*k].values[j], 4));
    }
    table
}

/// Every parameter along the record, for pictures; `time` is that of the iterates (see [`recursive_times`]).
pub fn recursive_histories<'a>(found: &BestIterate, time: &'a [f64]) -> Vec<TimeHistory<'a>> {
    let r = &found.recursion;
    let label = format!("t [{}]", found.model.definition().time);
    let one = |(j, p): (usize, &RecursiveParameter)| TimeHistory {
        title: format!(
            "{}: {} by recursive least squares, beside least squares of all steps",
            found.model.name(),
            name(p)
        ),
        time_label: label.clone(),
        value_label: p.unit.as_ref().map_or(name(p), |unit| format!("{} [{unit}]", name(p))),
        time,
        measured: vec![r.batch[j]; time.len()],
        modelled: r.iterates.iter().map(|i| i.values[j]).collect(),
    };
    r.parameters.iter().enumerate().map(one).collect()
}

/// Times of the iterates, those of later runs behind those of the runs before.
pub fn recursive_times(found: &BestIterate) -> Vec<f64> {
    let runs = &found.recursion.runs;
    let end = |run: usize| runs[..run].iter().map(|r| r.time[r.len() - 1]).sum::<f64>();
    found.recursion.iterates.iter().map(|i| end(i.run) + i.time).collect()
}
