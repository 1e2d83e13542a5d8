//! What a log holds: its topics with their clocks, and their fields.

use super::table::{aligned_right, plain, trimmed};
use crate::visible;
use fdm_results::documents::LogDocument;

/// Numbers of clocks, short and without noise of their own.
fn clock(value: Option<f64>) -> String {
    value.map_or_else(String::new, |v| format!("{}", (v * 1e6).round() / 1e6))
}

/// The topics: samples, rate, longest pause, span.
pub fn log_table(log: &LogDocument) -> String {
    let mut table = plain(&["topic", "samples", "rate [1/s]", "longest pause [s]", "from [s]", "to [s]"]);
    for topic in &log.topics {
        let rate = topic.rate.map_or_else(String::new, |r| format!("{}", (r * 100.0).round() / 100.0));
        let name = if topic.name.is_empty() { "(table)".to_string() } else { visible(&topic.name).into_owned() };
        table.add_row([
            name,
            topic.samples.to_string(),
            rate,
            clock(topic.longest_pause),
            clock(topic.from),
            clock(topic.to),
        ]);
    }
    (1..6).for_each(|column| aligned_right(&mut table, column));
    format!("{}, {} topics\n\n{}", log.format, log.topics.len(), trimmed(&table))
}

/// Every field with its unit and range.
pub fn log_fields(log: &LogDocument) -> String {
    let mut table = plain(&["field", "unit", "least", "greatest", "no number"]);
    for topic in &log.topics {
        for field in &topic.fields {
            let path =
                if topic.name.is_empty() { field.name.clone() } else { format!("{}.{}", topic.name, field.name) };
            let number = |v: Option<f64>| v.map_or_else(String::new, |v| format!("{v:.6}"));
            let gaps = if field.gaps > 0 { field.gaps.to_string() } else { String::new() };
            let unit = field.unit.as_deref().map_or_else(String::new, |u| visible(u).into_owned());
            table.add_row([visible(&path).into_owned(), unit, number(field.least), number(field.greatest), gaps]);
        }
    }
    (2..5).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}
