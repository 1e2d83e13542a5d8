//! What the next runs would tell: a table of parameters, one of manoeuvres.

use super::table::{aligned_right, plain, trimmed};
use fdm_results::documents::design::{Design, Distinction, Gain, Manoeuvre, Separation};
use fdm_results::documents::digits;
use fdm_system::model::Model;

/// Logarithm of odds that are clear: 20 to 1.
const CLEAR: f64 = 3.0;
/// Manoeuvres that are listed.
const LISTED: usize = 12;

/// Parameters now and then, planned runs, the most telling manoeuvres, and what nothing would tell.
pub fn design_table(design: &Design, model: &Model) -> String {
    let time = model.definition().time.to_string();
    let mut text = String::new();
    for (k, step) in design.steps.iter().enumerate() {
        let (m, bits) = (&step.manoeuvre, step.bits);
        let (words, height) = (m.words(&time), digits(m.height, 3));
        text.push_str(&format!("run {}: `{}`, {words}, height {height}: {bits:.1} bits\n", k + 1, m.input));
    }
    text.push_str(&format!("\n{}\n{}", parameters(design, &time), manoeuvres(design, model, &time)));
    for direction in &design.undetermined_now {
        text.push_str(&format!("not determined so far: {}\n", direction.sentence));
    }
    for direction in &design.undetermined_then {
        text.push_str(&format!("no manoeuvre here would determine: {}\n", direction.sentence));
    }
    text.push_str(&lost(&design.lost, &time));
    text
}

/// Planned runs with the odds after them, and the manoeuvres that separate two models best.
pub fn distinction_table(found: &Distinction, model: &Model) -> String {
    let time = model.definition().time.to_string();
    let [first, second] = &found.models;
    let odds = |s: &Separation| {
        format!("e^{:.1} if `{first}` is true, e^{:.1} if `{second}` is", s.log_odds[0], s.log_odds[1])
    };
    let mut text = String::new();
    for (k, step) in found.steps.iter().enumerate() {
        let (m, words) = (&step.manoeuvre, step.manoeuvre.words(&time));
        let (height, odds) = (digits(m.height, 3), odds(step));
        text.push_str(&format!("run {}: `{}`, {words}, height {height}: odds after it {odds}\n", k + 1, m.input));
    }
    let mut table =
        plain(&["as the next run", "height", "log odds, first true", "second true", "largest motion of outputs"]);
    for s in found.separations.iter().take(LISTED) {
        let m = &s.manoeuvre;
        let [a, b] = s.log_odds.map(|v| format!("{v:.1}"));
        table.add_row([
            format!("{}: {}", m.input, m.words(&time)),
            digits(m.height, 3),
            a,
            b,
            motion(model, &s.excursions),
        ]);
    }
    (1..4).for_each(|k| aligned_right(&mut table, k));
    text.push_str(&format!("\n{}", trimmed(&table)));
    text.push_str(&lost(&found.lost, &time));
    if found.separations.first().is_some_and(|s| s.mean() < CLEAR) {
        text.push_str("no manoeuvre here separates them clearly: larger or longer ones would\n");
    }
    text
}

/// Manoeuvres that were left out.
fn lost(lost: &[(Manoeuvre, String)], time: &str) -> String {
    lost.first().map_or(String::new(), |(manoeuvre, reason)| {
        let (count, words) = (lost.len(), manoeuvre.words(time));
        format!("{count} manoeuvres cannot be followed; the first, {words} of `{}`: {reason}\n", manoeuvre.input)
    })
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

fn parameters(design: &Design, time: &str) -> String {
    let runs = design.steps.len();
    let mut header = vec!["parameter".to_string(), "value".into(), "unit".into(), "error now".into()];
    header.extend((1..=runs).map(|k| format!("after run {k}")));
    header.extend(["best by".to_string(), "then".into()]);
    let mut table = plain(&header.iter().map(String::as_str).collect::<Vec<_>>());
    for o in &design.outlook {
        let best = o.best.and_then(|(k, error)| Some((design.gains.get(k)?, error)));
        let mut row = vec![o.parameter.clone(), digits(o.value, 5), o.unit.clone().unwrap_or_default()];
        row.push(part(o.value, o.now));
        row.extend(o.then.iter().map(|error| part(o.value, *error)));
        row.push(best.map_or("-".into(), |(gain, _)| named(gain, time)));
        row.push(best.map_or("-".into(), |(_, error)| part(o.value, Some(error))));
        table.add_row(row);
    }
    (3..4 + runs).chain([1, 5 + runs]).for_each(|k| aligned_right(&mut table, k));
    trimmed(&table)
}

fn named(gain: &Gain, time: &str) -> String {
    format!("{}: {}", gain.manoeuvre.input, gain.manoeuvre.words(time))
}

fn manoeuvres(design: &Design, model: &Model, time: &str) -> String {
    let header = ["as the next run", "bits", "worst known after it", "largest motion of outputs"];
    let mut table = plain(&header);
    for gain in design.gains.iter().take(LISTED) {
        let relative = design.outlook.iter().zip(&gain.errors).map(|(o, e)| (o, e.unwrap_or(f64::INFINITY)));
        let size = |value: f64| if value == 0.0 { 1.0 } else { value.abs() };
        let worst = relative.max_by(|a, b| (a.1 / size(a.0.value)).total_cmp(&(b.1 / size(b.0.value))));
        let worst = worst.map_or(String::new(), |(o, e)| {
            format!("{} {}", o.parameter, part(o.value, Some(e).filter(|e| e.is_finite())))
        });
        table.add_row([named(gain, time), format!("{:.1}", gain.bits), worst, motion(model, &gain.excursions)]);
    }
    aligned_right(&mut table, 1);
    trimmed(&table)
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
