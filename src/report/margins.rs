//! Modes and requirements of a result, with intervals and the probability that each requirement holds.

use super::table::{aligned_right, plain, trimmed};
use fdm_results::documents::requirement::{Assessment, By, MarginsDocument, ModeMargin};
use fdm_results::documents::{digits, digits_by_error};

/// Titles of [`requirement_cells`].
pub(crate) const REQUIREMENT_TITLES: [&str; 6] =
    ["requirement", "value", "95 % interval", "wanted", "holds with", "by"];

/// Verdict, requirements, modes, and what is to be said of them.
pub fn margins_text(margins: &MarginsDocument) -> String {
    let run = margins.run.as_ref().map_or(String::new(), |run| format!(", run {run}"));
    let mut text = format!("{}: margins of the result in {}{run}\n", margins.model, margins.result);
    let wanted: Vec<&Assessment> = margins.requirements.iter().filter(|r| r.probability.is_some()).collect();
    if !wanted.is_empty() {
        let sure = wanted.iter().filter(|r| r.probability.is_some_and(|p| p >= 0.95)).count();
        let broken = wanted.iter().filter(|r| r.probability.is_some_and(|p| p <= 0.05)).count();
        let open = wanted.len() - sure - broken;
        text.push_str(&format!(
            "of {} requirements {sure} hold with 95 % probability or more, {broken} with 5 % or less, {open} are open\n",
            wanted.len()
        ));
    }
    if !margins.requirements.is_empty() {
        text.push_str(&format!("\n{}", requirements_table(&margins.requirements)));
    }
    let said = remarks(margins);
    said.iter().take(REMARKS).for_each(|said| text.push_str(&format!("\n{said}")));
    if said.len() > REMARKS {
        text.push_str(&format!("\n{} more remarks: --json", said.len() - REMARKS));
    }
    if margins.requirements.is_empty() {
        text.push_str(
            "\nthe model has no requirements: --requirement 'NAME = EXPRESSION in [LOWER, UPPER]' asks for one\n",
        );
    } else if !text.ends_with('\n') {
        text.push('\n');
    }
    if !margins.modes.is_empty() {
        text.push_str(&format!(
            "\nmodes, with 95 % intervals\n\n{}",
            modes_with_intervals(&margins.modes, &margins.time)
        ));
    }
    if let Some(why) = &margins.no_modes {
        text.push_str(&format!("\nno modes: {why}\n"));
    }
    text
}

/// One row for each requirement.
pub fn requirements_table(requirements: &[Assessment]) -> String {
    let mut table = plain(&REQUIREMENT_TITLES);
    for r in requirements {
        table.add_row(requirement_cells(r));
    }
    [1, 2, 4].into_iter().for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

/// Name with unit, value, interval, limits, probability, and how they were found.
pub fn requirement_cells(r: &Assessment) -> Vec<String> {
    let unit = r.unit.as_deref().filter(|u| *u != "1").map_or(String::new(), |u| format!(" [{u}]"));
    let half = r.interval.map(|[low, high]| 0.25 * (high - low));
    let shown = |v: f64| {
        let significant = half.and_then(|half| digits_by_error(v, half, 2)).unwrap_or(4);
        digits(v, significant)
    };
    let value = r.value.map_or("none".into(), shown);
    let interval = r.interval.map_or(String::new(), |[low, high]| format!("{} to {}", shown(low), shown(high)));
    let wanted = match (r.lower, r.upper) {
        (Some(low), Some(high)) => format!("{low} to {high}"),
        (Some(low), None) => format!("at least {low}"),
        (None, Some(high)) => format!("at most {high}"),
        (None, None) => String::new(),
    };
    let by = match r.by {
        Some(By::Linear) => "delta method",
        Some(By::Draws) => "draws",
        None => "",
    };
    vec![format!("{}{unit}", r.name), value, interval, wanted, r.probability.map_or(String::new(), percent), by.into()]
}

/// A probability in percent, never rounded to certainty.
pub(crate) fn percent(p: f64) -> String {
    match 100.0 * p {
        p if p >= 99.95 => "over 99.9 %".into(),
        p if p < 0.05 => "under 0.1 %".into(),
        p if !(5.0..=95.0).contains(&p) => format!("{p:.1} %"),
        p => format!("{p:.0} %"),
    }
}

/// Remarks that are printed.
const REMARKS: usize = 5;

/// What is to be said of requirements: those without a value first, then those that are open.
fn remarks(margins: &MarginsDocument) -> Vec<String> {
    let all = || margins.requirements.iter();
    let mut said: Vec<String> =
        all().filter_map(|r| Some(format!("{}: no value, {}", r.name, r.reason.as_ref()?))).collect();
    for r in all().filter(|r| r.probability.is_some_and(|p| p > 0.05 && p < 0.95) && !r.parts.is_empty()) {
        let parts: Vec<String> =
            r.parts.iter().map(|part| format!("{} {:.0} %", part.parameter, 100.0 * part.share)).collect();
        said.push(format!("{}: open; its variance is that of {}", r.name, parts.join(", ")));
    }
    let draws = margins.draws;
    said.extend(all().filter_map(|r| {
        let missing = 100.0 * r.missing?;
        Some(format!("{}: of {draws} draws {missing:.1} % have no value; they count as not held", r.name))
    }));
    let bent: Vec<&str> =
        all().filter(|r| r.by == Some(By::Draws) && r.missing.is_none()).map(|r| r.name.as_str()).collect();
    if !bent.is_empty() {
        said.push(format!(
            "not linear in the parameters within their errors, so by {draws} draws: {}",
            bent.join(", ")
        ));
    }
    said
}

/// One row for each mode, a pair in one.
pub fn modes_with_intervals(modes: &[ModeMargin], time: &str) -> String {
    let frequency = format!("frequency [rad/{time}]");
    let (half, double) = (format!("time to half [{time}]"), format!("time to double [{time}]"));
    let mut table = plain(&["mode", &frequency, "damping", &half, &double]);
    for mode in modes {
        let number = |v: f64, interval: Option<[f64; 2]>| match interval {
            Some([low, high]) => {
                let significant = digits_by_error(v, 0.25 * (high - low), 2).unwrap_or(4);
                format!("{} ({} to {})", digits(v, significant), digits(low, significant), digits(high, significant))
            }
            None => digits(v, 4),
        };
        let open = |v: Option<f64>, interval: Option<[Option<f64>; 2]>| match (v, interval) {
            (None, _) => String::new(),
            (Some(v), Some([Some(low), Some(high)])) => number(v, Some([low, high])),
            // a rate that may be zero: the time of a rate that nearly is says nothing
            (Some(v), Some([Some(low), None])) if v > 100.0 * low => format!("above {}", digits(low, 3)),
            (Some(v), Some([Some(low), None])) => format!("{} (above {})", digits(v, 3), digits(low, 3)),
            (Some(v), _) => digits(v, 4),
        };
        // on the real axis it is one, and says nothing
        let damping = mode.damping.filter(|_| mode.im > 0.0);
        table.add_row(vec![
            mode.states.join(", "),
            number(mode.frequency, mode.frequency_interval),
            damping.map_or(String::new(), |z| number(z, mode.damping_interval)),
            open(mode.time_to_half, mode.time_to_half_interval),
            open(mode.time_to_double, mode.time_to_double_interval),
        ]);
    }
    (1..5).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}
