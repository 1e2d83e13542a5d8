//! Recursive least squares as tables and pictures: the chosen iterate, and how the estimates moved along the record.

use super::plot::TimeHistory;
use super::table::{aligned_right, plain, trimmed};
use fdm_estimate::equation_error::RecursiveParameter;
use fdm_estimate::{BestIterate, Criterion};
use fdm_results::documents::digits;

/// Rows of the table of the history.
const ROWS: usize = 12;

fn called(p: &RecursiveParameter) -> String {
    p.run.as_ref().map_or(p.name.clone(), |run| format!("{} ({run})", p.name))
}

/// The parameters of the chosen iterate beside the last ones and those of plain least squares, the errors of each, and the history.
pub fn recursive_table(found: &BestIterate) -> String {
    let r = &found.recursion;
    let (Some(best), Some(last)) = (r.iterates.get(found.best), r.iterates.last()) else {
        return String::from("the records have no step that says anything about a parameter\n");
    };
    let mut table = plain(&["parameter", "value", "std error", "%", "last", "all steps", "unit"]);
    for (j, p) in r.parameters.iter().enumerate() {
        let part = digits(100.0 * best.errors[j] / best.values[j].abs(), 2);
        let numbers = [digits(best.values[j], 6), digits(best.errors[j], 3), part];
        let others = [digits(last.values[j], 6), digits(r.batch[j], 6), p.unit.clone().unwrap_or_default()];
        table.add_row(std::iter::once(called(p)).chain(numbers).chain(others).collect::<Vec<_>>());
    }
    (1..6).for_each(|k| aligned_right(&mut table, k));
    let mut text = format!("{}\n", trimmed(&table));
    let run = &r.runs[best.run].name;
    let count = r.iterates.len();
    let how = match found.criterion {
        Criterion::Simulation => "its simulated error over all records is the least",
        Criterion::OneStep => "its errors from each sample to the next are the least",
        Criterion::Last => "it is the last one, as asked for",
    };
    text.push_str(&format!("iterate {} of {count}, at {} of `{run}`: {how}\n", found.best + 1, digits(best.time, 5)));
    if !found.simulated.is_empty() {
        let shown = |error: Option<f64>| error.map_or("not finite".into(), |e| digits(e, 4));
        let lost = found.simulated.iter().filter(|(_, e)| e.is_none()).count();
        text.push_str(&format!(
            "part of the outputs' mean square that a simulation does not meet: {}; with the last iterate {}, with least squares of \
             all steps {}\n",
            shown(found.error_of(found.best)),
            shown(found.error_of(count - 1)),
            shown(found.batch_error)
        ));
        if lost > 0 {
            text.push_str(&format!(
                "{lost} of {} iterates that were simulated left the finite numbers\n",
                found.simulated.len()
            ));
        }
    }
    text.push_str(&format!("\n{}", history(found)));
    r.refused.iter().for_each(|r| text.push_str(&format!("left out: {r}\n")));
    if !r.kept.is_empty() {
        let names = r.kept.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
        text.push_str(&format!("not estimated, so that their values stay: {names}\n"));
    }
    text
}

/// Some iterates, the chosen one among them.
fn history(found: &BestIterate) -> String {
    let r = &found.recursion;
    let names: Vec<String> = ["run", "time", "one step", "simulated"].map(String::from).to_vec();
    let header: Vec<String> = names.into_iter().chain(r.parameters.iter().map(called)).collect();
    let mut table = plain(&header.iter().map(String::as_str).collect::<Vec<_>>());
    let count = r.iterates.len();
    let mut rows: Vec<usize> =
        (1..=ROWS.min(count)).map(|k| k * count / ROWS.min(count) - 1).chain([found.best]).collect();
    rows.sort_unstable();
    rows.dedup();
    for k in rows {
        let i = &r.iterates[k];
        let mark = if k == found.best { "*" } else { "" };
        let simulated = found.error_of(k).map_or(String::new(), |e| digits(e, 3));
        let numbers =
            [r.runs[i.run].name.clone(), format!("{}{mark}", digits(i.time, 4)), digits(i.one_step, 3), simulated];
        table.add_row(numbers.into_iter().chain(i.values.iter().map(|v| digits(*v, 4))).collect::<Vec<_>>());
    }
    (1..header.len()).for_each(|k| aligned_right(&mut table, k));
    trimmed(&table)
}

/// Every parameter along the record, for pictures; `time` is that of the iterates (see [`recursive_times`]).
pub fn recursive_histories<'a>(found: &BestIterate, time: &'a [f64]) -> Vec<TimeHistory<'a>> {
    let r = &found.recursion;
    let label = format!("t [{}]", found.model.definition().time);
    let one = |(j, p): (usize, &RecursiveParameter)| TimeHistory {
        title: format!(
            "{}: {} by recursive least squares, beside least squares of all steps",
            found.model.name(),
            called(p)
        ),
        time_label: label.clone(),
        value_label: p.unit.as_ref().map_or(called(p), |unit| format!("{} [{unit}]", called(p))),
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
