//! Numbers as they stand on the page.

use crate::report::digits;
use serde_json::Value;

/// A number with so many significant digits; a dash where there is none.
pub(super) fn shown(value: &Value, significant: usize) -> String {
    value.as_f64().map_or_else(|| "–".into(), |v| text(v, significant))
}

/// The same for a number that is there.
pub(super) fn text(v: f64, significant: usize) -> String {
    digits(v, significant).replace('-', "\u{2212}")
}

/// A probability; below what a table of the distribution can tell, its bound.
pub(super) fn probability(value: &Value) -> String {
    match value.as_f64() {
        None => "–".into(),
        Some(p) if p < 0.001 => "< 0.001".into(),
        Some(p) => format!("{p:.3}"),
    }
}

/// A unit in brackets behind a name, nothing where there is none.
pub(super) fn bracketed(unit: Option<&str>) -> String {
    unit.filter(|u| !u.is_empty()).map_or(String::new(), |u| format!(" [{u}]"))
}
