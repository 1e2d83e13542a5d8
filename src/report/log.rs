//! What a log holds: its topics with their clocks, and their fields.

use super::section::Rows;
use crate::text;
use crate::visible;
use fdm_results::documents::LogDocument;

/// Numbers of clocks, short and without noise of their own.
fn clock(value: Option<f64>) -> String {
    value.map_or_else(String::new, |v| format!("{}", (v * 1e6).round() / 1e6))
}

/// The topics: samples, rate, longest pause, span.
pub fn log_table(log: &LogDocument) -> String {
    let mut table = Rows::over(&log.topics);
    table.words("topic", |t| if t.name.is_empty() { "(table)".into() } else { visible(&t.name) });
    table.number("samples", |t| t.samples);
    table.number("rate [1/s]", |t| t.rate.map_or_else(String::new, |r| format!("{}", (r * 100.0).round() / 100.0)));
    table.number("longest pause [s]", |t| clock(t.longest_pause));
    table.number("from [s]", |t| clock(t.from));
    table.number("to [s]", |t| clock(t.to));
    format!("{}, {} topics\n\n{}", log.format, log.topics.len(), text::table(table))
}

/// Every field with its unit and range.
pub fn log_fields(log: &LogDocument) -> String {
    let number = |v: Option<f64>| v.map_or_else(String::new, |v| format!("{v:.6}"));
    let mut table = Rows::over(log.topics.iter().flat_map(|t| t.fields.iter().map(move |f| (t, f))));
    table.words("field", |(topic, field)| match topic.name.is_empty() {
        true => visible(&field.name).into_owned(),
        false => visible(&format!("{}.{}", topic.name, field.name)).into_owned(),
    });
    table.unit(|(_, f)| f.unit.as_deref().map(|u| visible(u).into_owned()));
    table.number("least", |(_, f)| number(f.least));
    table.number("greatest", |(_, f)| number(f.greatest));
    table.number("no number", |(_, f)| if f.gaps > 0 { f.gaps.to_string() } else { String::new() });
    text::table(table)
}
